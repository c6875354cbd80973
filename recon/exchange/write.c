/* write.c - a rig's cameras for other programs: the rules of the readers the other way round. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "recon/exchange/exchange.h"

typedef pvx_err exchange_print(FILE *f, const struct rec_rig *r, size_t camera, struct pvx_diag *d);

static int exchange_count(const struct rec_camera *c) /* of distortion numbers that are in use */
{
    if (c->model == REC_FISHEYE)
        return 4;
    if (c->model == REC_SCHEIMPFLUG)
        return 14;
    return c->dist[5] != 0 || c->dist[6] != 0 || c->dist[7] != 0 ? 8 : 5;
}

static pvx_err exchange_cannot(const struct rec_camera *c, enum rec_exchange_format to,
                               const char *what, struct pvx_diag *d)
{
    return pvx_fail(d, PVX_EUNSUP, "camera '%s': %s cannot hold %s", c->name, rec_exchange_name(to),
                    what);
}

static void exchange_list_of(FILE *f, const double *v, int n)
{
    fputc('[', f);
    for (int i = 0; i < n; i++)
        fprintf(f, "%s%.17g", i == 0 ? "" : ", ", v[i]);
    fputc(']', f);
}

static void exchange_rows_of(FILE *f, const double *v, int rows, int cols)
{
    fputc('[', f);
    for (int i = 0; i < rows; i++) {
        fputs(i == 0 ? "" : ", ", f);
        exchange_list_of(f, v + i * cols, cols);
    }
    fputc(']', f);
}

static void exchange_K(const struct rec_camera *c, double K[9])
{
    const double k[9] = {c->fx, 0, c->cx, 0, c->fy, c->cy, 0, 0, 1};
    memcpy(K, k, sizeof k);
}

/* ---- formats with a text for each camera ------------------------------------------------------ */

static void opencv_matrix(FILE *f, const char *indent, const char *key, const double *v, int rows,
                          int cols)
{
    fprintf(f,
            "%s%s: !!opencv-matrix\n%s   rows: %d\n%s   cols: %d\n%s   dt: d\n%s   data: ", indent,
            key, indent, rows, indent, cols, indent, indent);
    exchange_list_of(f, v, rows * cols);
    fputc('\n', f);
}

static pvx_err opencv_print(FILE *f, const struct rec_rig *r, size_t i, struct pvx_diag *d)
{
    const struct rec_camera *c = &r->cameras[i];
    double K[9], k[14] = {0};
    /* FileStorage's keys begin with a letter or '_' and have no '.'. */
    if (strchr(c->name, '.') != NULL || (c->name[0] >= '0' && c->name[0] <= '9') ||
        c->name[0] == '-')
        return exchange_cannot(c, REC_EXCHANGE_OPENCV, "this name as a key", d);
    exchange_K(c, K);
    memcpy(k, c->dist, sizeof c->dist);
    memcpy(k + 12, c->tilt, sizeof c->tilt);
    fprintf(f, "%s%s:\n   image_width: %d\n   image_height: %d\n   fisheye_model: %d\n",
            i == 0 ? "%YAML:1.0\n---\n" : "", c->name, c->width, c->height,
            c->model == REC_FISHEYE);
    opencv_matrix(f, "   ", "camera_matrix", K, 3, 3);
    opencv_matrix(f, "   ", "distortion_coefficients", k, 1, exchange_count(c));
    opencv_matrix(f, "   ", "R", c->R, 3, 3);
    opencv_matrix(f, "   ", "T", c->t, 3, 1);
    return PVX_OK;
}

static pvx_err jarvis_print(FILE *f, const struct rec_rig *r, size_t i, struct pvx_diag *d)
{
    const struct rec_camera *c = &r->cameras[i];
    const double K[9] = {c->fx, 0, 0, 0, c->fy, 0, c->cx, c->cy, 1};
    double R[9], t[3];
    if (exchange_count(c) != 5)
        return exchange_cannot(c, REC_EXCHANGE_JARVIS, "its lens: only k1 k2 p1 p2 k3", d);
    for (int k = 0; k < 9; k++)
        R[k] = c->R[3 * (k % 3) + k / 3];
    for (int k = 0; k < 3; k++)
        t[k] = 1000 * c->t[k];
    fputs("%YAML:1.0\n---\n", f);
    fprintf(f, "image_width: %d\nimage_height: %d\n", c->width, c->height);
    opencv_matrix(f, "", "intrinsicMatrix", K, 3, 3);
    opencv_matrix(f, "", "distortionCoefficients", c->dist, 1, 5);
    opencv_matrix(f, "", "R", R, 3, 3);
    opencv_matrix(f, "", "T", t, 3, 1);
    return PVX_OK;
}

