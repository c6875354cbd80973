/* scenes.c - cameras of Agisoft Metashape (XML) and of Blender (JSON of the add-on): both have poses from the camera to the
 * world. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "recon/exchange/fields.h"

/* ---- Agisoft ---------------------------------------------------------------------------------- */
/* Source: Metashape manual, appendix "Camera models".  x, y: tangents right and down; r = hypot(x, y);
 *     x' = x (1 + K1 r^2 + K2 r^4 + K3 r^6 + K4 r^8) + P1 (r^2 + 2 x^2) + 2 P2 x y
 *     y' = y (1 + ...) + P2 (r^2 + 2 y^2) + 2 P1 x y
 *     u = w/2 + cx + x' f + x' B1 + y' B2,   v = h/2 + cy + y' f,   first pixel's centre (0.5, 0.5)
 * A fisheye has x atan(r)/r and atan(r) for x and r. */

/* xml.c: [name, {attributes}, text, children...] */
static int agisoft_next(const pvx_yaml *y, int node, const char *name, size_t *i)
{
    for (*i = *i < 3 ? 3 : *i; *i < pvx_yaml_length(y, node);) {
        int child = pvx_yaml_item(y, node, (*i)++);
        if (strcmp(pvx_yaml_text(y, pvx_yaml_item(y, child, 0)), name) == 0)
            return child;
    }
    return 0;
}

static int agisoft_child(const pvx_yaml *y, int node, const char *name)
{
    size_t i = 0;
    return agisoft_next(y, node, name, &i);
}

static const char *agisoft_attribute(const pvx_yaml *y, int node, const char *name)
{
    return pvx_yaml_text(y, pvx_yaml_get(y, pvx_yaml_item(y, node, 1), name));
}

bool exchange_is_agisoft(const pvx_yaml *y)
{
    int root = pvx_yaml_root(y);
    return strcmp(pvx_yaml_text(y, pvx_yaml_item(y, root, 0)), "document") == 0 &&
           agisoft_child(y, root, "chunk") != 0;
}

/* Numbers of an element that is there. */
static pvx_err agisoft_numbers(const struct exchange_in *in, int node, const char *key, size_t n,
                               double out[EXCHANGE_MAX])
{
    size_t got;
    if (node == 0)
        return pvx_fail(in->d, PVX_EFORMAT, "%s: <%s> is missing", in->path, key);
    return exchange_numbers(in, pvx_yaml_item(in->y, node, 2), key, n, n, out, &got);
}

/* One number, 0 where the element is missing. */
static pvx_err agisoft_number(const struct exchange_in *in, int parent, const char *key,
                              double *out)
{
    double v[EXCHANGE_MAX] = {0};
    int node = agisoft_child(in->y, parent, key);
    pvx_err e = node != 0 ? agisoft_numbers(in, node, key, 1, v) : PVX_OK;
    *out = v[0];
    return e;
}

static int agisoft_by_id(const pvx_yaml *y, int parent, const char *name, const char *id)
{
    int node;
    for (size_t i = 0; (node = agisoft_next(y, parent, name, &i)) != 0;)
        if (strcmp(agisoft_attribute(y, node, "id"), id) == 0)
            return node;
    return 0;
}

/* The adjusted calibration, else the only one. */
static int agisoft_calibration(const pvx_yaml *y, int sensor)
{
    int node, first = 0;
    for (size_t i = 0; (node = agisoft_next(y, sensor, "calibration", &i)) != 0;) {
        if (strcmp(agisoft_attribute(y, node, "class"), "adjusted") == 0)
            return node;
        first = first != 0 ? first : node;
    }
    return first;
}

static pvx_err agisoft_resolution(const struct exchange_in *in, int node, double wh[2])
{
    static const char *const keys[] = {"width", "height"};
    for (int i = 0; i < 2; i++) {
        const char *s = node != 0 ? agisoft_attribute(in->y, node, keys[i]) : "";
        if (pvx_parse_double(s, 1, 1e6, &wh[i]) != PVX_OK)
            return exchange_fail(in, node, "resolution", PVX_EFORMAT,
                                 "<resolution width= height=> is missing");
    }
    return PVX_OK;
}

