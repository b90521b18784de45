// SPDX-License-Identifier: GPL-3.0-or-later

/* By how much a line may lie before the nearest edge here and behind it, as part of the depth, of
 * `least` at least: overlays draw lines a little nearer, and edges are drawn a pixel wider here. */
#define WIRE_BEFORE 0.004
#define WIRE_BEHIND 0.03

float depth_of(float value) { return (line.x + line.y * value) / (line.z + line.w * value); }

bool is_wire(ivec2 pixel, float value)
{
  float wire = texelFetch(wire_tx, pixel, 0).r;
  if (wire > 1.0 || value >= 1.0) {
    return false;
  }
  float depth = depth_of(value);
  float behind = (depth - depth_of(wire)) / max(abs(depth), least);
  return behind > -WIRE_BEFORE && behind < WIRE_BEHIND;
}
