# SPDX-License-Identifier: GPL-3.0-or-later
"""The shaders of the live picture, as text; :mod:`paint` compiles them when a view is drawn.

`FOLLOW` follows one ray through all glasses, as ``optics.exit_rays`` does; it reads them from the
block that :mod:`description` packs. What is done with a way that leaves is up to the text that
stands before it: `PICTURE` looks its colour up, a test writes its exit ray.
"""

from __future__ import annotations

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
    THING_ROWS,
)
from .eye import CAPTURES
from .trees import LEAF, NODE_TEXELS, ROW_BITS, TRIANGLE_TEXELS

BLOCKS = f"""
struct Glasses {{ vec4 rows[{ROWS}]; }};
struct View {{
  mat4 to_clip;      /* common frame to the view's clip space */
  vec4 depth_row;    /* common place to depth along the view, in common units */
  vec4 pixel;        /* (a, b): a pixel is a + b z wide at a depth of z */
  vec4 plane;        /* common place of pixel (0, 0) on a plane across the view */
  vec4 right;        /* and how it moves by a pixel to the right, */
  vec4 up;           /* and up */
  vec4 eye;          /* common place of the eye, w = 1; in a parallel view its direction, w = 0 */
  vec4 size;         /* pixels; depth of the near plane, length of the longest ray */
  vec4 start;        /* radius of the ball that holds all glasses; from a capture to a second */
  /* Centre in the common frame; side of a face in pixels, 0: not drawn yet. */
  vec4 captures[{CAPTURES}];
  /* Of each one's close picture: forward, and 1 if there is one; right; up. */
  vec4 closes[{3 * CAPTURES}];
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
#define ROW_BITS {ROW_BITS}
"""

HOOKS = """
/* What is done with a way: who uses `follow` says it. All places are in the common frame.
 * leave: it left all glasses. lose: no face is met where one should be. covered: whether something
 * stands before the first place of the ray. stopped: whether something ends a stretch before the
 * next face (boxed: which only things can whose boxes reach into glass g). touches: whether a face
 * that may lie on a thing does. `taken`: what the stretch's medium takes of light. */
void leave(vec3 p, vec3 d, vec4 light, int g, int number);
void lose(vec4 light);
bool covered(vec3 p);
bool stopped(vec3 p, vec3 d, vec4 light, int g, vec3 taken, bool boxed, float way, int number);
bool touches(vec3 p, vec3 d, vec4 light, int g, int number);
/* The pixel of the picture that a sample is of. */
ivec2 sampled = ivec2(0);
"""