static pvx_err agisoft_lens(const struct exchange_in *in, int sensor, struct rec_exchange_camera *c)
{
    enum { F, CX, CY, B1, B2, K1, K2, K3, K4, P1, P2, P3, P4, N };
    static const char *const keys[N] = {"f",  "cx", "cy", "b1", "b2", "k1", "k2",
                                        "k3", "k4", "p1", "p2", "p3", "p4"};
    double v[N], wh[2];
    const pvx_yaml *y = in->y;
    int cal = agisoft_calibration(y, sensor);
    if (cal == 0)
        return exchange_fail(in, sensor, "sensor", PVX_EFORMAT,
                             "the sensor of camera '%s' has no <calibration>", c->c.name);
    const char *type = agisoft_attribute(y, cal, "type");
    const bool fisheye = strcmp(type, "fisheye") == 0 || strcmp(type, "equidistant_fisheye") == 0;
    if (!fisheye && strcmp(type, "frame") != 0)
        return exchange_fail(in, cal, "calibration", PVX_EUNSUP,
                             "the camera type '%s' of '%s' is not supported; frame or fisheye",
                             type, c->c.name);
    if (agisoft_child(y, cal, "f") == 0)
        return exchange_fail(in, cal, "calibration", PVX_EFORMAT,
                             "has no <f>: it is of PhotoScan before 1.2; let Metashape export it");
    for (int i = 0; i < N; i++)
        PVX_TRY(agisoft_number(in, cal, keys[i], &v[i]));
    if (v[P3] != 0 || v[P4] != 0 || (fisheye ? v[P1] != 0 || v[P2] != 0 : v[K4] != 0))
        return exchange_fail(in, cal, "calibration", PVX_EUNSUP,
                             "camera '%s' has %s, which is not supported: optimize the alignment "
                             "without it",
                             c->c.name,
                             v[P3] != 0 || v[P4] != 0 ? "p3 or p4"
                             : fisheye                ? "p1 or p2 of a fisheye"
                                                      : "k4");
    int res = agisoft_child(y, cal, "resolution");
    PVX_TRY(agisoft_resolution(in, res != 0 ? res : agisoft_child(y, sensor, "resolution"), wh));
    const double K[9] = {
        v[F] + v[B1], v[B2], wh[0] / 2 + v[CX], 0, v[F], wh[1] / 2 + v[CY], 0, 0, 1};
    PVX_TRY(exchange_lens(in, cal, "calibration", K, 0.5, c));
    const double frame[5] = {v[K1], v[K2], v[P2], v[P1], v[K3]}; /* P1 and P2 are OpenCV's p2, p1 */
    PVX_TRY(exchange_distortion(in, cal, "calibration", fisheye ? REC_FISHEYE : REC_PINHOLE,
                                fisheye ? &v[K1] : frame, fisheye ? 4 : 5, c));
    return exchange_size(in, res, "resolution", wh, c);
}

struct agisoft_world {
    double R[9], t[3], s;
};

/* <transform><rotation/><translation/><scale/></transform> of the chunk or a component; the identity without one. */
static pvx_err agisoft_world_of(const struct exchange_in *in, int parent, struct agisoft_world *w)
{
    double v[EXCHANGE_MAX];
    *w = (struct agisoft_world){{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}, 1};
    int node = agisoft_child(in->y, parent, "transform"), part;
    if (node == 0)
        return PVX_OK;
    if ((part = agisoft_child(in->y, node, "rotation")) != 0) {
        PVX_TRY(agisoft_numbers(in, part, "rotation", 9, v));
        memcpy(w->R, v, sizeof w->R);
    }
    if ((part = agisoft_child(in->y, node, "translation")) != 0) {
        PVX_TRY(agisoft_numbers(in, part, "translation", 3, v));
        memcpy(w->t, v, sizeof w->t);
    }
    if ((part = agisoft_child(in->y, node, "scale")) != 0) {
        PVX_TRY(agisoft_numbers(in, part, "scale", 1, v));
        w->s = v[0];
    }
    if (!(w->s > 0))
        return exchange_fail(in, node, "scale", PVX_EINVAL, "should be above 0");
    return PVX_OK;
}

