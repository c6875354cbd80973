#include "recon/view/key_frames.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/mem.h"
#include "base/yaml.h"
#include "recon/view/render.h"

static const double pi = 3.14159265358979323846;

struct reading {
    const pvx_yaml *y;
    const struct rec_rig *rig;
    const struct rec_key_frame *base;
    struct pvx_diag *d;
};

/* Reads three numbers of a key, if it has them. */
static pvx_err key_frames_point(const struct reading *r, int map, const char *key,
                                const char *where, double out[3])
{
    char full[80];
    int node = pvx_yaml_get(r->y, map, key);
    snprintf(full, sizeof full, "%s.%s", where, key);
    if (node == 0)
        return PVX_OK;
    PVX_TRY(pvx_yaml_doubles(r->y, node, full, 3, 3, out, r->d));
    for (int a = 0; a < 3; a++)
        if (!(fabs(out[a]) <= 1e6))
            return pvx_yaml_fail(r->y, node, full, PVX_EFORMAT, r->d, "%g is outside -1e6..1e6",
                                 out[a]);
    return PVX_OK;
}

/* The ideal camera at the place of a camera of the rig. */
static pvx_err of_rig(const struct reading *r, int node, const char *where, struct rec_key_frame *k)
{
    const char *name = pvx_yaml_text(r->y, node);
    if (r->rig == NULL || r->rig->n_cameras == 0)
        return pvx_yaml_fail(r->y, node, where, PVX_EFORMAT, r->d,
                             "camera '%s' is one of a rig: add --rig FILE", name);
    int at = rec_rig_find(r->rig, name);
    if (at < 0)
        return pvx_yaml_fail(r->y, node, where, PVX_ENOENT, r->d, "the rig has no camera '%s'",
                             name);
    const struct rec_camera *c = &r->rig->cameras[at];
    double deep = 0;
    for (int a = 0; a < 3; a++) {
        k->eye[a] = -(c->R[a] * c->t[0] + c->R[3 + a] * c->t[1] + c->R[6 + a] * c->t[2]);
        deep += c->R[6 + a] * (r->base->look_at[a] - k->eye[a]);
    }
    for (int a = 0; a < 3; a++) {
        k->look_at[a] = k->eye[a] + fmax(deep, 1e-3) * c->R[6 + a];
        k->up[a] = -c->R[3 + a];
    }
    k->fov_deg = 360 / pi * atan(0.5 * c->height / c->fy);
    return PVX_OK;
}

static pvx_err read_key(const struct reading *r, int map, size_t i, struct rec_key_frame *k)
{
    char where[32], full[48];
    snprintf(where, sizeof where, "keys[%zu]", i);
    PVX_TRY(pvx_yaml_known(r->y, map, where, "t eye look_at up fov camera", r->d));
    *k = *r->base;
    int t = pvx_yaml_get(r->y, map, "t"), eye = pvx_yaml_get(r->y, map, "eye"),
        camera = pvx_yaml_get(r->y, map, "camera"), fov = pvx_yaml_get(r->y, map, "fov");
    snprintf(full, sizeof full, "%s.t", where);
    if (t == 0)
        return pvx_yaml_fail(r->y, map, full, PVX_EFORMAT, r->d, "when?  Seconds");
    PVX_TRY(pvx_yaml_double(r->y, t, full, -1e6, 1e6, &k->t, r->d));
    if ((eye == 0) == (camera == 0))
        return pvx_yaml_fail(r->y, map, where, PVX_EFORMAT, r->d,
                             "from where?  Either eye: [x, y, z] or camera: NAME");
    if (camera != 0)
        PVX_TRY(of_rig(r, camera, where, k));
    PVX_TRY(key_frames_point(r, map, "eye", where, k->eye));
    PVX_TRY(key_frames_point(r, map, "look_at", where, k->look_at));
    PVX_TRY(key_frames_point(r, map, "up", where, k->up));
    snprintf(full, sizeof full, "%s.fov", where);
    return fov != 0 ? pvx_yaml_double(r->y, fov, full, 0.01, 175, &k->fov_deg, r->d) : PVX_OK;
}

static pvx_err read_keys(const struct reading *r, struct rec_key_frames *out)
{
    int root = pvx_yaml_root(r->y), version = pvx_yaml_get(r->y, root, "version"),
        keys = pvx_yaml_get(r->y, root, "keys");
    int64_t v;
    PVX_TRY(pvx_yaml_known(r->y, root, "path", "version keys", r->d));
    if (version == 0)
        return pvx_yaml_fail(r->y, root, "version", PVX_EFORMAT, r->d, "is missing: version: 1");
    PVX_TRY(pvx_yaml_int(r->y, version, "version", 1, 1, &v, r->d));
    size_t n = pvx_yaml_length(r->y, keys);
    if (pvx_yaml_kind(r->y, keys) != PVX_YAML_SEQ || n < 2 || n > REC_KEY_FRAMES_MAX)
        return pvx_yaml_fail(r->y, keys != 0 ? keys : root, "keys", PVX_EFORMAT, r->d,
                             "should be a list of 2 to %d cameras", REC_KEY_FRAMES_MAX);
    out->key = pvx_calloc(n, sizeof *out->key);
    if (out->key == NULL)
        return pvx_fail(r->d, PVX_ENOMEM, "no memory for key frames");
    for (out->n = 0; out->n < n; out->n++) {
        int map = pvx_yaml_item(r->y, keys, out->n);
        struct rec_key_frame *k = &out->key[out->n];
        PVX_TRY(read_key(r, map, out->n, k));
        if (out->n > 0 && !(k->t - k[-1].t >= 1e-3))
            return pvx_yaml_fail(r->y, map, "keys", PVX_EFORMAT, r->d,
                                 "t: %g is no millisecond after the %g before it", k->t, k[-1].t);
    }
    if (out->key[n - 1].t - out->key[0].t > REC_KEY_PICTURES_MAX / 100)
        return pvx_yaml_fail(r->y, keys, "keys", PVX_EFORMAT, r->d,
                             "%g seconds from first to last; %d at most",
                             out->key[n - 1].t - out->key[0].t, REC_KEY_PICTURES_MAX / 100);
    return PVX_OK;
}