FOLLOW = (
    CONSTANTS
    + """
#define NOWHERE 1e20
/* How far behind its start, in units of the glass, a ray may still meet an interface, and how far
 * beyond its end a meeting may lie: rounding. */
#define SKIN 2e-6
#define PENDING 8
#define MOST_STRETCHES 120
/* Events of a way for which the least weight holds as it is; longer ways must carry more. */
#define PLAIN 6.0
#define STRONG 0.1
/* Steps of Newton's method from a chord to the curve itself. */
#define NEWTON_STEPS 4
/* Meetings with chords that are tried until one is a meeting with the curve. */
#define CHORD_TRIES 3
/* A course: the interfaces that a way crossed, a digit of base 32 each; -1 for ways that were
 * mirrored, are too long or met another glass. */
#define NO_COURSE -1
/* By how much the square of a miss, in units of the glass, may be one because chords lie beside
 * the curve. */
#define SAG_SLACK 4e-4

/* Of the way that is followed. */
int course = 0;
/* Nodes of a mesh's tree that a ray sees, at most. */
#define MOST_NODES 4000
/* How far beyond its sides a triangle is met: rounding must leave no gap between two. */
#define SEAM 1e-6
/* How far off a mesh's face rays start, in units of the glass: they must not meet faces beside it
 * on the wrong side. */
#define CLEARANCE 4e-6
/* As in optics/facets.py. */
#define BENT_SHARE 0.9
#define BENT_CLEAR 0.01
#define BENT_HALVINGS 12

/* Clamped: NVIDIA's compiler refuses an index that it knows to be out of bounds even where no ray
 * ever comes, such as that of glass -1 behind a test for it. */
vec4 row(int k) { return glasses.rows[max(k, 0)]; }

/* The course after one more interface of glass g, whose row is `met`. */
int crossing(int g, int met)
{
  if (course < 0 || course >= LONGEST_COURSE) {
    return NO_COURSE;
  }
  int number = (met - int(row(1 + GLASS_ROWS * g).x)) / INTERFACE_ROWS;
  return course * COURSE_BASE + min(number, COURSE_BASE - 2) + 1;
}

/* Where a circle or sphere is met (see _meet_round in optics/surfaces.py), NOWHERE if not ahead.
 * `size2`: squared distance of the start from the middle. */
float meet_round(float radius, float size2, float outward, float p2, float square, bool back)
{
  if (square <= 0.0) {
    return NOWHERE;
  }
  float root = sqrt(square);
  float size = sqrt(size2);
  float beyond = (size - radius) * (size + radius);
  float way;
  if (back) {
    float far = root + abs(outward);
    way = outward > 0.0 ? -beyond / max(far, 1e-30) : far / p2;
  }
  else {
    if (outward >= 0.0) {
      return NOWHERE;
    }
    way = beyond / max(root - outward, 1e-30);
  }
  return way >= -SKIN * max(1.0, size) ? max(way, 0.0) : NOWHERE;
}

bool in_outline(int first, int count, vec2 p)
{
  bool inside = false;
  for (int k = 0; k < count; k++) {
    vec4 side = row(first + k);
    if ((side.y <= p.y) != (side.w <= p.y)) {
      if (p.x < side.x + (p.y - side.y) * ((side.z - side.x) / (side.w - side.y))) {
        inside = !inside;
      }
    }
  }
  return inside;
}

/* Radius, height and their derivatives by t. */
vec4 on_curve(int cubics, int count, float t)
{
  int k = clamp(int(floor(t)), 0, count - 1);
  float s = t - float(k);
  vec4 r = row(cubics + CUBIC_ROWS * k);
  vec4 z = row(cubics + CUBIC_ROWS * k + 1);
  return vec4(((r.w * s + r.z) * s + r.y) * s + r.x,
              ((z.w * s + z.z) * s + z.y) * s + z.x,
              (3.0 * r.w * s + 2.0 * r.z) * s + r.y,
              (3.0 * z.w * s + 2.0 * z.z) * s + z.y);
}

/* The nearest chord of a profile that a ray meets after `from`: (way, t of the curve). Chords are
 * taken a little longer than they are, and a little wider than the ray needs to meet them: the
 * curve lies beside them, and `refine` decides. */
vec2 meet_chords(int at, vec3 o, vec3 d, bool back, float from)
{
  vec4 where_ = row(at + 2);
  int bunches = int(where_.y);
  float p2 = dot(d.xy, d.xy);
  float outward = dot(o.xy, d.xy);
  float ell = o.x * d.y - o.y * d.x;
  float ell2 = ell * ell;
  float size2 = dot(o.xy, o.xy);
  float nearest2 = outward < 0.0 ? ell2 / max(p2, 1e-30) : size2;
  vec2 found = vec2(NOWHERE, 0.0);
  for (int b = 0; b < bunches; b++) {
    vec4 box = row(int(where_.x) + 2 * b);
    /* The ray's part within the cylinder round the bunch, and its heights there. */
    float wide2 = box.z * box.z + SAG_SLACK;
    if (nearest2 > wide2) {
      continue;
    }
    float root = sqrt(max(p2 * wide2 - ell2, 0.0));
    float enters = p2 > 1e-12 ? max((-outward - root) / p2, 0.0) : 0.0;
    float leaves = p2 > 1e-12 ? (root - outward) / p2 : 1e6;
    float one = o.z + enters * d.z;
    float two = o.z + leaves * d.z;
    if (leaves < from || enters > found.x || min(one, two) > box.y + SAG_SLACK ||
        max(one, two) < box.x - SAG_SLACK) {
      continue;
    }
    int count = int(row(int(where_.x) + 2 * b + 1).x);
    for (int c = 0; c < count; c++) {
      int chord = int(box.w) + CHORD_ROWS * c;
      vec4 f = row(chord);
      float r0 = f.x, z0 = f.y, dr = f.z, dz = f.w;
      float rise = r0 * dz + dr * (o.z - z0);
      float slope = dr * d.z;
      vec2 side = rise * d.xy - slope * o.xy;
      float square = dot(side, side) - dz * dz * ell2;
      if (square < -SAG_SLACK) {
        continue;
      }
      float a = dz * dz * p2 - slope * slope;
      float h = dz * dz * outward - slope * rise;
      float k = dz * dz * size2 - rise * rise;
      bool touches_ = square <= 0.0;
      float root2 = abs(dz) * sqrt(max(square, 0.0));
      float q = -(h + (h < 0.0 ? -root2 : root2));
      vec4 s = row(chord + 1);
      for (int n = 0; n < 2; n++) {
        float below = n == 0 ? a : q;
        float way = (n == 0 ? q : k) / (below == 0.0 ? 1e-30 : below);
        if (way >= found.x || way < from) {
          continue;
        }
        vec3 p = o + way * d;
        float size = length(p.xy);
        float along = (size - r0) * dr + (p.z - z0) * dz;
        float across = (size - r0) * dz - (p.z - z0) * dr;
        float towards = dz * dot(p.xy, d.xy) - dr * d.z * size;
        if (along < -0.05 * s.z || along > 1.05 * s.z || abs(across) > 1e-3 ||
            (!touches_ && (back ? towards <= 0.0 : towards >= 0.0))) {
          continue;
        }
        found = vec2(way, s.x + s.y * clamp(along / s.z, 0.0, 1.0));
      }
    }
  }
  return found;
}

/* The same on the curve itself, by Newton's method; false where it finds none there. */
bool refine(int at, vec3 o, vec3 d, bool back, inout float way, inout float t)
{
  vec4 where_ = row(at + 2);
  int ends = int(row(at + 1).w);
  int cubics = int(where_.z), count = int(where_.w);
  /* Distances grow with the start's: begin near the meeting. */
  vec3 near = o + way * d;
  float moved = 0.0;
  float p2 = dot(d.xy, d.xy);
  float outward = dot(near.xy, d.xy);
  float size2 = dot(near.xy, near.xy);
  vec4 c;
  for (int n = 0; n < NEWTON_STEPS; n++) {
    c = on_curve(cubics, count, t);
    float off = (p2 * moved + 2.0 * outward) * moved + size2 - c.x * c.x;
    float rise = near.z + moved * d.z - c.y;
    float w = 2.0 * (outward + moved * p2);
    float rr = 2.0 * c.x * c.z;
    float determinant = rr * d.z - w * c.w;
    float inverse = 1.0 / (determinant == 0.0 ? 1e-30 : determinant);
    moved += clamp((c.w * off - rr * rise) * inverse, -2.0, 2.0);
    t += clamp((d.z * off - w * rise) * inverse, -0.7, 0.7);
    if ((ends & 1) != 0) {
      t = abs(t);
    }
    if ((ends & 2) != 0 && t > float(count)) {
      t = 2.0 * float(count) - t;
    }
    t = clamp(t, -0.5, float(count) + 0.5);
  }
  c = on_curve(cubics, count, t);
  vec3 p = near + moved * d;
  float size = length(p.xy);
  way += moved;
  float towards = c.w * dot(p.xy, d.xy) - c.z * d.z * size;
  bool rests = abs(size - c.x) + abs(p.z - c.y) < 2e-5 * (1.0 + abs(way));
  return rests && t >= -1e-4 && t <= float(count) + 1e-4 && way >= -1e-5 &&
         (back ? towards > 0.0 : towards < 0.0);
}

#ifdef MESHES
vec4 texel(int k)
{
  return texelFetch(mesh_tx, ivec2(k & ((1 << ROW_BITS) - 1), k >> ROW_BITS), 0);
}

/* Where a ray enters a box, NOWHERE if not within its reach. `inverse`: of its direction. */
float meet_box(vec3 low, vec3 high, vec3 o, vec3 inverse, float reach)
{
  vec3 one = (low - o) * inverse, two = (high - o) * inverse;
  vec3 near = min(one, two), far = max(one, two);
  float enter = max(max(near.x, near.y), max(near.z, 0.0));
  return enter <= min(min(far.x, far.y), min(far.z, reach)) ? enter : NOWHERE;
}

/* The nearest triangle of a mesh but `skip`: (its texel, shares of the second and third corner).
 * (T. Möller and B. Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997.) The tree is
 * walked without a stack: a bit a level tells whether the node beside is still to be seen. */
vec3 meet_mesh(vec4 tree, vec3 o, vec3 d, float reach, int skip, inout float way)
{
  int nodes = int(tree.x), leaves = int(tree.y), first = int(tree.z);
  vec3 inverse = 1.0 / mix(d, vec3(1e-12), lessThan(abs(d), vec3(1e-12)));
  vec3 found = vec3(-1.0, 0.0, 0.0);
  float nearest = reach;
  int node = 1, waits = 0;
  for (int guard = 0; guard < MOST_NODES; guard++) {
    if (node >= leaves) {
      for (int k = 0; k < LEAF; k++) {
        int at = first + TRIANGLE_TEXELS * ((node - leaves) * LEAF + k);
        vec3 e1 = texel(at + 1).xyz, e2 = texel(at + 2).xyz;
        vec3 h = cross(d, e2);
        float determinant = dot(e1, h);
        if (determinant == 0.0 || at == skip) {
          continue;
        }
        float scale = 1.0 / determinant;
        vec3 s = o - texel(at).xyz;
        float u = scale * dot(s, h);
        vec3 q = cross(s, e1);
        float v = scale * dot(d, q);
        float t = scale * dot(e2, q);
        if (u >= -SEAM && v >= -SEAM && u + v <= 1.0 + SEAM && t >= 0.0 && t < nearest) {
          nearest = t;
          found = vec3(float(at), u, v);
        }
      }
    }
    else {
      int at = nodes + NODE_TEXELS * node;
      vec4 a = texel(at), b = texel(at + 1), c = texel(at + 2);
      float one = meet_box(a.xyz, vec3(a.w, b.xy), o, inverse, nearest);
      float two = meet_box(vec3(b.zw, c.x), c.yzw, o, inverse, nearest);
      if (min(one, two) < NOWHERE) {
        node = 2 * node + (two < one ? 1 : 0);
        waits = 2 * waits + (max(one, two) < NOWHERE ? 1 : 0);
        continue;
      }
    }
    while (waits != 0 && (waits & 1) == 0) {
      waits >>= 1;
      node >>= 1;
    }
    if (waits == 0) {
      break;
    }
    waits ^= 1;
    node ^= 1;
  }
  if (found.x >= 0.0) {
    way = nearest;
  }
  return found;
}
#endif

/* The next interface of glass g that a ray (in the glass's frame, unit direction) meets in medium
 * m: its row, -1 for none; how far; and of profiles and meshes where on it. */
int next_interface(int g, int m, vec3 o, vec3 d, float reach, int skip, out float way,
                   out vec3 spot)
{
  vec4 record = row(1 + GLASS_ROWS * g);
  int first = int(record.x), count = int(record.y);
  int met = -1;
  way = reach;
  spot = vec3(0.0);
#ifdef MESHES
  if (int(row(first).x) == MESH) {
    spot = meet_mesh(row(first + 1), o, d, reach, skip, way);
    return spot.x < 0.0 ? -1 : first;
  }
#endif
  float p2 = dot(d.xy, d.xy);
  float outward = dot(o.xy, d.xy);
  float ell = o.x * d.y - o.y * d.x;
  float size2 = dot(o.xy, o.xy);
  vec2 middle = row(2 + GLASS_ROWS * g).xy;
  bool sides = false;
  for (int k = 0; k < count; k++) {
    int at = first + INTERFACE_ROWS * k;
    vec4 face = row(at);
    bool back = m == int(face.z);
    if (!back && m != int(face.y)) {
      continue;
    }
    vec4 s = row(at + 1);
    int kind = int(face.x);
    float t = NOWHERE;
    float mark = 0.0;
    if (kind == CYLINDER) {
      t = meet_round(s.x, size2, outward, max(p2, 1e-30), p2 * s.x * s.x - ell * ell, back);
      float z = o.z + t * d.z;
      if (t < way && !((s.w > 0.5 ? z > s.y : z >= s.y) && z <= s.z)) {
        t = NOWHERE;
      }
    }
    else if (kind == PLANE || kind == LID) {
      if (back ? d.z > 0.0 : d.z < 0.0) {
        t = (s.x - o.z) / d.z;
        t = t >= -SKIN * max(1.0, abs(o.z)) ? max(t, 0.0) : NOWHERE;
      }
      if (t < way) {
        vec2 p = o.xy + t * d.xy;
        if (kind == PLANE) {
          float r = length(p);
          t = r >= s.y && r <= s.z ? t : NOWHERE;
        }
        else {
          p -= middle;
          if (dot(p, p) >= s.w && !in_outline(int(s.y), int(s.z), p + middle)) {
            t = NOWHERE;
          }
        }
      }
    }
    else if (kind == SIDE) {
      if (!sides) {
        /* All that follow are sides. Within a circle that lies in the outline none is met. */
        sides = true;
        vec2 begin = o.xy - middle, end = begin + way * d.xy;
        if (met >= 0 && max(dot(begin, begin), dot(end, end)) < row(met + 1).w) {
          break;
        }
      }
      float away = d.x * s.w - d.y * s.z;
      if (back ? away > 0.0 : away < 0.0) {
        t = ((s.x - o.x) * s.w - (s.y - o.y) * s.z) / away;
        t = t >= -SKIN * max(1.0, length(o.xy)) ? max(t, 0.0) : NOWHERE;
      }
      if (t < way) {
        vec4 limits = row(at + 2);
        vec3 p = o + t * d;
        float along = dot(p.xy - s.xy, s.zw);
        if (along < -SKIN || along > limits.x + SKIN || p.z < limits.y - SKIN ||
            p.z > limits.z + SKIN) {
          t = NOWHERE;
        }
      }
    }
    else if (kind == SHELL) {
      vec3 turn = cross(o, d);
      t = meet_round(s.x, dot(o, o), dot(o, d), 1.0, s.x * s.x - dot(turn, turn), back);
    }
    else {
      float from = -SKIN;
      for (int n = 0; n < CHORD_TRIES; n++) {
        vec2 found = meet_chords(at, o, d, back, from);
        if (found.x >= way + 1e-3) {
          break;
        }
        float exact = found.x;
        mark = found.y;
        if (refine(at, o, d, back, exact, mark)) {
          float z = o.z + exact * d.z;
          if ((s.z > 0.5 ? z > s.x : z >= s.x) && z <= s.y) {
            t = max(exact, 0.0);
            break;
          }
        }
        from = found.x + 1e-4;
      }
    }
    if (t < way) {
      way = t;
      met = at;
      spot.x = mark;
    }
  }
  return met;
}

/* Unit normal towards the front of a closed form's interface at a place, which is put onto it. */
vec3 closed_normal(int at, float spot, inout vec3 p)
{
  vec4 face = row(at), s = row(at + 1);
  int kind = int(face.x);
  if (kind == CYLINDER) {
    vec2 n = normalize(p.xy);
    p.xy = s.x * n;
    return vec3(n, 0.0);
  }
  if (kind == PLANE || kind == LID) {
    p.z = s.x;
    return vec3(0.0, 0.0, 1.0);
  }
  if (kind == SIDE) {
    return vec3(s.w, -s.z, 0.0);
  }
  if (kind == SHELL) {
    vec3 n = normalize(p);
    p = s.x * n;
    return n;
  }
  vec4 where_ = row(at + 2);
  vec4 c = on_curve(int(where_.z), int(where_.w), spot);
  float size = length(p.xy);
  vec2 axis = size > 1e-12 ? p.xy / size : vec2(1.0, 0.0);
  vec2 n = vec2(c.w, -c.z) / max(length(c.zw), 1e-20);
  p = vec3(c.x * axis, c.y);
  return vec3(n.x * axis, n.y);
}

/* Unit normal towards the front of an interface at a place, which is put onto it. `flat_`: the
 * surface's own, which that of a smooth mesh differs from. */
vec3 normal_at(int at, vec3 spot, inout vec3 p, out vec3 flat_)
{
#ifdef MESHES
  if (int(row(at).x) == MESH) {
    int k = int(spot.x);
    vec3 e1 = texel(k + 1).xyz, e2 = texel(k + 2).xyz;
    p = texel(k).xyz + spot.y * e1 + spot.z * e2;
    flat_ = normalize(cross(e1, e2));
    vec3 n = (1.0 - spot.y - spot.z) * texel(k + 3).xyz + spot.y * texel(k + 4).xyz +
             spot.z * texel(k + 5).xyz;
    return dot(n, n) > 0.0 ? normalize(n) : flat_;
  }
#endif
  flat_ = closed_normal(at, spot.x, p);
  return flat_;
}
/* Reflectance for unpolarised light; `cosine` before the interface, `behind` after it. */
float fresnel(float cosine, float eta, out float behind)
{
  float square = (1.0 - eta) * (1.0 + eta) + eta * cosine * eta * cosine;
  behind = sqrt(max(square, 0.0));
  if (square <= 0.0 || cosine <= 0.0) {
    return 1.0;
  }
  float across = (eta * cosine - behind) / (eta * cosine + behind);
  float along = (cosine - eta * behind) / (cosine + eta * behind);
  return 0.5 * (across * across + along * along);
}

vec3 to_glass(int g, vec3 p)
{
  int r = 1 + GLASS_ROWS * g;
  vec4 h = vec4(p, 1.0);
  return vec3(dot(row(r + 2), h), dot(row(r + 3), h), dot(row(r + 4), h));
}

vec3 to_common(int g, vec3 p)
{
  int r = 1 + GLASS_ROWS * g;
  vec4 h = vec4(p, 1.0);
  return vec3(dot(row(r + 5), h), dot(row(r + 6), h), dot(row(r + 7), h));
}

/* Directions stay unit: the frames differ by a rotation and a scale. */
vec3 turn_in(int g, vec3 d)
{
  int r = 1 + GLASS_ROWS * g;
  vec3 turned = vec3(dot(row(r + 2).xyz, d), dot(row(r + 3).xyz, d), dot(row(r + 4).xyz, d));
  return row(r + 8).x * turned;
}

vec3 turn_out(int g, vec3 d)
{
  int r = 1 + GLASS_ROWS * g;
  vec3 turned = vec3(dot(row(r + 5).xyz, d), dot(row(r + 6).xyz, d), dot(row(r + 7).xyz, d));
  return turned / row(r + 8).x;
}

vec4 medium_row(int g, int m) { return row(int(row(1 + GLASS_ROWS * g).z) + MEDIUM_ROWS * m); }

/* A place in the frame of one glass in that of another; -1: the common one. */
vec3 moved(int from, int to, vec3 p)
{
  if (from == to) {
    return p;
  }
  p = from < 0 ? p : to_common(from, p);
  return to < 0 ? p : to_glass(to, p);
}

vec3 turned_to(int from, int to, vec3 d)
{
  if (from == to) {
    return d;
  }
  d = from < 0 ? d : turn_out(from, d);
  return to < 0 ? d : turn_in(to, d);
}

/* What a ray is in: glass · 16 + medium, in the order in which it entered them; -1: nothing. */
int medium_in(ivec4 held, int g)
{
  for (int k = 0; k < DEEPEST; k++) {
    if (held[k] >= 0 && (held[k] >> 4) == g) {
      return held[k] & 15;
    }
  }
  return 0;
}

/* The same after the medium of one glass became another one. */
ivec4 with_medium(ivec4 held, int g, int m)
{
  ivec4 found = ivec4(-1);
  int count = 0;
  bool known = false;
  for (int k = 0; k < DEEPEST; k++) {
    bool own = held[k] >= 0 && (held[k] >> 4) == g;
    if (held[k] < 0 || (own && m == 0)) {
      continue;
    }
    found[count] = own ? 16 * g + m : held[k];
    known = known || own;
    count++;
  }
  if (!known && m > 0 && count < DEEPEST) {
    found[count] = 16 * g + m;
  }
  return found;
}

/* Which of them holds (see `Media` in optics/placed.py): the one of the highest priority, of equal
 * ones that which was entered first; -1: none. */
int holding(ivec4 held)
{
  int best = -1;
  float most = 0.0;
  for (int k = 0; k < DEEPEST; k++) {
    if (held[k] < 0) {
      continue;
    }
    int g = held[k] >> 4;
    float priority = row(10 + GLASS_ROWS * g).x;
    if ((int(medium_row(g, held[k] & 15).y) & HOLDS) != 0 && (best < 0 || priority > most)) {
      best = held[k];
      most = priority;
    }
  }
  return best;
}

/* The glass in whose frame a ray is followed: the last one that it entered and is still within. */
int home_of(ivec4 held)
{
  int home = -1;
  for (int k = 0; k < DEEPEST; k++) {
    if (held[k] >= 0 && (int(medium_row(held[k] >> 4, held[k] & 15).y) & ENDLESS) == 0) {
      home = held[k] >> 4;
    }
  }
  return home;
}

/* The glasses that rays start in: without those that end where the rays begin outside of all. */
ivec4 starting(bool within)
{
  ivec4 held = ivec4(-1);
  int count = int(row(0).x);
  for (int k = 0; k < count; k++) {
    int m = int(row(9 + GLASS_ROWS * k).z);
    if (m > 0 && (within || (int(medium_row(k, m).y) & ENDLESS) != 0)) {
      held = with_medium(held, k, m);
    }
  }
  return held;
}

float ior_of(int holder)
{
  return holder < 0 ? row(0).y : medium_row(holder >> 4, holder & 15).x;
}

#ifdef MESHES
/* An interpolated normal off which no ray is reflected into the face (see `bent` in
 * optics/facets.py). */
bool is_right(vec3 n, vec3 flat_, vec3 d, float least)
{
  return dot(n, d) < 0.0 && dot(reflect(d, n), flat_) >= least;
}

vec3 bent(vec3 n, vec3 flat_, vec3 d)
{
  float least = min(-BENT_SHARE * dot(flat_, d), BENT_CLEAR);
  if (n == flat_ || is_right(n, flat_, d, least)) {
    return n;
  }
  float low = 0.0, high = 1.0;
  for (int k = 0; k < BENT_HALVINGS; k++) {
    float middle = 0.5 * (low + high);
    if (is_right(normalize(mix(n, flat_, middle)), flat_, d, least)) {
      high = middle;
    }
    else {
      low = middle;
    }
  }
  return normalize(mix(n, flat_, high));
}
#endif

/* Follows one ray (common frame, unit direction) through all glasses, the strongest ways first.
 *
 * start: what it starts in, see `medium_in`. least: light below this part is not followed.
 * most: ways after which to stop. splits: false if surfaces only refract, and take no light.
 * Returns how far the ray goes to the first interface, NOWHERE if it meets none. */
float follow(vec3 place, vec3 along, ivec4 start, float least, int most, bool splits)
{
  vec3 places[PENDING];
  vec3 alongs[PENDING];
  vec4 lights[PENDING];
  ivec4 helds[PENDING];
  ivec4 states[PENDING];
  int pending = 0;
  vec4 light = vec4(1.0);
  ivec4 held = start;
  int home = home_of(held);
  /* p and d are in the frame of the glass `home`, of none in the common one. */
  vec3 p = home < 0 ? place : to_glass(home, place);
  vec3 d = home < 0 ? along : turn_in(home, along);
  int last = home, events = 0, ways = 0, skip = -1;
  course = home < 0 ? 0 : NO_COURSE;
  float first_way = NOWHERE;
  bool alive = true, begun = false;
  int glasses_ = int(row(0).x);
  for (int guard = 0; guard < MOST_STRETCHES; guard++) {
    if (!alive) {
      if (pending == 0 || ways >= most) {
        break;
      }
      int best = 0;
      for (int k = 1; k < pending; k++) {
        if (lights[k].w > lights[best].w) {
          best = k;
        }
      }
      pending--;
      p = places[best]; d = alongs[best]; light = lights[best]; held = helds[best];
      last = states[best].x; events = states[best].y; skip = states[best].z;
      course = states[best].w;
      places[best] = places[pending]; alongs[best] = alongs[pending];
      lights[best] = lights[pending]; states[best] = states[pending];
      helds[best] = helds[pending];
      home = home_of(held);
      alive = true;
    }
    vec3 from = home < 0 ? p : to_common(home, p);
    vec3 toward = home < 0 ? d : turn_out(home, d);
    /* Of the nearest interface: way in the common frame, row, glass, where on it. */
    float way = NOWHERE;
    vec3 spot = vec3(0.0);
    int met = -1, hit = last;
    for (int number = 0; number < glasses_; number++) {
      /* Its own glass first: what lies behind the face that is met there need not be looked at. */
      int k = number <= home ? (number == 0 ? home : number - 1) : number;
      bool own = k == home;
      vec3 q = own ? p : to_glass(k, from), v = own ? d : turn_in(k, toward);
      float size = row(9 + GLASS_ROWS * k).x;
      float enter = 0.0;
      if (!own) {
        /* From where it enters the glass's box: numbers stay small there. */
        vec3 away = row(2 + GLASS_ROWS * k).xyz - q, half_ = row(11 + GLASS_ROWS * k).xyz;
        vec3 inverse = 1.0 / mix(v, vec3(1e-12), lessThan(abs(v), vec3(1e-12)));
        vec3 middle = away * inverse, room = half_ * abs(inverse);
        vec3 enters = middle - room, leaves = middle + room;
        enter = max(max(enters.x, enters.y), max(enters.z, 0.0));
        if (enter > min(min(leaves.x, leaves.y), leaves.z) || enter * size > way) {
          continue;
        }
      }
      float t;
      vec3 mark;
      /* No farther than NOWHERE: that is the way to a face that is not met. */
      float near = min(way / size - enter, NOWHERE);
      int found = next_interface(k, medium_in(held, k), q + enter * v, v, near, skip, t, mark);
      if (found >= 0) {
        way = (t + enter) * size;
        spot = mark;
        met = found;
        hit = k;
      }
    }
    if (!begun) {
      begun = true;
      first_way = way;
      if (met < 0 || covered(place + first_way * along)) {
        return NOWHERE;
      }
    }
    vec3 n = vec3(0.0), flat_ = vec3(0.0), here = p;
    int beyond = 0;
    bool is_mesh = false;
    if (met >= 0) {
      vec3 v = d;
      if (hit != home) {
        here = to_glass(hit, from);
        v = turn_in(hit, toward);
      }
      here += way / row(9 + GLASS_ROWS * hit).x * v;
      n = normal_at(met, spot, here, flat_);
      vec4 face = row(met);
      is_mesh = int(face.x) == MESH;
      bool back = medium_in(held, hit) == int(face.z);
      if (is_mesh) {
        /* The side of a face tells what the ray was in. */
        back = dot(flat_, v) > 0.0;
        held = with_medium(held, hit, back ? 1 : 0);
      }
      beyond = back ? int(face.y) : int(face.z);
      n = back ? -n : n;
      flat_ = back ? -flat_ : flat_;
      d = v;
    }
    int holder = holding(held);
    vec3 taken = vec3(0.0);
    if (holder >= 0) {
      int g = holder >> 4;
      taken = row(int(row(1 + GLASS_ROWS * g).z) + MEDIUM_ROWS * (holder & 15) + 1).xyz /
              row(9 + GLASS_ROWS * g).x;
    }
    if (met < 0) {
      /* A closed form has a face wherever a ray in it goes. */
      if (home < 0 || int(row(int(row(1 + GLASS_ROWS * home).x)).x) == MESH) {
        leave(from, toward, light, last, ways);
        ways++;
      }
      else {
        lose(light);
      }
      alive = false;
      continue;
    }
    bool may_stop = events > 0 &&
                    (home < 0 || (int(medium_row(home, medium_in(held, home)).y) & HOLLOW) != 0);
    if (may_stop && stopped(from, toward, light, home < 0 ? last : home, taken,
                            home >= 0 || hit == last, way, ways)) {
      ways++;
      alive = false;
      continue;
    }
    light.rgb *= exp(-taken * way);
    if (row(met).w > 0.5 && events > 0 &&
        touches(to_common(hit, here), toward, light, hit, ways)) {
      ways++;
      alive = false;
      continue;
    }
    ivec4 after = with_medium(held, hit, beyond);
    int holder_after = holding(after);
    if ((events > 0 && hit != last) || holder == holder_after) {
      course = NO_COURSE;
    }
    last = hit;
    skip = is_mesh ? int(spot.x) : -1;
    vec3 clear = is_mesh ? CLEARANCE * flat_ : vec3(0.0);
    if (holder == holder_after) {
      /* What holds stays the same: the ray goes straight on. */
      held = after;
      home = home_of(held);
      p = here - clear;
    }
    else {
      float eta = ior_of(holder) / ior_of(holder_after);
#ifdef MESHES
      if (is_mesh) {
        n = bent(n, flat_, d);
      }
#endif
      float cosine = clamp(-dot(n, d), 0.0, 1.0), behind;
      float mirrored = fresnel(cosine, eta, behind);
      bool total = mirrored >= 1.0;
      if (!splits) {
        mirrored = 0.0;
        if (total) {
          lose(light);
          alive = false;
          continue;
        }
      }
      events++;
      float enough = min(least * max(1.0, float(events) / PLAIN), max(least, STRONG));
      enough = splits ? enough : 0.0;
      vec4 other = light * vec4(1.0, 1.0, 1.0, mirrored);
      light.w *= 1.0 - mirrored;
      if (is_mesh) {
        light.rgb *= row(met + 2).rgb;
        other.rgb *= row(10 + GLASS_ROWS * hit).yzw;
      }
      vec3 turned = d + 2.0 * cosine * n;
      d = normalize(eta * d + (eta * cosine - behind) * n);
      p = here - clear;
#ifdef MESHES
      if (is_mesh && dot(d, flat_) >= 0.0 && light.w > enough) {
        /* Refracted to before the face: black, as in Cycles. */
        leave(to_common(hit, p), turn_out(hit, d), vec4(vec3(0.0), light.w), hit, ways);
        ways++;
        light.w = 0.0;
      }
#endif
      vec3 second_place = here + clear;
      vec3 second = turned;
      vec4 rest = other;
      ivec4 second_held = held;
      int crossed = crossing(hit, met), second_course = NO_COURSE;
      if (other.w > light.w) {
        second_course = crossed;
        course = NO_COURSE;
        second_place = p; second = d; rest = light; second_held = after;
        p = here + clear; d = turned; light = other;
      }
      else {
        held = after;
        course = crossed;
      }
      home = home_of(held);
      if (rest.w > enough) {
        int slot = pending;
        if (pending == PENDING) {
          slot = 0;
          for (int k = 1; k < PENDING; k++) {
            if (lights[k].w < lights[slot].w) {
              slot = k;
            }
          }
          if (lights[slot].w > rest.w) {
            slot = -1;
          }
        }
        else {
          pending++;
        }
        if (slot >= 0) {
          int second_home = home_of(second_held);
          places[slot] = moved(hit, second_home, second_place);
          alongs[slot] = turned_to(hit, second_home, second);
          lights[slot] = rest;
          helds[slot] = second_held;
          states[slot] = ivec4(hit, events, skip, second_course);
        }
      }
      alive = light.w > enough;
    }
    p = moved(hit, home, p);
    d = turned_to(hit, home, d);
  }
  return first_way;
}
"""
)

