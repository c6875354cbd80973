#include "recon/geom/rig.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "base/file.h"
#include "base/mem.h"
#include "base/yaml.h"
#include "recon/geom/blind.h"
#include "recon/geom/photometry_text.h"
#include "recon/geom/rig_bodies.h"
#include "recon/geom/rig_optics.h"
#include "recon/geom/rig_spectral.h"

#define MAX_FILE  (4u << 20)
#define MAX_COORD 1e6 /* m; keeps every product of coordinates far from overflow */

/* ---- reading ---------------------------------------------------------------------------------- */

struct reader {
    const pvx_yaml *y;
    const char *name; /* of the file */
    struct pvx_diag *d;
};

static pvx_err need(const struct reader *r, int map, const char *path, const char *key, int *node)
{
    *node = pvx_yaml_get(r->y, map, key);
    if (*node == 0)
        return pvx_yaml_fail(r->y, map, path, PVX_EFORMAT, r->d, "the key '%s' is missing", key);
    return PVX_OK;
}

/* `n` numbers in [min,max] under a key that must be there. */
static pvx_err rig_numbers(const struct reader *r, int map, const char *path, const char *key,
                           size_t n, double limit, double *out)
{
    char full[96];
    snprintf(full, sizeof full, "%s.%s", path, key);
    int node;
    PVX_TRY(need(r, map, path, key, &node));
    PVX_TRY(pvx_yaml_doubles(r->y, node, full, n, n, out, r->d));
    for (size_t i = 0; i < n; i++)
        if (fabs(out[i]) > limit)
            return pvx_yaml_fail(r->y, pvx_yaml_item(r->y, node, i), full, PVX_EINVAL, r->d,
                                 "%g is outside %g..%g", out[i], -limit, limit);
    return PVX_OK;
}

/* `n` whole numbers in [1,max] under a key that must be there. */
static pvx_err integers(const struct reader *r, int map, const char *path, const char *key,
                        size_t n, int64_t max, int32_t *out)
{
    char full[96];
    snprintf(full, sizeof full, "%s.%s", path, key);
    int node;
    PVX_TRY(need(r, map, path, key, &node));
    if (pvx_yaml_kind(r->y, node) != PVX_YAML_SEQ || pvx_yaml_length(r->y, node) != n)
        return pvx_yaml_fail(r->y, node, full, PVX_EFORMAT, r->d,
                             "should be a list of %zu whole numbers", n);
    for (size_t i = 0; i < n; i++) {
        int64_t v;
        PVX_TRY(pvx_yaml_int(r->y, pvx_yaml_item(r->y, node, i), full, 1, max, &v, r->d));
        out[i] = (int32_t)v;
    }
    return PVX_OK;
}

static pvx_err read_volume(const struct reader *r, int root, struct rec_grid *g)
{
    int v, voxels, basis;
    PVX_TRY(need(r, root, "rig", "volume", &v));
    PVX_TRY(pvx_yaml_known(r->y, v, "volume", "min max voxels basis", r->d));
    PVX_TRY(rig_numbers(r, v, "volume", "min", 3, MAX_COORD, g->min));
    PVX_TRY(rig_numbers(r, v, "volume", "max", 3, MAX_COORD, g->max));
    PVX_TRY(need(r, v, "volume", "voxels", &voxels));
    if (strcmp(pvx_yaml_text(r->y, voxels), "auto") == 0)
        memset(g->n, 0, sizeof g->n); /* set once the cameras are known */
    else if (pvx_yaml_kind(r->y, voxels) != PVX_YAML_SEQ)
        return pvx_yaml_fail(r->y, voxels, "volume.voxels", PVX_EFORMAT, r->d,
                             "should be a list of 3 whole numbers or auto");
    else
        PVX_TRY(integers(r, v, "volume", "voxels", 3, REC_GRID_MAX, g->n));
    for (int a = 0; a < 3; a++)
        if (!(g->max[a] - g->min[a] >= 1e-9))
            return pvx_yaml_fail(r->y, pvx_yaml_get(r->y, v, "max"), "volume.max", PVX_EINVAL, r->d,
                                 "the volume is empty along %c: max %g is not above min %g",
                                 "xyz"[a], g -> max[a], g -> min[a]);
    g->basis = REC_BASIS_DEFAULT;
    if ((basis = pvx_yaml_get(r->y, v, "basis")) != 0) {
        const char *t = pvx_yaml_text(r->y, basis);
        if (strcmp(t, "box") == 0)
            g->basis = REC_BOX;
        else if (strcmp(t, "trilinear") == 0)
            g->basis = REC_TRILINEAR;
        else
            return pvx_yaml_fail(r->y, basis, "volume.basis", PVX_EINVAL, r->d,
                                 "should be box or trilinear");
    }
    return PVX_OK;
}

