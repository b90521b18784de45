// SPDX-License-Identifier: GPL-3.0-or-later

/* What is done with a way: who uses `follow` says it. All places are in the common frame.
 * leave: it left all glasses. lose: no face is met where one should be. covered: whether something
 * stands before the first place of the ray. stopped: whether something ends a stretch before the
 * next face (boxed: which only things can whose boxes reach into glass g). touches: whether a face
 * that may lie on a thing does. `taken`: what the stretch's medium takes of light. */
void leave(vec3 p, vec3 d, vec4 light, int g, int number);
void lose(vec4 light);
bool covered(vec3 p);
bool stopped(vec3 p, vec3 d, vec4 light, int g, vec3 taken, bool boxed, float way, int number);
bool touches(vec3 p, vec3 d, vec4 light, int g, int number);
/* The pixel of the picture that a sample is of. */
ivec2 sampled = ivec2(0);
