// SPDX-License-Identifier: GPL-3.0-or-later

/* The course after one more interface of glass g, whose row is `met`. */
int crossing(int g, int met)
{
  if (course < 0 || course >= LONGEST_COURSE) {
    return NO_COURSE;
  }
  int number = (met - int(row(1 + GLASS_ROWS * g).x)) / INTERFACE_ROWS;
  return course * COURSE_BASE + min(number, COURSE_BASE - 2) + 1;
}

/* Where a circle or sphere is met (see _meet_round in optics/surfaces.py), NOWHERE if not ahead.
 * `size2`: squared distance of the start from the middle. */
float meet_round(float radius, float size2, float outward, float p2, float square, bool back)
{
  if (square <= 0.0) {
    return NOWHERE;
  }
  float root = sqrt(square);
  float size = sqrt(size2);
  float beyond = (size - radius) * (size + radius);
  float way;
  if (back) {
    float far = root + abs(outward);
    way = outward > 0.0 ? -beyond / max(far, 1e-30) : far / p2;
  }
  else {
    if (outward >= 0.0) {
      return NOWHERE;
    }
    way = beyond / max(root - outward, 1e-30);
  }
  return way >= -SKIN * max(1.0, size) ? max(way, 0.0) : NOWHERE;
}

bool in_outline(int first, int count, vec2 p)
{
  bool inside = false;
  for (int k = 0; k < count; k++) {
    vec4 side = row(first + k);
    if ((side.y <= p.y) != (side.w <= p.y)) {
      if (p.x < side.x + (p.y - side.y) * ((side.z - side.x) / (side.w - side.y))) {
        inside = !inside;
      }
    }
  }
  return inside;
}

/* Radius, height and their derivatives by t. */
vec4 on_curve(int cubics, int count, float t)
{
  int k = clamp(int(floor(t)), 0, count - 1);
  float s = t - float(k);
  vec4 r = row(cubics + CUBIC_ROWS * k);
  vec4 z = row(cubics + CUBIC_ROWS * k + 1);
  return vec4(((r.w * s + r.z) * s + r.y) * s + r.x,
              ((z.w * s + z.z) * s + z.y) * s + z.x,
              (3.0 * r.w * s + 2.0 * r.z) * s + r.y,
              (3.0 * z.w * s + 2.0 * z.z) * s + z.y);
}

/* The nearest chord of a profile that a ray meets after `from`: (way, t of the curve). Chords are
 * taken a little longer than they are, and a little wider than the ray needs to meet them: the
 * curve lies beside them, and `refine` decides. */
