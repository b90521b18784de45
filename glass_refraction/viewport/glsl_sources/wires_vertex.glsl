// SPDX-License-Identifier: GPL-3.0-or-later

void main()
{
  gl_Position = to_clip * vec4(place, 1.0);
  gl_Position.z = 0.5 * gl_Position.z + (begin - 0.5) * gl_Position.w;
}
