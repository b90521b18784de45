// SPDX-License-Identifier: GPL-3.0-or-later

/* Part of the differences in a block from which on its values lie on no plane, and below which two
 * are the same. */
#define TWISTED 0.25
#define SAME 0.05

float raw_value(sampler2D tx, ivec2 pixel)
{
  return texelFetch(tx, clamp(pixel, ivec2(0), textureSize(tx, 0) - 1), 0).r;
}

/* Of a pixel beside one with the value `own`, which stands in where a line may be. */
float value_beside(sampler2D tx, ivec2 pixel, float own)
{
  return texelFetch(wire_tx, pixel, 0).r > 1.0 ? raw_value(tx, pixel) : own;
}

float value_of(sampler2D tx, ivec2 pixel)
{
  float own = raw_value(tx, pixel);
  if (amended == 0 || is_wire(pixel, own)) {
    return own;
  }
  ivec2 other = min(pixel ^ ivec2(1), textureSize(tx, 0) - 1);
  ivec2 right = ivec2(other.x, pixel.y), up = ivec2(pixel.x, other.y);
  float across = value_beside(tx, right, own), along = value_beside(tx, up, own);
  float opposite = value_beside(tx, other, own);
  float low = min(min(own, across), min(along, opposite));
  float high = max(max(own, across), max(along, opposite));
  float span = high - low;
  if (abs(own + opposite - across - along) <= TWISTED * span) {
    float value = own - abs(own - across) - abs(own - along);
    if (high >= 1.0 && own < 1.0) {
      /* It ended at 1: the nearer one is beside the block. */
      value = min(value, raw_value(tx, across >= 1.0 ? 2 * pixel - right : 2 * pixel - up));
    }
    return value;
  }
  /* One pixel lies nearer than the others, or farther: opposite of the least value or there. */
  bool is_own = own == low, is_opposite = opposite == low, is_across = across == low;
  ivec2 least_ = is_own ? pixel : (is_opposite ? other : (is_across ? right : up));
  ivec2 apart = is_own ? other : (is_opposite ? pixel : (is_across ? up : right));
  float beyond_ = is_own ? opposite : (is_opposite ? own : (is_across ? along : across));
  vec2 rest = is_own || is_opposite ? vec2(across, along) : vec2(own, opposite);
  bool is_apart = pixel == apart;
  if (min(rest.x, rest.y) < min(beyond_ - SAME * span, 1.0)) {
    /* Three lie as near. */
    return is_apart ? max(rest.x, rest.y) : low;
  }
  if (beyond_ < 1.0) {
    return is_apart ? 2.0 * low - beyond_ : low;
  }
  float nearer = raw_value(tx, 2 * apart - least_);
  if (nearer < low - SAME * span) {
    return is_apart ? nearer : low;
  }
  /* Nothing stands behind the three. */
  return is_apart ? 1.0 : low;
}
