# SPDX-License-Identifier: GPL-3.0-or-later
"""The shaders of the live picture, put together; :mod:`paint` compiles them when a view is drawn.

Their parts are the files in ``glsl_sources``. What they share with the code that packs their data
is defined here.

`FOLLOW` follows one ray through all glasses, as ``optics.exit_rays`` does; it reads them from the
block that :mod:`description` packs. What is done with a way that leaves is up to the text that
stands before it: `PICTURE` looks its colour up, a test writes its exit ray.
"""

from __future__ import annotations

from pathlib import Path

from ..scene.rays.lamps import BALL, DISC
from .bending import COURSE_BASE, MOST_DIGITS
from .description import (
    CHORD_ROWS,
    CUBIC_ROWS,
    CYLINDER,
    DEEPEST,
    ENDLESS,
    GLASS_ROWS,
    HOLDS,
    HOLLOW,
    INTERFACE_ROWS,
    LID,
    MEDIUM_ROWS,
    MESH,
    PLANE,
    PROFILE,
    ROWS,
    SHELL,
    SIDE,
    SIDE_BUNCH,
    THING_ROWS,
)
from .eye import CAPTURES, LAMP_ROWS, LAMPS, WORLD
from .trees import (
    BITS,
    LEAF,
    NODE_TEXELS,
    PAINT_TEXELS,
    ROW_BITS,
    TRIANGLE_TEXELS,
    UNFOLDED,
)

SOURCES = Path(__file__).parent / "glsl_sources"


def source(*names: str) -> str:
    """Files of `SOURCES`, by their names, one after the other."""
    return "".join((SOURCES / f"{name}.glsl").read_text(encoding="utf-8") for name in names)


BLOCKS = f"""
struct Glasses {{ vec4 rows[{ROWS}]; }};
struct View {{
  mat4 to_clip;      /* common frame to the view's clip space */
  vec4 depth_row;    /* common place to depth along the view, in common units */
  /* (a, b): a pixel is a + b z wide at a depth of z; most light of lamps after one event, after
   * more. */
  vec4 pixel;
  vec4 plane;        /* common place of pixel (0, 0) on a plane across the view */
  vec4 right;        /* and how it moves by a pixel to the right, */
  vec4 up;           /* and up */
  vec4 eye;          /* common place of the eye, w = 1; in a parallel view its direction, w = 0 */
  vec4 size;         /* pixels; depths of the near and of the far plane */
  /* Radius of the ball that holds all glasses; from a capture to a second; longest ray; lamps. */
  vec4 start;
  /* Centre in the common frame; side of a face in pixels, 0: not drawn yet. Last the world's. */
  vec4 captures[{WORLD + 1}];
  /* Of each one's close picture: forward, and 1 if there is one; right; up. */
  vec4 closes[{3 * (WORLD + 1)}];
  /* Of each lamp: from the common frame to its own, three rows; radiance and kind; by what it is
   * multiplied behind glass and mirrored, and its beam. */
  vec4 lamps[{LAMP_ROWS * LAMPS}];
}};
"""

CONSTANTS = f"""
#define GLASS_ROWS {GLASS_ROWS}
#define INTERFACE_ROWS {INTERFACE_ROWS}
#define MEDIUM_ROWS {MEDIUM_ROWS}
#define THING_ROWS {THING_ROWS}
#define CHORD_ROWS {CHORD_ROWS}
#define CUBIC_ROWS {CUBIC_ROWS}
#define CYLINDER {CYLINDER}
#define PLANE {PLANE}
#define LID {LID}
#define SIDE {SIDE}
#define SIDE_BUNCH {SIDE_BUNCH}
#define SHELL {SHELL}
#define PROFILE {PROFILE}
#define MESH {MESH}
#define ENDLESS {ENDLESS}
#define HOLLOW {HOLLOW}
#define COURSE_BASE {COURSE_BASE}
#define LONGEST_COURSE {COURSE_BASE ** (MOST_DIGITS - 1)}
#define HOLDS {HOLDS}
#define DEEPEST {DEEPEST}
#define LEAF {LEAF}
#define NODE_TEXELS {NODE_TEXELS}
#define TRIANGLE_TEXELS {TRIANGLE_TEXELS}
#define PAINT_TEXELS {PAINT_TEXELS}
#define ROW_BITS {ROW_BITS}
#define UNFOLDED {UNFOLDED}
#define GRID {2.0**BITS}
#define HALF_GRID {2.0 ** (BITS // 2)}
"""

