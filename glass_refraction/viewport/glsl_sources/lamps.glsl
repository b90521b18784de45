// SPDX-License-Identifier: GPL-3.0-or-later

/* Light of lamps that a way meets within its reach: they hide nothing. `tint`: what the glass lets
 * through, for what engines clamp is the light that arrives. */
vec3 lamps(vec3 p, vec3 d, float reach, vec3 tint)
{
  vec3 found = vec3(0.0);
  float most = events > 1 ? view.pixel.w : view.pixel.z;
  for (int k = 0; events > 0 && k < int(view.start.w); k++) {
    int first = LAMP_ROWS * k;
    vec4 h = vec4(p, 1.0), body = view.lamps[first + 3], beam = view.lamps[first + 4];
    vec3 o = vec3(dot(view.lamps[first], h), dot(view.lamps[first + 1], h),
                  dot(view.lamps[first + 2], h));
    vec3 v = vec3(dot(view.lamps[first].xyz, d), dot(view.lamps[first + 1].xyz, d),
                  dot(view.lamps[first + 2].xyz, d));
    float way;
    if (int(body.w) == BALL) {
      float square = dot(v, v), across = dot(o, v);
      float root = across * across - square * (dot(o, o) - 1.0);
      way = root > 0.0 ? (-across - sqrt(root)) / square : -1.0;
    }
    else {
      /* From its front alone. */
      way = v.z > 0.0 ? -o.z / v.z : -1.0;
      vec2 at = abs(o.xy + way * v.xy);
      way = (int(body.w) == DISC ? length(at) : max(at.x, at.y)) < 1.0 ? way : -1.0;
    }
    if (way <= 0.0 || way >= reach) {
      continue;
    }
    float ahead = clamp(v.z / length(view.lamps[first + 2].xyz), -1.0, 1.0);
    float part = smoothstep(0.0, 1.0, (ahead - beam.z) / beam.w);
    if (beam.w < 0.0) {
      part = max(beam.z - sqrt(1.0 - ahead * ahead) / max(ahead, 1e-6), 0.0) / -beam.w;
    }
    vec3 light = part * (by_mirror ? beam.y : beam.x) * body.rgb;
    found += light * most / max(dot(abs(light) * tint, vec3(1.0 / 3.0)), most);
  }
  return found;
}
