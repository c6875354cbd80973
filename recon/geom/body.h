/* body.h - known opaque bodies in the flame or in front of it: a ray ends at the first of them.
 *
 *     box       { x : min <= x <= max }
 *     cylinder  { x : 0 <= (x-from).a <= |to-from|, |x-from - ((x-from).a) a| <= radius },
 *               a = (to-from)/|to-from|                                                    (1)
 *     mesh      the inside of a closed surface of triangles
 * Source: slabs, T. L. Kay & J. T. Kajiya, SIGGRAPH 1986 (box, nodes of the mesh's tree); the quadric of (1);
 * T. Moeller & B. Trumbore, J. Graphics Tools 2(1), 1997 (triangles); the solid angle of a triangle, A. van
 * Oosterom & J. Strackee, IEEE Trans. Biomed. Eng. 30, 1983 (inside a mesh).
 * Units: metres, world.  Threads: bodies do not change after they are made; all queries are pure. */
#ifndef REC_BODY_H
#define REC_BODY_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

#ifdef __cplusplus
extern "C" {
#endif

#define REC_BODIES_MAX 64
#define REC_MESH_MAX   1000000 /* triangles */
#define REC_BODY_NAME  64
#define REC_BODY_FILE  1024

struct rec_mesh; /* triangles and their tree; shared by copies of a rig */

enum rec_body_kind { REC_BODY_BOX, REC_BODY_CYLINDER, REC_BODY_MESH };

struct rec_body {
    char name[REC_BODY_NAME];
    enum rec_body_kind kind;
    double a[3], b[3]; /* box: min, max; cylinder: from, to */
    double radius;     /* cylinder */
    struct rec_mesh *mesh;
    double scale;             /* mesh: metres per unit of the file */
    char file[REC_BODY_FILE]; /* mesh: absolute path of its file */
};

struct rec_bodies {
    size_t n; /* 0: no bodies; `body` is not read */
    struct rec_body *body;
};

/* Metres along dir (unit length) to the first body, 0 from inside one; INFINITY: none.
 * Cost: O(bodies), O(log triangles) for a mesh. */
double rec_body_hit(const struct rec_bodies *b, const double origin[3], const double dir[3]);

/* Whether the point is inside a body, or on its surface.  Cost: O(triangles). */
bool rec_body_inside(const struct rec_body *b, const double x[3]);

/* Copies bodies (meshes are shared, by a count of owners); frees what bodies own.  Their owner is that of the rig. */
PVX_MUST_CHECK pvx_err rec_bodies_copy(const struct rec_bodies *b, struct rec_bodies *out);
void rec_bodies_fini(struct rec_bodies *b);

/* A closed surface: `n` triangles of three corners [n][3][3] in metres, which are copied.
 * Errors: PVX_EINVAL + diag (no triangle, over REC_MESH_MAX, NaN, not closed), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_mesh_new(const double *corners, size_t n, struct rec_mesh **out,
                                    struct pvx_diag *d);
struct rec_mesh *rec_mesh_share(struct rec_mesh *m);
void rec_mesh_free(struct rec_mesh **m); /* gives up one owner's share */

double rec_mesh_hit(const struct rec_mesh *m, const double origin[3], const double dir[3]);
bool rec_mesh_inside(const struct rec_mesh *m, const double x[3]);
void rec_mesh_box(const struct rec_mesh *m, double min[3], double max[3]);
uint64_t rec_mesh_hash(const struct rec_mesh *m); /* XXH3-64 of its corners */

/* Reads an STL file, text or binary; corners are multiplied by `scale`.  A surface whose longest side is over a hundred
 * times `side` [m] is refused: the file is in millimetres.  `path` is relative to the working directory.
 * Errors: PVX_ENOENT, PVX_EPERM, PVX_EIO, PVX_EFORMAT (also: cut off), PVX_EINVAL, PVX_ENOMEM; diag: one sentence
 * with the remedy. */
PVX_MUST_CHECK pvx_err rec_mesh_load(const char *path, double scale, double side,
                                     struct rec_mesh **out, struct pvx_diag *d);

#ifdef __cplusplus
}
#endif
#endif
