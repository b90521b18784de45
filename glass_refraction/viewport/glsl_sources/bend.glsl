// SPDX-License-Identifier: GPL-3.0-or-later

/* Newton's steps, and the change of the unknowns below which the next one changes nothing: the
 * error after a step is about the square of the step. */
#define ROUND_STEPS 7
#define LAYER_STEPS 14
#define RESTS 1e-3
/* The limits of the angle that stands for a ray's distance from the axis, and of a step. */
#define STEEPEST 1.5706
#define LONGEST_STEP 0.7
#define BEGIN 0.98
/* Least cosine at the inner face: the derivatives have it below. */
#define LEAST_COSINE 1e-4
#define LEAST 1e-12
/* What `miss` is for a vertex that lies on the eye's side. */
#define NONE 1.0

/* A vertex q behind (held: in) a tube, or with q.z = 0 a ball in the plane of eye, middle and q.
 *
 * With everything divided by the ray's transverse momentum, a skew ray through a tube is a plane
 * one through a glass of another ior: m² = n² + (n² - 1) s², s being its rise by its transverse
 * way. Unknowns are s and the angle t for which r sin t is the ray's distance from the axis. After
 * the last event the ray is a straight line; q lies on it at its own height.
 * Returns the vector from the eye to where q appears. */
vec3 bend_round(vec3 q, bool held, out float miss)
{
  float re = bend.eye.x, r = bend.shape.x, n1 = (bend.shape.y - 1.0) * (bend.shape.y + 1.0);
  float passes = held ? 1.0 : 2.0;
  float away = length(vec2(q.x - re, q.y));
  float s = q.z / away;
  float t = asin(clamp(re * q.y / (away * r), -BEGIN, BEGIN));
  float lam, wE, across, along, air, wall, m2;
  for (int k = 0; k < ROUND_STEPS; k++) {
    float w2 = r * max(cos(t), LEAST_COSINE);
    lam = r * sin(t);
    float l2 = lam * lam;
    m2 = 1.0 + n1 + n1 * s * s;
    wE = sqrt((re - lam) * (re + lam));
    float w0 = sqrt((1.0 - lam) * (1.0 + lam));
    float wR = sqrt(m2 - l2), wr = sqrt(m2 * r * r - l2);
    /* By how much both faces turn the ray, as unit complex numbers. */
    vec2 a = vec2(l2 + w0 * wR, lam * (wR - w0)), b = vec2(l2 + wr * w2, lam * (w2 - wr));
    vec2 turn = vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
    if (!held) {
      turn = vec2(turn.x * turn.x - turn.y * turn.y, 2.0 * turn.x * turn.y);
    }
    vec2 u = normalize(vec2(-wE * turn.x - lam * turn.y, lam * turn.x - wE * turn.y));
    along = dot(q.xy, u);
    across = q.x * u.y - q.y * u.x;
    float f = across - lam;
    vec4 i = 1.0 / vec4(w0, wR, wr, w2);
    float iE = 1.0 / wE;
    float bends = passes * (i.x - i.y + i.z - i.w) - iE;
    float bends_m = passes * lam / (2.0 * m2) * (i.y - i.z);
    air = wE + passes * (w2 - w0) + along;
    wall = wR - wr;
    float far = air + passes * wall / m2;
    float g = s * far - q.z;
    float far_l = lam * (passes * (i.x - i.w - (i.y - i.z) / m2) - iE) - across * bends;
    float far_m = passes * (0.5 * (i.y - r * r * i.z) - wall / m2) / m2 - across * bends_m;
    float m_s = 2.0 * n1 * s;
    vec2 df = vec2(along * bends - 1.0, along * bends_m * m_s);
    vec2 dg = vec2(s * far_l, far + s * far_m * m_s);
    float determinant = df.x * dg.y - df.y * dg.x;
    float inverse = 1.0 / (abs(determinant) < LEAST ? LEAST : determinant);
    float dt = (f * dg.y - g * df.y) * inverse * i.w;
    float ds = (g * df.x - f * dg.x) * inverse;
    t = clamp(t - clamp(dt, -LONGEST_STEP, LONGEST_STEP), -STEEPEST, STEEPEST);
    s -= clamp(ds, -1.0 - abs(s), 1.0 + abs(s));
    /* How far past q the ray runs, as a part of how far it goes. */
    miss = abs(f) / max(1.0, abs(along));
    if (max(abs(dt), abs(ds)) < RESTS) {
      break;
    }
  }
  if (!held && along < 0.0) {
    miss = NONE;
  }
  lam = r * sin(t);
  wE = sqrt((re - lam) * (re + lam));
  float slope = sqrt(1.0 + s * s);
  float way = air * slope + passes * wall * sqrt((1.0 + s * s / m2) / m2);
  return way / slope * vec3(-wE / re, lam / re, s);
}

