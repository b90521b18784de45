// SPDX-License-Identifier: GPL-3.0-or-later

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
