// SPDX-License-Identifier: GPL-3.0-or-later

void main()
{
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  ivec2 last = textureSize(depth_tx, 0) - 1;
  float depth = texelFetch(depth_tx, pixel, 0).r;
  float near = depth, far = depth;
  for (int k = 0; k < 9; k++) {
    ivec2 other = clamp(pixel + ivec2(k % 3, k / 3) - 1, ivec2(0), last);
    float value = texelFetch(depth_tx, other, 0).r;
    near = min(near, value);
    far = max(far, value);
  }
  bool is_step = far - near > EDGE * (width.x + width.y * near);
  frag = vec4(depth, is_step ? near : 0.0, 0.0, 0.0);
}
