# SPDX-License-Identifier: GPL-3.0-or-later
"""A layout that draws nothing and tells what it was asked for."""

import bpy


class Layout:
    """Takes every call of a ``UILayout``; a property or operator that is not there raises.

    ``drawn`` : all labels, in order. With ``folded`` parts that are closed at first stay closed.
    """

    def __init__(self, drawn=None, folded=False):
        self.__dict__["drawn"] = [] if drawn is None else drawn
        self.__dict__["folded"] = folded

    def __setattr__(self, name, value):
        assert name in bpy.types.UILayout.bl_rna.properties, name

    def _inner(self, *_, **__):
        return Layout(self.drawn, self.folded)

    row = column = split = box = _inner

    def panel(self, name, default_closed=False):
        return self, None if default_closed and self.folded else self

    def separator(self):
        self.drawn.append("---")

    def label(self, text="", **_):
        # `draw_lines` wraps sentences; where there is no region, to fewer letters than these.
        assert len(text) < 60, f"Blender cuts it off: {text}"
        self.drawn.append(text)

    def menu(self, name, **_):
        assert hasattr(bpy.types, name)
        self.drawn.append(name)

    def prop(self, owner, name, text=None, **_):
        owner.path_resolve(name)
        self.drawn.append(name if text is None else text)

    def prop_search(self, owner, name, data, collection, text=None, **_):
        owner.path_resolve(name)
        assert hasattr(data, collection)
        self.drawn.append(name if text is None else text)

    def operator(self, name, text=None, **_):
        group, _, function = name.partition(".")
        kind = getattr(getattr(bpy.ops, group), function).get_rna_type()
        self.drawn.append(kind.name if text is None else text)
        return _Operator(kind)


class _Operator:
    def __init__(self, kind):
        self.__dict__["_kind"] = kind

    def __setattr__(self, name, value):
        assert name in self._kind.properties, name


def labels_of(panel, draw="draw", folded=False):
    """What a panel draws, by its labels, in order; ``folded``: see :class:`Layout`."""
    shown = Layout(folded=folded)

    class _Panel:
        layout = shown

    mixins = [c for c in panel.__mro__ if c.__module__ == panel.__module__]
    stand_in = type("_StandIn", (_Panel, *(c for c in mixins if c is not panel)), {})()
    function = getattr(panel, draw)
    function(stand_in, bpy.context)
    return shown.drawn