SMOOTH = """
/* Smoothed by hand: Blender 5.0 has no filter for the textures that Python makes. */
vec4 smooth_at(sampler2D tx, vec2 pixel)
{
  ivec2 last = textureSize(tx, 0) - 1;
  vec2 low = floor(pixel - 0.5);
  vec2 t = pixel - 0.5 - low;
  ivec2 a = clamp(ivec2(low), ivec2(0), last);
  ivec2 b = clamp(ivec2(low) + 1, ivec2(0), last);
  vec4 below = mix(texelFetch(tx, a, 0), texelFetch(tx, ivec2(b.x, a.y), 0), t.x);
  vec4 above = mix(texelFetch(tx, ivec2(a.x, b.y), 0), texelFetch(tx, b, 0), t.x);
  return mix(below, above, t.y);
}
"""

EDGE = """
/* Widths of a pixel by which a surface comes nearer from look to look; more is another's edge. */
#define EDGE 12.0
"""

VIEWS = (
    EDGE
    + f"""
#define CAPTURES {CAPTURES}
"""
    + """
#define FAR_OFF 1e19
#define TILE 8
#define CLOSE 6.0
/* Pixels from look to look where a tile does not tell. */
#define STRIDE 2.0
#define DIRECT_STEPS 80
/* Half the side of a box of things, with some room. */
#define BOX_MARGIN 1.02
#define CAPTURE_STEPS 32
/* Angle between steps, in pixels of a face (which is two wide at a distance of one). */
#define CAPTURE_STRIDE 5.0
#define HALVINGS 6
/* Ratio of depths of neighbouring pixels below which one surface goes on. */
#define GOES_ON 1.15
/* How far behind a thing's edge a ray still meets it, in common units: pixels do not tell where
 * exactly the edge is. */
#define SLACK 0.05
/* The same for surfaces in captures. */
#define THIN 0.03
/* The same as part of the distance: what a pixel of a capture cannot tell. */
#define THICK_PART 0.01
#define UNKNOWN -1e18
/* Of sqrt(s) / (sqrt(s + 1) - sqrt(s)) the value for s = 1: no edge is farther off. */
#define LIMB_MOST 2.42
/* Where a thing is nearer to a face than this, in common units, it touches it. */
#define TOUCHING 0.03
/* How much nearer than the glass a thing must be to cover it, in common units. */
#define NEARER 0.004

/* By how much depths differ at an edge, at a depth of z. */
float edge_at(float z) { return EDGE * (view.pixel.x + view.pixel.y * z); }

float depth_at(ivec2 pixel)
{
  ivec2 last = ivec2(view.size.xy) - 1;
  return texelFetch(depth_tx, clamp(pixel, ivec2(0), last), 0).r;
}

vec4 direct_at(vec2 pixel) { return smooth_at(direct_tx, pixel); }

/* Clamped as `row` is. */
vec4 capture_at(int slot) { return view.captures[clamp(slot, 0, CAPTURES - 1)]; }

/* Which face of a capture shows a direction, and which pixel of it: (x, y, face); the last one is
 * its close picture. `depth`: of d along the face's axis. */
vec3 face_of(int slot, vec3 d, out float depth)
{
  int close = 3 * clamp(slot, 0, CAPTURES - 1);
  vec4 forward = view.closes[close];
  float side = capture_at(slot).w;
  if (forward.w > 0.0) {
    depth = dot(d, forward.xyz);
    vec2 at = vec2(dot(d, view.closes[close + 1].xyz), dot(d, view.closes[close + 2].xyz));
    if (max(abs(at.x), abs(at.y)) < (1.0 - 1.0 / side) * depth) {
      return vec3((0.5 * at / depth + 0.5) * side, CLOSE);
    }
  }
  vec3 a = abs(d);
  bool is_x = a.x >= a.y && a.x >= a.z;
  bool is_y = !is_x && a.y >= a.z;
  vec3 r = is_x ? d.yzx : (is_y ? d.zxy : d);
  depth = abs(r.z);
  float turn = r.z < 0.0 ? -1.0 : 1.0;
  vec2 at = vec2(r.x, -turn * r.y) / abs(r.z);
  float axis = is_x ? 0.0 : (is_y ? 2.0 : 4.0);
  return vec3((0.5 * at + 0.5) * side, turn < 0.0 ? axis + 1.0 : axis);
}

ivec2 atlas_pixel(int slot, vec3 at, vec2 in_face, float side)
{
  ivec2 pixel = clamp(ivec2(in_face), ivec2(0), ivec2(int(side) - 1));
  return pixel + ivec2(int(at.z), slot) * int(side);
}

/* How far a place lies behind what the capture shows in its direction, along the face's axis.
 * Depths of less than 0 and more than FAR_OFF: nothing is there. */
float capture_gap(int slot, vec3 p)
{
  float side = capture_at(slot).w;
  float depth;
  vec3 at = face_of(slot, p, depth);
  float shown = abs(texelFetch(reach_tx, atlas_pixel(slot, at, at.xy, side), 0).r);
  return depth - shown;
}

/* The same, where a surface goes on from pixel to pixel: of a plane 1 / depth is linear there. */
float smooth_gap(int slot, vec3 p)
{
  float side = capture_at(slot).w;
  float depth;
  vec3 at = face_of(slot, p, depth);
  vec2 low = clamp(floor(at.xy - 0.5), vec2(0.0), vec2(side - 2.0));
  vec2 t = clamp(at.xy - 0.5 - low, 0.0, 1.0);
  ivec2 corner = atlas_pixel(slot, at, low, side);
  vec4 near = 1.0 / abs(vec4(texelFetch(reach_tx, corner, 0).r,
                             texelFetch(reach_tx, corner + ivec2(1, 0), 0).r,
                             texelFetch(reach_tx, corner + ivec2(0, 1), 0).r,
                             texelFetch(reach_tx, corner + ivec2(1, 1), 0).r));
  float most = max(max(near.x, near.y), max(near.z, near.w));
  float least_ = min(min(near.x, near.y), min(near.z, near.w));
  vec2 pair = t.x < 0.5 ? near.xz : near.yw;
  float nearest = t.y < 0.5 ? pair.x : pair.y;
  float mixed = mix(mix(near.x, near.y, t.x), mix(near.z, near.w, t.x), t.y);
  float shown = 1.0 / max(most < GOES_ON * least_ ? mixed : nearest, 1e-19);
  return depth - shown;
}

/* The second capture of a glass that has a first one, behind what hides much from that; or -1. */
int second_of(int slot)
{
  int second = slot + int(view.start.y);
  return slot >= 0 && second < CAPTURES && capture_at(second).w > 0.5 ? second : -1;
}

/* Whether a capture sees a place: nothing stands before it, or what stands there. */
bool is_seen(int slot, vec3 p)
{
  if (slot < 0) {
    return false;
  }
  vec3 q = p - capture_at(slot).xyz;
  return smooth_gap(slot, q) < THIN + THICK_PART * length(q);
}

bool is_there(float distance_) { return abs(distance_) < FAR_OFF; }

bool shows_thing(int slot, vec3 d)
{
  float side = capture_at(slot).w;
  float depth;
  vec3 at = face_of(slot, d, depth);
  return is_there(texelFetch(reach_tx, atlas_pixel(slot, at, at.xy, side), 0).r);
}

/* The colour in a direction, smoothed over pixels that are about as far as the nearest one. */
vec4 capture_colour(int slot, vec3 d)
{
  float side = capture_at(slot).w;
  float depth;
  vec3 at = face_of(slot, d, depth);
  vec2 low = clamp(floor(at.xy - 0.5), vec2(0.0), vec2(side - 2.0));
  vec2 t = clamp(at.xy - 0.5 - low, 0.0, 1.0);
  ivec2 corner = atlas_pixel(slot, at, low, side);
  ivec2 middle = corner + ivec2(round(t));
  depth = texelFetch(reach_tx, middle, 0).r;
  vec4 mixed = vec4(0.0);
  for (int k = 0; k < 4; k++) {
    ivec2 step_ = ivec2(k & 1, k >> 1);
    float other = texelFetch(reach_tx, corner + step_, 0).r;
    vec2 part = mix(1.0 - t, t, vec2(step_));
    bool same = is_there(other) == is_there(depth) &&
                (!is_there(other) || abs(other - depth) < 0.1 * depth);
    if (same) {
      mixed += part.x * part.y * vec4(texelFetch(capture_tx, corner + step_, 0).rgb, 1.0);
    }
  }
  vec3 colour = mixed.a > 0.0 ? mixed.rgb / mixed.a : texelFetch(capture_tx, middle, 0).rgb;
  return vec4(colour, depth <= -FAR_OFF ? 0.0 : 1.0);
}
"""
)

