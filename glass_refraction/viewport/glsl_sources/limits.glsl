// SPDX-License-Identifier: GPL-3.0-or-later

#define NOWHERE 1e20
/* How far behind its start, in units of the glass, a ray may still meet an interface, and how far
 * beyond its end a meeting may lie: rounding. */
#define SKIN 2e-6
#define PENDING 8
#define MOST_STRETCHES 120
/* Events of a way for which the least weight holds as it is; longer ways must carry more. */
#define PLAIN 6.0
#define STRONG 0.1
/* Steps of Newton's method from a chord to the curve itself. */
#define NEWTON_STEPS 4
/* Meetings with chords that are tried until one is a meeting with the curve. */
#define CHORD_TRIES 3
/* A course: the interfaces that a way crossed, a digit of base 32 each; -1 for ways that were
 * mirrored, are too long or met another glass. */
#define NO_COURSE -1
/* By how much the square of a miss, in units of the glass, may be one because chords lie beside
 * the curve. */
#define SAG_SLACK 4e-4

/* Of the way that is followed. */
int course = 0;
/* Its events so far, and whether any of them mirrored it. */
int events = 0;
bool by_mirror = false;
/* Nodes of a mesh's tree that a ray sees, at most. */
#define MOST_NODES 4000
/* How far beyond its sides a triangle is met: rounding must leave no gap between two. */
#define SEAM 1e-6
/* How far off a mesh's face rays start, in units of the glass: they must not meet faces beside it
 * on the wrong side. */
#define CLEARANCE 4e-6
/* As in optics/facets.py. */
#define BENT_SHARE 0.9
#define BENT_CLEAR 0.01
#define BENT_HALVINGS 12

/* Clamped: NVIDIA's compiler refuses an index that it knows to be out of bounds even where no ray
 * ever comes, such as that of glass -1 behind a test for it. */
vec4 row(int k) { return glasses.rows[max(k, 0)]; }

/* A place (w = 1) or a direction (w = 0) in the frame that three rows from k on lead to. */
vec3 by_rows(int k, vec4 v) { return vec3(dot(row(k), v), dot(row(k + 1), v), dot(row(k + 2), v)); }
