// SPDX-License-Identifier: GPL-3.0-or-later

/* Whether a place lies in the box of a thing that may stand in glass g; -1: who knows. */
bool in_thing(int g, vec3 p)
{
  if (g < 0) {
    return true;
  }
  int first = int(row(9 + GLASS_ROWS * g).w);
  int count = int(row(1 + GLASS_ROWS * g).w);
  for (int k = 0; k < count; k++) {
    vec3 q = abs(by_rows(first + THING_ROWS * k, vec4(p, 1.0)));
    if (max(max(q.x, q.y), q.z) < BOX_MARGIN) {
      return true;
    }
  }
  return false;
}

/* Whether a ray runs through one of some boxes of things within its reach. It may begin on the thing
 * on which its glass stands, and what is flat has no box behind that. */
bool meets_boxes(int first, int count, vec3 p, vec3 d, float reach)
{
  p -= LAID_ON * d;
  reach += LAID_ON;
  for (int k = 0; k < count; k++) {
    int at = first + THING_ROWS * k;
    vec3 o = by_rows(at, vec4(p, 1.0)), v = by_rows(at, vec4(d, 0.0));
    v = mix(v, vec3(1e-20), lessThan(abs(v), vec3(1e-20)));
    vec3 one = (-BOX_MARGIN - o) / v;
    vec3 two = (BOX_MARGIN - o) / v;
    vec3 enter = min(one, two), leave_ = max(one, two);
    float low = max(max(enter.x, enter.y), max(enter.z, 0.0));
    float high = min(min(leave_.x, leave_.y), min(leave_.z, reach));
    if (low <= high) {
      return true;
    }
  }
  return false;
}

/* How far along a ray, from `low` to `high`, the part u of its way across the view is. `one`, `two`:
 * both ends in clip space. */
float way_at(float u, float low, float high, vec4 one, vec4 two)
{
  return ((1.0 - u) * low * two.w + u * high * one.w) / ((1.0 - u) * two.w + u * one.w);
}

/* Where a ray meets what the view shows: marched through the view's depths, pixel by pixel, and
 * over whole tiles that it passes in front of or behind. `boxes`: the glass within which it runs,
 * where only its things can be met, or -1. `hidden`: it was behind something. */
