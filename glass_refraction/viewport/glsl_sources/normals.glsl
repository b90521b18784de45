// SPDX-License-Identifier: GPL-3.0-or-later

#ifdef MESHES
/* An interpolated normal off which no ray is reflected into the face (see `bent` in
 * optics/facets.py). */
bool is_right(vec3 n, vec3 flat_, vec3 d, float least)
{
  return dot(n, d) < 0.0 && dot(reflect(d, n), flat_) >= least;
}

vec3 bent(vec3 n, vec3 flat_, vec3 d)
{
  float least = min(-BENT_SHARE * dot(flat_, d), BENT_CLEAR);
  if (n == flat_ || is_right(n, flat_, d, least)) {
    return n;
  }
  float low = 0.0, high = 1.0;
  for (int k = 0; k < BENT_HALVINGS; k++) {
    float middle = 0.5 * (low + high);
    if (is_right(normalize(mix(n, flat_, middle)), flat_, d, least)) {
      high = middle;
    }
    else {
      low = middle;
    }
  }
  return normalize(mix(n, flat_, high));
}
#endif