LOOKUP = (
    VIEWS
    + """
vec4 sum = vec4(0.0);
float got = 0.0;

/* The part of a ray that the view can show: false if there is none. */
bool in_view(vec4 begin, vec4 step_, float z0, float z1, inout float low, inout float high)
{
  for (int k = 0; k < 5; k++) {
    float f = k == 4 ? z0 - view.size.z : begin.w + (k % 2 == 0 ? 1.0 : -1.0) * begin[k / 2];
    float s = k == 4 ? z1 : step_.w + (k % 2 == 0 ? 1.0 : -1.0) * step_[k / 2];
    if (s > 0.0) {
      low = max(low, -f / s);
    }
    else if (s < 0.0) {
      high = min(high, -f / s);
    }
    else if (f < 0.0) {
      return false;
    }
  }
  return low < high;
}

/* Which of the pixels round a place counts for it, where things end in front of others: those of
 * the nearer and those of the farther ones vote, the more the nearer they lie, so that edges run
 * straight where pixels make them stairs. */
ivec2 pixel_for(vec2 at)
{
  ivec2 last = ivec2(view.size.xy) - 1;
  ivec2 middle = clamp(ivec2(at), ivec2(0), last);
  if (texelFetch(depth_tx, middle, 0).g == 0.0) {
    return middle;
  }
  vec2 f = clamp(at - vec2(middle) - 0.5, -0.5, 0.5);
  /* Shares of a quadratic B-spline: of the pixel before, of this one, of the one after. */
  vec2 shares[3];
  shares[0] = 0.5 * (0.5 - f) * (0.5 - f);
  shares[1] = 0.75 - f * f;
  shares[2] = 0.5 * (0.5 + f) * (0.5 + f);
  float near = FAR_OFF, far = -FAR_OFF;
  for (int k = 0; k < 9; k++) {
    float depth = depth_at(middle + ivec2(k % 3, k / 3) - 1);
    near = min(near, depth);
    far = max(far, depth);
  }
  float limit = near + edge_at(near);
  float votes = 0.0;
  vec2 most = vec2(-1.0);
  ivec2 nearer = middle, farther = middle;
  for (int k = 0; k < 9; k++) {
    ivec2 one = ivec2(k % 3, k / 3);
    ivec2 pixel = clamp(middle + one - 1, ivec2(0), last);
    float share = shares[one.x].x * shares[one.y].y;
    if (depth_at(pixel) < limit) {
      votes += share;
      if (share > most.x) {
        most.x = share;
        nearer = pixel;
      }
    }
    else if (share > most.y) {
      most.y = share;
      farther = pixel;
    }
  }
  return votes > 0.5 ? nearer : farther;
}

float depth_near(vec2 at) { return depth_at(pixel_for(at)); }

/* Depth at a place between pixels. Of a plane 1 / depth is linear, in a parallel view depth is. */
float depth_between(vec2 at)
{
  ivec2 last = ivec2(view.size.xy) - 1;
  if (texelFetch(depth_tx, clamp(ivec2(at), ivec2(0), last), 0).g != 0.0) {
    return depth_near(at);
  }
  ivec2 low = ivec2(floor(at - 0.5));
  vec2 t = at - 0.5 - vec2(low);
  vec4 depths = vec4(depth_at(low), depth_at(low + ivec2(1, 0)), depth_at(low + ivec2(0, 1)),
                     depth_at(low + ivec2(1, 1)));
  bool parallel = view.eye.w < 0.5;
  vec4 part = parallel ? depths : 1.0 / depths;
  float mixed = mix(mix(part.x, part.y, t.x), mix(part.z, part.w, t.x), t.y);
  return parallel ? mixed : 1.0 / mixed;
}

/* The colour at a place, of the thing that counts for it: at edges without the others'. */
vec4 thing_at(vec2 at)
{
  ivec2 pixel = pixel_for(at);
  vec2 shown = texelFetch(depth_tx, pixel, 0).rg;
  if (shown.g == 0.0) {
    return direct_at(at);
  }
  ivec2 last = ivec2(view.size.xy) - 1;
  vec2 low = floor(at - 0.5);
  vec2 t = at - 0.5 - low;
  vec4 mixed = vec4(0.0);
  float whole = 0.0;
  for (int k = 0; k < 4; k++) {
    ivec2 one = ivec2(k & 1, k >> 1);
    ivec2 there = clamp(ivec2(low) + one, ivec2(0), last);
    vec2 part = mix(1.0 - t, t, vec2(one));
    float other = depth_at(there);
    if (abs(other - shown.r) < edge_at(min(other, shown.r))) {
      whole += part.x * part.y;
      mixed += part.x * part.y * texelFetch(direct_tx, there, 0);
    }
  }
  return whole > 0.0 ? mixed / whole : texelFetch(direct_tx, pixel, 0);
}

/* Depth of a round thing's edge, which lies up to a look before a place. From the edge on depths
 * differ from the edge's as a square root grows: three in a row tell where it is. */
float limb_at(vec2 at, vec2 heading)
{
  ivec2 along = abs(heading.x) > abs(heading.y) ? ivec2(heading.x > 0.0 ? 1 : -1, 0)
                                                : ivec2(0, heading.y > 0.0 ? 1 : -1);
  ivec2 pixel = pixel_for(at);
  float one = depth_at(pixel);
  float before = depth_at(pixel - along);
  if (abs(before - one) < edge_at(min(before, one))) {
    one = before;
    pixel -= along;
  }
  float two = depth_at(pixel + along), three = depth_at(pixel + 2 * along);
  float first = one - two, second = three - two;
  float least = edge_at(one);
  if (first <= 0.0 || first > least || abs(second) > least) {
    return one;
  }
  /* (L - z)² grows by as much from pixel to pixel. */
  float bends = first + second;
  float rise = bends > 0.0 ? (first * first + second * second) / (2.0 * bends) - first : NOWHERE;
  return one + clamp(rise, 0.0, LIMB_MOST * first);
}

/* Whether a place lies in the box of a thing that may stand in glass g; -1: who knows. */
bool in_thing(int g, vec3 p)
{
  if (g < 0) {
    return true;
  }
  int first = int(row(9 + GLASS_ROWS * g).w);
  int count = int(row(1 + GLASS_ROWS * g).w);
  for (int k = 0; k < count; k++) {
    int at = first + THING_ROWS * k;
    vec4 h = vec4(p, 1.0);
    vec3 q = abs(vec3(dot(row(at), h), dot(row(at + 1), h), dot(row(at + 2), h)));
    if (max(max(q.x, q.y), q.z) < BOX_MARGIN) {
      return true;
    }
  }
  return false;
}

/* Whether a ray runs through one of some boxes of things within its reach. */
bool meets_boxes(int first, int count, vec3 p, vec3 d, float reach)
{
  for (int k = 0; k < count; k++) {
    int at = first + THING_ROWS * k;
    vec4 h = vec4(p, 1.0);
    vec3 o = vec3(dot(row(at), h), dot(row(at + 1), h), dot(row(at + 2), h));
    vec3 v = vec3(dot(row(at).xyz, d), dot(row(at + 1).xyz, d), dot(row(at + 2).xyz, d));
    v = mix(v, vec3(1e-20), lessThan(abs(v), vec3(1e-20)));
    vec3 one = (-BOX_MARGIN - o) / v;
    vec3 two = (BOX_MARGIN - o) / v;
    vec3 enter = min(one, two), leave_ = max(one, two);
    float low = max(max(enter.x, enter.y), max(enter.z, 0.0));
    float high = min(min(leave_.x, leave_.y), min(leave_.z, reach));
    if (low <= high) {
      return true;
    }
  }
  return false;
}

/* Where a ray meets what the view shows: marched through the view's depths, pixel by pixel, and
 * over whole tiles that it passes in front of or behind. `boxes`: the glass within which it runs,
 * where only its things can be met, or -1. `hidden`: it was behind something. */
bool march_direct(vec3 o, vec3 d, float reach, int slot, int boxes, out vec2 at, out float way,
                  out bool hidden)
{
  hidden = false;
  at = vec2(0.0);
  way = reach;
  vec4 begin = view.to_clip * vec4(o, 1.0);
  vec4 step_ = view.to_clip * vec4(d, 0.0);
  float z0 = dot(view.depth_row, vec4(o, 1.0));
  float z1 = dot(view.depth_row.xyz, d);
  float low = 0.0, high = min(reach, view.size.w);
  if (!in_view(begin, step_, z0, z1, low, high)) {
    hidden = true;
    return false;
  }
  hidden = low > 0.0;
  bool leaves = high < min(reach, view.size.w);
  vec4 one = begin + low * step_;
  vec4 two = begin + high * step_;
  vec2 a = (0.5 * one.xy / one.w + 0.5) * view.size.xy;
  vec2 b = (0.5 * two.xy / two.w + 0.5) * view.size.xy;
  vec2 span = b - a;
  float pixels = max(max(abs(span.x), abs(span.y)), 1e-3);
  float by_pixel = min(1.0 / pixels, 1.0);
  vec2 heading = span / pixels;
  vec2 per = 1.0 / max(abs(span), vec2(1e-6));
  float u = 0.0;
  /* A ray that leaves a glass for the table that it stands on begins on the table. */
  float shown_before = depth_between(a);
  float before = z0 + low * z1 - shown_before;
  float z_before = z0 + low * z1;
  bool behind = before > NEARER;
  /* Depth of the edge that the ray passed behind. */
  float limb = UNKNOWN;
  float u_before = 0.0;
  /* How far the ray lay behind the thing's back. */
  float over_before = 0.0;
  hidden = hidden || behind;
  for (int k = 0; k < DIRECT_STEPS; k++) {
    if (u >= 1.0) {
      hidden = hidden || leaves;
      return false;
    }
    /* Over the whole tile, if all it shows is behind the ray or in front of it. */
    vec2 pixel = a + u * span;
    ivec2 tile = ivec2(pixel) / TILE;
    vec2 room = mix(pixel - vec2(tile * TILE), vec2((tile + 1) * TILE) - pixel,
                    greaterThan(span, vec2(0.0)));
    float next = min(1.0, u + min(room.x * per.x, room.y * per.y) + 0.02 * by_pixel);
    vec2 range = texelFetch(tile_tx, clamp(tile, ivec2(0), textureSize(tile_tx, 0) - 1), 0).rg;
    float t = ((1.0 - next) * low * two.w + next * high * one.w) /
              ((1.0 - next) * two.w + next * one.w);
    float z = z0 + t * z1;
    if (!behind && max(z, z_before) < range.x) {
      u = next;
      u_before = u;
      z_before = z;
      over_before = 0.0;
      shown_before = UNKNOWN;
      continue;
    }
    float back = limb > UNKNOWN ? 2.0 * limb - range.x : UNKNOWN;
    if (behind && min(z, z_before) > max(range.y, back)) {
      u = next;
      u_before = u;
      z_before = z;
      over_before = 0.0;
      shown_before = UNKNOWN;
      continue;
    }
    if (shown_before <= UNKNOWN) {
      shown_before = depth_near(pixel);
      before = z_before - shown_before;
      if (!behind && before > SLACK) {
        /* An edge lies just at the tile's: the ray passes behind it. */
        behind = true;
        hidden = true;
        limb = limb_at(pixel, heading);
      }
      else if (before <= 0.0) {
        behind = false;
      }
    }
    next = min(1.0, u + STRIDE * by_pixel);
    t = ((1.0 - next) * low * two.w + next * high * one.w) /
        ((1.0 - next) * two.w + next * one.w);
    z = z0 + t * z1;
    pixel = a + next * span;
    float shown = depth_near(pixel);
    float gap = z - shown;
    float jump = shown_before - shown;
    bool met = false;
    if (gap <= 0.0) {
      behind = false;
    }
    else if (!behind) {
      /* One surface goes on from pixel to pixel; behind an edge the ray may pass. */
      met = jump < edge_at(shown) + abs(z - z_before);
      behind = !met;
      limb = met ? UNKNOWN : limb_at(pixel, heading);
      over_before = 0.0;
    }
    else if (jump > edge_at(shown)) {
      limb = limb_at(pixel, heading);
      over_before = 0.0;
    }
    else if (jump < -edge_at(shown)) {
      limb = UNKNOWN;
    }
    /* Round things are as thick behind their edge as before it: the back is the front's mirror
     * image. */
    float over = z + shown - 2.0 * limb - SLACK;
    if (behind && limb > UNKNOWN && over < 0.0) {
      vec3 place = o + t * d;
      if (is_seen(slot, place) || is_seen(second_of(slot), place)) {
        /* What is seen from within the glass is not guessed: the capture tells. */
        limb = UNKNOWN;
      }
      else {
        /* Flat things are not as thick: their boxes tell. */
        met = in_thing(boxes, place);
      }
    }
    if (met) {
      float part = clamp(before < 0.0 ? -before / (gap - before) : 0.0, 0.0, 1.0);
      if (behind) {
        part = over_before > 0.0 ? over_before / (over_before - over) : 1.0;
      }
      float found = mix(u_before, next, part);
      at = a + found * span;
      way = ((1.0 - found) * low * two.w + found * high * one.w) /
            ((1.0 - found) * two.w + found * one.w);
      return true;
    }
    hidden = hidden || behind;
    u = next;
    u_before = u;
    before = min(gap, -1e-9);
    z_before = z;
    shown_before = shown;
    over_before = over;
  }
  hidden = true;
  return false;
}

/* Of a ray that no view shows to its end: where a capture shows what lies beside the edge behind
 * which the ray went, as the direction from the capture and its number; less than 0 for none. */
vec4 last_shown = vec4(-1.0);

/* Where a ray meets what a capture shows: marched by equal angles round the capture's centre.
 * `hidden`: it was behind something. */
bool march_capture(int slot, vec3 o, vec3 d, float reach, out vec3 at, out float way,
                   out bool hidden)
{
  vec4 capture = capture_at(slot);
  vec3 q = o - capture.xyz;
  float foot = -dot(q, d);
  vec3 nearest = q + foot * d;
  float apart = length(nearest);
  vec3 n = apart > 1e-5 ? nearest / apart : normalize(cross(d, vec3(d.y, d.z, -d.x)));
  apart = max(apart, 1e-5);
  float last = min(reach, view.size.w);
  /* At an angle a the ray is at apart / cos(a) · (cos(a) n + sin(a) d). */
  float low = atan(-foot, apart);
  float high = atan(last - foot, apart);
  int count = clamp(int((high - low) * capture.w / CAPTURE_STRIDE) + 3, 3, CAPTURE_STEPS);
  vec2 turn = vec2(cos((high - low) / float(count)), sin((high - low) / float(count)));
  vec2 angle = vec2(cos(low), sin(low));
  float before = 0.0;
  bool behind = capture_gap(slot, q) > THICK_PART * length(q);
  hidden = behind;
  at = vec3(0.0);
  way = reach;
  for (int k = 1; k <= count; k++) {
    angle = vec2(angle.x * turn.x - angle.y * turn.y, angle.x * turn.y + angle.y * turn.x);
    float t = k == count ? last : foot + apart * angle.y / max(angle.x, 1e-9);
    float gap = capture_gap(slot, q + t * d);
    if (!behind && gap > 0.0) {
      float near = before, far = t;
      for (int n_ = 0; n_ < HALVINGS; n_++) {
        /* Half the angle between both: the sum of their directions. */
        vec2 sum_ = normalize(vec2(apart, near - foot)) + normalize(vec2(apart, far - foot));
        float middle = foot + apart * sum_.y / max(sum_.x, 1e-9);
        if (smooth_gap(slot, q + middle * d) > 0.0) {
          far = middle;
        }
        else {
          near = middle;
        }
      }
      /* Along one pixel depths are linear: the place between both where the gap ends. */
      float gap_near = smooth_gap(slot, q + near * d);
      float gap_far = smooth_gap(slot, q + far * d);
      float part = gap_far > gap_near ? clamp(-gap_near / (gap_far - gap_near), 0.0, 1.0) : 1.0;
      way = mix(near, far, part);
      at = q + way * d;
      /* Behind an edge the ray may pass: halving has then led to where depths jump. */
      if (gap_far - gap_near < THIN + THICK_PART * length(at) + 2.0 * (far - near) &&
          abs(smooth_gap(slot, at)) < THIN + THICK_PART * length(at)) {
        return true;
      }
      behind = hidden = true;
      if (last_shown.w < 0.0) {
        last_shown = vec4(q + near * d, float(slot));
      }
    }
    else if (gap <= 0.0) {
      behind = false;
    }
    before = t;
  }
  way = reach;
  return false;
}

int capture_of(int g)
{
  int slot = g < 0 ? 0 : int(row(9 + GLASS_ROWS * g).y);
  return slot >= 0 && capture_at(slot).w > 0.5 ? slot : -1;
}

/* What a ray meets within its reach, if a view shows it. `boxes`: see `march_direct`. */
bool seen(vec3 o, vec3 d, float reach, int slot, int boxes, out vec4 colour, out float way)
{
  vec2 pixel;
  bool hidden = true, found = false;
  int first = slot;
  way = reach;
  colour = vec4(0.0);
  if (has_depth != 0) {
    found = march_direct(o, d, reach, slot, boxes, pixel, way, hidden);
    if (found) {
      colour = thing_at(pixel);
    }
  }
  if (slot >= 0 && hidden) {
    vec3 at;
    float other;
    float most = min(reach, way);
    bool met = march_capture(slot, o, d, most, at, other, hidden);
    int second = second_of(slot);
    if (!met && hidden && second >= 0) {
      slot = second;
      met = march_capture(slot, o, d, most, at, other, hidden);
    }
    /* What stands before it there those of other glasses may see. */
    for (int k = 0; k < CAPTURES && !met && hidden && !found; k++) {
      if (k != first && k != second && capture_at(k).w > 0.5) {
        slot = k;
        met = march_capture(slot, o, d, most, at, other, hidden);
      }
    }
    if (met) {
      colour = capture_colour(slot, at);
      way = other;
      found = true;
    }
  }
  return found;
}

/* Whether a ray may meet anything: things are in boxes, if it is known where they are. */
bool may_meet_any(vec3 p, vec3 d)
{
  return row(0).w < 0.0 || meets_boxes(int(row(0).z), int(row(0).w), p, d, NOWHERE);
}

/* The world in a direction in which the view does not show it: as the capture shows it there, else
 * as high to another side. Solid shading leaves it to the background. */
vec4 sky(vec3 d, int slot)
{
  if (backdrop.w > 0.5) {
    return vec4(0.0);
  }
  vec3 along = d;
  for (int k = 0; slot >= 0 && k < 4; k++) {
    if (!shows_thing(slot, along)) {
      return capture_colour(slot, along);
    }
    along = vec3(-along.y, along.x, along.z);
  }
  return slot >= 0 ? capture_colour(slot, d) : vec4(0.0);
}

/* What a ray shows of which no view shows the end: the world, or the nearest that is known. */
vec4 beyond(vec3 o, vec3 d, int slot)
{
  vec4 clip = view.to_clip * vec4(d, 0.0);
  if (view.eye.w < 0.5) {
    /* In a parallel view what is far off is seen where the ray leaves the scene. */
    clip = view.to_clip * vec4(o + view.size.w * d, 1.0);
  }
  vec2 pixel = (0.5 * clip.xy / clip.w + 0.5) * view.size.xy;
  bool shown = clip.w > 0.0 && all(greaterThanEqual(pixel, vec2(0.0))) &&
               all(lessThan(pixel, view.size.xy));
  if (has_depth != 0 && shown && depth_near(pixel) >= FAR_OFF) {
    return thing_at(pixel);
  }
  if (!may_meet_any(o, d)) {
    return sky(d, slot);
  }
  if (slot >= 0) {
    /* Where a thing stands before the first capture the second may show more. */
    int second = second_of(slot);
    if (second >= 0) {
      return capture_colour(shows_thing(slot, d) ? second : slot, d);
    }
    if (backdrop.w < 0.5 && last_shown.w >= 0.0) {
      /* What lies beside the edge behind which it went is most like what it ends on. Solid shading
       * has no textures: there the thing before it is more like its own back. */
      return capture_colour(int(last_shown.w), last_shown.xyz);
    }
    return capture_colour(slot, d);
  }
  if (clip.w <= 0.0) {
    clip = view.to_clip * vec4(o, 1.0);
    pixel = (0.5 * clip.xy / clip.w + 0.5) * view.size.xy;
  }
  return direct_at(clamp(pixel, vec2(0.5), view.size.xy - 0.5));
}

/* What shows nothing lets the background through. That is not tinted where it is drawn, so what is
 * seen of it through tinted glass is added here: all but what every colour has. */
void add(vec4 colour, vec4 light)
{
  float plain = min(min(light.r, light.g), min(light.b, 1.0));
  vec3 open = (1.0 - colour.a) * (light.rgb - plain) * backdrop.rgb;
  float shown = colour.a + (1.0 - colour.a) * (1.0 - plain);
  sum += light.w * vec4(light.rgb * colour.rgb + open, shown);
  got += light.w;
}

bool covered(vec3 p)
{
  if (has_depth == 0) {
    return false;
  }
  vec4 clip = view.to_clip * vec4(p, 1.0);
  vec2 pixel = (0.5 * clip.xy / clip.w + 0.5) * view.size.xy;
  return depth_between(pixel) < dot(view.depth_row, vec4(p, 1.0)) - NEARER;
}

void leave(vec3 p, vec3 d, vec4 light, int g, int number)
{
  vec4 colour;
  float way;
  int slot = capture_of(g);
  last_shown = vec4(-1.0);
  if (!may_meet_any(p, d) || !seen(p, d, NOWHERE, slot, -1, colour, way)) {
    colour = beyond(p, d, slot);
  }
  add(colour, light);
}

void lose(vec4 light) {}

bool stopped(vec3 p, vec3 d, vec4 light, int g, vec3 taken, bool boxed, float way, int number)
{
  /* From one glass to another anything may stand; within one what reaches into its box. */
  vec2 things = vec2(row(9 + GLASS_ROWS * g).w, row(1 + GLASS_ROWS * g).w);
  if (boxed && !meets_boxes(int(things.x), int(things.y), p, d, way)) {
    return false;
  }
  vec4 colour;
  float reached;
  if (!seen(p, d, way, capture_of(g), boxed ? g : -1, colour, reached)) {
    return false;
  }
  light.rgb *= exp(-taken * reached);
  add(colour, light);
  return true;
}

/* A face that lies on a thing shows it, with no air between. */
bool touches(vec3 at, vec3 d, vec4 light, int g, int number)
{
  vec4 clip = view.to_clip * vec4(at, 1.0);
  vec2 pixel = (0.5 * clip.xy / clip.w + 0.5) * view.size.xy;
  float near = TOUCHING * row(9 + GLASS_ROWS * g).x;
  if (has_depth != 0 && clip.w > 0.0 && all(greaterThanEqual(pixel, vec2(0.0))) &&
      all(lessThan(pixel, view.size.xy))) {
    if (abs(depth_near(pixel) - dot(view.depth_row, vec4(at, 1.0))) < near) {
      add(thing_at(pixel), light);
      return true;
    }
  }
  int slot = capture_of(g);
  if (slot >= 0) {
    vec3 away = at - capture_at(slot).xyz;
    if (abs(smooth_gap(slot, away)) < near) {
      add(capture_colour(slot, away), light);
      return true;
    }
  }
  return false;
}
"""
)

