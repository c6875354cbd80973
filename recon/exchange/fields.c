#include "recon/exchange/fields.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define HUGE_NUMBER 1e9

pvx_err(exchange_fail)(const struct exchange_in *in, int node, const char *key, pvx_err e,
                       const char *fmt, ...)
{
    char reason[500];
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(reason, sizeof reason, fmt, ap);
    va_end(ap);
    if (node != 0 && in->y != NULL)
        return pvx_yaml_fail(in->y, node, key, e, in->d, "%s", reason);
    return pvx_fail(in->d, e, "%s: %s: %s", in->path, key, reason);
}

void exchange_stem(const char *path, char out[REC_NAME_MAX])
{
    const char *slash = strrchr(path, '/'), *from = slash != NULL ? slash + 1 : path;
    const char *dot = strrchr(from, '.');
    size_t n = dot != NULL && dot > from ? (size_t)(dot - from) : strlen(from);
    snprintf(out, REC_NAME_MAX, "%.*s", (int)(n < REC_NAME_MAX ? n : REC_NAME_MAX - 1), from);
}

void exchange_note(struct rec_exchange *x, const char *text)
{
    size_t n = strlen(x->note);
    if (strstr(x->note, text) == NULL && n + strlen(text) + 2 < sizeof x->note)
        snprintf(x->note + n, sizeof x->note - n, "%s%s", n > 0 ? " " : "", text);
}

pvx_err exchange_camera(struct rec_exchange *x, const char *path, const char *name,
                        struct rec_exchange_camera **out, struct pvx_diag *d)
{
    char clean[REC_NAME_MAX];
    *out = NULL;
    if (strlen(name) >= sizeof clean)
        return pvx_fail(d, PVX_EINVAL, "%s: the camera name '%.80s...' has more than %d characters",
                        path, name, REC_NAME_MAX - 1);
    snprintf(clean, sizeof clean, "%s", name);
    for (char *p = clean; *p != '\0'; p++)
        if (!rec_rig_name_ok((char[]){'a', *p, '\0'}))
            *p = '_';
    if (!rec_rig_name_ok(clean))
        return pvx_fail(d, PVX_EINVAL, "%s: '%s' names no camera", path, clean);
    for (size_t i = 0; i < x->n; i++)
        if (strcmp(x->camera[i].c.name, clean) == 0) {
            *out = &x->camera[i];
            return PVX_OK;
        }
    if (x->n == REC_MAX_CAMERAS)
        return pvx_fail(d, PVX_EINVAL, "%s: more than %d cameras; a rig has at most as many", path,
                        REC_MAX_CAMERAS);
    struct rec_exchange_camera *c = &x->camera[x->n++];
    memset(c, 0, sizeof *c);
    memcpy(c->c.name, clean, sizeof clean);
    c->c.gain[0] = c->c.gain[1] = c->c.gain[2] = 1;
    *out = c;
    return PVX_OK;
}

/* ---- numbers ---------------------------------------------------------------------------------- */

static pvx_err exchange_list(const struct exchange_in *in, int node, const char *key, size_t room,
                             double *out, size_t *n)
{
    size_t length = pvx_yaml_length(in->y, node);
    if (pvx_yaml_kind(in->y, node) == PVX_YAML_SCALAR) { /* FileStorage's list of one, in XML */
        *n = 1;
        return room < 1
                   ? pvx_yaml_fail(in->y, node, key, PVX_EFORMAT, in->d, "has too many numbers")
                   : pvx_yaml_double(in->y, node, key, -HUGE_NUMBER, HUGE_NUMBER, out, in->d);
    }
    if (length > room)
        return pvx_yaml_fail(in->y, node, key, PVX_EFORMAT, in->d, "has too many numbers");
    for (size_t i = 0; i < length; i++)
        PVX_TRY(pvx_yaml_double(in->y, pvx_yaml_item(in->y, node, i), key, -HUGE_NUMBER,
                                HUGE_NUMBER, &out[i], in->d));
    *n = length;
    return PVX_OK;
}

/* A FileStorage matrix, or ROS's. */
static pvx_err exchange_matrix(const struct exchange_in *in, int node, const char *key,
                               double out[EXCHANGE_MAX], size_t *n)
{
    const pvx_yaml *y = in->y;
    int r = pvx_yaml_get(y, node, "rows"), c = pvx_yaml_get(y, node, "cols");
    int list = pvx_yaml_get(y, node, "data");
    int64_t high = 0, wide = 0;
    if (r == 0 || c == 0 || list == 0 || pvx_yaml_kind(y, list) == PVX_YAML_MAP)
        return pvx_yaml_fail(y, node, key, PVX_EFORMAT, in->d,
                             "should be a matrix: rows, cols, data");
    PVX_TRY(pvx_yaml_int(y, r, key, 0, 1 << 20, &high, in->d));
    PVX_TRY(pvx_yaml_int(y, c, key, 0, 1 << 20, &wide, in->d));
    PVX_TRY(exchange_list(in, list, key, EXCHANGE_MAX, out, n));
    if (*n != (size_t)(high * wide))
        return pvx_yaml_fail(y, node, key, PVX_EFORMAT, in->d, "has %zu numbers, not rows x cols",
                             *n);
    return PVX_OK;
}

