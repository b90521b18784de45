// SPDX-License-Identifier: GPL-3.0-or-later

ivec4 drawn_of(int g) { return g >= 0 && g < MOST_DRAWN ? drawn.glasses[g] : ivec4(0, 0, -1, 0); }

vec4 drawn_at(int number) { return texelFetch(drawn_tx, ivec3(sampled, number), 0); }

bool ends(vec3 p, vec3 d, vec4 light, int g, vec3 taken, bool boxed, float way, int number)
{
  ivec4 known = drawn_of(g);
  bool leaves = way >= NOWHERE;
  if (known.z >= 0 && course > 0) {
    vec4 shown = drawn_at(known.z);
    if (leaves && course == known.x) {
      bool any_ = shown.a == EXIT;
      add(any_ ? vec4(shown.rgb, 1.0) : beyond(p, d, capture_of(g)), light);
      return true;
    }
    if (course == known.y && boxed) {
      if (shown.a == HELD) {
        add(vec4(shown.rgb, 1.0), light);
        return true;
      }
      if (!leaves) {
        return false;
      }
    }
  }
  return ends_by_ray(p, d, light, g, taken, boxed, way, number);
}