/* Camera to chunk, then chunk to world. */
static pvx_err agisoft_pose(const struct exchange_in *in, int node, const struct agisoft_world *w,
                            struct rec_exchange_camera *c)
{
    double T[EXCHANGE_MAX], R[9] = {0}, at[3];
    PVX_TRY(agisoft_numbers(in, node, "transform", 16, T));
    for (int i = 0; i < 3; i++) {
        at[i] = w->t[i];
        for (int k = 0; k < 3; k++) {
            at[i] += w->s * w->R[3 * i + k] * T[4 * k + 3];
            for (int j = 0; j < 3; j++)
                R[3 * i + j] += w->R[3 * i + k] * T[4 * k + j];
        }
    }
    return exchange_pose_to_world(in, node, "transform", R, at, c);
}

static pvx_err agisoft_camera(const struct exchange_in *in, int chunk, int cam, size_t *left_out)
{
    const pvx_yaml *y = in->y;
    struct rec_exchange_camera *c;
    struct agisoft_world w;
    char name[REC_NAME_MAX];
    int transform = agisoft_child(y, cam, "transform");
    if (transform == 0) { /* not aligned */
        ++*left_out;
        return PVX_OK;
    }
    exchange_stem(agisoft_attribute(y, cam, "label"), name);
    PVX_TRY(exchange_camera(in->x, in->path, name, &c, in->d));
    int sensor = agisoft_by_id(y, agisoft_child(y, chunk, "sensors"), "sensor",
                               agisoft_attribute(y, cam, "sensor_id"));
    if (sensor == 0)
        return exchange_fail(in, cam, "camera", PVX_EFORMAT, "camera '%s' has no sensor", name);
    PVX_TRY(agisoft_lens(in, sensor, c));
    int component = agisoft_by_id(y, agisoft_child(y, chunk, "components"), "component",
                                  agisoft_attribute(y, cam, "component_id"));
    PVX_TRY(agisoft_world_of(in, chunk, &w));
    if (agisoft_child(y, component, "transform") != 0)
        PVX_TRY(agisoft_world_of(in, component, &w));
    return agisoft_pose(in, transform, &w, c);
}

pvx_err exchange_read_agisoft(const struct exchange_in *in)
{
    const pvx_yaml *y = in->y;
    int chunk = agisoft_child(y, pvx_yaml_root(y), "chunk"), cam, group;
    int cameras = agisoft_child(y, chunk, "cameras");
    size_t left_out = 0, i = 0, j;
    if (!exchange_is_agisoft(y) || cameras == 0)
        return pvx_fail(in->d, PVX_EFORMAT,
                        "%s: no <document><chunk><cameras>, as Metashape writes", in->path);
    while ((cam = agisoft_next(y, cameras, "camera", &i)) != 0)
        PVX_TRY(agisoft_camera(in, chunk, cam, &left_out));
    for (i = 0; (group = agisoft_next(y, cameras, "group", &i)) != 0;)
        for (j = 0; (cam = agisoft_next(y, group, "camera", &j)) != 0;)
            PVX_TRY(agisoft_camera(in, chunk, cam, &left_out));
    if (left_out > 0)
        exchange_note(in->x, "Pictures that Metashape did not align are left out.");
    return PVX_OK;
}

/* ---- Blender ---------------------------------------------------------------------------------- */
/* Source: Blender's BKE_camera_params_compute_viewplane.  sensor: width, or height for a vertical fit; view: picture's
 * width, or its height times the pixels' aspect for a vertical fit; with y up, and edges of the picture at whole numbers
 *     fx = lens view / sensor,   cx = w/2 - shift_x view,   fy = fx / aspect,   cy = h/2 + shift_y view / aspect */

bool exchange_is_blender(const pvx_yaml *y)
{
    return strcmp(pvx_yaml_text(y, pvx_yaml_get(y, pvx_yaml_root(y), "format")),
                  "pyrovox-blender-cameras") == 0;
}

static pvx_err blender_number(const struct exchange_in *in, int map, const char *key, double min,
                              double max, double *out)
{
    int node = pvx_yaml_get(in->y, map, key);
    if (node == 0)
        return exchange_fail(in, map, key, PVX_EFORMAT, "is missing");
    return pvx_yaml_double(in->y, node, key, min, max, out, in->d);
}

