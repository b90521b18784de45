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

BEND = (
    f"""
#define SLAB {SLAB}
#define TUBE {TUBE}
#define BALL {BALL}
"""
    + """
/* Newton's steps, and the change of the unknowns below which the next one changes nothing: the
 * error after a step is about the square of the step. */
#define ROUND_STEPS 7
#define LAYER_STEPS 14
#define RESTS 1e-3
/* The limits of the angle that stands for a ray's distance from the axis, and of a step. */
#define STEEPEST 1.5706
#define LONGEST_STEP 0.7
#define BEGIN 0.98
/* Least cosine at the inner face: the derivatives have it below. */
#define LEAST_COSINE 1e-4
#define LEAST 1e-12
/* What `miss` is for a vertex that lies on the eye's side. */
#define NONE 1.0

/* A vertex q behind (held: in) a tube, or with q.z = 0 a ball in the plane of eye, middle and q.
 *
 * With everything divided by the ray's transverse momentum, a skew ray through a tube is a plane
 * one through a glass of another ior: m² = n² + (n² - 1) s², s being its rise by its transverse
 * way. Unknowns are s and the angle t for which r sin t is the ray's distance from the axis. After
 * the last event the ray is a straight line; q lies on it at its own height.
 * Returns the vector from the eye to where q appears. */
vec3 bend_round(vec3 q, bool held, out float miss)
{
  float re = bend.eye.x, r = bend.shape.x, n1 = (bend.shape.y - 1.0) * (bend.shape.y + 1.0);
  float passes = held ? 1.0 : 2.0;
  float away = length(vec2(q.x - re, q.y));
  float s = q.z / away;
  float t = asin(clamp(re * q.y / (away * r), -BEGIN, BEGIN));
  float lam, wE, across, along, air, wall, m2;
  for (int k = 0; k < ROUND_STEPS; k++) {
    float w2 = r * max(cos(t), LEAST_COSINE);
    lam = r * sin(t);
    float l2 = lam * lam;
    m2 = 1.0 + n1 + n1 * s * s;
    wE = sqrt((re - lam) * (re + lam));
    float w0 = sqrt((1.0 - lam) * (1.0 + lam));
    float wR = sqrt(m2 - l2), wr = sqrt(m2 * r * r - l2);
    /* By how much both faces turn the ray, as unit complex numbers. */
    vec2 a = vec2(l2 + w0 * wR, lam * (wR - w0)), b = vec2(l2 + wr * w2, lam * (w2 - wr));
    vec2 turn = vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
    if (!held) {
      turn = vec2(turn.x * turn.x - turn.y * turn.y, 2.0 * turn.x * turn.y);
    }
    vec2 u = normalize(vec2(-wE * turn.x - lam * turn.y, lam * turn.x - wE * turn.y));
    along = dot(q.xy, u);
    across = q.x * u.y - q.y * u.x;
    float f = across - lam;
    vec4 i = 1.0 / vec4(w0, wR, wr, w2);
    float iE = 1.0 / wE;
    float bends = passes * (i.x - i.y + i.z - i.w) - iE;
    float bends_m = passes * lam / (2.0 * m2) * (i.y - i.z);
    air = wE + passes * (w2 - w0) + along;
    wall = wR - wr;
    float far = air + passes * wall / m2;
    float g = s * far - q.z;
    float far_l = lam * (passes * (i.x - i.w - (i.y - i.z) / m2) - iE) - across * bends;
    float far_m = passes * (0.5 * (i.y - r * r * i.z) - wall / m2) / m2 - across * bends_m;
    float m_s = 2.0 * n1 * s;
    vec2 df = vec2(along * bends - 1.0, along * bends_m * m_s);
    vec2 dg = vec2(s * far_l, far + s * far_m * m_s);
    float determinant = df.x * dg.y - df.y * dg.x;
    float inverse = 1.0 / (abs(determinant) < LEAST ? LEAST : determinant);
    float dt = (f * dg.y - g * df.y) * inverse * i.w;
    float ds = (g * df.x - f * dg.x) * inverse;
    t = clamp(t - clamp(dt, -LONGEST_STEP, LONGEST_STEP), -STEEPEST, STEEPEST);
    s -= clamp(ds, -1.0 - abs(s), 1.0 + abs(s));
    /* How far past q the ray runs, as a part of how far it goes. */
    miss = abs(f) / max(1.0, abs(along));
    if (max(abs(dt), abs(ds)) < RESTS) {
      break;
    }
  }
  if (!held && along < 0.0) {
    miss = NONE;
  }
  lam = r * sin(t);
  wE = sqrt((re - lam) * (re + lam));
  float slope = sqrt(1.0 + s * s);
  float way = air * slope + passes * wall * sqrt((1.0 + s * s / m2) / m2);
  return way / slope * vec3(-wE / re, lam / re, s);
}

/* A vertex below layers. The unknown x is the tangent in the thinnest medium: the offset is an
 * increasing, concave function of it, and Newton's method comes to the root from below. */
vec3 bend_layers(vec3 q)
{
  int count = int(bend.shape.z);
  float own = max(-bend.shape.w - q.z, 0.0);
  float offset = length(q.xy);
  float thinnest = bend.layers[0].y;
  for (int k = 1; k < count; k++) {
    thinnest = min(thinnest, bend.layers[k].y);
  }
  float t2 = thinnest * thinnest, steepest = 0.0, level = 0.0, rest = offset;
  for (int k = 0; k < count; k++) {
    float thickness = k == count - 1 ? own : bend.layers[k].x, n = bend.layers[k].y;
    steepest += thickness * thinnest / n;
    if (n > thinnest) {
      rest -= thickness * thinnest / sqrt((n - thinnest) * (n + thinnest));
    }
    else {
      level += thickness;
    }
  }
  float x = max(offset / steepest, level > 0.0 ? rest / level : 0.0);
  for (int step_ = 0; step_ < LAYER_STEPS; step_++) {
    float reached = 0.0, slope = 0.0;
    for (int k = 0; k < count; k++) {
      float thickness = k == count - 1 ? own : bend.layers[k].x, n = bend.layers[k].y;
      float i = inversesqrt(n * n + (n - thinnest) * (n + thinnest) * x * x);
      reached += thickness * thinnest * x * i;
      slope += thickness * thinnest * n * n * i * i * i;
    }
    float dx = (offset - reached) / slope;
    x = max(x + dx, 0.0);
    if (abs(dx) < RESTS * (1.0 + x)) {
      break;
    }
  }
  float way = 0.0, stretched = sqrt(1.0 + x * x);
  for (int k = 0; k < count; k++) {
    float thickness = k == count - 1 ? own : bend.layers[k].x, n = bend.layers[k].y;
    way += thickness * n * stretched * inversesqrt(n * n + (n - thinnest) * (n + thinnest) * x * x);
  }
  float n = bend.layers[0].y;
  float sine = thinnest * x / (n * stretched);
  float cosine = sqrt(n * n + (n - thinnest) * (n + thinnest) * x * x) / (n * stretched);
  vec2 heading = offset > 0.0 ? q.xy / offset : vec2(0.0);
  return way * vec3(sine * heading, -cosine);
}

/* From the eye to where a place in the frame appears; `miss`: by how much no ray gets there. */
vec3 bent(vec3 q, out float miss)
{
  miss = 0.0;
#if KIND == SLAB
  return bend_layers(q);
#elif KIND == TUBE
  return bend_round(q, held != 0, miss);
#else
  float size = length(q.yz);
  vec3 v = bend_round(vec3(q.x, size, 0.0), held != 0, miss);
  return vec3(v.x, v.y * (size > 0.0 ? q.yz / size : vec2(0.0)));
#endif
}
"""
)

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

