// SPDX-License-Identifier: GPL-3.0-or-later

/* What shows nothing lets the background through. That is not tinted where it is drawn, so what is
 * seen of it through tinted glass is added here: all but what every colour has. */
void add(vec4 colour, vec4 light)
{
  float plain = min(min(light.r, light.g), min(light.b, 1.0));
  vec3 open = (1.0 - colour.a) * (light.rgb - plain) * backdrop.rgb;
  float shown = colour.a + (1.0 - colour.a) * (1.0 - plain);
  sum += light.w * vec4(light.rgb * colour.rgb + open, shown);
  got += light.w;
}

bool covered(vec3 p)
{
  if (has_depth == 0) {
    return false;
  }
  vec4 place = vec4(p, 1.0);
  return depth_between(pixel_at(view.to_clip * place)) < dot(view.depth_row, place) + LAID_ON;
}

void darken(vec3 p, vec3 d, float part, int number) { add(vec4(0.0), vec4(vec3(0.0), part)); }

bool is_lost = false;

void lose(vec4 light) { is_lost = true; }

bool ends(vec3 p, vec3 d, vec4 light, int g, vec3 taken, bool boxed, float way, int number)
{
  bool leaves = way >= NOWHERE;
  boxed = boxed && !leaves;
  int slot = capture_of(g);
  last_shown = vec4(-1.0);
  unseen_ways = vec2(0.0, NOWHERE);
  /* From one glass to another anything may stand; within one what reaches into its box. */
  vec2 things = leaves ? row(0).zw : vec2(row(9 + GLASS_ROWS * g).w, row(1 + GLASS_ROWS * g).w);
  bool is_any = leaves ? things.y < 0.0 : !boxed;
  vec4 colour = vec4(0.0);
  float reached = way;
  bool met = (is_any || meets_boxes(int(things.x), int(things.y), p, d, way)) &&
             seen(p, d, way, slot, boxed ? g : -1, colour, reached);
  vec3 shine = lamps(p, d, reached, light.rgb);
  if (leaves) {
    colour = met ? colour : beyond(p, d, slot);
  }
  else if (met) {
    light.rgb *= exp(-taken * reached);
  }
  else {
    sum.rgb += light.w * light.rgb * shine;
    return false;
  }
  colour.rgb += shine;
  add(colour, light);
  return true;
}

/* A face that lies on a thing shows it, with no air between. */
bool touches(vec3 at, vec3 d, vec4 light, int g, int number)
{
  vec4 clip = view.to_clip * vec4(at, 1.0);
  vec2 pixel = pixel_at(clip);
  float near = TOUCHING * row(9 + GLASS_ROWS * g).x;
  if (is_in_picture(clip, pixel) &&
      abs(depth_near(pixel) - dot(view.depth_row, vec4(at, 1.0))) < near) {
    add(thing_at(pixel), light);
    return true;
  }
  int slot = capture_of(g);
  if (slot >= 0) {
    vec3 away = at - capture_at(slot).xyz;
    if (abs(smooth_gap(slot, away)) < near) {
      add(capture_colour(slot, away), light);
      return true;
    }
  }
  return false;
}
