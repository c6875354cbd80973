/* ray_table.h - a ray per pixel from a file: camera.h (9).
 *
 * The file is .npy, little-endian float32 or float64 in C order, [h][w][6]: a point of the ray [m] and its direction,
 * both in the world.  NaN: the pixel sees nothing.  In axes of its own (z along the mean direction, origin at the mean
 * point) a ray is (a + a' z, b + b' z).  Between pixels a, b, a', b' are interpolated bilinearly, and beyond the outer
 * ones they go on so.
 * Ownership of those of get: the process.  A file is read once for each content and kept until the end, because
 * cameras are copied freely.  Threads: get may be called by any; a table never changes. */
#ifndef REC_RAY_TABLE_H
#define REC_RAY_TABLE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

#define REC_RAY_TABLE_FILE 1024

struct rec_ray_table {
    char file[REC_RAY_TABLE_FILE]; /* absolute path */
    uint64_t hash;                 /* XXH3-64 of the file */
    int32_t w, h;
    double R[9], t[3]; /* its axes, as in camera.h */
    double (*line)[4]; /* [h][w] a, b, a', b' */
    struct rec_ray_table *next;
};

/* Errors: those of pvx_file_read, PVX_EFORMAT, PVX_EINVAL (size, rays that spread too far), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_ray_table_get(const char *path, int32_t w, int32_t h,
                                         const struct rec_ray_table **out, struct pvx_diag *d);

/* The same from the bytes of a file; owner: caller, free. */
PVX_MUST_CHECK pvx_err rec_ray_table_parse(const char *bytes, size_t len, int32_t w, int32_t h,
                                           struct rec_ray_table **out, struct pvx_diag *d);
void rec_ray_table_free(struct rec_ray_table *t);

/* The line at pixel (x,y), and its derivatives by x and y or NULL.  False: no ray there. */
bool rec_ray_table_at(const struct rec_ray_table *t, double x, double y, double line[4],
                      double slope[8]);

/* The pixel that sees the point X of the table's axes, z > 0, by Newton's method from the nearest of a few pixels.
 * False: none is found. */
bool rec_ray_table_find(const struct rec_ray_table *t, const double X[3], double xy[2]);

#endif