static double rig_det3(const double m[9])
{
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
           m[2] * (m[3] * m[7] - m[4] * m[6]);
}

/* Largest |R R^T - I| entry. */
static double off_rotation(const double R[9])
{
    double worst = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double s = i == j ? -1 : 0;
            for (int k = 0; k < 3; k++)
                s += R[3 * i + k] * R[3 * j + k];
            worst = fmax(worst, fabs(s));
        }
    return worst;
}

/* Nearest rotation (polar factor) by Newton's iteration R <- (R + R^-T)/2, which converges
 * quadratically; Higham, SIAM J. Sci. Stat. Comput. 7:1160, 1986. */
static void orthonormalise(double R[9])
{
    for (int it = 0; it < 20 && off_rotation(R) > 1e-15; it++) {
        double det = rig_det3(R), C[9];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
                C[3 * i + j] = R[3 * i1 + j1] * R[3 * i2 + j2] - R[3 * i1 + j2] * R[3 * i2 + j1];
            }
        for (int i = 0; i < 9; i++) /* cofactors / det = R^-T */
            R[i] = 0.5 * (R[i] + C[i] / det);
    }
}

bool rec_rig_name_ok(const char *s)
{
    if (*s == '\0' || strlen(s) >= REC_NAME_MAX || strcmp(s, ".") == 0 || strcmp(s, "..") == 0)
        return false;
    return s[strspn(s, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-")] ==
           '\0';
}

/* Four numbers that may be k1 k2 k3 k4 of a fisheye.  Lenses have a p1, p2 of some 0.001.  A pinhole that sees more
 * than 55 degrees off axis is rare, and most that do have a barrel distortion. */
static bool rig_ambiguous(const struct rec_camera *c, const double dist[8])
{
    double x = fmax(c->cx, c->width - 1 - c->cx) / c->fx;
    double y = fmax(c->cy, c->height - 1 - c->cy) / c->fy;
    bool wide = hypot(x, y) > 1.43 && dist[0] > -0.1 && dist[2] != 0 && dist[3] != 0;
    return wide || fabs(dist[2]) > 0.02 || fabs(dist[3]) > 0.02;
}

static pvx_err read_model(const struct reader *r, int node, const char *path, struct rec_camera *c)
{
    char full[96];
    const char *name = pvx_yaml_text(r->y, node);
    snprintf(full, sizeof full, "%s.model", path);
    for (int i = REC_PINHOLE; i <= REC_RAYS; i++)
        if (strcmp(name, rec_camera_model_name((enum rec_camera_model)i)) == 0) {
            c->model = (enum rec_camera_model)i;
            return PVX_OK;
        }
    return pvx_yaml_fail(
        r->y, node, full, PVX_EINVAL, r->d,
        "'%s' is not known; pinhole, fisheye (OpenCV's, also called equidistant), scheimpflug "
        "(OpenCV's tilted sensor), telecentric or rays (a ray per pixel from a file)",
        name);
}

/* How many numbers `distortion` may have by the model: k1 k2 k3 k4 of a fisheye, 14 with a tilt. */
static pvx_err read_count(const struct reader *r, int node, const char *full, size_t n,
                          const struct rec_camera *c)
{
    if (c->model == REC_FISHEYE && n != 0 && n != 4)
        return pvx_yaml_fail(r->y, node, full, PVX_EFORMAT, r->d,
                             "of a fisheye should have 4 numbers (k1 k2 k3 k4), not %zu", n);
    if (c->model == REC_TELECENTRIC && n != 0)
        return pvx_yaml_fail(
            r->y, node, full, PVX_EUNSUP, r->d,
            "of a telecentric lens is not supported, not even zeros: leave it out");
    if (c->model == REC_SCHEIMPFLUG && n != 14)
        return pvx_yaml_fail(r->y, node, full, PVX_EFORMAT, r->d,
                             "of a scheimpflug should have 14 numbers, of which the last two tilt "
                             "the sensor (tx ty, radians), not %zu",
                             n);
    if (n != 0 && n != 4 && n != 5 && n != 8 && n != 12 && n != 14)
        return pvx_yaml_fail(r->y, node, full, PVX_EFORMAT, r->d,
                             "should have 0, 4, 5, 8, 12 or 14 numbers "
                             "(k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]]), not %zu",
                             n);
    return PVX_OK;
}

/* s1 s2 s3 s4, which are not supported, and tx ty, which make a Scheimpflug. */
static pvx_err read_sensor(const struct reader *r, int node, const char *full, bool pinhole,
                           const double k[14], struct rec_camera *c)
{
    for (int i = 8; i < 12; i++)
        if (k[i] != 0)
            return pvx_yaml_fail(r->y, node, full, PVX_EUNSUP, r->d,
                                 "%g is of OpenCV's thin prism (s1 s2 s3 s4) model, which is not "
                                 "supported: calibrate without CALIB_THIN_PRISM_MODEL",
                                 k[i]);
    if (k[12] == 0 && k[13] == 0 && c->model != REC_SCHEIMPFLUG)
        return PVX_OK;
    if (pinhole)
        return pvx_yaml_fail(
            r->y, node, full, PVX_EINVAL, r->d,
            "tx %g, ty %g tilt the sensor (OpenCV's CALIB_TILTED_MODEL), and model "
            "says pinhole: write model: scheimpflug",
            k[12], k[13]);
    if (fabs(k[12]) > 1.2 || fabs(k[13]) > 1.2)
        return pvx_yaml_fail(r->y, node, full, PVX_EINVAL, r->d,
                             "a sensor tilted by %g, %g: radians are wanted, at most 1.2", k[12],
                             k[13]);
    c->model = REC_SCHEIMPFLUG;
    c->tilt[0] = k[12];
    c->tilt[1] = k[13];
    return PVX_OK;
}

static pvx_err read_distortion(const struct reader *r, int m, const char *path,
                               struct rec_camera *c)
{
    char full[96];
    double k[14] = {0};
    int model = pvx_yaml_get(r->y, m, "model"), node = pvx_yaml_get(r->y, m, "distortion");
    if (model != 0)
        PVX_TRY(read_model(r, model, path, c));
    snprintf(full, sizeof full, "%s.distortion", path);
    if (node == 0)
        return c->model == REC_SCHEIMPFLUG ? read_count(r, m, full, 0, c) : PVX_OK;
    PVX_TRY(pvx_yaml_doubles(r->y, node, full, 0, 14, k, r->d));
    size_t n = pvx_yaml_length(r->y, node);
    PVX_TRY(read_count(r, node, full, n, c));
    size_t whole = 0, zero = 0;
    for (size_t i = 0; i < n; i++) {
        whole += k[i] == floor(k[i]);
        zero += k[i] == 0;
        if (fabs(k[i]) > 1e6)
            return pvx_yaml_fail(r->y, node, full, PVX_EINVAL, r->d, "%g is outside -1e6..1e6",
                                 k[i]);
    }
    if (n == 8 && whole == n && zero < n) /* [-0,2, 0,1, 0,0, 0,0] */
        return pvx_yaml_fail(r->y, node, full, PVX_EFORMAT, r->d,
                             "all 8 are whole numbers: write 0.5, not 0,5");
    if (c->model != REC_FISHEYE)
        PVX_TRY(read_sensor(r, node, full, model != 0 && c->model == REC_PINHOLE, k, c));
    if (model == 0 && n == 4 && rig_ambiguous(c, k))
        return pvx_yaml_fail(
            r->y, node, full, PVX_EINVAL, r->d,
            "p1 or p2 is larger than lenses have, or the picture is that of a very wide lens: "
            "are these k1 k2 k3 k4 of a fisheye? Write model: fisheye, or model: pinhole");
    memcpy(c->dist, k, sizeof c->dist);
    return PVX_OK;
}

static pvx_err read_lens(const struct reader *r, int m, const char *path, struct rec_camera *c)
{
    double K[4];
    PVX_TRY(rig_numbers(r, m, path, "K", 4, 1e7, K));
    char full[96];
    snprintf(full, sizeof full, "%s.K", path);
    if (!(K[0] >= 1e-3) || !(K[1] >= 1e-3))
        return pvx_yaml_fail(r->y, pvx_yaml_get(r->y, m, "K"), full, PVX_EINVAL, r->d,
                             "the focal lengths fx, fy must be positive (pixels)");
    c->fx = K[0];
    c->fy = K[1];
    c->cx = K[2];
    c->cy = K[3];
    return read_distortion(r, m, path, c);
}

static pvx_err read_pose(const struct reader *r, int m, const char *path, struct rec_camera *c)
{
    char full[96];
    snprintf(full, sizeof full, "%s.R", path);
    PVX_TRY(rig_numbers(r, m, path, "R", 9, 10, c->R));
    PVX_TRY(rig_numbers(r, m, path, "t", 3, MAX_COORD, c->t));
    int node = pvx_yaml_get(r->y, m, "R");
    double off = off_rotation(c->R), det = rig_det3(c->R);
    if (fabs(det + 1) <= 1e-2)
        return pvx_yaml_fail(r->y, node, full, PVX_EINVAL, r->d,
                             "is a mirror image (det = %.4g); a rotation has det = 1. "
                             "Camera axes are x right, y down, z forward",
                             det);
    if (!(off <= 1e-3) || !(fabs(det - 1) <= 1e-3))
        return pvx_yaml_fail(r->y, node, full, PVX_EINVAL, r->d,
                             "is not a rotation: |R R^T - I| = %.3g, det = %.4g (row by row, world "
                             "to camera)",
                             off, det);
    if (off > 1e-12) /* numbers that were written in full stay as they are */
        orthonormalise(c->R);
    return PVX_OK;
}

static pvx_err read_gain(const struct reader *r, int m, const char *path, struct rec_camera *c)
{
    char full[96];
    double g[3];
    c->gain[0] = c->gain[1] = c->gain[2] = 1;
    int node = pvx_yaml_get(r->y, m, "gain");
    if (node == 0)
        return PVX_OK;
    snprintf(full, sizeof full, "%s.gain", path);
    PVX_TRY(pvx_yaml_doubles(r->y, node, full, 1, 3, g, r->d));
    size_t n = pvx_yaml_length(r->y, node);
    if (n == 2)
        return pvx_yaml_fail(r->y, node, full, PVX_EFORMAT, r->d, "should have 1 or 3 numbers");
    for (size_t i = 0; i < n; i++)
        if (!(g[i] >= 1e-6 && g[i] <= 1e6))
            return pvx_yaml_fail(r->y, node, full, PVX_EINVAL, r->d, "%g is outside 1e-6..1e6",
                                 g[i]);
    for (size_t i = 0; i < 3; i++)
        c->gain[i] = (float)g[n == 1 ? 0 : i];
    return PVX_OK;
}

static pvx_err read_uncertainty(const struct reader *r, int m, const char *path,
                                struct rec_uncertainty *u)
{
    char full[96];
    int node = pvx_yaml_get(r->y, m, "uncertainty"), v;
    double *const out[] = {&u->px, &u->px_95, &u->voxels, &u->voxels_95};
    static const char *const keys[] = {"px", "px_95", "voxels", "voxels_95"};
    if (node == 0)
        return PVX_OK;
    snprintf(full, sizeof full, "%s.uncertainty", path);
    PVX_TRY(pvx_yaml_known(r->y, node, full, "px px_95 voxels voxels_95", r->d));
    for (int i = 0; i < 4; i++) {
        PVX_TRY(need(r, node, full, keys[i], &v));
        PVX_TRY(pvx_yaml_double(r->y, v, keys[i], 0, 1e6, out[i], r->d));
    }
    return PVX_OK;
}

static pvx_err read_camera(const struct reader *r, int m, size_t index, const struct rec_rig *rig,
                           struct rec_camera *c)
{
    char path[48];
    int node;
    int32_t size[2];
    snprintf(path, sizeof path, "cameras[%zu]", index);
    PVX_TRY(pvx_yaml_known(
        r->y, m, path,
        "name size K distortion model rays R t windows blur gain photometry uncertainty", r->d));
    PVX_TRY(need(r, m, path, "name", &node));
    const char *name = pvx_yaml_text(r->y, node);
    snprintf(path, sizeof path, "cameras[%zu].name", index);
    if (!rec_rig_name_ok(name))
        return pvx_yaml_fail(r->y, node, path, PVX_EINVAL, r->d,
                             "should be 1 to %d of A-Z a-z 0-9 . _ - (it names a folder)",
                             REC_NAME_MAX - 1);
    snprintf(c->name, sizeof c->name, "%s", name);
    if (rec_rig_find(rig, name) >= 0)
        return pvx_yaml_fail(r->y, node, path, PVX_EINVAL, r->d, "'%s' is used twice", name);
    snprintf(path, sizeof path, "cameras[%zu]", index);
    PVX_TRY(integers(r, m, path, "size", 2, 16384, size));
    c->width = size[0];
    c->height = size[1];
    node = pvx_yaml_get(r->y, m, "model");
    if (node != 0 && strcmp(pvx_yaml_text(r->y, node), "rays") == 0) {
        PVX_TRY(rec_rays_read(r->y, m, path, r->name, c, r->d));
    } else {
        PVX_TRY(read_lens(r, m, path, c));
        PVX_TRY(read_pose(r, m, path, c));
    }
    if ((node = pvx_yaml_get(r->y, m, "windows")) != 0)
        PVX_TRY(rec_windows_read(r->y, node, path, &rig->grid, c, r->d));
    if ((node = pvx_yaml_get(r->y, m, "blur")) != 0)
        PVX_TRY(rec_blur_read(r->y, node, path, &rig->grid, c, r->d));
    PVX_TRY(read_gain(r, m, path, c));
    if ((node = pvx_yaml_get(r->y, m, "photometry")) != 0) {
        char full[64];
        snprintf(full, sizeof full, "%s.photometry", path);
        PVX_TRY(rec_photometry_read(r->y, node, full, &c->photometry, r->d));
    }
    return read_uncertainty(r, m, path, &c->uncertainty);
}

static pvx_err read_rig(const struct reader *r, struct rec_rig *rig)
{
    int root = pvx_yaml_root(r->y), node;
    int64_t version;
    PVX_TRY(pvx_yaml_known(r->y, root, "rig", "version volume cameras bodies spectral", r->d));
    PVX_TRY(need(r, root, "rig", "version", &node));
    PVX_TRY(pvx_yaml_int(r->y, node, "version", 0, INT32_MAX, &version, r->d));
    if (version != 1)
        return pvx_yaml_fail(r->y, node, "version", PVX_EVERSION, r->d,
                             "%lld is not known here; this program reads version 1",
                             (long long)version);
    PVX_TRY(read_volume(r, root, &rig->grid));
    PVX_TRY(need(r, root, "rig", "cameras", &node));
    size_t n = pvx_yaml_length(r->y, node);
    if (pvx_yaml_kind(r->y, node) != PVX_YAML_SEQ || n == 0)
        return pvx_yaml_fail(r->y, node, "cameras", PVX_EFORMAT, r->d,
                             "should be a list of at least one camera (- name: ...)");
    if (n > REC_MAX_CAMERAS)
        return pvx_yaml_fail(r->y, node, "cameras", PVX_EINVAL, r->d,
                             "%zu cameras; at most %d are supported", n, REC_MAX_CAMERAS);
    rig->cameras = pvx_calloc(n, sizeof *rig->cameras);
    if (rig->cameras == NULL)
        return PVX_ENOMEM;
    for (; rig->n_cameras < n; rig->n_cameras++) /* find() sees the finished ones */
        PVX_TRY(read_camera(r, pvx_yaml_item(r->y, node, rig->n_cameras), rig->n_cameras, rig,
                            &rig->cameras[rig->n_cameras]));
    char why[PVX_DIAG_MAX - 128];
    if (rig->grid.n[0] == 0 && (rec_rig_blind(rig, why, sizeof why) == REC_BLIND_ALL ||
                                rec_rig_finest(rig, 1, rig->grid.n) != PVX_OK))
        return pvx_yaml_fail(
            r->y, pvx_yaml_get(r->y, pvx_yaml_get(r->y, root, "volume"), "voxels"), "volume.voxels",
            PVX_EINVAL, r->d, "auto: %s",
            why[0] != '\0' ? why : "no camera has the middle of the volume in front of it");
    if ((node = pvx_yaml_get(r->y, root, "bodies")) != 0)
        PVX_TRY(rec_bodies_read(r->y, node, r->name, rig, &rig->bodies, r->d));
    if ((node = pvx_yaml_get(r->y, root, "spectral")) != 0)
        return rec_spectral_read(r->y, node, &rig->spectral, r->d);
    return PVX_OK;
}

pvx_err rec_rig_parse(const char *text, size_t len, const char *name, struct rec_rig *out,
                      struct pvx_diag *d)
{
    pvx_yaml *y;
    memset(out, 0, sizeof *out);
    PVX_TRY(pvx_yaml_parse(text, len, name, &y, d));
    struct reader r = {y, name, d};
    pvx_err e = read_rig(&r, out);
    if (e != PVX_OK)
        rec_rig_fini(out);
    pvx_yaml_free(&y);
    return e;
}

pvx_err rec_rig_load(const char *path, struct rec_rig *out, struct pvx_diag *d)
{
    char *text;
    size_t len;
    memset(out, 0, sizeof *out);
    PVX_TRY(pvx_file_read(path, MAX_FILE, &text, &len, d));
    pvx_err e = rec_rig_parse(text, len, path, out, d);
    free(text);
    return e;
}

/* ---- writing ---------------------------------------------------------------------------------- */

static void rig_put_list(FILE *f, const char *key, const double *v, int n, const char *end)
{
    fprintf(f, "%s: [", key);
    for (int i = 0; i < n; i++)
        fprintf(f, "%s%.17g", i == 0 ? "" : ", ", v[i]);
    fprintf(f, "]%s", end);
}

static void rig_put_lens(FILE *f, const struct rec_camera *c)
{
    double k[14] = {0};
    int n = 8;
    memcpy(k, c->dist, sizeof c->dist);
    memcpy(k + 12, c->tilt, sizeof c->tilt);
    while (n > 0 && c->dist[n - 1] == 0)
        n--;
    bool five = c->model != REC_FISHEYE && rig_ambiguous(c, c->dist);
    n = n == 0 ? 0 : n <= 4 && !five ? 4 : n <= 5 ? 5 : 8;
    rig_put_list(f, "    distortion", k, c->model == REC_SCHEIMPFLUG ? 14 : n, "\n");
    if (c->model != REC_PINHOLE)
        fprintf(f, "    model: %s\n", rec_camera_model_name(c->model));
}

pvx_err rec_rig_format(const struct rec_rig *r, char **out, size_t *len)
{
    *out = NULL;
    *len = 0;
    FILE *f = open_memstream(out, len);
    if (f == NULL)
        return PVX_ENOMEM;
    const struct rec_grid *g = &r->grid;
    fputs("version: 1\nvolume:\n", f);
    rig_put_list(f, "  min", g->min, 3, "  # metres\n");
    rig_put_list(f, "  max", g->max, 3, "\n");
    fprintf(f, "  voxels: [%d, %d, %d]\n  basis: %s\ncameras:\n", g->n[0], g->n[1], g->n[2],
            rec_basis_name(g->basis));
    for (size_t i = 0; i < r->n_cameras; i++) {
        const struct rec_camera *c = &r->cameras[i];
        double K[4] = {c->fx, c->fy, c->cx, c->cy};
        double gain[3] = {c->gain[0], c->gain[1], c->gain[2]};
        fprintf(f, "  - name: %s\n    size: [%d, %d]\n", c->name, c->width, c->height);
        if (c->model == REC_RAYS) {
            rec_rays_write(f, c);
        } else {
            rig_put_list(f, "    K", K, 4, "  # fx fy cx cy, pixels\n");
            rig_put_lens(f, c);
            rig_put_list(f, "    R", c->R, 9, "\n");
            rig_put_list(f, "    t", c->t, 3, "\n");
        }
        rec_windows_write(f, c);
        rec_blur_write(f, c);
        if (gain[0] != 1 || gain[1] != 1 || gain[2] != 1)
            rig_put_list(f, "    gain", gain, 3, "\n");
        rec_photometry_write(f, &c->photometry);
        const struct rec_uncertainty *u = &c->uncertainty;
        if (u->px > 0)
            fprintf(
                f,
                "    uncertainty: { px: %.17g, px_95: %.17g, voxels: %.17g, voxels_95: %.17g }\n",
                u->px, u->px_95, u->voxels, u->voxels_95);
    }
    rec_bodies_write(f, &r->bodies);
    rec_spectral_write(f, r->spectral);
    bool bad = ferror(f) != 0;
    if (fclose(f) != 0 || bad) {
        PVX_FREE(*out);
        return PVX_ENOMEM;
    }
    return PVX_OK;
}

/* ---- handling --------------------------------------------------------------------------------- */

void rec_rig_fini(struct rec_rig *r)
{
    PVX_FREE(r->cameras);
    r->n_cameras = 0;
    rec_bodies_fini(&r->bodies);
    PVX_FREE(r->spectral);
}

pvx_err rec_rig_copy(const struct rec_rig *r, struct rec_rig *out)
{
    struct rec_camera *c = pvx_calloc(r->n_cameras, sizeof *c);
    if (c == NULL)
        return PVX_ENOMEM;
    struct rec_bodies bodies = {0};
    struct rec_spectral *spectral = NULL;
    pvx_err e = rec_bodies_copy(&r->bodies, &bodies);
    if (e == PVX_OK && r->spectral != NULL)
        e = (spectral = pvx_calloc(1, sizeof *spectral)) != NULL ? PVX_OK : PVX_ENOMEM;
    if (e != PVX_OK) {
        rec_bodies_fini(&bodies);
        free(c);
        return PVX_ENOMEM;
    }
    memcpy(c, r->cameras, r->n_cameras * sizeof *c);
    if (spectral != NULL)
        *spectral = *r->spectral;
    *out = *r;
    out->cameras = c;
    out->bodies = bodies;
    out->spectral = spectral;
    return PVX_OK;
}

int rec_rig_find(const struct rec_rig *r, const char *name)
{
    for (size_t i = 0; i < r->n_cameras; i++)
        if (strcmp(r->cameras[i].name, name) == 0)
            return (int)i;
    return -1;
}

pvx_err rec_rig_finest(const struct rec_rig *r, int32_t binning, int32_t n[3])
{
    const struct rec_grid *g = &r->grid;
    double side[3], X[3], density = 0, cameras = 0;
    for (int a = 0; a < 3; a++)
        X[a] = 0.5 * (g->min[a] + g->max[a]);
    for (size_t i = 0; i < r->n_cameras; i++) {
        const struct rec_camera *c = &r->cameras[i];
        double z = rec_camera_depth(c, X);
        if (!(z > 0))
            continue;
        density += c->fx * c->fy / (z * z) / ((double)binning * binning);
        cameras++;
    }
    if (cameras == 0)
        return PVX_EINVAL;
    for (int a = 0; a < 3; a++)
        side[a] = g->max[a] - g->min[a];
    double mean = cbrt(side[0] * side[1] * side[2]);
    double longest = fmax(side[0], fmax(side[1], side[2]));
    double h = fmax(0.7 * sqrt(cameras / density), cbrt(mean / (30 * density)));
    h = fmax(h, longest / REC_GRID_FINEST);
    for (int a = 0; a < 3; a++) {
        int32_t most = (int32_t)fmax(1, floor(side[a] / h + 1e-6)), step = 1;
        while (32 * step <= most)
            step *= 2;
        n[a] = most - most % step;
    }
    return PVX_OK;
}

static pvx_err fail_unknown(const struct rec_rig *r, const char *name, int len, struct pvx_diag *d)
{
    char list[400] = "";
    size_t n = 0;
    for (size_t i = 0; i < r->n_cameras && n + REC_NAME_MAX + 2 < sizeof list; i++)
        n += (size_t)snprintf(list + n, sizeof list - n, " %s", r->cameras[i].name);
    return pvx_fail(d, PVX_ENOENT, "no camera '%.*s' in the rig; it has:%s", len, name, list);
}

pvx_err rec_rig_select(struct rec_rig *r, const char *comma_list, struct pvx_diag *d)
{
    bool keep[REC_MAX_CAMERAS] = {false};
    for (const char *p = comma_list;; p++) {
        size_t n = strcspn(p, ",");
        char name[REC_NAME_MAX] = "";
        if (n < sizeof name)
            memcpy(name, p, n);
        int i = n == 0 ? -1 : rec_rig_find(r, name);
        if (i < 0)
            return fail_unknown(r, p, n > REC_NAME_MAX ? REC_NAME_MAX : (int)n, d);
        keep[i] = true;
        p += n;
        if (*p == '\0')
            break;
    }
    size_t n = 0;
    for (size_t i = 0; i < r->n_cameras; i++)
        if (keep[i])
            r->cameras[n++] = r->cameras[i];
    r->n_cameras = n;
    return PVX_OK;
}

static void hash_doubles(XXH3_state_t *h, const double *v, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        double x = v[i] + 0.0; /* -0 and 0 are the same place */
        uint64_t u;
        uint8_t le[8];
        memcpy(&u, &x, 8);
        for (int b = 0; b < 8; b++)
            le[b] = (uint8_t)(u >> (8 * b));
        XXH3_64bits_update(h, le, 8);
    }
}

uint64_t rec_rig_hash(const struct rec_rig *r)
{
    XXH3_state_t h;
    const struct rec_grid *g = &r->grid;
    double head[] = {g->n[0], g->n[1], g->n[2], g->basis, (double)r->n_cameras};
    XXH3_64bits_reset(&h);
    hash_doubles(&h, head, 5);
    hash_doubles(&h, g->min, 3);
    hash_doubles(&h, g->max, 3);
    for (size_t i = 0; i < r->n_cameras; i++) {
        const struct rec_camera *c = &r->cameras[i];
        double k[] = {c->width, c->height, c->fx, c->fy, c->cx, c->cy};
        hash_doubles(&h, k, 6);
        hash_doubles(&h, c->dist, 8);
        double model = c->model;
        if (c->model != REC_PINHOLE) /* the hash of old rigs stays */
            hash_doubles(&h, &model, 1);
        hash_doubles(&h, c->R, 9);
        hash_doubles(&h, c->t, 3);
        double extra[6 * REC_WINDOWS];
        hash_doubles(&h, extra, rec_window_numbers(c, extra));
        if (c->model == REC_SCHEIMPFLUG)
            hash_doubles(&h, c->tilt, 2);
        double table[2];
        hash_doubles(&h, table, rec_rays_numbers(c, table));
        const double blur[] = {-1, c->blur.sigma, c->blur.aperture, c->blur.focus};
        if (blur[1] > 0 || blur[2] > 0)
            hash_doubles(&h, blur, 4);
    }
    for (size_t i = 0; i < r->bodies.n; i++) { /* no bodies: the hash of old rigs stays */
        double b[8];
        hash_doubles(&h, b, rec_body_numbers(&r->bodies.body[i], b));
    }
    return XXH3_64bits_digest(&h);
}
