# SPDX-License-Identifier: GPL-3.0-or-later
"""The shaders of the live picture, as text; :mod:`paint` compiles them when a view is drawn."""

from __future__ import annotations

DEPTH = """
float depth_at(ivec2 pixel)
{
  float value = texelFetch(depth_tx, pixel, 0).r;
  return (depth_line.x + depth_line.y * value) / (depth_line.z + depth_line.w * value);
}
"""

COPY_VERTEX = """
void main()
{
  place_at = place;
  own_colour = colour;
  gl_Position = clip;
}
"""

# Looks the colour up in the direct picture where the true place projects. What the direct picture
# shows there may be nearer: the depths tell, and then the surface's own colour stands in.
COPY_FRAGMENT = (
    DEPTH
    + """
/* The 4 x 4 pixels round a place in the direct picture; which of them show that very surface. */
vec4 colours[16];
bool shows[16];

vec4 sharp(vec2 t)
{
  /* The cubic through the pixels (Keys 1981, a = -1/2). */
  vec4 weight[2];
  for (int axis = 0; axis < 2; axis++) {
    float s = t[axis];
    weight[axis] = vec4(s * (-0.5 + s * (1.0 - 0.5 * s)),
                        1.0 + s * s * (-2.5 + 1.5 * s),
                        s * (0.5 + s * (2.0 - 1.5 * s)),
                        s * s * (-0.5 + 0.5 * s));
  }
  vec4 sum = vec4(0.0);
  for (int k = 0; k < 16; k++) {
    sum += weight[0][k % 4] * weight[1][k / 4] * colours[k];
  }
  return max(sum, vec4(0.0));
}

/* At an outline the engine's anti-aliasing has mixed the colours of both sides, and an overlay's
 * line has a depth of its own: take the nearest pixels that lie well within the surface. */
vec4 inner(vec2 t, bool only_inner)
{
  vec4 sum = vec4(0.0);
  float total = 0.0;
  for (int k = 0; k < 16; k++) {
    ivec2 step = ivec2(k % 4, k / 4);
    bool within = shows[k];
    for (int n = 0; only_inner && n < 9; n++) {
      ivec2 other = clamp(step + ivec2(n % 3, n / 3) - 1, ivec2(0), ivec2(3));
      within = within && shows[other.y * 4 + other.x];
    }
    vec2 away = vec2(step - 1) - t;
    float weight = within ? exp(-2.0 * dot(away, away)) + 1e-6 : 0.0;
    sum += weight * colours[k];
    total += weight;
  }
  return total > 0.0 ? sum / total : vec4(-1.0);
}

void main()
{
  vec4 found = vec4(own_colour, 1.0);
  ivec2 size = textureSize(direct_tx, 0);
  vec2 place = place_at.z > 1e-9 ? place_at.xy / place_at.z : vec2(-1.0);
  if (all(greaterThanEqual(place, vec2(0.0))) && all(lessThan(place, vec2(1.0)))) {
    place = place * vec2(size) - 0.5;
    vec2 base = floor(place);
    vec2 t = place - base;
    float near = tolerance.x * place_at.w + tolerance.y;
    bool all_show = true;
    bool any_shows = false;
    for (int k = 0; k < 16; k++) {
      ivec2 pixel = clamp(ivec2(base) + ivec2(k % 4, k / 4) - 1, ivec2(0), size - 1);
      colours[k] = texelFetch(direct_tx, pixel, 0);
      shows[k] = has_depth == 0 || abs(depth_at(pixel) - place_at.w) < near;
      all_show = all_show && shows[k];
      any_shows = any_shows || shows[k];
    }
    if (all_show) {
      found = sharp(t);
    }
    else if (any_shows) {
      vec4 well = inner(t, true);
      found = well.a < 0.0 ? inner(t, false) : well;
    }
  }
  frag_colour = found;
}
"""
)

HULL_VERTEX = """
void main()
{
  own_depth = depth;
  gl_Position = clip;
}
"""

# White where the glass is seen: not where something stands before it.
HULL_FRAGMENT = (
    DEPTH
    + """
void main()
{
  ivec2 pixel = ivec2(gl_FragCoord.xy) / side + origin;
  float near = tolerance.x * own_depth + tolerance.y;
  if (has_depth != 0 && depth_at(pixel) < own_depth - near) {
    discard;
  }
  frag_colour = vec4(1.0);
}
"""
)

QUAD_VERTEX = """
void main()
{
  gl_Position = vec4(mix(box.xy, box.zw, corner), 0.0, 1.0);
}
"""

# One light path's part of the light: its weight times what is seen along it. Where no copy is, that
# is the surroundings' colour or, if the direct picture shows none, what stands right behind.
SUM_FRAGMENT = """
void main()
{
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec4 layer = vec4(0.0);
  for (int j = 0; j < side; j++) {
    for (int i = 0; i < side; i++) {
      layer += texelFetch(layer_tx, pixel * side + ivec2(i, j), 0);
    }
  }
  layer /= float(max(1, side * side));
  vec2 place = (vec2(pixel + origin) + 0.5) / float(grid.z) - vec2(grid.xy) - 0.5;
  vec2 base = floor(place);
  vec2 t = place - base;
  vec2 sum = vec2(0.0);
  ivec2 last = textureSize(weight_tx, 0) - 1;
  for (int j = 0; j < 2; j++) {
    for (int i = 0; i < 2; i++) {
      float part = (i == 0 ? 1.0 - t.x : t.x) * (j == 0 ? 1.0 - t.y : t.y);
      sum += part * texelFetch(weight_tx, clamp(ivec2(base) + ivec2(i, j), ivec2(0), last), 0).rg;
    }
  }
  float weight = sum.y > 1e-4 ? sum.x / sum.y : 0.0;
  vec4 behind = beyond;
  if (is_unknown != 0) {
    ivec2 most = textureSize(direct_tx, 0) - 1;
    behind = texelFetch(direct_tx, clamp(pixel + origin, ivec2(0), most), 0);
  }
  frag_colour = weight * (layer + (1.0 - layer.a) * behind);
}
"""

# What a pixel of the view is multiplied by (part 0) and what is added to it (part 1), in the
# scene's colours; what its background, which lies in the overlay, is multiplied by (part 2), and
# the background that is added where a surface stood (part 3).
RESULT_FRAGMENT = """
void main()
{
  ivec2 here = ivec2(gl_FragCoord.xy);
  ivec2 pixel = here - origin;
  float cover = 0.0;
  for (int j = 0; j < side; j++) {
    for (int i = 0; i < side; i++) {
      cover += texelFetch(hull_tx, pixel * side + ivec2(i, j), 0).r;
    }
  }
  cover /= float(side * side);
  vec4 seen = texelFetch(sum_tx, pixel, 0);
  float before = texelFetch(direct_tx, here, 0).a;
  float after = mix(before, min(seen.a, 1.0), cover);
  bool is_open = before < 0.99;
  if (part == 0) {
    frag_colour = vec4(1.0 - cover);
  }
  else if (part == 1) {
    frag_colour = cover * seen;
  }
  else if (part == 2) {
    frag_colour = vec4(is_open ? (1.0 - after) / (1.0 - before) : 1.0);
  }
  else {
    frag_colour = is_open || after > 0.99 ? vec4(0.0) : (1.0 - after) * backdrop;
  }
}
"""
