/* room_scene.h - the contents of the virtual room (room.h): six walls, a pillar, a block; where rays end.
 *
 * All lengths scale with s = max(height, diagonal of the ground plan) of the box that the room is made for:
 * 4.5 s x 4.5 s x 2.25 s, floor under the box.  Walls are one-sided: a camera outside looks through them.
 * Bodies are boxes turned about z that stand on the floor; the pillar (0) reaches the ceiling.
 * Faces are rectangles with light known at (nu + 1) x (nv + 1) points, corners included:
 *     x(a, b) = o + a u + b v,  a, b in 0..1                                                    (1)
 * Private to the room's files and its tests.  Threads: all functions but init are pure. */
#ifndef REC_ROOM_SCENE_H
#define REC_ROOM_SCENE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { ROOM_BODIES = 2, ROOM_FACES = 6 + 4 + 5, ROOM_FLOOR = 4 };

struct room_body {
    double centre[3], half[3], cosine, sine; /* of the turn about z */
};

struct room_face {
    double o[3], u[3], v[3], n[3]; /* edges m, unit normal */
    int body;                      /* -1: a wall, visible from inside */
    int32_t nu, nv;
    size_t first;           /* of its points */
    double tile, albedo[2]; /* side of the chequers, m; 0: all is albedo[0] */
};

struct room_scene {
    double min[3], max[3], size; /* of the room; s */
    int n_bodies, n_faces;
    struct room_body body[ROOM_BODIES];
    struct room_face face[ROOM_FACES];
    size_t n_points; /* of all faces */
};

struct room_hit {
    int face;
    double a, b; /* of (1) */
};

/* Room for a box; at least 1e-6 m of each side is assumed.  points: along the floor's side. */
void room_scene_init(struct room_scene *s, const double min[3], const double max[3],
                     int32_t points);

/* The part of a ray (|d| = 1) in the room, from `enter` to the first surface at `leave`, m.
 * False: it misses the room. */
bool room_scene_ray(const struct room_scene *s, const double o[3], const double d[3], double *enter,
                    double *leave, struct room_hit *hit);

/* Whether x is in the room and in none of its bodies. */
bool room_scene_free(const struct room_scene *s, const double x[3]);
/* Whether x is in a body or on its surface: the floor is not visible there. */
bool room_scene_covered(const struct room_scene *s, const double x[3]);

/* How much of the ball (c, r) is visible from p past body k.  r = 0: all or none.  ROOM_ALL and ROOM_NONE are
 * always right, but ROOM_PART may in truth be all or none.  Points p + t (c' - p), |c' - c| <= r, are at most t r
 * away from q = p + t (c - p).  So all of them are in the body where q is in the body shrunk by t r, and none of
 * them is in it where no q is in the body grown by t r. */
enum room_seen { ROOM_ALL, ROOM_PART, ROOM_NONE };
enum room_seen room_scene_sees(const struct room_scene *s, int k, const double p[3],
                               const double c[3], double r);

#endif
