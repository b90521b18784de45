// SPDX-License-Identifier: GPL-3.0-or-later

/* What is done with a way: who uses `follow` says it. All places are in the common frame.
 * ends: whether something ends a stretch before the next face (boxed: which only things can whose
 * boxes reach into glass g); of a way that leaves all glasses, for which there is none (`way` is
 * NOWHERE), something always does. One hook for both, and called once: compilers copy it to where
 * it is called. darken: a way is black from here on. lose: no face is met where one should be.
 * covered: whether something stands before the first place of the ray. touches: whether a face that
 * may lie on a thing does. `taken`: what the stretch's medium takes of light. */
bool ends(vec3 p, vec3 d, vec4 light, int g, vec3 taken, bool boxed, float way, int number);
void darken(vec3 p, vec3 d, float part, int number);
void lose(vec4 light);
bool covered(vec3 p);
bool touches(vec3 p, vec3 d, vec4 light, int g, int number);
/* The pixel of the picture that a sample is of, and its number among the pixel's. */
ivec2 sampled = ivec2(0);
int sample_number = 0;
