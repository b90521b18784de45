// SPDX-License-Identifier: GPL-3.0-or-later

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
