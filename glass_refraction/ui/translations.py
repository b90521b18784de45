# SPDX-License-Identifier: GPL-3.0-or-later
"""Translations of labels, tooltips and messages, by language and context.

Blender looks plain labels and tooltips up by itself. Another language is another entry of
``MESSAGES``; what it leaves out stays English.
"""

from __future__ import annotations

import bpy

_LABEL, _OPERATOR = "*", "Operator"

_GERMAN = {
    _OPERATOR: {
        "Add Refractive Glass": "Lichtbrechendes Glas hinzufügen",
        "Make Refractive Glass": "Zu lichtbrechendem Glas machen",
        "Make Active a Glass": "Aktives Objekt zu Glas machen",
        "Refractive Glass": "Lichtbrechendes Glas",
        "Update Refractive Glass": "Lichtbrechendes Glas aktualisieren",
        "Compare with Cycles": "Mit Cycles vergleichen",
        "Turn Normals Outwards": "Normalen nach außen wenden",
        "Slab": "Platte",
        "Cylinder": "Zylinder",
        "Rod": "Stab",
        "Sphere": "Kugel",
        "Window Pane": "Fensterscheibe",
        "Tumbler": "Trinkglas",
        "Glass of Water": "Glas Wasser",
        "Glass Rod": "Glasstab",
        "Crystal Ball": "Glaskugel",
        "Fish Bowl": "Goldfischglas",
        "Aquarium Wall": "Aquariumwand",
        "Add Refractive Glass Asset Library": "Asset-Bibliothek hinzufügen",
        "Remove Refractive Glass Asset Library": "Asset-Bibliothek entfernen",
    },
    _LABEL: {
        "Refractive Glass": "Lichtbrechendes Glas",
        "Glass": "Glas",
        "Add Glass": "Glas hinzufügen",
        "Shape": "Form",
        "Radius": "Radius",
        "Wall Thickness": "Wandstärke",
        "Height": "Höhe",
        "Bottom Thickness": "Bodenstärke",
        "Liquid Level": "Flüssigkeitsstand",
        "Liquid": "Flüssigkeit",
        "Medium": "Medium",
        "Contents": "Inhalt",
        "Behind": "Dahinter",
        "Seen Through": "Durch das Glas gesehen",
        "The object's flat mesh is the outline": "Das flache Mesh des Objekts ist der Umriss",
        "Mesh": "Mesh",
        "Priority": "Vorrang",
        "The object's own mesh is the glass": "Das Mesh des Objekts selbst ist das Glas",
        "Exact shape: its surfaces are perfectly smooth": "Exakte Form: die Flächen sind "
        "völlig glatt",
        "Open: {} edges have one face. A face's front is outside, as in Cycles": "Offen: {} Kanten "
        "haben eine Fläche. Die Vorderseite einer Fläche ist außen, wie in Cycles",
        "{} edges have more than two faces: what is inside is not clear there": "{} Kanten haben "
        "mehr als zwei Flächen: was innen ist, ist dort nicht klar",
        "Normals disagree along {} edges: a face's front must be outside": "Normalen widersprechen "
        "sich an {} Kanten: die Vorderseite einer Fläche muss außen sein",
        "Inside out: its normals look inwards, where the glass is": "Umgestülpt: die Normalen "
        "zeigen nach innen, wo das Glas ist",
        'Material "{}" is the glass: its IOR and this one follow each other': 'Material „{}" ist '
        "das Glas: seine Brechzahl und diese folgen einander",
        'The first of its glassy materials counts for all of it: "{}"': "Das erste seiner "
        'gläsernen Materialien gilt für alles: „{}"',
        'Faces of "{}" are no glass': 'Flächen aus „{}" sind kein Glas',
        "The modifier is off in renders: switch it on to see through the glass": "Der Modifikator "
        "ist beim Rendern aus: einschalten, um durch das Glas zu sehen",
        "Status": "Status",
        "Nothing computed yet: render a picture": "Noch nichts berechnet: ein Bild rendern",
        "Glass Covers": "Glas bedeckt",
        "{:,} pixels": "{:,} Pixel",
        "Computed in": "Berechnet in",
        "Light Not Seen": "Nicht gesehenes Licht",
        "Light Comes from": "Licht kommt von",
        "{}: {:.0%} of the light, {} samples": "{}: {:.0%} des Lichts, {} Samples",
        "Vertices": "Punkte",
        "Error Bound": "Fehlerschranke",
        "Light Paths in Use": "Verwendete Lichtpfade",
        "refracted {} times": "{}-mal gebrochen",
        "mirrored {} times": "{}-mal gespiegelt",
        "Go to Object Mode first": "Zuerst in den Objektmodus wechseln",
        "Select a mesh object: it becomes the glass (text, curves: Object > Convert)": "Ein "
        "Mesh-Objekt auswählen: es wird zum Glas (Text, Kurven: Objekt > Umwandeln)",
        '"{}" is a refractive glass already': '"{}" ist bereits ein lichtbrechendes Glas',
        '"{}" is linked from a library: make it local first': '"{}" ist aus einer Bibliothek '
        "verknüpft: zuerst lokal machen",
    },
}

MESSAGES = {
    "de_DE": {
        (context, english): german
        for context, messages in _GERMAN.items()
        for english, german in messages.items()
    }
}
"""Language -> (context, English) -> translation, as ``bpy.app.translations`` takes it."""


def register() -> None:
    """Hand the translations to Blender."""
    bpy.app.translations.register(__name__, MESSAGES)


def unregister() -> None:
    """Undo :func:`register`."""
    bpy.app.translations.unregister(__name__)
