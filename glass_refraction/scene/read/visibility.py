# SPDX-License-Identifier: GPL-3.0-or-later
"""Which view layer is rendered, and which objects a render of it shows."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from .animation import may_change


def rendered_layer(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """The view layer that the glass is computed in: the first that renders show."""
    return next((layer for layer in scene.view_layers if layer.use), scene.view_layers[0])


def any_depsgraph(scene: bpy.types.Scene) -> bpy.types.Depsgraph | None:
    """The depsgraph of the view layer that the glass is computed in, or of another one.

    None where Blender has not evaluated the scene: nobody looks at it.
    """
    layers = (rendered_layer(scene), *scene.view_layers)
    return next((layer.depsgraph for layer in layers if layer.depsgraph is not None), None)


def rendered_objects(
    view_layer: bpy.types.ViewLayer, *, ever: bool = False
) -> Iterator[bpy.types.Object]:
    """The view layer's objects that renders show, each once, in the collections' order.

    ``ever``: those too that are hidden now and that another frame may show.
    """
    seen = set()
    for collection in _collections(view_layer.layer_collection, rendered=True):
        for obj in collection.objects:
            hidden = obj.hide_render and not (ever and may_change(obj, "hide_render"))
            if hidden or obj.session_uid in seen:
                continue
            seen.add(obj.session_uid)
            yield obj


def layer_objects(view_layer: bpy.types.ViewLayer) -> set[bpy.types.Object]:
    """The view layer's objects; its own list of them is old until it is evaluated."""
    collections = _collections(view_layer.layer_collection, rendered=False)
    return {obj for collection in collections for obj in collection.objects}


def _collections(layer_collection, *, rendered: bool) -> Iterator[bpy.types.Collection]:
    """The collections that a view layer does not exclude; only those that renders show, or all."""
    if rendered and layer_collection.collection.hide_render:
        return
    if not layer_collection.exclude:
        yield layer_collection.collection
    for child in layer_collection.children:
        yield from _collections(child, rendered=rendered)
