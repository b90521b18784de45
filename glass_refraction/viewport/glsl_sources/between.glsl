// SPDX-License-Identifier: GPL-3.0-or-later

void main()
{
  vec2 at = gl_FragCoord.xy / parts;
  frag = vec4(depth_near(at), limb_at(at, vec2(1.0, 0.0)), depth_between(at), 0.0);
}
