/* ray_table.h - a ray per pixel from a file, or a bundle of them: camera.h (9).
 *
 * The file is .npy, little-endian float32 or float64 in C order, [h][w][6]: a point of the ray [m] and its direction,
 * both in the world.  NaN: the pixel sees nothing.  In axes of its own (z along the mean direction, origin at the mean
 * point, of all rays) a ray is (a + a' z, b + b' z).  It begins at z = 0, so points belong on the camera's side of the
 * volume.  Between pixels a, b, a', b' are interpolated bilinearly, and beyond the outer ones they go on so.
 * A file of [h][w][k][6], 1 <= k <= REC_RAY_TABLE_RAYS, has k rays of equal weight per pixel, those through its middle
 * and the aperture in any order.  The pixel's own ray, by which points are projected, is then the mean one:
 *     (a, b, a', b') = sum_i (a_i, b_i, a'_i, b'_i) / k                                                (1)
 * It crosses every plane of z at the mean of the crossings.  Light comes along the bundle, and between pixels its ray i is
 * the mean one there and the difference of (1) that ray i of the nearest pixel has.  They need not meet anywhere.
 * Cost: 32 bytes per pixel, and with k > 1 16 more for each ray.
 * Ownership of those of get: the process.  A file is read once for each content and kept until the end, because
 * cameras are copied freely.  Threads: get may be called by any; a table never changes. */
#ifndef REC_RAY_TABLE_H
#define REC_RAY_TABLE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

#define REC_RAY_TABLE_FILE 1024
#define REC_RAY_TABLE_RAYS 64 /* of a pixel, at most */

struct rec_ray_table {
    char file[REC_RAY_TABLE_FILE]; /* absolute path */
    uint64_t hash;                 /* XXH3-64 of the file */
    int32_t w, h;
    double R[9], t[3]; /* its axes, as in camera.h */
    double (*line)[4]; /* [h][w] a, b, a', b', of a bundle's mean ray */
    int32_t rays;      /* of a pixel */
    float (*off)[4];   /* [h][w][rays] what each is off the mean; NULL: rays is 1 */
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

/* The same for ray i of the bundle; rays > 1. */
bool rec_ray_table_one(const struct rec_ray_table *t, double x, double y, int32_t i,
                       double line[4]);

/* The largest distance [px] from a pixel to where its bundle's points at depth z[0] or z[1] are seen, of some pixels. */
double rec_ray_table_disc(const struct rec_ray_table *t, const double z[2]);

/* The pixel that sees the point X of the table's axes, z > 0, by Newton's method from the nearest of a few pixels.
 * False: none is found. */
bool rec_ray_table_find(const struct rec_ray_table *t, const double X[3], double xy[2]);

#endif
