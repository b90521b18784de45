// SPDX-License-Identifier: GPL-3.0-or-later

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
