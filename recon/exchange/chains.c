/* chains.c - ROS camera_info, Kalibr's camchain, and the TOML of anipose, aniposelib and caliscope: one lens each, and a
 * pose where there is one. */
#include <stdio.h>
#include <string.h>

#include "recon/exchange/fields.h"

/* ---- ROS -------------------------------------------------------------------------------------- */

static int ros_get(const pvx_yaml *y, const char *file, const char *message)
{
    int root = pvx_yaml_root(y), node = pvx_yaml_get(y, root, file);
    return node != 0 ? node : pvx_yaml_get(y, root, message);
}

static int ros_any(const pvx_yaml *y, const char *file, const char *ros1, const char *ros2)
{
    int node = ros_get(y, file, ros1);
    return node != 0 ? node : pvx_yaml_get(y, pvx_yaml_root(y), ros2);
}

bool exchange_is_ros(const pvx_yaml *y)
{
    int root = pvx_yaml_root(y);
    return pvx_yaml_get(y, root, "distortion_model") != 0 && ros_any(y, "camera_matrix", "K", "k");
}

static bool ros_zero(const struct exchange_in *in, int map)
{
    for (size_t i = 0; i < pvx_yaml_length(in->y, map); i++) {
        const char *s = pvx_yaml_text(in->y, pvx_yaml_value(in->y, map, i));
        if (strcmp(s, "0") != 0 && strcasecmp(s, "false") != 0)
            return false;
    }
    return true;
}

static pvx_err ros_lens(const struct exchange_in *in, struct rec_exchange_camera *c)
{
    double v[EXCHANGE_MAX], K[9];
    size_t n;
    const pvx_yaml *y = in->y;
    int node = ros_any(y, "camera_matrix", "K", "k");
    PVX_TRY(exchange_numbers(in, node, "camera_matrix", 9, 9, v, &n));
    memcpy(K, v, sizeof K);
    PVX_TRY(exchange_lens(in, node, "camera_matrix", K, 0, c));
    int word = pvx_yaml_get(y, pvx_yaml_root(y), "distortion_model");
    const char *model = pvx_yaml_text(y, word);
    const bool fisheye = strcmp(model, "equidistant") == 0 || strcmp(model, "fisheye") == 0;
    if (!fisheye && strcmp(model, "plumb_bob") != 0 && strcmp(model, "rational_polynomial") != 0)
        return exchange_fail(in, word, "distortion_model", PVX_EUNSUP,
                             "camera '%s': '%s' is not supported; plumb_bob, rational_polynomial "
                             "or equidistant",
                             c->c.name, model);
    node = ros_any(y, "distortion_coefficients", "D", "d");
    n = 0;
    if (node != 0)
        PVX_TRY(exchange_numbers(in, node, "distortion_coefficients", 0, 14, v, &n));
    return exchange_distortion(in, node, "distortion_coefficients",
                               fisheye ? REC_FISHEYE : REC_PINHOLE, v, n, c);
}

/* Of two rectified cameras, P = [K'|K' shift] says how they stand.  Source: sensor_msgs/CameraInfo. */
static pvx_err ros_rectified(const struct exchange_in *in, struct rec_exchange_camera *c)
{
    double P[EXCHANGE_MAX], R[EXCHANGE_MAX];
    size_t n;
    const pvx_yaml *y = in->y;
    int p = ros_any(y, "projection_matrix", "P", "p"),
        r = ros_any(y, "rectification_matrix", "R", "r");
    if (p == 0 || r == 0)
        return PVX_OK;
    PVX_TRY(exchange_numbers(in, p, "projection_matrix", 12, 12, P, &n));
    PVX_TRY(exchange_numbers(in, r, "rectification_matrix", 9, 9, R, &n));
    if (!(P[0] >= 1e-3 && P[5] >= 1e-3)) /* not rectified: all zeros */
        return PVX_OK;
    memcpy(c->rect, R, sizeof c->rect);
    c->shift[0] = P[3] / P[0];
    c->shift[1] = P[7] / P[5];
    c->shift[2] = 0;
    c->rectified = true;
    return PVX_OK;
}

pvx_err exchange_read_ros(const struct exchange_in *in)
{
    const pvx_yaml *y = in->y;
    struct rec_exchange_camera *c;
    double wh[2];
    char stem[REC_NAME_MAX];
    exchange_stem(in->path, stem);
    const char *name = pvx_yaml_text(y, pvx_yaml_get(y, pvx_yaml_root(y), "camera_name"));
    if (!exchange_is_ros(y))
        return pvx_fail(in->d, PVX_EFORMAT,
                        "%s: is no camera_info: camera_matrix or distortion_model is missing",
                        in->path);
    PVX_TRY(exchange_camera(in->x, in->path, *name != '\0' ? name : stem, &c, in->d));
    PVX_TRY(ros_lens(in, c));
    PVX_TRY(ros_rectified(in, c));
    int w = ros_get(y, "image_width", "width"), h = ros_get(y, "image_height", "height");
    if (w != 0 && h != 0) {
        PVX_TRY(pvx_yaml_double(y, w, "image_width", 0, 1e6, &wh[0], in->d));
        PVX_TRY(pvx_yaml_double(y, h, "image_height", 0, 1e6, &wh[1], in->d));
        PVX_TRY(exchange_size(in, w, "image_width", wh, c));
    }
    int roi = pvx_yaml_get(y, pvx_yaml_root(y), "roi");
    if (!ros_zero(in, roi))
        return exchange_fail(in, roi, "roi", PVX_EUNSUP,
                             "camera '%s' has a region of interest: give the calibration of its "
                             "whole pictures",
                             c->c.name);
    return PVX_OK;
}

