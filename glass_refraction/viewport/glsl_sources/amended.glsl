// SPDX-License-Identifier: GPL-3.0-or-later

/* Part of the differences in a block from which on its values lie on no plane, and below which two
 * are the same. */
#define TWISTED 0.25
#define SAME 0.05

float raw_value(sampler2D tx, ivec2 pixel)
{
  return texelFetch(tx, clamp(pixel, ivec2(0), textureSize(tx, 0) - 1), 0).r;
}

/* Of a pixel beside another; where a line is, `guess` stands in. */
float value_beside(sampler2D tx, ivec2 pixel, float guess)
{
  float value = raw_value(tx, pixel);
  return is_wire(clamp(pixel, ivec2(0), textureSize(tx, 0) - 1), value) ? guess : value;
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
  float opposite = value_beside(tx, other, min(across + along - own, 1.0));
  float low = min(min(own, across), min(along, opposite));
  float high = max(max(own, across), max(along, opposite));
  float span = high - low;
  /* The least value, and the one opposite of it. */
  bool is_own = own == low, is_opposite = opposite == low, is_across = across == low;
  ivec2 least_ = is_own ? pixel : (is_opposite ? other : (is_across ? right : up));
  ivec2 apart = is_own ? other : (is_opposite ? pixel : (is_across ? up : right));
  float beyond_ = is_own ? opposite : (is_opposite ? own : (is_across ? along : across));
  vec2 rest = is_own || is_opposite ? vec2(across, along) : vec2(own, opposite);
  /* Three that lie as near, before one that ended at 1, may have a plane's values; but a plane comes
   * nearer beside the block. */
  float rise = min(rest.x, rest.y) - low;
  float ahead = max(value_beside(tx, 2 * least_ - ivec2(apart.x, least_.y), low),
                    value_beside(tx, 2 * least_ - ivec2(least_.x, apart.y), low));
  bool is_plane = abs(own + opposite - across - along) <= TWISTED * span &&
                  (high < 1.0 || rise <= TWISTED * span || ahead < low - 0.5 * rise);
  if (is_plane) {
    float value = own - abs(own - across) - abs(own - along);
    if (high >= 1.0 && own < 1.0) {
      /* It ended at 1: the nearer one is beside the block. */
      value = min(value, raw_value(tx, across >= 1.0 ? 2 * pixel - right : 2 * pixel - up));
    }
    return value;
  }
  /* One pixel lies nearer than the others, or farther: opposite of the least value or there. */
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
