/* room_int.h - the state of a room, for its files and its tests. */
#ifndef REC_ROOM_INT_H
#define REC_ROOM_INT_H
#include "recon/view/room.h"
#include "recon/view/room_scene.h"

struct rec_room {
    struct room_scene scene;
    pvx_pool *pool;
    struct rec_grid grid; /* of the volume, borrowed */
    const float *dense;   /* NULL: none */
    int nch;
    float *light;      /* [scene.n_points][3] E, without E_a; < 0: covered by a body */
    double ambient[3]; /* E_a */
};

/* Point (i, j) of a face, i in 0..nu, j in 0..nv; its place in `light`. */
static inline size_t room_point(const struct room_face *f, int32_t i, int32_t j, double x[3])
{
    for (int a = 0; a < 3; a++)
        x[a] = f->o[a] + f->u[a] * i / f->nu + f->v[a] * j / f->nv;
    return f->first + (size_t)j * (size_t)(f->nu + 1) + (size_t)i;
}

/* Area [m^2] that point (i, j) of a face stands for in the trapezoid rule. */
double room_point_area(const struct room_face *f, int32_t i, int32_t j);

/* Albedo of a face at (a, b). */
double room_albedo(const struct room_face *f, double a, double b);

#endif
