// SPDX-License-Identifier: GPL-3.0-or-later

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
    frag = vec4(erased ? 0.0 : (is_open ? min((1.0 - after) / (1.0 - before), 1.0) : 1.0));
  }
  else {
    /* The overlay takes no factor above one: more background than it has is added. */
    float lacks = erased ? (1.0 - covers) * (1.0 - before) : (is_open ? before - after : 0.0);
    frag = max(lacks, 0.0) * backdrop;
  }
}