/* A vertex below layers. The unknown x is the tangent in the thinnest medium: the offset is an
 * increasing, concave function of it, and Newton's method comes to the root from below. */
vec3 bend_layers(vec3 q)
{
  int count = int(bend.shape.z);
  float own = max(-bend.shape.w - q.z, 0.0);
  float offset = length(q.xy);
  float thinnest = bend.layers[0].y;
  for (int k = 1; k < count; k++) {
    thinnest = min(thinnest, bend.layers[k].y);
  }
  float t2 = thinnest * thinnest, steepest = 0.0, level = 0.0, rest = offset;
  for (int k = 0; k < count; k++) {
    float thickness = k == count - 1 ? own : bend.layers[k].x, n = bend.layers[k].y;
    steepest += thickness * thinnest / n;
    if (n > thinnest) {
      rest -= thickness * thinnest / sqrt((n - thinnest) * (n + thinnest));
    }
    else {
      level += thickness;
    }
  }
  float x = max(offset / steepest, level > 0.0 ? rest / level : 0.0);
  for (int step_ = 0; step_ < LAYER_STEPS; step_++) {
    float reached = 0.0, slope = 0.0;
    for (int k = 0; k < count; k++) {
      float thickness = k == count - 1 ? own : bend.layers[k].x, n = bend.layers[k].y;
      float i = inversesqrt(n * n + (n - thinnest) * (n + thinnest) * x * x);
      reached += thickness * thinnest * x * i;
      slope += thickness * thinnest * n * n * i * i * i;
    }
    float dx = (offset - reached) / slope;
    x = max(x + dx, 0.0);
    if (abs(dx) < RESTS * (1.0 + x)) {
      break;
    }
  }
  float way = 0.0, stretched = sqrt(1.0 + x * x);
  for (int k = 0; k < count; k++) {
    float thickness = k == count - 1 ? own : bend.layers[k].x, n = bend.layers[k].y;
    way += thickness * n * stretched * inversesqrt(n * n + (n - thinnest) * (n + thinnest) * x * x);
  }
  float n = bend.layers[0].y;
  float sine = thinnest * x / (n * stretched);
  float cosine = sqrt(n * n + (n - thinnest) * (n + thinnest) * x * x) / (n * stretched);
  vec2 heading = offset > 0.0 ? q.xy / offset : vec2(0.0);
  return way * vec3(sine * heading, -cosine);
}

/* From the eye to where a place in the frame appears; `miss`: by how much no ray gets there. */
vec3 bent(vec3 q, out float miss)
{
  miss = 0.0;
#if KIND == SLAB
  return bend_layers(q);
#elif KIND == TUBE
  return bend_round(q, held != 0, miss);
#else
  float size = length(q.yz);
  vec3 v = bend_round(vec3(q.x, size, 0.0), held != 0, miss);
  return vec3(v.x, v.y * (size > 0.0 ? q.yz / size : vec2(0.0)));
#endif
}