bool march_direct(vec3 o, vec3 d, float reach, int slot, int boxes, out vec2 at, out float way,
                  out bool hidden)
{
  hidden = false;
  at = vec2(0.0);
  way = reach;
  vec4 begin = view.to_clip * vec4(o, 1.0);
  vec4 step_ = view.to_clip * vec4(d, 0.0);
  float z0 = dot(view.depth_row, vec4(o, 1.0));
  float z1 = dot(view.depth_row.xyz, d);
  float low = 0.0, high = min(reach, view.start.z);
  if (!in_view(begin, step_, z0, z1, low, high)) {
    hidden = true;
    return false;
  }
  hidden = low > 0.0;
  bool leaves = high < min(reach, view.start.z);
  vec4 one = begin + low * step_;
  vec4 two = begin + high * step_;
  vec2 a = pixel_at(one);
  vec2 span = pixel_at(two) - a;
  float pixels = max(max(abs(span.x), abs(span.y)), 1e-3);
  float by_pixel = min(1.0 / pixels, 1.0);
  vec2 heading = span / pixels;
  vec2 per = 1.0 / max(abs(span), vec2(1e-6));
  float u = 0.0;
  /* A ray that leaves a glass for the table that it stands on begins on the table. */
  float shown_before = depth_between(a);
  float before = z0 + low * z1 - shown_before;
  float z_before = z0 + low * z1;
  bool behind = before > NEARER;
  /* Depth of the edge that the ray passed behind. */
  float limb = UNKNOWN;
  float u_before = 0.0;
  /* How far the ray lay behind the thing's back. */
  float over_before = 0.0;
  hidden = hidden || behind;
  for (int k = 0; k < DIRECT_STEPS; k++) {
    if (u >= 1.0) {
      hidden = hidden || leaves;
      return false;
    }
    /* Over the whole tile, if all it shows is behind the ray or in front of it. */
    vec2 pixel = a + u * span;
    ivec2 tile = ivec2(pixel) / TILE;
    vec2 room = mix(pixel - vec2(tile * TILE), vec2((tile + 1) * TILE) - pixel,
                    greaterThan(span, vec2(0.0)));
    float next = min(1.0, u + min(room.x * per.x, room.y * per.y) + 0.02 * by_pixel);
    vec2 range = texelFetch(tile_tx, clamp(tile, ivec2(0), textureSize(tile_tx, 0) - 1), 0).rg;
    float t = way_at(next, low, high, one, two);
    float z = z0 + t * z1;
    float back = limb > UNKNOWN ? 2.0 * limb - range.x : UNKNOWN;
    if (behind ? min(z, z_before) > max(range.y, back) : max(z, z_before) < range.x) {
      u = next;
      u_before = u;
      z_before = z;
      over_before = 0.0;
      shown_before = UNKNOWN;
      continue;
    }
    /* In a tile that is not passed over the first look is where the ray enters it. */
    bool enters = shown_before <= UNKNOWN;
    /* What comes just round an edge is narrow. */
    bool has_edge = range.y - range.x > edge_at(range.x);
    next = enters ? u : min(1.0, u + (has_edge ? 1.0 : STRIDE) * by_pixel);
    t = way_at(next, low, high, one, two);
    z = z0 + t * z1;
    pixel = a + next * span;
    float shown = depth_near(pixel);
    float gap = z - shown;
    float jump = shown_before - shown;
    bool met = false;
    /* Where along the way there is an edge whose depth is to be known. */
    float edge = UNKNOWN;
    if (gap <= 0.0) {
      behind = false;
    }
    else if (enters) {
      /* An edge lies just at the tile's: the ray meets it or passes behind it. */
      edge = !behind && gap > SLACK ? u : UNKNOWN;
    }
    else if (!behind) {
      /* One surface goes on from pixel to pixel. Where it ends the ray may pass behind it, or before
       * its edge and so meet it: single looks lie too far within to tell. */
      met = jump < edge_at(shown) + abs(z - z_before);
      if (!met) {
        float outside = u;
        edge = next;
        for (int n_ = 0; n_ < EDGE_HALVINGS; n_++) {
          float middle = 0.5 * (outside + edge);
          bool is_on = depth_near(a + middle * span) < shown + 0.5 * jump;
          outside = is_on ? outside : middle;
          edge = is_on ? middle : edge;
        }
      }
    }
    else if (jump > edge_at(shown)) {
      edge = next;
    }
    else if (jump < -edge_at(shown)) {
      limb = UNKNOWN;
    }
    if (edge > UNKNOWN) {
      limb = limb_at(a + edge * span, heading);
      met = !behind && z0 + way_at(edge, low, high, one, two) * z1 < limb;
      behind = !met;
      over_before = 0.0;
    }
    /* Round things are as thick behind their edge as before it: the back is the front's mirror
     * image. */
    float over = z + shown - 2.0 * limb - SLACK;
    if (behind && limb > UNKNOWN && over < 0.0) {
      vec3 place = o + t * d;
      if (is_seen(slot, place) || is_seen(second_of(slot), place)) {
        /* What is seen from within the glass is not guessed: the capture tells. */
        limb = UNKNOWN;
      }
      else {
        /* Flat things are not as thick: their boxes tell. */
        met = in_thing(boxes, place);
      }
    }
    if (met) {
      float part = clamp(before < 0.0 ? -before / (gap - before) : 0.0, 0.0, 1.0);
      if (behind) {
        part = over_before > 0.0 ? over_before / (over_before - over) : 1.0;
      }
      float found = mix(u_before, next, part);
      at = a + found * span;
      way = way_at(found, low, high, one, two);
      return true;
    }
    hidden = hidden || behind;
    u = next;
    u_before = u;
    before = min(gap, -1e-9);
    z_before = z;
    shown_before = shown;
    over_before = over;
  }
  hidden = true;
  return false;
}