pvx_err rec_key_frames_parse(const char *text, size_t len, const char *name,
                             const struct rec_key_frame *base, const struct rec_rig *rig,
                             struct rec_key_frames *out, struct pvx_diag *d)
{
    pvx_yaml *y = NULL;
    *out = (struct rec_key_frames){0};
    PVX_TRY(pvx_yaml_parse(text, len, name, &y, d));
    struct reading r = {y, rig, base, d};
    pvx_err e = read_keys(&r, out);
    pvx_yaml_free(&y);
    if (e != PVX_OK)
        rec_key_frames_fini(out);
    return e;
}

pvx_err rec_key_frames_load(const char *path, const struct rec_key_frame *base,
                            const struct rec_rig *rig, struct rec_key_frames *out,
                            struct pvx_diag *d)
{
    char *text;
    size_t len;
    *out = (struct rec_key_frames){0};
    PVX_TRY(pvx_file_read(path, 4 << 20, &text, &len, d));
    pvx_err e = rec_key_frames_parse(text, len, path, base, rig, out, d);
    free(text);
    return e;
}

void rec_key_frames_fini(struct rec_key_frames *k)
{
    free(k->key);
    *k = (struct rec_key_frames){0};
}

size_t rec_key_frames_pictures(const struct rec_key_frames *k, int fps)
{
    return (size_t)((k->key[k->n - 1].t - k->key[0].t) * fps + 1e-6) + 1;
}

/* ---- between the keys ---- */

enum { NUMBERS = 10 };

static void key_frames_numbers(const struct rec_key_frame *k, double v[NUMBERS])
{
    memcpy(v, k->eye, sizeof k->eye);
    memcpy(v + 3, k->look_at, sizeof k->look_at);
    memcpy(v + 6, k->up, sizeof k->up);
    v[9] = log(k->fov_deg);
}

/* d/dt at key i. */
static void slope(const struct rec_key_frames *k, size_t i, double out[NUMBERS])
{
    double before[NUMBERS], at[NUMBERS], after[NUMBERS];
    size_t a = i > 0 ? i - 1 : i, b = i + 1 < k->n ? i + 1 : i;
    double h0 = k->key[i].t - k->key[a].t, h1 = k->key[b].t - k->key[i].t;
    key_frames_numbers(&k->key[a], before);
    key_frames_numbers(&k->key[i], at);
    key_frames_numbers(&k->key[b], after);
    for (int q = 0; q < NUMBERS; q++) {
        double m0 = h0 > 0 ? (at[q] - before[q]) / h0 : 0,
               m1 = h1 > 0 ? (after[q] - at[q]) / h1 : 0;
        out[q] = h0 > 0 && h1 > 0 ? (h1 * m0 + h0 * m1) / (h0 + h1) : m0 + m1;
    }
}

pvx_err rec_key_frames_camera(const struct rec_key_frames *k, size_t i, int fps, int32_t w,
                              int32_t h, struct rec_camera *out, struct pvx_diag *d)
{
    double t = fmin(k->key[0].t + (double)i / fps, k->key[k->n - 1].t);
    size_t j = 0, end = k->n - 1; /* key[j].t <= t < key[end].t, or the last two */
    while (end - j > 1) {
        size_t mid = (j + end) / 2;
        *(k->key[mid].t <= t ? &j : &end) = mid;
    }
    double p0[NUMBERS], p1[NUMBERS], m0[NUMBERS], m1[NUMBERS], v[NUMBERS];
    double step = k->key[j + 1].t - k->key[j].t, s = (t - k->key[j].t) / step;
    key_frames_numbers(&k->key[j], p0);
    key_frames_numbers(&k->key[j + 1], p1);
    slope(k, j, m0);
    slope(k, j + 1, m1);
    for (int q = 0; q < NUMBERS; q++) /* Hermite's cubic */
        v[q] =
            p0[q] + s * (step * m0[q] + s * (3 * (p1[q] - p0[q]) - step * (2 * m0[q] + m1[q]) +
                                             s * (2 * (p0[q] - p1[q]) + step * (m0[q] + m1[q]))));
    double fov = fmin(fmax(exp(v[9]), 0.01), 175);
    if (rec_look_at_camera(v, v + 3, v + 6, fov * pi / 180, w, h, out) != PVX_OK)
        return pvx_fail(
            d, PVX_EINVAL,
            "at %.3f s the camera stands in what it looks at (%g,%g,%g), or looks along "
            "'up': another key, or another up: in one of them",
            t, v[3], v[4], v[5]);
    return PVX_OK;
}