# The same triangles where they are, to tell what the solving costs.
PLAIN_VERTEX = """
void main()
{
  vec3 q = (place * vec4(pos, 1.0)).xyz;
  at = q;
  miss = 0.0;
  gl_Position = bend.to_clip * vec4(q - bend.eye.xyz, 0.0) + bend.clip_eye;
}
"""

# For tests: one point per vertex, whose pixel takes where it appears in the picture (-1 to 1) and
# the length of the way there.
POINTS_VERTEX = (
    BEND
    + """
void main()
{
  vec3 v = bent((place * vec4(pos, 1.0)).xyz, miss);
  vec4 clip = bend.to_clip * vec4(v, 0.0) + bend.clip_eye;
  at = vec3(clip.xy / clip.w, length(v));
  vec2 pixel = vec2(float(gl_VertexID % COLUMNS), float(gl_VertexID / COLUMNS)) + 0.5;
  gl_Position = vec4(2.0 * pixel / float(COLUMNS) - 1.0, 0.0, 1.0);
  gl_PointSize = 1.0;
}
"""
)

POINTS_FRAGMENT = """
void main() { frag = vec4(at, miss); }
"""

COLOUR = (
    glsl.SMOOTH
    + glsl.VIEWS
    + f"""
#define EXIT {EXIT}
#define HELD {HELD}
#define SLAB {SLAB}
#define TUBE {TUBE}
"""
    + """
/* `miss` above which a fragment belongs to no image: triangles that begin on the eye's side. */
#define MOST_MISS 0.5
/* Widths of a pixel by which the view's depth may differ from a surface that it looks at squarely,
 * and the least cosine at which it does. */
#define ROUGH 1.5
#define FLATTEST 0.05

/* Whether the light path meets its vertex where this fragment is: behind the glass, or in it. */
bool is_there(vec3 q)
{
#if KIND == SLAB
  return q.z < -bend.shape.w;
#elif KIND == TUBE
  float size = length(q.xy);
#else
  float size = length(q);
#endif
#if KIND != SLAB
  return held != 0 ? size < bend.shape.x : size > 1.0;
#endif
}

/* What the view shows at a place: of the four pixels round it those that are as deep. */
vec4 direct_colour(vec3 p, vec3 normal)
{
  vec4 clip = view.to_clip * vec4(p, 1.0);
  vec2 pixel = (0.5 * clip.xy / clip.w + 0.5) * view.size.xy;
  if (has_depth == 0 || clip.w <= 0.0 || any(lessThan(pixel, vec2(0.0))) ||
      any(greaterThanEqual(pixel, view.size.xy))) {
    return vec4(0.0);
  }
  float z = dot(view.depth_row, vec4(p, 1.0));
  vec3 towards = normalize(view.eye.xyz - p);
  float cosine = clamp(abs(dot(normal, towards)), FLATTEST, 1.0);
  float rough = ROUGH * (view.pixel.x + view.pixel.y * z) / cosine;
  vec2 low = floor(pixel - 0.5);
  vec2 t = pixel - 0.5 - low;
  ivec2 last = ivec2(view.size.xy) - 1;
  vec4 mixed = vec4(0.0);
  for (int k = 0; k < 4; k++) {
    ivec2 step_ = ivec2(k & 1, k >> 1);
    ivec2 there = clamp(ivec2(low) + step_, ivec2(0), last);
    if (abs(texelFetch(depth_tx, there, 0).r - z) < rough) {
      vec2 part = mix(1.0 - t, t, vec2(step_));
      mixed += part.x * part.y * vec4(texelFetch(direct_tx, there, 0).rgb, 1.0);
    }
  }
  return mixed.a > 0.0 ? vec4(mixed.rgb / mixed.a, 1.0) : vec4(0.0);
}

/* Where no view is known to show a place: its surface's colour; while the view has no depths (that
 * of EEVEE without overlays) what it shows there, whatever that is. */
vec4 without_depth(vec3 p)
{
  vec4 clip = view.to_clip * vec4(p, 1.0);
  if (has_depth != 0 || clip.w <= 0.0) {
    return base;
  }
  vec2 pixel = (0.5 * clip.xy / clip.w + 0.5) * view.size.xy;
  return direct_at(clamp(pixel, vec2(0.5), view.size.xy - 0.5));
}

void main()
{
  if (miss > MOST_MISS || !is_there(at)) {
    discard;
  }
  vec3 p = (bend.to_common * vec4(at, 1.0)).xyz;
  vec4 shown = direct_colour(p, normalize(cross(dFdx(p), dFdy(p))));
  if (shown.a == 0.0 && slot >= 0 && capture_at(slot).w > 0.5) {
    vec3 away = p - capture_at(slot).xyz;
    if (abs(smooth_gap(slot, away)) < THIN + THICK_PART * length(away)) {
      shown = vec4(capture_colour(slot, away).rgb, 1.0);
    }
  }
  if (shown.a == 0.0) {
    shown = without_depth(p);
  }
  frag = vec4(shown.rgb, held != 0 ? HELD : EXIT);
}
"""
)

