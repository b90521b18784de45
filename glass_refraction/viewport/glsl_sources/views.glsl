// SPDX-License-Identifier: GPL-3.0-or-later

#define FAR_OFF 1e19
#define TILE 8
#define CLOSE 6.0
/* Pixels from look to look in tiles that neither tell nor show an edge. */
#define STRIDE 2.0
#define DIRECT_STEPS 120
/* Half the side of a box of things, with some room. */
#define BOX_MARGIN 1.02
#define CAPTURE_STEPS 32
/* How much longer than thick the box of a flat thing is, at least. */
#define FLAT 1e3
/* Angle between steps, in pixels of a face (which is two wide at a distance of one). */
#define CAPTURE_STRIDE 5.0
#define HALVINGS 6
#define EDGE_HALVINGS 4
/* How far behind a thing's edge a ray still meets it, in common units: pixels do not tell where
 * exactly the edge is. */
#define SLACK 0.05
/* The same for surfaces in captures. */
#define THIN 0.03
/* The same as part of the distance: what a pixel of a capture cannot tell. */
#define THICK_PART 0.01
#define UNKNOWN -1e18
/* Of a pixel beside an edge in the colour of a surface, over others. */
#define MIXED 0.02
/* Of sqrt(s) / (sqrt(s + 1) - sqrt(s)) the value for s = 1: no edge is farther off. */
#define LIMB_MOST 2.42
/* Where a thing is nearer to a face than this, in common units, it touches it. */
#define TOUCHING 0.03
/* How much nearer than a place a thing must be to hide it, in common units. */
#define NEARER 0.004
/* How much farther than the glass a thing may be that covers it: a face may lie on a thing. */
#define LAID_ON 0.001

/* By how much depths differ at an edge, at a depth of z. */
float edge_at(float z) { return EDGE * (view.pixel.x + view.pixel.y * z); }

float depth_at(ivec2 pixel)
{
  ivec2 last = ivec2(view.size.xy) - 1;
  return texelFetch(depth_tx, clamp(pixel, ivec2(0), last), 0).r;
}

vec4 direct_at(vec2 pixel) { return smooth_at(direct_tx, pixel); }

/* Where in the view a place in clip space is, in pixels. */
vec2 pixel_at(vec4 clip) { return (0.5 * clip.xy / clip.w + 0.5) * view.size.xy; }

/* Whether that is in the picture, whose depths are known. */
bool is_in_picture(vec4 clip, vec2 pixel)
{
  return has_depth != 0 && clip.w > 0.0 && all(greaterThanEqual(pixel, vec2(0.0))) &&
         all(lessThan(pixel, view.size.xy));
}

/* Clamped as `row` is. */
vec4 capture_at(int slot) { return view.captures[clamp(slot, 0, WORLD)]; }

/* Which face of a capture shows a direction, and which pixel of it: (x, y, face); the last one is
 * its close picture. `depth`: of d along the face's axis. */
vec3 face_of(int slot, vec3 d, out float depth)
{
  int close = 3 * clamp(slot, 0, WORLD);
  vec4 forward = view.closes[close];
  float side = capture_at(slot).w;
  if (forward.w > 0.0) {
    depth = dot(d, forward.xyz);
    vec2 at = vec2(dot(d, view.closes[close + 1].xyz), dot(d, view.closes[close + 2].xyz));
    if (max(abs(at.x), abs(at.y)) < (1.0 - 1.0 / side) * depth) {
      return vec3((0.5 * at / depth + 0.5) * side, CLOSE);
    }
  }
  vec3 a = abs(d);
  bool is_x = a.x >= a.y && a.x >= a.z;
  bool is_y = !is_x && a.y >= a.z;
  vec3 r = is_x ? d.yzx : (is_y ? d.zxy : d);
  depth = abs(r.z);
  float turn = r.z < 0.0 ? -1.0 : 1.0;
  vec2 at = vec2(r.x, -turn * r.y) / abs(r.z);
  float axis = is_x ? 0.0 : (is_y ? 2.0 : 4.0);
  return vec3((0.5 * at + 0.5) * side, turn < 0.0 ? axis + 1.0 : axis);
}

