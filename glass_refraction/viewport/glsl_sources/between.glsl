// SPDX-License-Identifier: GPL-3.0-or-later

void main()
{
  vec2 at = gl_FragCoord.xy / parts;
  Around shown = around(0, vec3(at, 0.0));
  float captured = 1.0 / dot(shown.parts, shown.near);
  frag = vec4(depth_near(at), limb_at(at, vec2(1.0, 0.0)), depth_between(at), captured);
}
