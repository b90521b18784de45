// SPDX-License-Identifier: GPL-3.0-or-later

/* Reflectance for unpolarised light; `cosine` before the interface, `behind` after it. */
float fresnel(float cosine, float eta, out float behind)
{
  float square = (1.0 - eta) * (1.0 + eta) + eta * cosine * eta * cosine;
  behind = sqrt(max(square, 0.0));
  if (square <= 0.0 || cosine <= 0.0) {
    return 1.0;
  }
  float across = (eta * cosine - behind) / (eta * cosine + behind);
  float along = (cosine - eta * behind) / (cosine + eta * behind);
  return 0.5 * (across * across + along * along);
}

vec3 to_glass(int g, vec3 p) { return by_rows(3 + GLASS_ROWS * g, vec4(p, 1.0)); }

vec3 to_common(int g, vec3 p) { return by_rows(6 + GLASS_ROWS * g, vec4(p, 1.0)); }

/* Directions stay unit: the frames differ by a rotation and a scale. */
vec3 turn_in(int g, vec3 d)
{
  return row(9 + GLASS_ROWS * g).x * by_rows(3 + GLASS_ROWS * g, vec4(d, 0.0));
}

vec3 turn_out(int g, vec3 d)
{
  return by_rows(6 + GLASS_ROWS * g, vec4(d, 0.0)) / row(9 + GLASS_ROWS * g).x;
}

/* Whether a ray of the common frame passes the ball round a glass, or enters it beyond a way. Of
 * many glasses most are passed: nothing else of them is read then. */
bool passes_ball(int g, vec3 place, vec3 along, float way)
{
  vec4 ball = row(12 + GLASS_ROWS * g);
  vec3 away = ball.xyz - place;
  float square = dot(away, away), ahead = dot(away, along), beyond = max(ahead - way, 0.0);
  /* What rounding takes from the difference of squares is given back. */
  float least = ball.w + 1e-6 * square;
  return square - ahead * ahead > least || (ahead < 0.0 && square > least) ||
         beyond * beyond > least;
}

vec4 medium_row(int g, int m) { return row(int(row(1 + GLASS_ROWS * g).z) + MEDIUM_ROWS * m); }

/* A place in the frame of one glass in that of another; -1: the common one. */
vec3 moved(int from, int to, vec3 p)
{
  if (from == to) {
    return p;
  }
  p = from < 0 ? p : to_common(from, p);
  return to < 0 ? p : to_glass(to, p);
}

vec3 turned_to(int from, int to, vec3 d)
{
  if (from == to) {
    return d;
  }
  d = from < 0 ? d : turn_out(from, d);
  return to < 0 ? d : turn_in(to, d);
}

/* What a ray is in: glass · 16 + medium, in the order in which it entered them; -1: nothing. */
int medium_in(ivec4 held, int g)
{
  for (int k = 0; k < DEEPEST; k++) {
    if (held[k] >= 0 && (held[k] >> 4) == g) {
      return held[k] & 15;
    }
  }
  return 0;
}

/* The same after the medium of one glass became another one. */
ivec4 with_medium(ivec4 held, int g, int m)
{
  ivec4 found = ivec4(-1);
  int count = 0;
  bool known = false;
  for (int k = 0; k < DEEPEST; k++) {
    bool own = held[k] >= 0 && (held[k] >> 4) == g;
    if (held[k] < 0 || (own && m == 0)) {
      continue;
    }
    found[count] = own ? 16 * g + m : held[k];
    known = known || own;
    count++;
  }
  if (!known && m > 0 && count < DEEPEST) {
    found[count] = 16 * g + m;
  }
  return found;
}

/* Which of them holds (see `Media` in optics/placed.py): the one of the highest priority, of equal
 * ones that which was entered first; -1: none. */
int holding(ivec4 held)
{
  int best = -1;
  float most = 0.0;
  for (int k = 0; k < DEEPEST; k++) {
    if (held[k] < 0) {
      continue;
    }
    int g = held[k] >> 4;
    float priority = row(10 + GLASS_ROWS * g).x;
    if ((int(medium_row(g, held[k] & 15).y) & HOLDS) != 0 && (best < 0 || priority > most)) {
      best = held[k];
      most = priority;
    }
  }
  return best;
}

/* The glass in whose frame a ray is followed: the last one that it entered and is still within. */
int home_of(ivec4 held)
{
  int home = -1;
  for (int k = 0; k < DEEPEST; k++) {
    if (held[k] >= 0 && (int(medium_row(held[k] >> 4, held[k] & 15).y) & ENDLESS) == 0) {
      home = held[k] >> 4;
    }
  }
  return home;
}

/* The glasses that rays start in: without those that end where the rays begin outside of all. */
ivec4 starting(bool within)
{
  ivec4 held = ivec4(-1);
  int count = int(row(0).x);
  for (int k = 0; k < count; k++) {
    int m = int(row(9 + GLASS_ROWS * k).z);
    if (m > 0 && (within || (int(medium_row(k, m).y) & ENDLESS) != 0)) {
      held = with_medium(held, k, m);
    }
  }
  return held;
}

float ior_of(int holder)
{
  return holder < 0 ? row(0).y : medium_row(holder >> 4, holder & 15).x;
}