/* A list of lists. */
static pvx_err exchange_lists(const struct exchange_in *in, int node, const char *key,
                              double out[EXCHANGE_MAX], size_t *n)
{
    const pvx_yaml *y = in->y;
    const size_t wide = pvx_yaml_length(y, pvx_yaml_item(y, node, 0));
    const size_t rows = pvx_yaml_length(y, node);
    for (size_t i = 0; i < rows; i++) {
        size_t got = 0;
        PVX_TRY(
            exchange_list(in, pvx_yaml_item(y, node, i), key, EXCHANGE_MAX - *n, out + *n, &got));
        if (got != wide)
            return pvx_yaml_fail(y, node, key, PVX_EFORMAT, in->d, "has rows of different lengths");
        *n += got;
    }
    return PVX_OK;
}

pvx_err exchange_numbers(const struct exchange_in *in, int node, const char *key, size_t n_min,
                         size_t n_max, double out[EXCHANGE_MAX], size_t *n)
{
    const pvx_yaml *y = in->y;
    memset(out, 0, EXCHANGE_MAX * sizeof *out);
    *n = 0;
    if (pvx_yaml_kind(y, node) == PVX_YAML_MAP)
        PVX_TRY(exchange_matrix(in, node, key, out, n));
    else if (pvx_yaml_kind(y, pvx_yaml_item(y, node, 0)) == PVX_YAML_SEQ)
        PVX_TRY(exchange_lists(in, node, key, out, n));
    else if (pvx_yaml_kind(y, node) == PVX_YAML_NONE)
        return exchange_fail(in, node, key, PVX_EFORMAT, "is missing");
    else
        PVX_TRY(exchange_list(in, node, key, EXCHANGE_MAX, out, n));
    if (*n >= n_min && *n <= n_max)
        return PVX_OK;
    if (n_min == n_max)
        return pvx_yaml_fail(y, node, key, PVX_EFORMAT, in->d, "should have %zu numbers, not %zu",
                             n_min, *n);
    return pvx_yaml_fail(y, node, key, PVX_EFORMAT, in->d,
                         "should have %zu to %zu numbers, not %zu", n_min, n_max, *n);
}

/* ---- lens ------------------------------------------------------------------------------------- */

pvx_err exchange_lens(const struct exchange_in *in, int node, const char *key, const double K[9],
                      double centre, struct rec_exchange_camera *c)
{
    if (c->lens)
        return exchange_fail(in, node, key, PVX_EINVAL, "camera '%s' has its lens in two places",
                             c->c.name);
    if (!(K[0] >= 1e-3) || !(K[4] >= 1e-3) || K[3] != 0 || K[6] != 0 || K[7] != 0 ||
        !(fabs(K[8] - 1) < 1e-9))
        return exchange_fail(in, node, key, PVX_EINVAL,
                             "camera '%s': should be fx 0 cx, 0 fy cy, 0 0 1 with focal lengths in "
                             "pixels; has %g %g %g, %g %g %g, %g %g %g",
                             c->c.name, K[0], K[1], K[2], K[3], K[4], K[5], K[6], K[7], K[8]);
    if (fabs(K[1]) > 1e-3) /* moves no pixel by 0.01 at |y|/z < 10 */
        return exchange_fail(in, node, key, PVX_EUNSUP,
                             "camera '%s' has skewed pixels (%g), which are not supported: "
                             "calibrate without skew",
                             c->c.name, K[1]);
    double first = in->x->centred ? in->x->centre : centre;
    c->c.fx = K[0];
    c->c.fy = K[4];
    c->c.cx = K[2] - first;
    c->c.cy = K[5] - first;
    c->lens = true;
    return PVX_OK;
}

pvx_err exchange_distortion(const struct exchange_in *in, int node, const char *key,
                            enum rec_camera_model model, const double *k, size_t n,
                            struct rec_exchange_camera *c)
{
    c->c.model = model;
    if (model == REC_FISHEYE && n != 0 && n != 4)
        return exchange_fail(in, node, key, PVX_EFORMAT,
                             "camera '%s': a fisheye has 4 numbers (k1 k2 k3 k4), not %zu",
                             c->c.name, n);
    if (n != 0 && n != 4 && n != 5 && n != 8 && n != 12 && n != 14)
        return exchange_fail(in, node, key, PVX_EFORMAT,
                             "camera '%s': should have 0, 4, 5, 8, 12 or 14 numbers (k1 k2 p1 p2 "
                             "[k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]]), not %zu",
                             c->c.name, n);
    for (size_t i = 8; i < n && i < 12; i++)
        if (k[i] != 0)
            return exchange_fail(in, node, key, PVX_EUNSUP,
                                 "camera '%s': %g is of OpenCV's thin prism model (s1 s2 s3 s4), "
                                 "which is not supported: calibrate without it",
                                 c->c.name, k[i]);
    if (n == 14 && (k[12] != 0 || k[13] != 0)) {
        c->c.model = REC_SCHEIMPFLUG;
        c->c.tilt[0] = k[12];
        c->c.tilt[1] = k[13];
    }
    memset(c->c.dist, 0, sizeof c->c.dist);
    for (size_t i = 0; i < n && i < 8; i++)
        c->c.dist[i] = k[i];
    return PVX_OK;
}

