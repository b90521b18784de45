// SPDX-License-Identifier: GPL-3.0-or-later

void main()
{
  vec3 v = bent((place * vec4(pos, 1.0)).xyz, miss);
  vec4 clip = bend.to_clip * vec4(v, 0.0) + bend.clip_eye;
  at = vec3(clip.xy / clip.w, length(v));
  vec2 pixel = vec2(float(gl_VertexID % COLUMNS), float(gl_VertexID / COLUMNS)) + 0.5;
  gl_Position = vec4(2.0 * pixel / float(COLUMNS) - 1.0, 0.0, 1.0);
  gl_PointSize = 1.0;
}