/* ---- Kalibr ----------------------------------------------------------------------------------- */

bool exchange_is_kalibr(const pvx_yaml *y)
{
    int cam = pvx_yaml_get(y, pvx_yaml_root(y), "cam0");
    return pvx_yaml_get(y, cam, "camera_model") != 0 && pvx_yaml_get(y, cam, "intrinsics") != 0;
}

static pvx_err kalibr_lens(const struct exchange_in *in, int map, struct rec_exchange_camera *c)
{
    double v[EXCHANGE_MAX];
    size_t n;
    const pvx_yaml *y = in->y;
    int node = pvx_yaml_get(y, map, "camera_model");
    if (strcmp(pvx_yaml_text(y, node), "pinhole") != 0)
        return exchange_fail(in, node, "camera_model", PVX_EUNSUP,
                             "camera '%s': '%s' is not supported: calibrate with pinhole-radtan or "
                             "pinhole-equi",
                             c->c.name, pvx_yaml_text(y, node));
    node = pvx_yaml_get(y, map, "intrinsics");
    PVX_TRY(exchange_numbers(in, node, "intrinsics", 4, 4, v, &n));
    const double K[9] = {v[0], 0, v[2], 0, v[1], v[3], 0, 0, 1};
    PVX_TRY(exchange_lens(in, node, "intrinsics", K, 0, c));
    node = pvx_yaml_get(y, map, "distortion_model");
    const char *model = pvx_yaml_text(y, node);
    const bool fisheye = strcmp(model, "equidistant") == 0;
    if (!fisheye && strcmp(model, "radtan") != 0 && strcmp(model, "none") != 0)
        return exchange_fail(in, node, "distortion_model", PVX_EUNSUP,
                             "camera '%s': '%s' is not supported: calibrate with pinhole-radtan or "
                             "pinhole-equi",
                             c->c.name, model);
    node = pvx_yaml_get(y, map, "distortion_coeffs");
    n = 0;
    if (strcmp(model, "none") != 0)
        PVX_TRY(exchange_numbers(in, node, "distortion_coeffs", 4, 4, v, &n));
    PVX_TRY(exchange_distortion(in, node, "distortion_coeffs", fisheye ? REC_FISHEYE : REC_PINHOLE,
                                v, n, c));
    node = pvx_yaml_get(y, map, "resolution");
    if (node == 0)
        return PVX_OK;
    PVX_TRY(exchange_numbers(in, node, "resolution", 2, 2, v, &n));
    return exchange_size(in, node, "resolution", v, c);
}

/* T[16] <- step[16] T */
static void kalibr_chain(const double step[16], double T[16])
{
    double product[16] = {0};
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            for (int k = 0; k < 4; k++)
                product[4 * i + j] += step[4 * i + k] * T[4 * k + j];
    memcpy(T, product, sizeof product);
}

pvx_err exchange_read_kalibr(const struct exchange_in *in)
{
    double T[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}, step[EXCHANGE_MAX];
    size_t n;
    const pvx_yaml *y = in->y;
    if (!exchange_is_kalibr(y))
        return pvx_fail(in->d, PVX_EFORMAT,
                        "%s: is no camchain: cam0 with camera_model and intrinsics is missing",
                        in->path);
    PVX_TRY(exchange_unit(in, 1));
    for (int i = 0;; i++) {
        struct rec_exchange_camera *c;
        char key[16];
        snprintf(key, sizeof key, "cam%d", i);
        int map = pvx_yaml_get(y, pvx_yaml_root(y), key);
        if (map == 0)
            return PVX_OK;
        PVX_TRY(exchange_camera(in->x, in->path, key, &c, in->d));
        PVX_TRY(kalibr_lens(in, map, c));
        int node = pvx_yaml_get(y, map, "T_cn_cnm1");
        if (i > 0) {
            if (node == 0)
                return exchange_fail(in, map, key, PVX_EFORMAT,
                                     "T_cn_cnm1 is missing: where the camera stands is not known");
            PVX_TRY(exchange_numbers(in, node, "T_cn_cnm1", 16, 16, step, &n));
            kalibr_chain(step, T);
        }
        const double R[9] = {T[0], T[1], T[2], T[4], T[5], T[6], T[8], T[9], T[10]};
        PVX_TRY(exchange_pose(in, node, "T_cn_cnm1", R, (const double[]){T[3], T[7], T[11]}, c));
    }
}

