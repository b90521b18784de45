// SPDX-License-Identifier: GPL-3.0-or-later

vec4 sum = vec4(0.0);
float got = 0.0;

/* The part of a ray that the view can show: false if there is none. */
bool in_view(vec4 begin, vec4 step_, float z0, float z1, inout float low, inout float high)
{
  for (int k = 0; k < 6; k++) {
    float side = k % 2 == 0 ? 1.0 : -1.0;
    /* Left and right, below and above, near and far. */
    float f = k < 4 ? begin.w + side * begin[k / 2] : side * (z0 - view.size[k - 2]);
    float s = k < 4 ? step_.w + side * step_[k / 2] : side * z1;
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
  float near = texelFetch(depth_tx, middle, 0).g;
  if (near == 0.0) {
    return middle;
  }
  vec2 f = clamp(at - vec2(middle) - 0.5, -0.5, 0.5);
  float limit = near + edge_at(near);
  float votes = 0.0;
  vec2 most = vec2(-1.0);
  ivec2 nearer = middle, farther = middle;
  for (int k = 0; k < 9; k++) {
    ivec2 one = ivec2(k % 3, k / 3) - 1;
    ivec2 pixel = clamp(middle + one, ivec2(0), last);
    /* Of a quadratic B-spline. */
    vec2 off = abs(vec2(one) - f), rest = 1.5 - off;
    vec2 shares = mix(0.75 - off * off, 0.5 * rest * rest, greaterThan(off, vec2(0.5)));
    float share = shares.x * shares.y;
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

/* The colour at a place, of the thing that counts for it: at edges without the others'. The engine's
 * samples mix those on both sides of an edge, so pixels that lie off it count for more. */
vec4 thing_at(vec2 at)
{
  ivec2 pixel = pixel_for(at);
  float shown = texelFetch(depth_tx, pixel, 0).r;
  ivec2 last = ivec2(view.size.xy) - 1;
  vec2 low = floor(at - 0.5);
  vec2 t = at - 0.5 - low;
  vec4 mixed = vec4(0.0);
  float whole = 0.0;
  for (int k = 0; k < 4; k++) {
    ivec2 one = ivec2(k & 1, k >> 1);
    ivec2 there = clamp(ivec2(low) + one, ivec2(0), last);
    vec2 parts = mix(1.0 - t, t, vec2(one));
    vec2 other = texelFetch(depth_tx, there, 0).rg;
    if (abs(other.r - shown) < edge_at(min(other.r, shown))) {
      float part = parts.x * parts.y * (other.g == 0.0 ? 1.0 : MIXED);
      whole += part;
      mixed += part * texelFetch(direct_tx, there, 0);
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
