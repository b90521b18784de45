# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's method as a vertex shader: every vertex is moved to where it appears.

`BEND` solves Snell's law for one vertex in single precision, in the frame that :mod:`bending`
describes. A fragment shader colours the moved triangles by what the view shows of them, and the
ray shader takes that picture for the ways that are refracted only (`PICTURE`).
"""

from __future__ import annotations

from . import glsl
from .bending import BALL, MOST_LAYERS, SLAB, TUBE

EXIT, HELD = 1.0, 0.5
"""Alpha of what was drawn: seen behind a glass, or held by it. 0: nothing was drawn."""
MOST_DRAWN = 16
"""Glasses of a view, of which each may be drawn by displaced vertices."""

BLOCKS = f"""
struct Bend {{
  mat4 to_clip;     /* a vector from the eye, in the frame of the bending, to clip space */
  mat4 to_common;   /* from that frame to the common one */
  vec4 clip_eye;    /* the eye in clip space */
  vec4 eye;         /* and in the frame */
  vec4 shape;       /* inner radius, ior of the wall; layers, depth of the last interface */
  vec4 layers[{MOST_LAYERS}];   /* thickness, ior */
}};
struct Drawn {{ ivec4 glasses[{MOST_DRAWN}]; }};   /* course, course of contents, slot or -1 */
"""

BEND = f"""
#define SLAB {SLAB}
#define TUBE {TUBE}
#define BALL {BALL}
""" + glsl.source("bend")

VERTEX = (
    BEND
    + """
void main()
{
  vec3 q = (place * vec4(pos, 1.0)).xyz;
  vec3 v = bent(q, miss);
  at = q;
  gl_Position = bend.to_clip * vec4(v, 0.0) + bend.clip_eye;
}
"""
)

COLOUR = (
    glsl.SMOOTH
    + glsl.VIEWS
    + f"""
#define EXIT {EXIT}
#define HELD {HELD}
#define SLAB {SLAB}
#define TUBE {TUBE}
"""
    + glsl.source("displaced_colour")
)

# Rays take the drawn picture for ways that were refracted only, at the interfaces that it is of.
PICTURE = (
    glsl.HOOKS
    + glsl.SMOOTH
    + glsl.FOLLOW
    + """
#define ends ends_by_ray
"""
    + glsl.LOOKUP
    + f"""
#undef ends
#define EXIT {EXIT}
#define HELD {HELD}
#define MOST_DRAWN {MOST_DRAWN}
"""
    + glsl.source("displaced_ways")
    + glsl.MAIN
)