static void ros_matrix(FILE *f, const char *key, const double *v, int rows, int cols)
{
    fprintf(f, "%s:\n  rows: %d\n  cols: %d\n  data: ", key, rows, cols);
    exchange_list_of(f, v, rows * cols);
    fputc('\n', f);
}

static pvx_err ros_print(FILE *f, const struct rec_rig *r, size_t i, struct pvx_diag *d)
{
    static const double one[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    const struct rec_camera *c = &r->cameras[i];
    const double P[12] = {c->fx, 0, c->cx, 0, 0, c->fy, c->cy, 0, 0, 0, 1, 0};
    const int n = exchange_count(c);
    double K[9];
    (void)d;
    exchange_K(c, K);
    fprintf(f, "image_width: %d\nimage_height: %d\ncamera_name: %s\n", c->width, c->height,
            c->name);
    ros_matrix(f, "camera_matrix", K, 3, 3);
    fprintf(f, "distortion_model: %s\n",
            n == 4   ? "equidistant"
            : n == 5 ? "plumb_bob"
                     : "rational_polynomial");
    ros_matrix(f, "distortion_coefficients", c->dist, 1, n);
    ros_matrix(f, "rectification_matrix", one, 3, 3);
    ros_matrix(f, "projection_matrix", P, 3, 4);
    return PVX_OK;
}

/* T_cn_cnm1 = [R|t]_n [R|t]_(n-1)^-1 */
static void kalibr_step(const struct rec_camera *a, const struct rec_camera *b, double T[16])
{
    memset(T, 0, 16 * sizeof *T);
    T[15] = 1;
    for (int i = 0; i < 3; i++) {
        T[4 * i + 3] = b->t[i];
        for (int j = 0; j < 3; j++) {
            for (int k = 0; k < 3; k++)
                T[4 * i + j] += b->R[3 * i + k] * a->R[3 * j + k];
            T[4 * i + 3] -= T[4 * i + j] * a->t[j];
        }
    }
}

static pvx_err kalibr_print(FILE *f, const struct rec_rig *r, size_t i, struct pvx_diag *d)
{
    const struct rec_camera *c = &r->cameras[i];
    const double K[4] = {c->fx, c->fy, c->cx, c->cy};
    double T[16];
    if (c->model == REC_PINHOLE && (exchange_count(c) != 5 || c->dist[4] != 0))
        return exchange_cannot(c, REC_EXCHANGE_KALIBR, "its lens: only k1 k2 p1 p2", d);
    fprintf(f, "cam%zu:\n  camera_model: pinhole\n  distortion_coeffs: ", i);
    exchange_list_of(f, c->dist, 4);
    fprintf(f, "\n  distortion_model: %s\n  intrinsics: ",
            c->model == REC_FISHEYE ? "equidistant" : "radtan");
    exchange_list_of(f, K, 4);
    fprintf(f, "\n  resolution: [%d, %d]\n  rostopic: /%s/image_raw\n", c->width, c->height,
            c->name);
    if (i == 0)
        return PVX_OK;
    kalibr_step(&r->cameras[i - 1], c, T);
    fputs("  T_cn_cnm1:\n", f);
    for (int k = 0; k < 4; k++) {
        fputs("  - ", f);
        exchange_list_of(f, T + 4 * k, 4);
        fputc('\n', f);
    }
    return PVX_OK;
}

/* Hamilton's, real part first.  The largest of the four is found first: Shepperd, J. Guidance and Control 1:223, 1978. */
static void exchange_to_quaternion(const double R[9], double q[4])
{
    const double tr = R[0] + R[4] + R[8];
    const double four[4] = {tr, R[0], R[4], R[8]};
    int big = 0;
    for (int i = 1; i < 4; i++)
        if (four[i] > four[big])
            big = i;
    const double raw[4][4] = {{1 + tr, R[7] - R[5], R[2] - R[6], R[3] - R[1]},
                              {R[7] - R[5], 1 + 2 * R[0] - tr, R[1] + R[3], R[2] + R[6]},
                              {R[2] - R[6], R[1] + R[3], 1 + 2 * R[4] - tr, R[5] + R[7]},
                              {R[3] - R[1], R[2] + R[6], R[5] + R[7], 1 + 2 * R[8] - tr}};
    double length = 0;
    for (int i = 0; i < 4; i++)
        length += raw[big][i] * raw[big][i];
    for (int i = 0; i < 4; i++)
        q[i] = raw[big][i] / sqrt(length) * (raw[big][0] < 0 ? -1 : 1);
}

/* Rotation vector of R, by its quaternion. */
static void exchange_to_rodrigues(const double R[9], double v[3])
{
    double q[4];
    exchange_to_quaternion(R, q);
    const double s = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    const double scale = s > 1e-12 ? 2 * atan2(s, q[0]) / s : 2;
    for (int i = 0; i < 3; i++)
        v[i] = scale * q[i + 1];
}

static pvx_err anipose_print(FILE *f, const struct rec_rig *r, size_t i, struct pvx_diag *d)
{
    const struct rec_camera *c = &r->cameras[i];
    double K[9], v[3];
    (void)d;
    exchange_K(c, K);
    exchange_to_rodrigues(c->R, v);
    fprintf(f, "[cam_%zu]\nname = \"%s\"\nsize = [%d, %d]\nmatrix = ", i, c->name, c->width,
            c->height);
    exchange_rows_of(f, K, 3, 3);
    fputs("\ndistortions = ", f);
    exchange_list_of(f, c->dist, exchange_count(c));
    fputs("\nrotation = ", f);
    exchange_list_of(f, v, 3);
    fputs("\ntranslation = ", f);
    exchange_list_of(f, c->t, 3);
    fprintf(f, "\nfisheye = %s\n\n", c->model == REC_FISHEYE ? "true" : "false");
    if (i + 1 == r->n_cameras)
        fputs("[metadata]\nadjusted = false\nerror = 0.0\n", f);
    return PVX_OK;
}

/* Blender has no distortion; the caller says so. */
static pvx_err blender_print(FILE *f, const struct rec_rig *r, size_t i, struct pvx_diag *d)
{
    const struct rec_camera *c = &r->cameras[i];
    double at[3];
    if (c->model == REC_FISHEYE)
        return exchange_cannot(c, REC_EXCHANGE_BLENDER, "a fisheye", d);
    rec_camera_centre(c, at);
    const bool tall = c->width < c->height * (c->fx / c->fy);
    const double aspect = c->fx / c->fy, view = tall ? c->height * aspect : c->width;
    const double shift[2] = {(c->width / 2.0 - (c->cx + 0.5)) / view,
                             ((c->cy + 0.5) - c->height / 2.0) * aspect / view};
    const double T[16] = {c->R[0], -c->R[3], -c->R[6], at[0], c->R[1], -c->R[4], -c->R[7], at[1],
                          c->R[2], -c->R[5], -c->R[8], at[2], 0,       0,        0,        1};
    fprintf(f, "%s  {\"name\": \"%s\", \"type\": \"PERSP\", \"size\": [%d, %d],\n",
            i == 0 ? "{\"format\": \"pyrovox-blender-cameras\", \"metres_per_unit\": 1, "
                     "\"cameras\": [\n"
                   : "",
            c->name, c->width, c->height);
    fprintf(f,
            "   \"sensor_fit\": \"AUTO\", \"sensor_width\": 36, \"sensor_height\": 24, "
            "\"lens\": %.17g, \"pixel_aspect\": %.17g,\n   \"shift\": ",
            c->fx * 36 / view, aspect);
    exchange_list_of(f, shift, 2);
    fputs(",\n   \"matrix_world\": ", f);
    exchange_rows_of(f, T, 4, 4);
    fputs(i + 1 < r->n_cameras ? "},\n" : "}\n]}\n", f);
    return PVX_OK;
}

/* ---- COLMAP ----------------------------------------------------------------------------------- */

static pvx_err colmap_print_cameras(FILE *f, const struct rec_rig *r, size_t i, struct pvx_diag *d)
{
    const struct rec_camera *c = &r->cameras[i];
    const bool simple = c->dist[4] == 0 && exchange_count(c) == 5;
    const char *model = c->model == REC_FISHEYE ? "OPENCV_FISHEYE"
                        : simple                ? "OPENCV"
                                                : "FULL_OPENCV";
    (void)d;
    fprintf(f, "%zu %s %d %d %.17g %.17g %.17g %.17g", i + 1, model, c->width, c->height, c->fx,
            c->fy, c->cx + 0.5, c->cy + 0.5);
    for (int k = 0; k < (strcmp(model, "FULL_OPENCV") == 0 ? 8 : 4); k++)
        fprintf(f, " %.17g", c->dist[k]);
    fputc('\n', f);
    return PVX_OK;
}

static pvx_err colmap_print_images(FILE *f, const struct rec_rig *r, size_t i, struct pvx_diag *d)
{
    const struct rec_camera *c = &r->cameras[i];
    double q[4];
    (void)d;
    exchange_to_quaternion(c->R, q);
    fprintf(f, "%zu %.17g %.17g %.17g %.17g %.17g %.17g %.17g %zu %s.png\n\n", i + 1, q[0], q[1],
            q[2], q[3], c->t[0], c->t[1], c->t[2], i + 1, c->name);
    return PVX_OK;
}

static pvx_err colmap_print_points(FILE *f, const struct rec_rig *r, size_t i, struct pvx_diag *d)
{
    (void)r;
    (void)d;
    if (i == 0)
        fputs("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n", f);
    return PVX_OK;
}

/* ---- files ------------------------------------------------------------------------------------ */

static pvx_err exchange_save(const struct rec_rig *r, size_t from, size_t to, exchange_print *print,
                             const char *path, struct pvx_diag *d)
{
    char *text = NULL;
    size_t len = 0;
    FILE *f = open_memstream(&text, &len);
    PVX_NEED(f);
    pvx_err e = PVX_OK;
    for (size_t i = from; i < to && e == PVX_OK; i++)
        e = print(f, r, i, d);
    if (fclose(f) != 0 && e == PVX_OK)
        e = PVX_ENOMEM;
    PVX_THEN(e, pvx_file_write(path, text, len, d));
    free(text);
    return e;
}

static pvx_err exchange_save_in(const struct rec_rig *r, size_t from, size_t to,
                                exchange_print *print, const char *folder, const char *name,
                                struct pvx_diag *d)
{
    char path[4096];
    int n = snprintf(path, sizeof path, "%s/%s", folder, name);
    if (n < 0 || (size_t)n >= sizeof path)
        return pvx_fail(d, PVX_ERANGE, "%s: too long", folder);
    return exchange_save(r, from, to, print, path, d);
}

pvx_err rec_exchange_write(const struct rec_rig *r, enum rec_exchange_format to, const char *path,
                           struct pvx_diag *d)
{
    const size_t n = r->n_cameras;
    char name[REC_NAME_MAX + 8];
    pvx_err e;
    for (size_t i = 0; i < n; i++) {
        const struct rec_camera *c = &r->cameras[i];
        if (c->n_windows > 0 || c->model >= REC_TELECENTRIC)
            return exchange_cannot(
                c, to, c->n_windows > 0 ? "its windows" : "a telecentric lens or rays", d);
        if (c->model == REC_SCHEIMPFLUG && to != REC_EXCHANGE_OPENCV)
            return exchange_cannot(c, to, "a tilted sensor", d);
    }
    switch (to) {
    case REC_EXCHANGE_OPENCV: return exchange_save(r, 0, n, opencv_print, path, d);
    case REC_EXCHANGE_KALIBR: return exchange_save(r, 0, n, kalibr_print, path, d);
    case REC_EXCHANGE_ANIPOSE: return exchange_save(r, 0, n, anipose_print, path, d);
    case REC_EXCHANGE_BLENDER: return exchange_save(r, 0, n, blender_print, path, d);
    case REC_EXCHANGE_ROS:
    case REC_EXCHANGE_JARVIS:
        e = pvx_mkdirs(path, d);
        for (size_t i = 0; i < n && e == PVX_OK; i++) {
            snprintf(name, sizeof name, "%s.yaml", r->cameras[i].name);
            e = exchange_save_in(r, i, i + 1, to == REC_EXCHANGE_ROS ? ros_print : jarvis_print,
                                 path, name, d);
        }
        return e;
    case REC_EXCHANGE_COLMAP:
        e = pvx_mkdirs(path, d);
        PVX_THEN(e, exchange_save_in(r, 0, n, colmap_print_cameras, path, "cameras.txt", d));
        PVX_THEN(e, exchange_save_in(r, 0, n, colmap_print_images, path, "images.txt", d));
        PVX_THEN(e, exchange_save_in(r, 0, n, colmap_print_points, path, "points3D.txt", d));
        return e;
    default:
        return pvx_fail(d, PVX_EUNSUP, "%s is read, but not written here", rec_exchange_name(to));
    }
}
