// SPDX-License-Identifier: GPL-3.0-or-later

/* The next interface of glass g that a ray (in the glass's frame, unit direction) meets in medium
 * m: its row, -1 for none; how far; and of profiles and meshes where on it. */
int next_interface(int g, int m, vec3 o, vec3 d, float reach, int skip, out float way,
                   out vec3 spot)
{
  vec4 record = row(1 + GLASS_ROWS * g);
  int first = int(record.x), count = int(record.y);
  int met = -1;
  way = reach;
  spot = vec3(0.0);
#ifdef MESHES
  if (int(row(first).x) == MESH) {
    spot = meet_mesh(row(first + 1), o, d, reach, skip, way);
    return spot.x < 0.0 ? -1 : first;
  }
#endif
  float p2 = dot(d.xy, d.xy);
  float outward = dot(o.xy, d.xy);
  float ell = o.x * d.y - o.y * d.x;
  float size2 = dot(o.xy, o.xy);
  vec2 middle = row(2 + GLASS_ROWS * g).xy;
  int sides = -1;
  for (int k = 0; k < count; k++) {
    int at = first + INTERFACE_ROWS * k;
    vec4 face = row(at);
    bool back = m == int(face.z);
    if (!back && m != int(face.y)) {
      continue;
    }
    vec4 s = row(at + 1);
    int kind = int(face.x);
    float t = NOWHERE;
    float mark = 0.0;
    if (kind == CYLINDER) {
      t = meet_round(s.x, size2, outward, max(p2, 1e-30), p2 * s.x * s.x - ell * ell, back);
      float z = o.z + t * d.z;
      if (t < way && !((s.w > 0.5 ? z > s.y : z >= s.y) && z <= s.z)) {
        t = NOWHERE;
      }
    }
    else if (kind == PLANE || kind == LID) {
      if (back ? d.z > 0.0 : d.z < 0.0) {
        t = (s.x - o.z) / d.z;
        t = t >= -SKIN * max(1.0, abs(o.z)) ? max(t, 0.0) : NOWHERE;
      }
      if (t < way) {
        vec2 p = o.xy + t * d.xy;
        if (kind == PLANE) {
          float r = length(p);
          t = r >= s.y && r <= s.z ? t : NOWHERE;
        }
        else {
          p -= middle;
          if (dot(p, p) >= s.w && !in_outline(int(s.y), int(s.z), p + middle)) {
            t = NOWHERE;
          }
        }
      }
    }
    else if (kind == SIDE) {
      if (sides < 0) {
        /* All that follow are sides. Within a circle that lies in the outline none is met. */
        sides = k;
        vec2 begin = o.xy - middle, end = begin + way * d.xy;
        if (max(dot(begin, begin), dot(end, end)) < row(first + 1).w) {
          break;
        }
      }
      if ((k - sides) % SIDE_BUNCH == 0) {
        /* A circle round the next ones: not all of them need be looked at. */
        float room = row(at + 2).w;
        vec2 off = o.xy - row(at + INTERFACE_ROWS * (SIDE_BUNCH / 2) + 1).xy;
        off += clamp(-dot(off, d.xy) / max(p2, 1e-30), 0.0, way) * d.xy;
        if (room > 0.0 && dot(off, off) > room) {
          k += SIDE_BUNCH - 1;
          continue;
        }
      }
      float away = d.x * s.w - d.y * s.z;
      if (back ? away > 0.0 : away < 0.0) {
        t = ((s.x - o.x) * s.w - (s.y - o.y) * s.z) / away;
        t = t >= -SKIN * max(1.0, length(o.xy)) ? max(t, 0.0) : NOWHERE;
      }
      if (t < way) {
        vec4 limits = row(at + 2);
        vec3 p = o + t * d;
        float along = dot(p.xy - s.xy, s.zw);
        if (along < -SKIN || along > limits.x + SKIN || p.z < limits.y - SKIN ||
            p.z > limits.z + SKIN) {
          t = NOWHERE;
        }
      }
    }
    else if (kind == SHELL) {
      vec3 turn = cross(o, d);
      t = meet_round(s.x, dot(o, o), dot(o, d), 1.0, s.x * s.x - dot(turn, turn), back);
    }
    else {
      float from = -SKIN;
      for (int n = 0; n < CHORD_TRIES; n++) {
        vec2 found = meet_chords(at, o, d, back, from);
        if (found.x >= way + 1e-3) {
          break;
        }
        float exact = found.x;
        mark = found.y;
        if (refine(at, o, d, back, exact, mark)) {
          float z = o.z + exact * d.z;
          if ((s.z > 0.5 ? z > s.x : z >= s.x) && z <= s.y) {
            t = max(exact, 0.0);
            break;
          }
        }
        from = found.x + 1e-4;
      }
    }
    if (t < way) {
      way = t;
      met = at;
      spot.x = mark;
    }
  }
  return met;
}

