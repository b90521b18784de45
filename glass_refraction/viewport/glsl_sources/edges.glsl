// SPDX-License-Identifier: GPL-3.0-or-later

/* Differences from pixel to pixel, as they are and as part of the colour, that are too much. */
#define EDGE_STEP vec4(0.04)
#define EDGE_PART 0.16

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
