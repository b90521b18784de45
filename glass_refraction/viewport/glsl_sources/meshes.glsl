// SPDX-License-Identifier: GPL-3.0-or-later

#ifdef MESHES
vec4 texel(int k)
{
  return texelFetch(mesh_tx, ivec2(k & ((1 << ROW_BITS) - 1), k >> ROW_BITS), 0);
}

/* Where a ray enters a packed box of a tree's grid (see trees.py), NOWHERE if not within its reach.
 * `o`, `inverse`: where it starts in the grid, and of its direction there. */
float meet_box(vec4 box, vec3 o, vec3 inverse, float reach)
{
  vec4 upper = floor(box / GRID), lower = box - GRID * upper;
  vec3 one = (vec3(lower.xy, upper.x + HALF_GRID * upper.y) - o) * inverse;
  vec3 two = (vec3(lower.zw, upper.z + HALF_GRID * upper.w) - o) * inverse;
  vec3 near = min(one, two), far = max(one, two);
  float enter = max(max(near.x, near.y), max(near.z, 0.0));
  return enter <= min(min(far.x, far.y), min(far.z, reach)) ? enter : NOWHERE;
}

/* The nearest triangle of a mesh but `skip`: (its texel, shares of the second and third corner).
 * (T. Möller and B. Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997.) The tree is
 * walked without a stack: a bit a level tells whether the node beside is still to be seen. */
vec3 meet_mesh(vec4 tree, vec3 o, vec3 d, float reach, int skip, inout float way)
{
  int nodes = int(tree.x), leaves = int(tree.y), first = int(tree.z);
  vec3 steps = texel(nodes + 1).xyz, start = (o - texel(nodes).xyz) * steps;
  vec3 inverse = 1.0 / (steps * mix(d, vec3(1e-12), lessThan(abs(d), vec3(1e-12))));
  vec3 found = vec3(-1.0, 0.0, 0.0);
  float nearest = reach;
  int node = 1, waits = 0;
  for (int guard = 0; guard < MOST_NODES; guard++) {
    if (node >= leaves) {
      for (int k = 0; k < LEAF; k++) {
        int at = first + TRIANGLE_TEXELS * ((node - leaves) * LEAF + k);
        vec3 e1 = texel(at + 1).xyz, e2 = texel(at + 2).xyz;
        vec3 h = cross(d, e2);
        float determinant = dot(e1, h);
        if (determinant == 0.0 || at == skip) {
          continue;
        }
        float scale = 1.0 / determinant;
        vec3 s = o - texel(at).xyz;
        float u = scale * dot(s, h);
        vec3 q = cross(s, e1);
        float v = scale * dot(d, q);
        float t = scale * dot(e2, q);
        if (u >= -SEAM && v >= -SEAM && u + v <= 1.0 + SEAM && t >= 0.0 && t < nearest) {
          nearest = t;
          found = vec3(float(at), u, v);
        }
      }
    }
    else {
      int at = nodes + NODE_TEXELS * node;
      float one = meet_box(texel(at), start, inverse, nearest);
      float two = meet_box(texel(at + 1), start, inverse, nearest);
      if (min(one, two) < NOWHERE) {
        node = 2 * node + (two < one ? 1 : 0);
        waits = 2 * waits + (max(one, two) < NOWHERE ? 1 : 0);
        continue;
      }
    }
    if (waits == 0) {
      break;
    }
    int up = findLSB(waits);
    waits = (waits >> up) ^ 1;
    node = (node >> up) ^ 1;
  }
  if (found.x >= 0.0) {
    way = nearest;
  }
  return found;
}
#endif