HOOKS = source("hooks")

FOLLOW = CONSTANTS + source(
    "limits", "surfaces", "meshes", "interfaces", "media", "normals", "follow"
)

SMOOTH = source("smooth")

EDGE = """
/* Widths of a pixel by which a surface comes nearer from look to look; more is another's edge. */
#define EDGE 12.0
"""

SAME_SURFACE = """
/* Ratio of depths of neighbouring pixels below which one surface goes on. */
#define GOES_ON 1.15
"""

VIEWS = (
    EDGE
    + SAME_SURFACE
    + f"""
#define CAPTURES {CAPTURES}
#define WORLD {WORLD}
"""
    + source("views")
)

LAMPS_LIGHT = f"""
#define LAMP_ROWS {LAMP_ROWS}
#define BALL {BALL}
#define DISC {DISC}
""" + source("lamps")

LOOKUP = VIEWS + LAMPS_LIGHT + source("depths", "march", "seen", "colours")

MAIN = source("main")

PICTURE = HOOKS + SMOOTH + FOLLOW + LOOKUP + MAIN

# For tests: the depth that counts for places between pixels, that of an edge to their left, that of
# a surface that goes on, and the one that counts for places of a capture.
BETWEEN = HOOKS + SMOOTH + FOLLOW + LOOKUP + source("between")

QUAD_VERTEX = """
void main()
{
  gl_Position = vec4(mix(box.xy, box.zw, corner), 0.0, 1.0);
}
"""

# Edges of glasses, whose depths tell where an overlay drew them. `begin`, 0 or 1: all
# that is drawn with 1 lies behind all that is drawn with 0.
WIRES_VERTEX = source("wires_vertex")

WIRES = """
void main() { frag = vec4(2.0 * gl_FragCoord.z - begin); }
"""

# Whether an overlay's line that a glass is drawn by is at a pixel, of which the depth buffer has a
# value. `line`: see `eye.common_line`.
WIRE_AT = source("wire_at")

# Takes off what EEVEE adds to depths: to each by how much it differs from those beside it in its
# block of 2 x 2 pixels (`film_display_depth_amend`; it ends at 1). Ends of things then have depths
# of what lies behind them, and what lies behind them has others that lie farther still. Of near and
# far pixels in a block each arrangement leaves a mark of its own. `amended`: 1 where EEVEE drew.
AMENDED = WIRE_AT + source("amended")

# Puts the picture into the view. part 0: what the view's pixels are multiplied by, 1: what is added
# to them; 2: what the background, which lies in the overlay, is multiplied by, 3: the background
# that is added there where a line was. The overlay also has the lines that the glasses are drawn by
# so that they can be clicked at; where no glass is selected they are taken out. Overlays are added
# by another curve than the scene's colours have: so where a surface stood, the background that is
# seen in the glass goes into the scene.
RESULT = SMOOTH + WIRE_AT + source("result")

# Which pixels of a first sample differ from those beside them, so that more are worth their time.
EDGES = source("edges")

# The samples of a layer of listed pixels, each where it belongs; they are added to what is there.
SUM = source("sum")

# The view's depths in units of the common frame. Overlays write theirs too: whatever is but a few
# pixels wide, as their lines are, gets the depth of what lies on both sides of it.
DEPTH = AMENDED + source("depth")

# The same depths, and the nearest beside a pixel where one lies in front of another; else 0.
STEPS = EDGE + source("steps")

# The nearest and the farthest depth in each tile of the view.
TILES = source("tiles")

# Takes a face of a capture, as the engine drew it, into the atlas of all captures. Where an overlay
# drew lines of glasses, what is beside them stands in.
FACE = AMENDED + SAME_SURFACE + source("face")