MAIN = """
/* What is shown of a sample, about as the eye weighs it: `glass` of it hides the direct picture,
 * and the background lies behind both. */
vec3 weighed(vec4 seen, float glass)
{
  vec4 shown = seen + (1.0 - glass) * texelFetch(direct_tx, sampled, 0);
  vec3 whole = shown.rgb + max(1.0 - shown.a, 0.0) * backdrop.rgb;
  return sqrt(clamp(whole, 0.0, 1.0));
}

/* The square of how far a sample of a listed pixel lies from the mean of those before. */
float apart()
{
  vec4 known = texelFetch(known_tx, sampled, 0), counted = texelFetch(counted_tx, sampled, 0);
  float count = max(counted.g, 1.0);
  vec3 off = weighed(color, cover.r) - weighed(known / count, counted.r / count);
  off *= band.rgb;
  return max(max(off.r * off.r, off.g * off.g), off.b * off.b);
}

/* One sample of every pixel: the colour seen through the glass, and whether there is any. */
void main()
{
  vec2 at = gl_FragCoord.xy;
  if (is_listed != 0) {
    at = texelFetch(list_tx, ivec2(at), 0).xy + 0.5;
    if (at.x < 0.0) {
      discard;
    }
  }
  sampled = ivec2(at);
  vec2 pixel = (at + jitter.xy) * jitter.z;
  vec3 p = view.plane.xyz + pixel.x * view.right.xyz + pixel.y * view.up.xyz;
  bool parallel = view.eye.w < 0.5;
  vec3 d = parallel ? view.eye.xyz : normalize(p - view.eye.xyz);
  /* The ray begins where it enters the ball that holds all glasses: numbers stay small there. */
  float ahead = -dot(p, d);
  float off = length(p + ahead * d);
  color = vec4(0.0);
  /* Whether there is any glass, how many samples the pixel has, and how much these differ. */
  cover = vec4(0.0, 1.0, 0.0, 0.0);
  if (off > view.start.x) {
    cover.b = is_listed != 0 ? apart() : 0.0;
    cover *= band.a;
    return;
  }
  float enter = ahead - sqrt(view.start.x * view.start.x - off * off);
  float eye_way = parallel ? -view.size.w : -length(p - view.eye.xyz);
  bool within = eye_way > enter;
  p += max(enter, eye_way) * d;
  float way = follow(p, d, starting(within), least, most, splits != 0);
  if (way < NOWHERE && got > 0.0) {
    color = sum / got;
    cover.r = 1.0;
  }
  else if (way < NOWHERE && splits == 0) {
    /* What only refracts is black where it would reflect totally. */
    color.a = cover.r = 1.0;
  }
  if (is_listed != 0) {
    cover.b = apart();
  }
  color *= band;
  cover *= band.a;
}
"""

