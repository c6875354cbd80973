#include "recon/geom/ray_table.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "base/file.h"
#include "base/mem.h"

#define MAX_FILE ((size_t)1 << 31)
#define STEEP    4.0 /* slope against the mean direction, at most: 76 degrees */

static pthread_mutex_t ray_table_lock = PTHREAD_MUTEX_INITIALIZER;
static struct rec_ray_table *ray_table_all;

/* Whether the header has the text `key`: value, blanks aside. */
static bool ray_table_says(const char *header, const char *key, const char *value)
{
    const char *p = strstr(header, key);
    if (p == NULL)
        return false;
    p += strlen(key);
    while (*p == ' ' || *p == ':')
        p++;
    return strncmp(p, value, strlen(value)) == 0;
}

/* The axes of the header, 5 at most; returns how many.  0: not a list of numbers. */
static int ray_table_shape(const char *header, long axis[5])
{
    const char *p = strstr(header, "'shape'");
    char *end;
    int n = 0;
    if (p == NULL || (p = strchr(p, '(')) == NULL)
        return 0;
    for (p++; n < 5; p = end + strspn(end, " ,")) {
        axis[n] = strtol(p, &end, 10);
        if (end == p)
            break;
        n++;
    }
    return *p == ')' ? n : 0;
}

/* Where the numbers begin, their bytes each, and the rays of a pixel. */
static pvx_err ray_table_header(const char *bytes, size_t len, struct rec_ray_table *t, size_t *at,
                                size_t *size, struct pvx_diag *d)
{
    char text[512];
    long axis[5];
    int32_t w = t->w, h = t->h;
    const uint8_t *b = (const uint8_t *)bytes;
    if (len < 12 || memcmp(bytes, "\x93NUMPY", 6) != 0 || b[6] < 1 || b[6] > 3)
        return pvx_fail(d, PVX_EFORMAT, "not a .npy file");
    size_t wide = b[6] == 1 ? 2 : 4, n = 0;
    for (size_t i = 0; i < wide; i++)
        n |= (size_t)b[8 + i] << 8 * i;
    *at = 8 + wide + n;
    if (n >= sizeof text || *at > len)
        return pvx_fail(d, PVX_EFORMAT, "its header is cut off or too long");
    memcpy(text, bytes + 8 + wide, n);
    text[n] = '\0';
    *size = ray_table_says(text, "'descr'", "'<f4'")   ? 4
            : ray_table_says(text, "'descr'", "'<f8'") ? 8
                                                       : 0;
    if (*size == 0 || !ray_table_says(text, "'fortran_order'", "False"))
        return pvx_fail(d, PVX_EFORMAT, "should be float32 or float64, little-endian, in C order");
    int n_axes = ray_table_shape(text, axis);
    if (n_axes < 3 || n_axes > 4 || axis[0] != h || axis[1] != w || axis[n_axes - 1] != 6)
        return pvx_fail(d, PVX_EINVAL,
                        "should have the shape (%d, %d, 6), height and width of the camera's size, "
                        "or (%d, %d, k, 6) for bundles of k rays per pixel",
                        h, w, h, w);
    if (n_axes == 4 && !(axis[2] >= 1 && axis[2] <= REC_RAY_TABLE_RAYS))
        return pvx_fail(d, PVX_EINVAL, "has bundles of %ld rays per pixel; 1 to %d are supported",
                        axis[2], REC_RAY_TABLE_RAYS);
    t->rays = n_axes == 4 ? (int32_t)axis[2] : 1;
    if ((len - *at) / *size != (size_t)w * (size_t)h * (size_t)t->rays * 6)
        return pvx_fail(d, PVX_EFORMAT, "has not the size that its header says");
    return PVX_OK;
}

/* Ray i as the file has it.  False: none. */
static bool ray_table_ray(const char *data, size_t size, size_t i, double r[6])
{
    double n = 0;
    for (size_t k = 0; k < 6; k++) {
        float f;
        if (size == 4) {
            memcpy(&f, data + (6 * i + k) * 4, 4);
            r[k] = f;
        } else {
            memcpy(&r[k], data + (6 * i + k) * 8, 8);
        }
        if (!(fabs(r[k]) < 1e6))
            return false;
        n += k >= 3 ? r[k] * r[k] : 0;
    }
    for (size_t k = 3; k < 6 && n > 0; k++)
        r[k] /= sqrt(n);
    return n > 1e-30;
}

