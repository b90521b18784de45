# SPDX-License-Identifier: GPL-3.0-or-later
"""Which objects a lamp or softbox lights, and is mirrored in."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import bpy


def is_mirrored(lamp: bpy.types.Object, glasses: Iterable[str]) -> bool:
    """Whether one of the glasses, by name, shows a lamp: glossy rays see it, and it lights one."""
    return lamp.visible_glossy and lights_any(lamp, glasses)


def lights_any(lamp: bpy.types.Object, names: Iterable[str]) -> bool:
    """Whether a lamp counts any of these objects, by name, among its receivers.

    Without a collection all objects are; with one that includes none, all but the excluded.
    """
    collection = lamp.light_linking.receiver_collection
    if collection is None:
        return True
    states = dict(_states(collection))
    others = "EXCLUDE" if "INCLUDE" in states.values() else "INCLUDE"
    return any(states.get(name, others) == "INCLUDE" for name in names)


def _states(collection: bpy.types.Collection) -> Iterator[tuple[str, str]]:
    """Name and link state of each object. A child collection's holds for all in it, unless the
    object is in the collection itself, which counts last."""
    for child, link in zip(collection.children, collection.collection_children, strict=True):
        for obj in child.all_objects:
            yield obj.name, link.light_linking.link_state
    for obj, link in zip(collection.objects, collection.collection_objects, strict=True):
        yield obj.name, link.light_linking.link_state