pvx_err exchange_size(const struct exchange_in *in, int node, const char *key, const double wh[2],
                      struct rec_exchange_camera *c)
{
    for (int i = 0; i < 2; i++)
        if (!(wh[i] >= 1 && wh[i] <= 16384) || wh[i] != floor(wh[i]))
            return exchange_fail(in, node, key, PVX_EINVAL,
                                 "camera '%s': the size of its pictures is %g x %g; 1 to 16384 "
                                 "pixels are possible",
                                 c->c.name, wh[0], wh[1]);
    if (c->c.width != 0 && (c->c.width != (int32_t)wh[0] || c->c.height != (int32_t)wh[1]))
        return exchange_fail(in, node, key, PVX_EINVAL,
                             "camera '%s' has two sizes: %dx%d and %gx%g", c->c.name, c->c.width,
                             c->c.height, wh[0], wh[1]);
    c->c.width = (int32_t)wh[0];
    c->c.height = (int32_t)wh[1];
    return PVX_OK;
}

/* ---- pose ------------------------------------------------------------------------------------- */

void exchange_transpose(const double in[9], double out[9])
{
    for (int i = 0; i < 9; i++)
        out[i] = in[3 * (i % 3) + i / 3];
}

/* R = I + sin a [k] + (1 - cos a) [k]^2, v = a k, |k| = 1.  Source: Rodrigues' formula, as cv::Rodrigues documents it. */
void exchange_rodrigues(const double v[3], double R[9])
{
    double a = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    double s = a > 0 ? sin(a) / a : 1, c = a > 0 ? (1 - cos(a)) / (a * a) : 0.5;
    const double K[9] = {0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double square = 0;
            for (int k = 0; k < 3; k++)
                square += K[3 * i + k] * K[3 * k + j];
            R[3 * i + j] = (i == j) + s * K[3 * i + j] + c * square;
        }
}

/* Hamilton's convention, real part first; not of unit length is the caller's matter (exchange_pose refuses it). */
void exchange_quaternion(const double q[4], double R[9])
{
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double r[9] = {w * w + x * x - y * y - z * z, 2 * (x * y - w * z),
                         2 * (x * z + w * y),           2 * (x * y + w * z),
                         w * w - x * x + y * y - z * z, 2 * (y * z - w * x),
                         2 * (x * z - w * y),           2 * (y * z + w * x),
                         w * w - x * x - y * y + z * z};
    memcpy(R, r, sizeof r);
}

static pvx_err exchange_is_rotation(const struct exchange_in *in, int node, const char *key,
                                    const double R[9], const char *name)
{
    double off = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double s = i == j ? -1 : 0;
            for (int k = 0; k < 3; k++)
                s += R[3 * i + k] * R[3 * j + k];
            off = fmax(off, fabs(s));
        }
    double det = R[0] * (R[4] * R[8] - R[5] * R[7]) - R[1] * (R[3] * R[8] - R[5] * R[6]) +
                 R[2] * (R[3] * R[7] - R[4] * R[6]);
    if (!(off <= 1e-3) || !(fabs(det - 1) <= 1e-3))
        return exchange_fail(in, node, key, PVX_EINVAL,
                             "camera '%s': R is not a rotation (|R R^T - I| = %.3g, det = %.4g)%s",
                             name, off, det, det < 0 ? "; it is a mirror image" : "");
    return PVX_OK;
}

pvx_err exchange_pose(const struct exchange_in *in, int node, const char *key, const double R[9],
                      const double t[3], struct rec_exchange_camera *c)
{
    if (c->pose)
        return exchange_fail(in, node, key, PVX_EINVAL, "camera '%s' has its pose in two places",
                             c->c.name);
    PVX_TRY(exchange_is_rotation(in, node, key, R, c->c.name));
    memcpy(c->c.R, R, sizeof c->c.R);
    memcpy(c->c.t, t, sizeof c->c.t);
    c->pose = true;
    return PVX_OK;
}

pvx_err exchange_pose_to_world(const struct exchange_in *in, int node, const char *key,
                               const double R[9], const double at[3], struct rec_exchange_camera *c)
{
    double to[9], t[3];
    exchange_transpose(R, to);
    for (int i = 0; i < 3; i++)
        t[i] = -(to[3 * i] * at[0] + to[3 * i + 1] * at[1] + to[3 * i + 2] * at[2]);
    return exchange_pose(in, node, key, to, t, c);
}

pvx_err exchange_unit(const struct exchange_in *in, double metres)
{
    if (in->x->unit != 0 && fabs(in->x->unit / metres - 1) > 1e-9)
        return pvx_fail(in->d, PVX_EINVAL,
                        "%s: a unit of t is %g m here, and %g m in the files before it: import "
                        "files of one unit",
                        in->path, metres, in->x->unit);
    in->x->unit = metres;
    return PVX_OK;
}