/* Axes with z along the unit vector z, and y as near to down as may be, about the point `at`. */
static void ray_table_axes(const double at[3], const double z[3], struct rec_ray_table *t)
{
    double m = hypot(z[0], z[1]), *R = t->R;
    R[0] = m > 1e-9 ? z[1] / m : 1;
    R[1] = m > 1e-9 ? -z[0] / m : 0;
    R[2] = 0;
    for (int a = 0; a < 3; a++) {
        int p = (a + 1) % 3, q = (a + 2) % 3;
        R[3 + a] = z[p] * R[q] - z[q] * R[p];
        R[6 + a] = z[a];
    }
    for (int i = 0; i < 3; i++)
        t->t[i] = -(R[3 * i] * at[0] + R[3 * i + 1] * at[1] + R[3 * i + 2] * at[2]);
}

/* The line of a ray in the table's axes.  False: too steep. */
static bool ray_table_line(const struct rec_ray_table *t, const double r[6], double line[4])
{
    double P[3], D[3];
    for (int a = 0; a < 3; a++) {
        P[a] = t->R[3 * a] * r[0] + t->R[3 * a + 1] * r[1] + t->R[3 * a + 2] * r[2] + t->t[a];
        D[a] = t->R[3 * a] * r[3] + t->R[3 * a + 1] * r[4] + t->R[3 * a + 2] * r[5];
    }
    if (!(D[2] > 0) || !(hypot(D[0], D[1]) <= STEEP * D[2]))
        return false;
    for (int a = 0; a < 2; a++) {
        line[2 + a] = D[a] / D[2];
        line[a] = P[a] - line[2 + a] * P[2];
    }
    return true;
}

/* The rays of pixel i: their mean, and what they are off it. */
static pvx_err ray_table_pixel(struct rec_ray_table *t, const char *data, size_t size, size_t i,
                               struct pvx_diag *d)
{
    double r[6], all[REC_RAY_TABLE_RAYS][4], *mean = t->line[i];
    size_t n = 0, rays = (size_t)t->rays, x = i % (size_t)t->w, y = i / (size_t)t->w;
    for (size_t k = 0; k < rays; k++) {
        if (!ray_table_ray(data, size, i * rays + k, r))
            continue;
        if (!ray_table_line(t, r, all[n++]))
            return pvx_fail(d, PVX_EINVAL,
                            "the ray of pixel (%zu, %zu) is more than 76 degrees off the mean "
                            "direction",
                            x, y);
    }
    if (n > 0 && n < rays)
        return pvx_fail(d, PVX_EINVAL,
                        "pixel (%zu, %zu) has only %zu of its %zu rays; trace others in place of "
                        "the lost ones, or make all NaN",
                        x, y, n, rays);
    for (int a = 0; a < 4; a++) {
        mean[a] = n > 0 ? all[0][a] : NAN;
        for (size_t k = 1; k < n; k++)
            mean[a] += all[k][a];
        mean[a] /= (double)rays;
        for (size_t k = 0; k < n && t->off != NULL; k++)
            t->off[i * rays + k][a] = (float)(all[k][a] - mean[a]);
    }
    return PVX_OK;
}

