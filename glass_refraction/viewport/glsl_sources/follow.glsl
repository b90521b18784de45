// SPDX-License-Identifier: GPL-3.0-or-later

/* Follows one ray (common frame, unit direction) through all glasses, the strongest ways first.
 *
 * start: what it starts in, see `medium_in`. least: light below this part is not followed.
 * most: ways after which to stop. splits: false if surfaces only refract, and take no light.
 * unseen: how far the ray runs before the camera's near plane: there nothing bends it.
 * Returns how far the ray goes to the first interface, NOWHERE if it meets none. */
float follow(vec3 place, vec3 along, ivec4 start, float least, int most, bool splits,
             float unseen)
{
  vec3 places[PENDING];
  vec3 alongs[PENDING];
  vec4 lights[PENDING];
  ivec4 helds[PENDING];
  ivec4 states[PENDING];
  int pending = 0;
  vec4 light = vec4(1.0);
  ivec4 held = start;
  int home = home_of(held);
  /* p and d are in the frame of the glass `home`, of none in the common one. */
  vec3 p = home < 0 ? place : to_glass(home, place);
  vec3 d = home < 0 ? along : turn_in(home, along);
  int last = home, ways = 0, skip = -1;
  course = home < 0 ? 0 : NO_COURSE;
  events = 0;
  by_mirror = false;
  float first_way = NOWHERE, gone = 0.0;
  bool alive = true, begun = false;
  int glasses_ = int(row(0).x);
  for (int guard = 0; guard < MOST_STRETCHES; guard++) {
    if (!alive) {
      if (pending == 0 || ways >= most) {
        break;
      }
      int best = 0;
      for (int k = 1; k < pending; k++) {
        if (lights[k].w > lights[best].w) {
          best = k;
        }
      }
      pending--;
      p = places[best]; d = alongs[best]; light = lights[best]; held = helds[best];
      last = states[best].x; events = abs(states[best].y); skip = states[best].z;
      course = states[best].w;
      by_mirror = states[best].y < 0;
      places[best] = places[pending]; alongs[best] = alongs[pending];
      lights[best] = lights[pending]; states[best] = states[pending];
      helds[best] = helds[pending];
      home = home_of(held);
      alive = true;
    }
    vec3 from = home < 0 ? p : to_common(home, p);
    vec3 toward = home < 0 ? d : turn_out(home, d);
    /* Of the nearest interface: way in the common frame, row, glass, where on it. */
    float way = NOWHERE;
    vec3 spot = vec3(0.0);
    int met = -1, hit = last;
    for (int number = 0; number < glasses_; number++) {
      /* Its own glass first: what lies behind the face that is met there need not be looked at. */
      int k = number <= home ? (number == 0 ? home : number - 1) : number;
      bool own = k == home;
      if (!own && passes_ball(k, from, toward, way)) {
        continue;
      }
      vec3 q = own ? p : to_glass(k, from), v = own ? d : turn_in(k, toward);
      float size = row(9 + GLASS_ROWS * k).x;
      /* From where it enters the glass's box, where numbers stay small, to where it leaves that. */
      vec3 away = row(2 + GLASS_ROWS * k).xyz - q, half_ = row(11 + GLASS_ROWS * k).xyz;
      vec3 inverse = 1.0 / mix(v, vec3(1e-12), lessThan(abs(v), vec3(1e-12)));
      vec3 middle = away * inverse, room = half_ * abs(inverse);
      vec3 enters = middle - room, leaves = middle + room;
      float enter = own ? 0.0 : max(max(enters.x, enters.y), max(enters.z, 0.0));
      float leave_ = min(min(leaves.x, leaves.y), leaves.z);
      if (!own && (enter > leave_ || enter * size > way)) {
        continue;
      }
      float t;
      vec3 mark;
      float near = min(way / size, leave_) - enter;
      int found = next_interface(k, medium_in(held, k), q + enter * v, v, near, skip, t, mark);
      if (found >= 0) {
        way = (t + enter) * size;
        spot = mark;
        met = found;
        hit = k;
      }
    }
    bool is_cut = gone + way < unseen;
    if (!begun && !is_cut) {
      begun = true;
      first_way = gone + way;
      if (met < 0 || covered(place + first_way * along)) {
        return NOWHERE;
      }
    }
    vec3 n = vec3(0.0), flat_ = vec3(0.0), here = p;
    int beyond = 0;
    bool is_mesh = false;
    if (met >= 0) {
      vec3 v = d;
      if (hit != home) {
        here = to_glass(hit, from);
        v = turn_in(hit, toward);
      }
      here += way / row(9 + GLASS_ROWS * hit).x * v;
      n = normal_at(met, spot, v, here, flat_);
      vec4 face = row(met);
      is_mesh = int(face.x) == MESH;
      bool back = medium_in(held, hit) == int(face.z);
      if (is_mesh) {
        /* The side of a face tells what the ray was in. */
        back = dot(flat_, v) > 0.0;
        held = with_medium(held, hit, back ? 1 : 0);
      }
      beyond = back ? int(face.y) : int(face.z);
      n = back ? -n : n;
      flat_ = back ? -flat_ : flat_;
      d = v;
    }
    int holder = holding(held);
    vec3 taken = vec3(0.0);
    if (holder >= 0) {
      int g = holder >> 4;
      taken = row(int(row(1 + GLASS_ROWS * g).z) + MEDIUM_ROWS * (holder & 15) + 1).xyz /
              row(9 + GLASS_ROWS * g).x;
    }
    if (met < 0 && home >= 0 && int(row(int(row(1 + GLASS_ROWS * home).x)).x) != MESH) {
      /* A closed form has a face wherever a ray in it goes. */
      lose(light);
      alive = false;
      continue;
    }
    bool may_end = met < 0 ||
                   (events > 0 &&
                    (home < 0 || (int(medium_row(home, medium_in(held, home)).y) & HOLLOW) != 0));
    if (may_end && ends(from, toward, light, home < 0 ? last : home, taken,
                        home >= 0 || hit == last, way, ways)) {
      ways++;
      alive = false;
      continue;
    }
    light.rgb *= exp(-taken * min(way, max(gone + way - unseen, 0.0)));
    gone += way;
    if (row(met).w > 0.5 && events > 0 &&
        touches(to_common(hit, here), toward, light, hit, ways)) {
      ways++;
      alive = false;
      continue;
    }
    ivec4 after = with_medium(held, hit, beyond);
    int holder_after = holding(after);
    bool is_straight = is_cut || holder == holder_after;
    if ((events > 0 && hit != last) || is_straight) {
      course = NO_COURSE;
    }
    last = hit;
    skip = is_mesh ? int(spot.x) : -1;
    vec3 clear = is_mesh ? CLEARANCE * flat_ : vec3(0.0);
    if (is_straight) {
      /* What holds stays the same, or is not seen: the ray goes straight on. */
      held = after;
      home = home_of(held);
      p = here - clear;
    }
    else {
      float eta = ior_of(holder) / ior_of(holder_after);
#ifdef MESHES
      if (is_mesh) {
        n = bent(n, flat_, d);
        float rough = roughness_at(met, spot);
        if (rough > 0.0) {
          n = bent(facet(n, d, rough * rough, events), flat_, d);
        }
      }
#endif
      float cosine = clamp(-dot(n, d), 0.0, 1.0), behind;
      float mirrored = fresnel(cosine, eta, behind);
      bool total = mirrored >= 1.0;
      if (!splits) {
        mirrored = 0.0;
        if (total) {
          lose(light);
          alive = false;
          continue;
        }
      }
      events++;
      float enough = min(least * max(1.0, float(events) / PLAIN), max(least, STRONG));
      enough = splits ? enough : 0.0;
      vec4 other = light * vec4(1.0, 1.0, 1.0, mirrored);
      light.w *= 1.0 - mirrored;
#ifdef MESHES
      if (is_mesh) {
        vec3 through = row(met + 2).rgb, off = row(10 + GLASS_ROWS * hit).yzw;
        colours_at(met, spot, through, off);
        light.rgb *= through;
        other.rgb *= off;
      }
#endif
      vec3 turned = d + 2.0 * cosine * n;
      d = normalize(eta * d + (eta * cosine - behind) * n);
      p = here - clear;
#ifdef MESHES
      if (is_mesh && dot(d, flat_) >= 0.0 && light.w > enough) {
        /* Refracted to before the face: black, as in Cycles. */
        darken(to_common(hit, p), turn_out(hit, d), light.w, ways);
        ways++;
        light.w = 0.0;
      }
#endif
      vec3 second_place = here + clear;
      vec3 second = turned;
      vec4 rest = other;
      ivec4 second_held = held;
      bool second_by_mirror = true;
      int crossed = crossing(hit, met), second_course = NO_COURSE;
      if (other.w > light.w) {
        second_course = crossed;
        course = NO_COURSE;
        second_place = p; second = d; rest = light; second_held = after;
        p = here + clear; d = turned; light = other;
        second_by_mirror = by_mirror;
        by_mirror = true;
      }
      else {
        held = after;
        course = crossed;
      }
      home = home_of(held);
      if (rest.w > enough) {
        int slot = pending;
        if (pending == PENDING) {
          slot = 0;
          for (int k = 1; k < PENDING; k++) {
            if (lights[k].w < lights[slot].w) {
              slot = k;
            }
          }
          if (lights[slot].w > rest.w) {
            slot = -1;
          }
        }
        else {
          pending++;
        }
        if (slot >= 0) {
          int second_home = home_of(second_held);
          places[slot] = moved(hit, second_home, second_place);
          alongs[slot] = turned_to(hit, second_home, second);
          lights[slot] = rest;
          helds[slot] = second_held;
          states[slot] = ivec4(hit, second_by_mirror ? -events : events, skip, second_course);
        }
      }
      alive = light.w > enough;
    }
    p = moved(hit, home, p);
    d = turned_to(hit, home, d);
  }
  return first_way;
}
