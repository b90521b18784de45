// SPDX-License-Identifier: GPL-3.0-or-later

int capture_of(int g)
{
  int slot = g < 0 ? 0 : int(row(9 + GLASS_ROWS * g).y);
  return slot >= 0 && capture_at(slot).w > 0.5 ? slot : -1;
}

/* What a ray meets within its reach, if a view shows it. `boxes`: see `march_direct`. */
bool seen(vec3 o, vec3 d, float reach, int slot, int boxes, out vec4 colour, out float way)
{
  vec2 pixel;
  bool hidden = true, found = false;
  way = reach;
  colour = vec4(0.0);
  if (has_depth != 0) {
    found = march_direct(o, d, reach, slot, boxes, pixel, way, hidden);
    if (found) {
      colour = thing_at(pixel);
    }
  }
  if (!hidden) {
    unseen_ways = vec2(NOWHERE, 0.0);
  }
  if (slot >= 0 && hidden) {
    int second = second_of(slot);
    /* What they see no nearer than the view does may be the same, and the view tells finer. */
    float most = found ? max(way - THIN - THICK_PART * way, 0.0) : reach;
    /* The glass's own captures first. What stands before it there those of other glasses may see. */
    for (int k = -2; k < (found ? 0 : CAPTURES) && hidden; k++) {
      int one = k == -2 ? slot : (k == -1 ? second : k);
      bool is_own = k < 0;
      if (one < 0 || (!is_own && (one == slot || one == second || capture_at(one).w < 0.5))) {
        continue;
      }
      vec3 at;
      float other;
      if (march_capture(one, o, d, most, at, other, hidden)) {
        colour = capture_colour(one, at);
        way = other;
        return true;
      }
    }
  }
  return found;
}

/* Whether a ray may meet anything within its reach: things are in boxes, if it is known where. */
bool may_meet_any(vec3 p, vec3 d, float reach)
{
  return row(0).w < 0.0 || meets_boxes(int(row(0).z), int(row(0).w), p, d, reach);
}

/* Whether a ray meets, within its reach, a flat thing that is shown beside the edge behind which it
 * went. Of others the box does not tell, and what the ray went behind may be shown there itself. */
bool meets_shown(vec3 p, vec3 d, float reach)
{
  float depth;
  int slot = int(last_shown.w);
  if (slot < 0) {
    return false;
  }
  /* Of the same surface as the colour there. */
  Around shown = around(slot, face_of(slot, last_shown.xyz, depth));
  vec3 away = last_shown.xyz / (depth * max(dot(shown.parts, shown.near), 1e-9));
  for (int k = 0; k < int(row(0).w); k++) {
    int at = int(row(0).z) + THING_ROWS * k;
    vec3 q = abs(by_rows(at, vec4(capture_at(slot).xyz + away, 1.0)));
    vec3 room = vec3(length(row(at).xyz), length(row(at + 1).xyz), length(row(at + 2).xyz));
    bool is_flat = max(room.x, max(room.y, room.z)) > FLAT * min(room.x, min(room.y, room.z));
    if (is_flat && all(lessThan(q, 1.0 + (THIN + THICK_PART * length(away)) * room)) &&
        meets_boxes(at, 1, p, d, reach)) {
      return true;
    }
  }
  return false;
}

/* What a ray shows of which no view shows the end: the world, or the nearest that is known. */
vec4 beyond(vec3 o, vec3 d, int slot)
{
  float hidden = unseen_ways.y - unseen_ways.x;
  vec3 hidden_from = o + unseen_ways.x * d, toward = last_shown.xyz;
  int shows = int(last_shown.w);
  if (hidden <= 0.0 || !meets_shown(hidden_from, d, hidden)) {
    vec4 clip = view.to_clip * vec4(d, 0.0);
    if (view.eye.w < 0.5) {
      /* In a parallel view what is far off is seen where the ray leaves the scene. */
      clip = view.to_clip * vec4(o + view.start.z * d, 1.0);
    }
    vec2 pixel = pixel_at(clip);
    if (is_in_picture(clip, pixel) && depth_near(pixel) >= FAR_OFF) {
      return thing_at(pixel);
    }
    bool is_world = hidden <= 0.0 || !may_meet_any(hidden_from, d, hidden);
    if (!is_world && slot < 0) {
      if (clip.w <= 0.0) {
        pixel = pixel_at(view.to_clip * vec4(o, 1.0));
      }
      return direct_at(clamp(pixel, vec2(0.5), view.size.xy - 0.5));
    }
    /* Where a thing stands before the first capture the second may show more. Else what lies beside
     * the edge behind which it went is most like what it ends on. Solid shading has no textures:
     * there the thing before it is more like its own back. The world is far off, and another in
     * other directions. */
    int second = second_of(slot);
    if (!is_world && second < 0 && backdrop.w < 0.5 && shows >= 0) {
      is_world = !shows_thing(shows, toward);
    }
    else {
      shows = second >= 0 && shows_thing(slot, d) ? second : slot;
      toward = d;
    }
    if (is_world) {
      /* Solid shading leaves it to the background. */
      bool is_known = capture_at(WORLD).w > 0.5;
      shows = backdrop.w > 0.5 ? -1 : (is_known ? WORLD : slot);
      toward = d;
    }
  }
  return shows >= 0 ? capture_colour(shows, toward) : vec4(0.0);
}