static pvx_err blender_lens(const struct exchange_in *in, int map, struct rec_exchange_camera *c)
{
    double wh[EXCHANGE_MAX], shift[EXCHANGE_MAX], lens, sensor[2], aspect;
    size_t n;
    const pvx_yaml *y = in->y;
    const char *type = pvx_yaml_text(y, pvx_yaml_get(y, map, "type"));
    const char *fit = pvx_yaml_text(y, pvx_yaml_get(y, map, "sensor_fit"));
    if (strcmp(type, "PERSP") != 0)
        return exchange_fail(in, map, "type", PVX_EUNSUP,
                             "camera '%s' is of type %s; only PERSP is supported", c->c.name, type);
    PVX_TRY(exchange_numbers(in, pvx_yaml_get(y, map, "size"), "size", 2, 2, wh, &n));
    PVX_TRY(exchange_numbers(in, pvx_yaml_get(y, map, "shift"), "shift", 2, 2, shift, &n));
    PVX_TRY(blender_number(in, map, "lens", 1e-3, 1e6, &lens));
    PVX_TRY(blender_number(in, map, "sensor_width", 1e-3, 1e6, &sensor[0]));
    PVX_TRY(blender_number(in, map, "sensor_height", 1e-3, 1e6, &sensor[1]));
    PVX_TRY(blender_number(in, map, "pixel_aspect", 1e-3, 1e3, &aspect)); /* y / x */
    const bool tall =
        strcmp(fit, "VERTICAL") == 0 || (strcmp(fit, "AUTO") == 0 && wh[0] < wh[1] * aspect);
    const double view = tall ? wh[1] * aspect : wh[0];
    const double f = lens * view / sensor[strcmp(fit, "VERTICAL") == 0];
    const double K[9] = {f, 0,          wh[0] / 2 - shift[0] * view,
                         0, f / aspect, wh[1] / 2 + shift[1] * view / aspect,
                         0, 0,          1};
    PVX_TRY(exchange_lens(in, map, "camera", K, 0.5, c));
    PVX_TRY(exchange_distortion(in, map, "camera", REC_PINHOLE, K, 0, c));
    return exchange_size(in, map, "size", wh, c);
}

/* matrix_world: columns x right, y up, z backwards, and the place.  Its scale does not act on a camera. */
static pvx_err blender_pose(const struct exchange_in *in, int map, struct rec_exchange_camera *c)
{
    double T[EXCHANGE_MAX], R[9];
    size_t n;
    int node = pvx_yaml_get(in->y, map, "matrix_world");
    PVX_TRY(exchange_numbers(in, node, "matrix_world", 16, 16, T, &n));
    for (int j = 0; j < 3; j++) {
        double length = sqrt(T[j] * T[j] + T[4 + j] * T[4 + j] + T[8 + j] * T[8 + j]);
        for (int i = 0; i < 3; i++)
            R[3 * i + j] = (j > 0 ? -1 : 1) * T[4 * i + j] / (length > 0 ? length : 1);
    }
    return exchange_pose_to_world(in, node, "matrix_world", R, (double[]){T[3], T[7], T[11]}, c);
}

pvx_err exchange_read_blender(const struct exchange_in *in)
{
    const pvx_yaml *y = in->y;
    int list = pvx_yaml_get(y, pvx_yaml_root(y), "cameras");
    double unit;
    if (!exchange_is_blender(y) || pvx_yaml_kind(y, list) != PVX_YAML_SEQ)
        return pvx_fail(in->d, PVX_EFORMAT, "%s: was not written by Pyrovox's add-on for Blender",
                        in->path);
    PVX_TRY(blender_number(in, pvx_yaml_root(y), "metres_per_unit", 1e-9, 1e9, &unit));
    PVX_TRY(exchange_unit(in, unit));
    for (size_t i = 0; i < pvx_yaml_length(y, list); i++) {
        int map = pvx_yaml_item(y, list, i);
        struct rec_exchange_camera *c;
        PVX_TRY(exchange_camera(in->x, in->path, pvx_yaml_text(y, pvx_yaml_get(y, map, "name")), &c,
                                in->d));
        PVX_TRY(blender_lens(in, map, c));
        PVX_TRY(blender_pose(in, map, c));
    }
    return PVX_OK;
}