vec2 meet_chords(int at, vec3 o, vec3 d, bool back, float from)
{
  vec4 where_ = row(at + 2);
  int bunches = int(where_.y);
  float p2 = dot(d.xy, d.xy);
  float outward = dot(o.xy, d.xy);
  float ell = o.x * d.y - o.y * d.x;
  float ell2 = ell * ell;
  float size2 = dot(o.xy, o.xy);
  float nearest2 = outward < 0.0 ? ell2 / max(p2, 1e-30) : size2;
  vec2 found = vec2(NOWHERE, 0.0);
  for (int b = 0; b < bunches; b++) {
    vec4 box = row(int(where_.x) + 2 * b);
    /* The ray's part within the cylinder round the bunch, and its heights there. */
    float wide2 = box.z * box.z + SAG_SLACK;
    if (nearest2 > wide2) {
      continue;
    }
    float root = sqrt(max(p2 * wide2 - ell2, 0.0));
    float enters = p2 > 1e-12 ? max((-outward - root) / p2, 0.0) : 0.0;
    float leaves = p2 > 1e-12 ? (root - outward) / p2 : 1e6;
    float one = o.z + enters * d.z;
    float two = o.z + leaves * d.z;
    if (leaves < from || enters > found.x || min(one, two) > box.y + SAG_SLACK ||
        max(one, two) < box.x - SAG_SLACK) {
      continue;
    }
    int count = int(row(int(where_.x) + 2 * b + 1).x);
    for (int c = 0; c < count; c++) {
      int chord = int(box.w) + CHORD_ROWS * c;
      vec4 f = row(chord);
      float r0 = f.x, z0 = f.y, dr = f.z, dz = f.w;
      float rise = r0 * dz + dr * (o.z - z0);
      float slope = dr * d.z;
      vec2 side = rise * d.xy - slope * o.xy;
      float square = dot(side, side) - dz * dz * ell2;
      if (square < -SAG_SLACK) {
        continue;
      }
      float a = dz * dz * p2 - slope * slope;
      float h = dz * dz * outward - slope * rise;
      float k = dz * dz * size2 - rise * rise;
      bool touches_ = square <= 0.0;
      float root2 = abs(dz) * sqrt(max(square, 0.0));
      float q = -(h + (h < 0.0 ? -root2 : root2));
      vec4 s = row(chord + 1);
      for (int n = 0; n < 2; n++) {
        float below = n == 0 ? a : q;
        float way = (n == 0 ? q : k) / (below == 0.0 ? 1e-30 : below);
        if (way >= found.x || way < from) {
          continue;
        }
        vec3 p = o + way * d;
        float size = length(p.xy);
        float along = (size - r0) * dr + (p.z - z0) * dz;
        float across = (size - r0) * dz - (p.z - z0) * dr;
        float towards = dz * dot(p.xy, d.xy) - dr * d.z * size;
        if (along < -0.05 * s.z || along > 1.05 * s.z || abs(across) > 1e-3 ||
            (!touches_ && (back ? towards <= 0.0 : towards >= 0.0))) {
          continue;
        }
        found = vec2(way, s.x + s.y * clamp(along / s.z, 0.0, 1.0));
      }
    }
  }
  return found;
}

/* The same on the curve itself, by Newton's method; false where it finds none there. */
bool refine(int at, vec3 o, vec3 d, bool back, inout float way, inout float t)
{
  vec4 where_ = row(at + 2);
  int ends = int(row(at + 1).w);
  int cubics = int(where_.z), count = int(where_.w);
  /* Distances grow with the start's: begin near the meeting. */
  vec3 near = o + way * d;
  float moved = 0.0;
  float p2 = dot(d.xy, d.xy);
  float outward = dot(near.xy, d.xy);
  float size2 = dot(near.xy, near.xy);
  vec4 c;
  for (int n = 0; n < NEWTON_STEPS; n++) {
    c = on_curve(cubics, count, t);
    float off = (p2 * moved + 2.0 * outward) * moved + size2 - c.x * c.x;
    float rise = near.z + moved * d.z - c.y;
    float w = 2.0 * (outward + moved * p2);
    float rr = 2.0 * c.x * c.z;
    float determinant = rr * d.z - w * c.w;
    float inverse = 1.0 / (determinant == 0.0 ? 1e-30 : determinant);
    moved += clamp((c.w * off - rr * rise) * inverse, -2.0, 2.0);
    t += clamp((d.z * off - w * rise) * inverse, -0.7, 0.7);
    if ((ends & 1) != 0) {
      t = abs(t);
    }
    if ((ends & 2) != 0 && t > float(count)) {
      t = 2.0 * float(count) - t;
    }
    t = clamp(t, -0.5, float(count) + 0.5);
  }
  c = on_curve(cubics, count, t);
  vec3 p = near + moved * d;
  float size = length(p.xy);
  way += moved;
  float towards = c.w * dot(p.xy, d.xy) - c.z * d.z * size;
  bool rests = abs(size - c.x) + abs(p.z - c.y) < 2e-5 * (1.0 + abs(way));
  return rests && t >= -1e-4 && t <= float(count) + 1e-4 && way >= -1e-5 &&
         (back ? towards > 0.0 : towards < 0.0);
}