PICTURE = HOOKS + SMOOTH + FOLLOW + LOOKUP + MAIN

# For tests: the depth that counts for places between pixels, and that of an edge to their left.
BETWEEN = (
    HOOKS
    + SMOOTH
    + FOLLOW
    + LOOKUP
    + """
void main()
{
  vec2 at = gl_FragCoord.xy / parts;
  frag = vec4(depth_near(at), limb_at(at, vec2(1.0, 0.0)), depth_between(at), 0.0);
}
"""
)

EXITS_AT_ONCE = 3
"""Ways of which `EXITS` writes the exit rays, two textures each: Blender draws into six at once."""

_EXITS_OUT = "\n".join(
    f"  place_{k} = exit_places[{k}];\n  along_{k} = exit_alongs[{k}];"
    for k in range(EXITS_AT_ONCE)
)

EXITS = (
    HOOKS
    + FOLLOW
    + f"""
#define AT_ONCE {EXITS_AT_ONCE}
"""
    + """
/* For tests: exit rays of the ways from number `wanted` on of the ray in each pixel. */
vec4 exit_places[AT_ONCE];
vec4 exit_alongs[AT_ONCE];

void leave(vec3 p, vec3 d, vec4 light, int g, int number)
{
  for (int k = 0; k < AT_ONCE; k++) {
    if (number == wanted + k) {
      exit_places[k] = vec4(p, light.w);
      exit_alongs[k] = vec4(d, 0.0);
    }
  }
}

void lose(vec4 light) {}
bool covered(vec3 p) { return false; }
bool stopped(vec3 p, vec3 d, vec4 light, int g, vec3 taken, bool boxed, float way, int number)
{
  return false;
}
bool touches(vec3 p, vec3 d, vec4 light, int g, int number) { return false; }

void main()
{
  for (int k = 0; k < AT_ONCE; k++) {
    exit_places[k] = exit_alongs[k] = vec4(0.0);
  }
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec3 p = texelFetch(origin_tx, pixel, 0).xyz;
  vec3 d = normalize(texelFetch(along_tx, pixel, 0).xyz);
  follow(p, d, starting(false), least, most, true);
"""
    + _EXITS_OUT
    + """
}
"""
)