/* ---- anipose, aniposelib, caliscope ------------------------------------------------------------ */

static bool anipose_camera(const pvx_yaml *y, int map)
{
    return pvx_yaml_get(y, map, "matrix") != 0 && pvx_yaml_get(y, map, "size") != 0;
}

bool exchange_is_anipose(const pvx_yaml *y)
{
    int root = pvx_yaml_root(y);
    for (size_t i = 0; i < pvx_yaml_length(y, root); i++)
        if (anipose_camera(y, pvx_yaml_value(y, root, i)))
            return true;
    return false;
}

static bool anipose_true(const pvx_yaml *y, int map, const char *key)
{
    return strcmp(pvx_yaml_text(y, pvx_yaml_get(y, map, key)), "true") == 0;
}

static pvx_err anipose_pose(const struct exchange_in *in, int map, struct rec_exchange_camera *c)
{
    double v[EXCHANGE_MAX], t[EXCHANGE_MAX], R[9];
    size_t n;
    int r = pvx_yaml_get(in->y, map, "rotation"), s = pvx_yaml_get(in->y, map, "translation");
    if (r == 0 || s == 0 || pvx_yaml_length(in->y, r) == 0 || pvx_yaml_length(in->y, s) == 0)
        return PVX_OK;
    PVX_TRY(exchange_numbers(in, r, "rotation", 3, 9, v, &n));
    if (n == 9)
        memcpy(R, v, sizeof R);
    else if (n == 3)
        exchange_rodrigues(v, R);
    else
        return exchange_fail(in, r, "rotation", PVX_EFORMAT, "should have 3 or 9 numbers, not %zu",
                             n);
    PVX_TRY(exchange_numbers(in, s, "translation", 3, 3, t, &n));
    return exchange_pose(in, r, "rotation", R, t, c);
}

static pvx_err anipose_one(const struct exchange_in *in, int map, const char *table)
{
    struct rec_exchange_camera *c;
    double v[EXCHANGE_MAX];
    size_t n;
    char own[REC_NAME_MAX];
    const pvx_yaml *y = in->y;
    const char *name = pvx_yaml_text(y, pvx_yaml_get(y, map, "name"));
    const bool caliscope = strncmp(table, "cameras.", 8) == 0;
    snprintf(own, sizeof own, "%s%.50s", caliscope ? "cam_" : "", caliscope ? table + 8 : table);
    PVX_TRY(exchange_camera(in->x, in->path, *name != '\0' ? name : own, &c, in->d));
    int node = pvx_yaml_get(y, map, "matrix");
    PVX_TRY(exchange_numbers(in, node, "matrix", 9, 9, v, &n));
    PVX_TRY(exchange_lens(in, node, "matrix", v, 0, c));
    node = pvx_yaml_get(y, map, "distortions");
    n = 0;
    if (node != 0)
        PVX_TRY(exchange_numbers(in, node, "distortions", 0, 14, v, &n));
    PVX_TRY(exchange_distortion(in, node, "distortions",
                                anipose_true(y, map, "fisheye") ? REC_FISHEYE : REC_PINHOLE, v, n,
                                c));
    node = pvx_yaml_get(y, map, "size");
    PVX_TRY(exchange_numbers(in, node, "size", 2, 2, v, &n));
    PVX_TRY(exchange_size(in, node, "size", v, c));
    int turned = pvx_yaml_get(y, map, "rotation_count");
    if (turned != 0 && strcmp(pvx_yaml_text(y, turned), "0") != 0)
        exchange_note(in->x, "caliscope shows some pictures turned (rotation_count); the "
                             "calibration is of the pictures as they were recorded.");
    if (caliscope)
        exchange_note(in->x, "caliscope writes metres if its board was measured in centimetres.");
    return anipose_pose(in, map, c);
}

pvx_err exchange_read_anipose(const struct exchange_in *in)
{
    const pvx_yaml *y = in->y;
    const int root = pvx_yaml_root(y);
    size_t left_out = 0, found = 0;
    for (size_t i = 0; i < pvx_yaml_length(y, root); i++) {
        int map = pvx_yaml_value(y, root, i);
        if (!anipose_camera(y, map))
            continue;
        found++;
        if (anipose_true(y, map, "ignore"))
            left_out++;
        else
            PVX_TRY(anipose_one(in, map, pvx_yaml_key(y, root, i)));
    }
    if (found == 0)
        return pvx_fail(in->d, PVX_EFORMAT, "%s: no table has matrix and size, as a camera has",
                        in->path);
    if (left_out > 0)
        exchange_note(in->x, "Cameras with ignore = true are left out.");
    return PVX_OK;
}