# Rays take the drawn picture for ways that were refracted only, at the interfaces that it is of.
PICTURE = (
    glsl.HOOKS
    + glsl.SMOOTH
    + glsl.FOLLOW
    + """
#define leave leave_by_ray
#define stopped stopped_by_ray
"""
    + glsl.LOOKUP
    + f"""
#undef leave
#undef stopped
#define EXIT {EXIT}
#define HELD {HELD}
#define MOST_DRAWN {MOST_DRAWN}
"""
    + """
ivec4 drawn_of(int g) { return g >= 0 && g < MOST_DRAWN ? drawn.glasses[g] : ivec4(0, 0, -1, 0); }

vec4 drawn_at(int number) { return texelFetch(drawn_tx, ivec3(sampled, number), 0); }

void leave(vec3 p, vec3 d, vec4 light, int g, int number)
{
  ivec4 known = drawn_of(g);
  if (known.z >= 0 && course > 0) {
    vec4 shown = drawn_at(known.z);
    if (course == known.x) {
      bool any_ = shown.a == EXIT;
      add(any_ ? vec4(shown.rgb, 1.0) : beyond(p, d, capture_of(g)), light);
      return;
    }
    if (course == known.y && shown.a == HELD) {
      add(vec4(shown.rgb, 1.0), light);
      return;
    }
  }
  leave_by_ray(p, d, light, g, number);
}

bool stopped(vec3 p, vec3 d, vec4 light, int g, vec3 taken, bool boxed, float way, int number)
{
  ivec4 known = drawn_of(g);
  if (known.z >= 0 && course > 0 && course == known.y && boxed) {
    vec4 shown = drawn_at(known.z);
    if (shown.a == HELD) {
      add(vec4(shown.rgb, 1.0), light);
    }
    return shown.a == HELD;
  }
  return stopped_by_ray(p, d, light, g, taken, boxed, way, number);
}
"""
    + glsl.MAIN
)
