// SPDX-License-Identifier: GPL-3.0-or-later

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