ivec2 atlas_pixel(int slot, vec3 at, vec2 in_face, float side)
{
  ivec2 pixel = clamp(ivec2(in_face), ivec2(0), ivec2(int(side) - 1));
  /* The world's are the last ones. */
  int row_ = slot == WORLD ? textureSize(reach_tx, 0).y / int(side) - 1 : slot;
  return pixel + ivec2(int(at.z), row_) * int(side);
}

/* How far what the capture shows in a direction is along the face's axis; less than 0 and more than
 * FAR_OFF: nothing is there. `depth`: see `face_of`. */
float reach_at(int slot, vec3 d, out float depth)
{
  vec3 at = face_of(slot, d, depth);
  return texelFetch(reach_tx, atlas_pixel(slot, at, at.xy, capture_at(slot).w), 0).r;
}

/* How far a place lies behind what the capture shows in its direction. */
float capture_gap(int slot, vec3 p)
{
  float depth;
  float shown = abs(reach_at(slot, p, depth));
  return depth - shown;
}

/* What a capture shows round a place, at `at` of a face. */
struct Around {
  ivec2 corner;      /* the first of four pixels, in the atlas */
  vec4 near;         /* 1 / depth of each, for of a plane that is linear from pixel to pixel */
  vec4 parts;        /* of each in the place: those of the one surface that most of them show */
};

Around around(int slot, vec3 at)
{
  float side = capture_at(slot).w;
  vec2 low = clamp(floor(at.xy - 0.5), vec2(0.0), vec2(side - 2.0));
  vec2 t = clamp(at.xy - 0.5 - low, 0.0, 1.0);
  Around found;
  found.corner = atlas_pixel(slot, at, low, side);
  found.near = 1.0 / abs(vec4(texelFetch(reach_tx, found.corner, 0).r,
                              texelFetch(reach_tx, found.corner + ivec2(1, 0), 0).r,
                              texelFetch(reach_tx, found.corner + ivec2(0, 1), 0).r,
                              texelFetch(reach_tx, found.corner + ivec2(1, 1), 0).r));
  vec4 parts = vec4(1.0 - t.x, t.x, 1.0 - t.x, t.x) * vec4(vec2(1.0 - t.y), vec2(t.y));
  found.parts = vec4(0.0);
  float most = 0.0;
  for (int k = 0; k < 4; k++) {
    vec4 nearer = max(found.near, found.near[k]), farther = min(found.near, found.near[k]);
    vec4 votes = mix(vec4(0.0), parts, lessThan(nearer, GOES_ON * farther));
    float sum_ = dot(votes, vec4(1.0));
    if (sum_ > most) {
      most = sum_;
      found.parts = votes / sum_;
    }
  }
  return found;
}

/* The same as `capture_gap`, where edges run straight though pixels make them stairs. */
float smooth_gap(int slot, vec3 p)
{
  float depth;
  Around shown = around(slot, face_of(slot, p, depth));
  return depth - 1.0 / max(dot(shown.parts, shown.near), 1e-19);
}

/* The second capture of a glass that has a first one, behind what hides much from that; or -1. */
int second_of(int slot)
{
  int second = slot + int(view.start.y);
  return slot >= 0 && second < CAPTURES && capture_at(second).w > 0.5 ? second : -1;
}

/* Whether a capture sees a place: nothing stands before it, or what stands there. */
bool is_seen(int slot, vec3 p)
{
  if (slot < 0) {
    return false;
  }
  vec3 q = p - capture_at(slot).xyz;
  return smooth_gap(slot, q) < THIN + THICK_PART * length(q);
}

bool shows_thing(int slot, vec3 d)
{
  float depth;
  return abs(reach_at(slot, d, depth)) < FAR_OFF;
}

/* The colour in a direction. */
vec4 capture_colour(int slot, vec3 d)
{
  float depth;
  Around shown = around(slot, face_of(slot, d, depth));
  vec3 colour = vec3(0.0);
  float thing = 0.0;
  for (int k = 0; k < 4; k++) {
    ivec2 pixel = shown.corner + ivec2(k & 1, k >> 1);
    colour += shown.parts[k] * texelFetch(capture_tx, pixel, 0).rgb;
    thing += shown.parts[k] * float(texelFetch(reach_tx, pixel, 0).r > -FAR_OFF);
  }
  return vec4(colour, float(thing > 0.5));
}
