// SPDX-License-Identifier: GPL-3.0-or-later

/* `miss` above which a fragment belongs to no image: triangles that begin on the eye's side. */
#define MOST_MISS 0.5
/* Widths of a pixel by which the view's depth may differ from a surface that it looks at squarely,
 * and the least cosine at which it does. */
#define ROUGH 1.5
#define FLATTEST 0.05

/* Whether the light path meets its vertex where this fragment is: behind the glass, or in it. */
bool is_there(vec3 q)
{
#if KIND == SLAB
  return q.z < -bend.shape.w;
#elif KIND == TUBE
  float size = length(q.xy);
#else
  float size = length(q);
#endif
#if KIND != SLAB
  return held != 0 ? size < bend.shape.x : size > 1.0;
#endif
}

/* What the view shows at a place: of the four pixels round it those that are as deep. */
vec4 direct_colour(vec3 p, vec3 normal)
{
  vec4 clip = view.to_clip * vec4(p, 1.0);
  vec2 pixel = pixel_at(clip);
  if (!is_in_picture(clip, pixel)) {
    return vec4(0.0);
  }
  float z = dot(view.depth_row, vec4(p, 1.0));
  vec3 towards = normalize(view.eye.xyz - p);
  float cosine = clamp(abs(dot(normal, towards)), FLATTEST, 1.0);
  float rough = ROUGH * (view.pixel.x + view.pixel.y * z) / cosine;
  vec2 low = floor(pixel - 0.5);
  vec2 t = pixel - 0.5 - low;
  ivec2 last = ivec2(view.size.xy) - 1;
  vec4 mixed = vec4(0.0);
  for (int k = 0; k < 4; k++) {
    ivec2 step_ = ivec2(k & 1, k >> 1);
    ivec2 there = clamp(ivec2(low) + step_, ivec2(0), last);
    if (abs(texelFetch(depth_tx, there, 0).r - z) < rough) {
      vec2 part = mix(1.0 - t, t, vec2(step_));
      mixed += part.x * part.y * vec4(texelFetch(direct_tx, there, 0).rgb, 1.0);
    }
  }
  return mixed.a > 0.0 ? vec4(mixed.rgb / mixed.a, 1.0) : vec4(0.0);
}

/* Where no view is known to show a place: its surface's colour; while the view has no depths (that
 * of EEVEE without overlays) what it shows there, whatever that is. */
vec4 without_depth(vec3 p)
{
  vec4 clip = view.to_clip * vec4(p, 1.0);
  if (has_depth != 0 || clip.w <= 0.0) {
    return base;
  }
  return direct_at(clamp(pixel_at(clip), vec2(0.5), view.size.xy - 0.5));
}

void main()
{
  if (miss > MOST_MISS || !is_there(at)) {
    discard;
  }
  vec3 p = (bend.to_common * vec4(at, 1.0)).xyz;
  vec4 shown = direct_colour(p, normalize(cross(dFdx(p), dFdy(p))));
  if (shown.a == 0.0 && slot >= 0 && capture_at(slot).w > 0.5) {
    vec3 away = p - capture_at(slot).xyz;
    if (abs(smooth_gap(slot, away)) < THIN + THICK_PART * length(away)) {
      shown = vec4(capture_colour(slot, away).rgb, 1.0);
    }
  }
  if (shown.a == 0.0) {
    shown = without_depth(p);
  }
  frag = vec4(shown.rgb, held != 0 ? HELD : EXIT);
}