QUAD_VERTEX = """
void main()
{
  gl_Position = vec4(mix(box.xy, box.zw, corner), 0.0, 1.0);
}
"""

# Edges and points of glasses, whose depths tell where an overlay drew them. `begin`, 0 or 1: all
# that is drawn with 1 lies behind all that is drawn with 0.
WIRES_VERTEX = """
void main()
{
  gl_Position = to_clip * vec4(place, 1.0);
  gl_Position.z = 0.5 * gl_Position.z + (begin - 0.5) * gl_Position.w;
  gl_PointSize = dot_size;
}
"""

WIRES = """
void main() { frag = vec4(2.0 * gl_FragCoord.z - begin); }
"""

# Whether an overlay's line that a glass is drawn by is at a pixel, of which the depth buffer has a
# value. `line`: see `eye.common_line`.
WIRE_AT = """
/* By how much a line may lie before the nearest edge here and behind it, as part of the depth:
 * overlays draw lines a little nearer, and edges are drawn a pixel wider here. */
#define WIRE_BEFORE 0.004
#define WIRE_BEHIND 0.03

float depth_of(float value) { return (line.x + line.y * value) / (line.z + line.w * value); }

bool is_wire(ivec2 pixel, float value)
{
  float wire = texelFetch(wire_tx, pixel, 0).r;
  if (wire > 1.0 || value >= 1.0) {
    return false;
  }
  float depth = depth_of(value);
  float behind = (depth - depth_of(wire)) / max(abs(depth), 1.0);
  return behind > -WIRE_BEFORE && behind < WIRE_BEHIND;
}
"""