/* Unit normal towards the front of a closed form's interface at a place, which is put onto it. */
vec3 closed_normal(int at, float spot, inout vec3 p)
{
  vec4 face = row(at), s = row(at + 1);
  int kind = int(face.x);
  if (kind == CYLINDER) {
    vec2 n = normalize(p.xy);
    p.xy = s.x * n;
    return vec3(n, 0.0);
  }
  if (kind == PLANE || kind == LID) {
    p.z = s.x;
    return vec3(0.0, 0.0, 1.0);
  }
  if (kind == SIDE) {
    return vec3(s.w, -s.z, 0.0);
  }
  if (kind == SHELL) {
    vec3 n = normalize(p);
    p = s.x * n;
    return n;
  }
  vec4 where_ = row(at + 2);
  vec4 c = on_curve(int(where_.z), int(where_.w), spot);
  float size = length(p.xy);
  vec2 axis = size > 1e-12 ? p.xy / size : vec2(1.0, 0.0);
  vec2 n = vec2(c.w, -c.z) / max(length(c.zw), 1e-20);
  p = vec3(c.x * axis, c.y);
  return vec3(n.x * axis, n.y);
}

#ifdef MESHES
/* A normal of two numbers, see `_flattened` in trees.py. */
vec3 unfolded(float x, float y)
{
  vec2 f = vec2(x, y) - UNFOLDED;
  vec3 n = vec3(f, 1.0 - abs(f.x) - abs(f.y));
  if (n.z < 0.0) {
    n.xy = (1.0 - abs(f.yx)) * mix(vec2(1.0), vec2(-1.0), lessThan(f, vec2(0.0)));
  }
  return normalize(n);
}

/* A colour in one number, see `_in_one` in trees.py. */
vec3 unpacked(float number)
{
  return mod(floor(number / vec3(65536.0, 256.0, 1.0)), 256.0) / 255.0;
}

/* The first texel of a mesh's paint where a ray meets it, 0 if it is not painted; and the shares of
 * the corners there. */
int paint_at(int at, vec3 spot, out vec3 shares)
{
  vec4 mesh = row(at + 1);
  shares = vec3(1.0 - spot.y - spot.z, spot.yz);
  int number = (int(spot.x) - int(mesh.z)) / TRIANGLE_TEXELS;
  return mesh.w > 0.0 ? int(mesh.w) + PAINT_TEXELS * number : 0;
}

/* What a mesh lets through at a place where it refracts and where it reflects, if it is painted. */
void colours_at(int at, vec3 spot, inout vec3 through, inout vec3 off)
{
  vec3 shares;
  int k = paint_at(at, spot, shares);
  if (k > 0) {
    vec4 first = texel(k), second = texel(k + 1), third = texel(k + 2);
    through = mat3(first.rgb, second.rgb, third.rgb) * shares;
    off = mat3(unpacked(first.w), unpacked(second.w), unpacked(third.w)) * shares;
  }
}

/* Roughness of a mesh at a place. */
float roughness_at(int at, vec3 spot)
{
  float most = row(at + 2).w;
  if (most == 0.0) {
    return 0.0;
  }
  vec3 shares;
  int k = paint_at(at, spot, shares);
  return k > 0 ? dot(texel(k + 3).xyz, shares) : most;
}
#endif

/* Unit normal towards the front of an interface at a place, which is put onto it. `d`: of the ray
 * that meets it. `flat_`: the surface's own, which that of a smooth mesh differs from. */
vec3 normal_at(int at, vec3 spot, vec3 d, inout vec3 p, out vec3 flat_)
{
#ifdef MESHES
  if (int(row(at).x) == MESH) {
    int k = int(spot.x);
    vec4 corner = texel(k), e1 = texel(k + 1), e2 = texel(k + 2);
    p = corner.xyz + spot.y * e1.xyz + spot.z * e2.xyz;
    flat_ = normalize(cross(e1.xyz, e2.xyz));
    vec4 n0 = texel(k + 3), n1 = texel(k + 4), n2 = texel(k + 5);
    if (corner.w > 0.0 && dot(flat_, d) > 0.0) {
      n0.xyz = unfolded(corner.w, e1.w);
      n1.xyz = unfolded(e2.w, n0.w);
      n2.xyz = unfolded(n1.w, n2.w);
    }
    vec3 n = (1.0 - spot.y - spot.z) * n0.xyz + spot.y * n1.xyz + spot.z * n2.xyz;
    return dot(n, n) > 0.0 ? normalize(n) : flat_;
  }
#endif
  flat_ = closed_normal(at, spot.x, p);
  return flat_;
}
