// SPDX-License-Identifier: GPL-3.0-or-later

/* For tests: exit rays of the ways from number `wanted` on of the ray in each pixel. */
vec4 exit_places[AT_ONCE];
vec4 exit_alongs[AT_ONCE];

void leave(vec3 p, vec3 d, vec4 light, int g, int number)
{
  for (int k = 0; k < AT_ONCE; k++) {
    if (number == wanted + k) {
      exit_places[k] = vec4(p, light.w);
      exit_alongs[k] = vec4(d, 0.0);
    }
  }
}

void lose(vec4 light) {}
bool covered(vec3 p) { return false; }
bool stopped(vec3 p, vec3 d, vec4 light, int g, vec3 taken, bool boxed, float way, int number)
{
  return false;
}
bool touches(vec3 p, vec3 d, vec4 light, int g, int number) { return false; }

void main()
{
  for (int k = 0; k < AT_ONCE; k++) {
    exit_places[k] = exit_alongs[k] = vec4(0.0);
  }
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec3 p = texelFetch(origin_tx, pixel, 0).xyz;
  vec3 d = normalize(texelFetch(along_tx, pixel, 0).xyz);
  follow(p, d, starting(false), least, most, true);