/* Axes from the means, then every line in them.  What it allocates is the table's. */
static pvx_err ray_table_fill(struct rec_ray_table *t, const char *data, size_t size,
                              struct pvx_diag *d)
{
    double mean[6] = {0}, r[6], n = 0;
    size_t pixels = (size_t)t->w * (size_t)t->h, all = pixels * (size_t)t->rays;
    t->line = pvx_calloc(pixels, sizeof *t->line);
    PVX_NEED(t->line);
    if (t->rays > 1) {
        t->off = pvx_calloc(all, sizeof *t->off);
        PVX_NEED(t->off);
    }
    for (size_t i = 0; i < all; i++)
        if (ray_table_ray(data, size, i, r)) {
            n++;
            for (int k = 0; k < 6; k++)
                mean[k] += r[k];
        }
    double length = sqrt(mean[3] * mean[3] + mean[4] * mean[4] + mean[5] * mean[5]);
    if (!(n > 0) || !(length > 0.1 * n))
        return pvx_fail(d, PVX_EINVAL, "has no rays, or they go in all directions");
    for (int k = 0; k < 3; k++) {
        mean[k] /= n;
        mean[3 + k] /= length;
    }
    ray_table_axes(mean, mean + 3, t);
    for (size_t i = 0; i < pixels; i++)
        PVX_TRY(ray_table_pixel(t, data, size, i, d));
    return PVX_OK;
}

pvx_err rec_ray_table_parse(const char *bytes, size_t len, int32_t w, int32_t h,
                            struct rec_ray_table **out, struct pvx_diag *d)
{
    size_t at, size;
    *out = NULL;
    if (w < 2 || h < 2)
        return pvx_fail(d, PVX_EINVAL, "a picture of rays has 2 x 2 pixels at least");
    struct rec_ray_table *t = pvx_calloc(1, sizeof *t);
    PVX_NEED(t);
    t->w = w;
    t->h = h;
    t->hash = XXH3_64bits(bytes, len);
    pvx_err e = ray_table_header(bytes, len, t, &at, &size, d);
    if (e == PVX_OK)
        e = ray_table_fill(t, bytes + at, size, d);
    if (e != PVX_OK) {
        rec_ray_table_free(t);
        return e;
    }
    *out = t;
    return PVX_OK;
}

void rec_ray_table_free(struct rec_ray_table *t)
{
    free(t->line);
    free(t->off);
    free(t);
}

pvx_err rec_ray_table_get(const char *path, int32_t w, int32_t h, const struct rec_ray_table **out,
                          struct pvx_diag *d)
{
    char *bytes;
    size_t len;
    struct rec_ray_table *t;
    PVX_TRY(pvx_file_read(path, MAX_FILE, &bytes, &len, d));
    uint64_t hash = XXH3_64bits(bytes, len);
    pthread_mutex_lock(&ray_table_lock);
    for (t = ray_table_all; t != NULL; t = t->next)
        if (t->hash == hash && t->w == w && t->h == h && strcmp(t->file, path) == 0)
            break;
    pvx_err e = PVX_OK;
    if (t == NULL && (e = rec_ray_table_parse(bytes, len, w, h, &t, d)) == PVX_OK) {
        snprintf(t->file, sizeof t->file, "%s", path);
        t->next = ray_table_all;
        ray_table_all = t;
    }
    *out = t;
    pthread_mutex_unlock(&ray_table_lock);
    free(bytes);
    return e;
}

static double ray_table_mix(double a, double b, double f)
{
    return a + f * (b - a);
}

bool rec_ray_table_at(const struct rec_ray_table *t, double x, double y, double line[4],
                      double slope[8])
{
    if (!(x > -t->w && x < 2.0 * t->w && y > -t->h && y < 2.0 * t->h))
        return false;
    double i = fmin(fmax(floor(x), 0), t->w - 2), j = fmin(fmax(floor(y), 0), t->h - 2);
    double f = x - i, g = y - j, sum = 0;
    const double(*p)[4] = (const double(*)[4])t->line + (size_t)j * (size_t)t->w + (size_t)i;
    const double(*q)[4] = p + t->w;
    for (int k = 0; k < 4; k++) {
        double above = ray_table_mix(p[0][k], p[1][k], f),
               below = ray_table_mix(q[0][k], q[1][k], f);
        line[k] = ray_table_mix(above, below, g);
        sum += line[k];
        if (slope != NULL) {
            slope[2 * k] = ray_table_mix(p[1][k] - p[0][k], q[1][k] - q[0][k], g);
            slope[2 * k + 1] = below - above;
        }
    }
    return isfinite(sum);
}

