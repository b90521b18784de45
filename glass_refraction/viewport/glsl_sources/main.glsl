// SPDX-License-Identifier: GPL-3.0-or-later

/* What is shown of a sample, about as the eye weighs it: `glass` of it hides the direct picture,
 * and the background lies behind both. */
vec3 weighed(vec4 seen, float glass)
{
  vec4 shown = seen + (1.0 - glass) * texelFetch(direct_tx, sampled, 0);
  vec3 whole = shown.rgb + max(1.0 - shown.a, 0.0) * backdrop.rgb;
  return sqrt(clamp(whole, 0.0, 1.0));
}

/* The square of how far a sample of a listed pixel lies from the mean of those before. */
float apart()
{
  vec4 known = texelFetch(known_tx, sampled, 0), counted = texelFetch(counted_tx, sampled, 0);
  float count = max(counted.g, 1.0);
  vec3 off = weighed(color, cover.r) - weighed(known / count, counted.r / count);
  off *= band.rgb;
  return max(max(off.r * off.r, off.g * off.g), off.b * off.b);
}

/* One sample of every pixel: the colour seen through the glass, and whether there is any. */
void main()
{
  vec2 at = gl_FragCoord.xy;
  if (is_listed != 0) {
    at = texelFetch(list_tx, ivec2(at), 0).xy + 0.5;
    if (at.x < 0.0) {
      discard;
    }
  }
  sampled = ivec2(at);
  sample_number = int(jitter.w);
  vec2 pixel = (at + jitter.xy) * jitter.z;
  vec3 p = view.plane.xyz + pixel.x * view.right.xyz + pixel.y * view.up.xyz;
  bool parallel = view.eye.w < 0.5;
  vec3 d = parallel ? view.eye.xyz : normalize(p - view.eye.xyz);
  /* The ray begins where it enters the ball that holds all glasses: numbers stay small there. */
  float ahead = -dot(p, d);
  float off = length(p + ahead * d);
  color = vec4(0.0);
  /* Whether there is any glass, how many samples the pixel has, and how much these differ. */
  cover = vec4(0.0, 1.0, 0.0, 0.0);
  if (off > view.start.x) {
    cover.b = is_listed != 0 ? apart() : 0.0;
    cover *= band.a;
    return;
  }
  float enter = ahead - sqrt(view.start.x * view.start.x - off * off);
  float eye_way = parallel ? -view.start.z : -length(p - view.eye.xyz);
  bool within = eye_way > enter;
  p += max(enter, eye_way) * d;
  float unseen = (view.size.z - dot(view.depth_row, vec4(p, 1.0))) / dot(view.depth_row.xyz, d);
  float way = follow(p, d, starting(within), least, most, splits != 0, unseen);
  if (way < NOWHERE && got > 0.0) {
    color = sum / got;
    cover.r = 1.0;
  }
  else if (way < NOWHERE && (splits == 0 || (unseen > 0.0 && !is_lost))) {
    /* What only refracts is black where it would reflect totally, and so is what goes on being
     * reflected in a wall that the near plane cuts open. */
    color.a = cover.r = 1.0;
  }
  if (is_listed != 0) {
    cover.b = apart();
  }
  color *= band;
  cover *= band.a;
}