/* Of a ray that no view shows to its end: where a capture shows what lies beside the edge behind
 * which the ray went, as the direction from the capture and its number; less than 0 for none. */
vec4 last_shown = vec4(-1.0);
/* And the ways along it between which no view shows it. */
vec2 unseen_ways = vec2(0.0, NOWHERE);

/* Where a ray meets what a capture shows: marched by equal angles round the capture's centre.
 * `hidden`: it was behind something. */
bool march_capture(int slot, vec3 o, vec3 d, float reach, out vec3 at, out float way,
                   out bool hidden)
{
  vec4 capture = capture_at(slot);
  vec3 q = o - capture.xyz;
  float foot = -dot(q, d);
  vec3 nearest = q + foot * d;
  float apart = length(nearest);
  vec3 n = apart > 1e-5 ? nearest / apart : normalize(cross(d, vec3(d.y, d.z, -d.x)));
  apart = max(apart, 1e-5);
  float last = min(reach, view.start.z);
  /* At an angle a the ray is at apart / cos(a) · (cos(a) n + sin(a) d). */
  float low = atan(-foot, apart);
  float high = atan(last - foot, apart);
  int count = clamp(int((high - low) * capture.w / CAPTURE_STRIDE) + 3, 3, CAPTURE_STEPS);
  vec2 turn = vec2(cos((high - low) / float(count)), sin((high - low) / float(count)));
  vec2 angle = vec2(cos(low), sin(low));
  float before = 0.0;
  bool behind = smooth_gap(slot, q) > THICK_PART * length(q);
  vec2 ways = behind ? vec2(0.0) : vec2(NOWHERE, 0.0);
  hidden = behind;
  at = vec3(0.0);
  way = reach;
  for (int k = 1; k <= count; k++) {
    angle = vec2(angle.x * turn.x - angle.y * turn.y, angle.x * turn.y + angle.y * turn.x);
    float t = k == count ? last : foot + apart * angle.y / max(angle.x, 1e-9);
    float gap = capture_gap(slot, q + t * d);
    gap = gap > 0.0 ? smooth_gap(slot, q + t * d) : gap;
    if (!behind && gap > 0.0) {
      float near = before, far = t;
      for (int n_ = 0; n_ < HALVINGS; n_++) {
        /* Half the angle between both: the sum of their directions. */
        vec2 sum_ = normalize(vec2(apart, near - foot)) + normalize(vec2(apart, far - foot));
        float middle = foot + apart * sum_.y / max(sum_.x, 1e-9);
        if (smooth_gap(slot, q + middle * d) > 0.0) {
          far = middle;
        }
        else {
          near = middle;
        }
      }
      /* Along one pixel depths are linear: the place between both where the gap ends. */
      float gap_near = smooth_gap(slot, q + near * d);
      float gap_far = smooth_gap(slot, q + far * d);
      float part = gap_far > gap_near ? clamp(-gap_near / (gap_far - gap_near), 0.0, 1.0) : 1.0;
      way = mix(near, far, part);
      at = q + way * d;
      /* Behind an edge the ray may pass: halving has then led to where depths jump. */
      if (gap_far - gap_near < THIN + THICK_PART * length(at) + 2.0 * (far - near) &&
          abs(smooth_gap(slot, at)) < THIN + THICK_PART * length(at)) {
        return true;
      }
      behind = hidden = true;
      ways.x = min(ways.x, near);
      if (last_shown.w < 0.0) {
        /* Right beside the edge pixels are mixed. */
        vec3 beside = normalize(q + near * d), off = normalize(q + before * d) - beside;
        off *= min(1.0, CAPTURE_STRIDE / capture.w / max(length(off), 1e-9));
        last_shown = vec4(beside + off, float(slot));
      }
    }
    else if (gap <= 0.0) {
      ways.y = behind ? t : ways.y;
      behind = false;
    }
    before = t;
  }
  unseen_ways = vec2(max(unseen_ways.x, ways.x), min(unseen_ways.y, behind ? NOWHERE : ways.y));
  way = reach;
  return false;
}