bool rec_ray_table_one(const struct rec_ray_table *t, double x, double y, int32_t i, double line[4])
{
    if (!rec_ray_table_at(t, x, y, line, NULL))
        return false;
    double u = fmin(fmax(floor(x + 0.5), 0), t->w - 1), v = fmin(fmax(floor(y + 0.5), 0), t->h - 1);
    size_t pixel = (size_t)v * (size_t)t->w + (size_t)u;
    for (int a = 0; a < 4; a++)
        line[a] += (double)t->off[pixel * (size_t)t->rays + (size_t)i][a];
    return true;
}

/* What the ray of (x,y) misses X by, in its plane; M = d miss / d (x,y). */
static bool ray_table_miss(const struct rec_ray_table *t, const double X[3], const double xy[2],
                           double miss[2], double M[4])
{
    double line[4], s[8];
    if (!rec_ray_table_at(t, xy[0], xy[1], line, s))
        return false;
    for (int a = 0; a < 2; a++) {
        miss[a] = line[a] + line[2 + a] * X[2] - X[a];
        for (int k = 0; k < 2; k++)
            M[2 * a + k] = s[2 * a + k] + s[2 * (2 + a) + k] * X[2];
    }
    return true;
}

double rec_ray_table_disc(const struct rec_ray_table *t, const double z[2])
{
    enum { NODES = 9 };
    double most = 0;
    for (int n = 0; n < 2 * NODES * NODES; n++) {
        int32_t x = n / 2 % NODES * (t->w - 1) / (NODES - 1);
        int32_t y = n / 2 / NODES * (t->h - 1) / (NODES - 1);
        double M[4], miss[2], line[4], at[2] = {x, y}, Z = z[n % 2];
        if (!ray_table_miss(t, (const double[3]){0, 0, Z}, at, miss, M))
            continue;
        double det = M[0] * M[3] - M[1] * M[2];
        for (int32_t i = 0; i < t->rays && t->off != NULL; i++) {
            if (!rec_ray_table_one(t, x, y, i, line))
                continue;
            double a = line[0] + line[2] * Z - miss[0], b = line[1] + line[3] * Z - miss[1];
            most = fmax(most, hypot(M[3] * a - M[1] * b, M[0] * b - M[2] * a) / fabs(det));
        }
    }
    return fmin(most, hypot(t->w, t->h));
}

bool rec_ray_table_find(const struct rec_ray_table *t, const double X[3], double xy[2])
{
    enum { NODES = 7 };
    double best = INFINITY, at[2], miss[2], M[4];
    for (int n = 0; n < NODES * NODES; n++) {
        at[0] = (n % NODES + 0.5) / NODES * (t->w - 1);
        at[1] = (n / NODES + 0.5) / NODES * (t->h - 1);
        if (ray_table_miss(t, X, at, miss, M) && hypot(miss[0], miss[1]) < best) {
            best = hypot(miss[0], miss[1]);
            xy[0] = at[0];
            xy[1] = at[1];
        }
    }
    if (!isfinite(best))
        return false;
    double share = 1, step[2];
    if (!ray_table_miss(t, X, xy, miss, M))
        return false;
    for (int it = 0; it < 80; it++) {
        double det = M[0] * M[3] - M[1] * M[2];
        if (!(fabs(det) > 0))
            return false;
        step[0] = (M[3] * miss[0] - M[1] * miss[1]) / det;
        step[1] = (M[0] * miss[1] - M[2] * miss[0]) / det;
        if (hypot(step[0], step[1]) < 1e-10)
            return true;
        double m2[2], M2[4];
        at[0] = xy[0] - share * step[0];
        at[1] = xy[1] - share * step[1];
        if (ray_table_miss(t, X, at, m2, M2) && hypot(m2[0], m2[1]) < best) {
            best = hypot(m2[0], m2[1]);
            memcpy(xy, at, sizeof at);
            memcpy(miss, m2, sizeof m2);
            memcpy(M, M2, sizeof M2);
            share = 1;
        } else if ((share *= 0.5) < 1e-3) {
            return hypot(step[0], step[1]) < 1e-7;
        }
    }
    return false;
}