# Takes off what EEVEE adds to depths: to each by how much it differs from those beside it in its
# block of 2 x 2 pixels (`film_display_depth_amend`; it ends at 1). Ends of things then have depths
# of what lies behind them, and what lies behind them has others that lie farther still. Of near and
# far pixels in a block each arrangement leaves a mark of its own. `amended`: 1 where EEVEE drew.
AMENDED = (
    WIRE_AT
    + """
/* Part of the differences in a block from which on its values lie on no plane, and below which two
 * are the same. */
#define TWISTED 0.25
#define SAME 0.05

float raw_value(sampler2D tx, ivec2 pixel)
{
  return texelFetch(tx, clamp(pixel, ivec2(0), textureSize(tx, 0) - 1), 0).r;
}

/* Of a pixel beside one with the value `own`, which stands in where a line may be. */
float value_beside(sampler2D tx, ivec2 pixel, float own)
{
  return texelFetch(wire_tx, pixel, 0).r > 1.0 ? raw_value(tx, pixel) : own;
}

float value_of(sampler2D tx, ivec2 pixel)
{
  float own = raw_value(tx, pixel);
  if (amended == 0 || is_wire(pixel, own)) {
    return own;
  }
  ivec2 other = min(pixel ^ ivec2(1), textureSize(tx, 0) - 1);
  ivec2 right = ivec2(other.x, pixel.y), up = ivec2(pixel.x, other.y);
  float across = value_beside(tx, right, own), along = value_beside(tx, up, own);
  float opposite = value_beside(tx, other, own);
  float low = min(min(own, across), min(along, opposite));
  float high = max(max(own, across), max(along, opposite));
  float span = high - low;
  if (abs(own + opposite - across - along) <= TWISTED * span) {
    float value = own - abs(own - across) - abs(own - along);
    if (high >= 1.0 && own < 1.0) {
      /* It ended at 1: the nearer one is beside the block. */
      value = min(value, raw_value(tx, across >= 1.0 ? 2 * pixel - right : 2 * pixel - up));
    }
    return value;
  }
  /* One pixel lies nearer than the others, or farther: opposite of the least value or there. */
  bool is_own = own == low, is_opposite = opposite == low, is_across = across == low;
  ivec2 least_ = is_own ? pixel : (is_opposite ? other : (is_across ? right : up));
  ivec2 apart = is_own ? other : (is_opposite ? pixel : (is_across ? up : right));
  float beyond_ = is_own ? opposite : (is_opposite ? own : (is_across ? along : across));
  vec2 rest = is_own || is_opposite ? vec2(across, along) : vec2(own, opposite);
  bool is_apart = pixel == apart;
  if (min(rest.x, rest.y) < min(beyond_ - SAME * span, 1.0)) {
    /* Three lie as near. */
    return is_apart ? max(rest.x, rest.y) : low;
  }
  if (beyond_ < 1.0) {
    return is_apart ? 2.0 * low - beyond_ : low;
  }
  float nearer = raw_value(tx, 2 * apart - least_);
  if (nearer < low - SAME * span) {
    return is_apart ? nearer : low;
  }
  /* Nothing stands behind the three. */
  return is_apart ? 1.0 : low;
}
"""
)

# Puts the picture into the view. part 0: what the view's pixels are multiplied by, 1: what is added
# to them; 2: what the background, which lies in the overlay, is multiplied by, 3: the background
# that is added there where a line was. The overlay also has the lines that the glasses are drawn by
# so that they can be clicked at; where no glass is selected they are taken out. Overlays are added
# by another curve than the scene's colours have: so where a surface stood, the background that is
# seen in the glass goes into the scene.
RESULT = (
    SMOOTH
    + WIRE_AT
    + """
/* Pixels from a line's own to those that it is smoothed over; the edges are drawn as wide. */
#define LINE_REACH 2

/* Whether an overlay's line that a glass is drawn by is here or right beside. */
bool is_line(ivec2 pixel)
{
  if (texelFetch(wire_tx, pixel, 0).r > 1.0) {
    return false;
  }
  ivec2 last = textureSize(direct_tx, 0) - 1;
  for (int y = -LINE_REACH; y <= LINE_REACH; y++) {
    for (int x = -LINE_REACH; x <= LINE_REACH; x++) {
      ivec2 p = clamp(pixel + ivec2(x, y), ivec2(0), last);
      if (is_wire(p, texelFetch(raw_tx, p, 0).r)) {
        return true;
      }
    }
  }
  return false;
}

vec4 at_pixel(sampler2D tx)
{
  return divisor > 1.0 ? smooth_at(tx, gl_FragCoord.xy / divisor)
                       : texelFetch(tx, ivec2(gl_FragCoord.xy), 0);
}

void main()
{
  vec4 covers_ = at_pixel(cover_tx);
  float covers = covers_.r / max(covers_.g, 1.0);
  if (covers <= 0.0 && (part < 2 || lines != 0)) {
    discard;
  }
  if (part == 0) {
    frag = vec4(1.0 - covers);
    return;
  }
  vec4 seen = at_pixel(color_tx) / max(covers_.g, 1.0);
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float before = texelFetch(direct_tx, pixel, 0).a;
  float after = (1.0 - covers) * before + min(seen.a, covers);
  bool erased = lines == 0 && is_line(pixel);
  bool is_open = before < 0.99 && !erased;
  if (part == 1) {
    /* Where no background is, it is put into the scene. */
    frag = is_open ? seen : vec4(seen.rgb + max(covers - seen.a, 0.0) * backdrop.rgb, covers);
  }
  else if (part == 2) {
    frag = vec4(erased ? 0.0 : (is_open ? (1.0 - after) / (1.0 - before) : 1.0));
  }
  else {
    frag = erased ? (1.0 - covers) * (1.0 - before) * backdrop : vec4(0.0);
  }
}
"""
)

# Which pixels of a first sample differ from those beside them, so that more are worth their time.
EDGES = """
/* Differences from pixel to pixel, as they are and as part of the colour, that are too much. */
#define EDGE_STEP vec4(0.02)
#define EDGE_PART 0.08

void main()
{
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec4 here = texelFetch(first_tx, pixel, 0);
  ivec2 last = textureSize(first_tx, 0) - 1;
  frag = vec4(0.0);
  for (int k = 0; k < 4; k++) {
    ivec2 step_ = (k & 1) == 0 ? ivec2(1 - (k & 2), 0) : ivec2(0, 1 - (k & 2));
    vec4 other = texelFetch(first_tx, clamp(pixel + step_, ivec2(0), last), 0);
    if (any(greaterThan(abs(other - here), EDGE_STEP + EDGE_PART * abs(here)))) {
      frag = vec4(1.0);
    }
  }
}
"""

# The samples of a layer of listed pixels, each where it belongs; they are added to what is there.
SUM = """
void main()
{
  int place = int(texelFetch(place_tx, ivec2(gl_FragCoord.xy), 0).r);
  if (place < 0) {
    discard;
  }
  int width = textureSize(more_color_tx, 0).x;
  ivec2 there = ivec2(place % width, place / width);
  color = texelFetch(more_color_tx, there, 0);
  cover = texelFetch(more_cover_tx, there, 0);
}
"""

# The view's depths in units of the common frame. Overlays write theirs too: whatever is but a few
# pixels wide, as their lines are, gets the depth of what lies on both sides of it.
DEPTH = (
    AMENDED
    + """
#define FAR_OFF 1e20
#define LINE 2
/* Pixels over which lines of glasses may lie side by side. */
#define MOST_WIRES 24

float value_at(ivec2 pixel)
{
  return value_of(raw_tx, clamp(pixel, ivec2(0), textureSize(raw_tx, 0) - 1));
}

/* The value beyond the lines that lie side by side in one direction. */
float value_beyond(ivec2 pixel, ivec2 step_)
{
  ivec2 last = textureSize(raw_tx, 0) - 1;
  float value = 1.0;
  for (int k = 0; k < MOST_WIRES; k++) {
    pixel = clamp(pixel + step_, ivec2(0), last);
    value = texelFetch(raw_tx, pixel, 0).r;
    if (!is_wire(pixel, value)) {
      return value_of(raw_tx, pixel);
    }
  }
  return value;
}

void main()
{
  ivec2 p = ivec2(gl_FragCoord.xy);
  float value = value_at(p);
  ivec2 right = ivec2(1, 0), up = ivec2(0, 1);
  float across, along;
  if (is_wire(p, value)) {
    across = min(value_beyond(p, -right), value_beyond(p, right));
    along = min(value_beyond(p, -up), value_beyond(p, up));
  }
  else {
    across = min(value_at(p - LINE * right), value_at(p + LINE * right));
    along = min(value_at(p - LINE * up), value_at(p + LINE * up));
  }
  value = max(value, max(across, along));
  frag = vec4(value >= 1.0 ? FAR_OFF : depth_of(value), 0.0, 0.0, 0.0);
}
"""
)

# The same depths, and which pixels have others beside them that lie in front of them or behind.
STEPS = (
    EDGE
    + """
void main()
{
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  ivec2 last = textureSize(depth_tx, 0) - 1;
  float depth = texelFetch(depth_tx, pixel, 0).r;
  float near = depth, far = depth;
  for (int k = 0; k < 9; k++) {
    ivec2 other = clamp(pixel + ivec2(k % 3, k / 3) - 1, ivec2(0), last);
    float value = texelFetch(depth_tx, other, 0).r;
    near = min(near, value);
    far = max(far, value);
  }
  bool is_step = far - near > EDGE * (width.x + width.y * near);
  frag = vec4(depth, is_step ? 1.0 : 0.0, 0.0, 0.0);
}
"""
)

# The nearest and the farthest depth in each tile of the view.
TILES = """
#define TILE 8
#define FAR_OFF 1e19

void main()
{
  ivec2 last = textureSize(depth_tx, 0) - 1;
  ivec2 first = ivec2(gl_FragCoord.xy) * TILE;
  vec2 range = vec2(FAR_OFF, -FAR_OFF);
  for (int y = 0; y < TILE; y++) {
    for (int x = 0; x < TILE; x++) {
      float value = texelFetch(depth_tx, min(first + ivec2(x, y), last), 0).r;
      range = vec2(min(range.x, value), max(range.y, value));
    }
  }
  frag = vec4(min(range, FAR_OFF), 0.0, 0.0);
}
"""

# Takes a face of a capture, as the engine drew it, into the atlas of all captures. Where an overlay
# drew lines of glasses, what is beside them stands in.
FACE = (
    AMENDED
    + """
#define MOST_WIRES 64
/* By what part a line may come nearer over the few pixels by which edges are drawn wider. */
#define STEEP 0.1

/* Depth of the nearest edge whose line may cover a pixel. */
float nearest_wire(ivec2 pixel)
{
  float value = 1.0;
  for (int k = 0; k < 25; k++) {
    ivec2 one = clamp(pixel + ivec2(k % 5, k / 5) - 2, ivec2(0), textureSize(wire_tx, 0) - 1);
    value = min(value, texelFetch(wire_tx, one, 0).r);
  }
  return depth_of(value);
}

ivec2 beside_wires(ivec2 pixel)
{
  ivec2 last = textureSize(face_tx, 0) - 1;
  for (int far = 0; far < MOST_WIRES; far++) {
    for (int k = 0; k < 4; k++) {
      ivec2 step_ = (k & 1) == 0 ? ivec2(1 - (k & 2), 0) : ivec2(0, 1 - (k & 2));
      ivec2 other = clamp(pixel + far * step_, ivec2(0), last);
      float wire = texelFetch(wire_tx, other, 0).r;
      float depth = depth_of(texelFetch(depth_tx, other, 0).r);
      /* Lines are smoothed over pixels that show what lies behind them. */
      if (wire > 1.0 || depth < (1.0 - STEEP) * nearest_wire(other)) {
        return other;
      }
    }
  }
  return pixel;
}

void main()
{
  ivec2 pixel = beside_wires(ivec2(gl_FragCoord.xy) - origin);
  color = texelFetch(face_tx, pixel, 0);
  float value = value_of(depth_tx, pixel);
  reach = vec4(value < 1.0 ? depth_of(value) : (color.a > 0.5 ? 1e20 : -1e20));
}
"""
)
