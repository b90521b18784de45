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

/* Two numbers from 0 to 1 for an event of a sample: the samples of a pixel are spread evenly at the
 * first two (M. Roberts, The Unreasonable Effectiveness of Quasirandom Sequences, 2018), from a place
 * that the pixel chooses. */
vec2 facet_shares(int event)
{
  uvec3 v = uvec3(sampled, event < 2 ? event : event + MOST_STRETCHES * (1 + sample_number));
  /* M. Jarzynski and M. Olano, Hash Functions for GPU Rendering, 2020. */
  v = v * 1664525u + 1013904223u;
  v += v.yzx * v.zxy;
  v ^= v >> 16u;
  v += v.yzx * v.zxy;
  vec2 begin = vec2(v.xy >> 8u) / 16777216.0;
  vec2 part = event == 0 ? vec2(0.7548776662, 0.5698402910) : vec2(0.8191725134, 0.6710436067);
  return fract(begin + (event < 2 ? float(sample_number) : 0.0) * part);
}

/* Normal of a facet of a rough surface as a ray sees it, see `visible_facets` in optics/facets.py.
 * alpha: roughness squared. */
vec3 facet(vec3 n, vec3 d, float alpha, int event)
{
  vec3 one = normalize(cross(n, abs(n.x) < 0.7 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0)));
  vec3 other = cross(n, one);
  vec3 seen = normalize(vec3(-alpha * dot(one, d), -alpha * dot(other, d), -dot(n, d)));
  vec2 shares = facet_shares(event);
  float azimuth = 6.283185307 * shares.x;
  float height = (1.0 - shares.y) * (1.0 + seen.z) - seen.z;
  float radius = sqrt(max(1.0 - height * height, 0.0));
  vec3 half_ = vec3(radius * cos(azimuth), radius * sin(azimuth), height) + seen;
  return normalize(alpha * half_.x * one + alpha * half_.y * other + max(half_.z, 0.0) * n);
}
#endif
