// SPDX-License-Identifier: GPL-3.0-or-later

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

float depth_at(ivec2 pixel)
{
  float value = value_of(depth_tx, clamp(pixel, ivec2(0), textureSize(depth_tx, 0) - 1));
  return value < 1.0 ? depth_of(value) : 1e20;
}

bool goes_on(float one, float other) { return max(one, other) < GOES_ON * min(one, other); }

/* A pixel whose colour is a thing's own: EEVEE's samples mix those on both sides of an edge. */
ivec2 within(ivec2 pixel)
{
  float own = depth_at(pixel);
  for (int k = 0; k < 4; k++) {
    ivec2 step_ = (k & 1) == 0 ? ivec2(1 - (k & 2), 0) : ivec2(0, 1 - (k & 2));
    if (!goes_on(own, depth_at(pixel + step_)) && goes_on(own, depth_at(pixel - step_))) {
      return pixel - step_;
    }
  }
  return pixel;
}

void main()
{
  ivec2 pixel = beside_wires(ivec2(gl_FragCoord.xy) - origin);
  ivec2 inner = amended != 0 ? within(pixel) : pixel;
  color = texelFetch(face_tx, clamp(inner, ivec2(0), textureSize(face_tx, 0) - 1), 0);
  float value = value_of(depth_tx, pixel);
  reach = vec4(value < 1.0 ? depth_of(value) : (color.a > 0.5 ? 1e20 : -1e20));
}
