#include "recon/exchange/exchange.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "recon/exchange/fields.h"

#define MAX_FILE (64u << 20)

static const char *const names[] = {"auto",    "opencv", "ros",    "kalibr",  "colmap",
                                    "anipose", "matlab", "jarvis", "agisoft", "blender"};
_Static_assert(sizeof names / sizeof *names == REC_EXCHANGE_FORMATS, "a name for every format");

const char *rec_exchange_name(enum rec_exchange_format f)
{
    return names[f];
}

enum rec_exchange_format rec_exchange_by_name(const char *name)
{
    unsigned f = 0;
    while (f < REC_EXCHANGE_FORMATS && strcmp(names[f], name) != 0)
        f++;
    return (enum rec_exchange_format)f;
}

static bool exchange_ends(const char *path, const char *end)
{
    return pvx_path_ends(path, end);
}

/* First byte that is no blank. */
static char exchange_first(const char *text, size_t len)
{
    size_t i = 0;
    if (len >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0)
        i = 3;
    while (i < len && strchr(" \t\r\n", text[i]) != NULL && text[i] != '\0')
        i++;
    return i < len ? text[i] : '\0';
}

static bool exchange_is_rig(const pvx_yaml *y)
{
    int root = pvx_yaml_root(y);
    return pvx_yaml_get(y, root, "volume") != 0 && pvx_yaml_get(y, root, "cameras") != 0;
}

static const struct {
    bool (*is)(const pvx_yaml *y);
    pvx_err (*read)(const struct exchange_in *in);
} readers[REC_EXCHANGE_FORMATS] = {
    [REC_EXCHANGE_OPENCV] = {NULL, exchange_read_opencv},
    [REC_EXCHANGE_ROS] = {exchange_is_ros, exchange_read_ros},
    [REC_EXCHANGE_KALIBR] = {exchange_is_kalibr, exchange_read_kalibr},
    [REC_EXCHANGE_ANIPOSE] = {exchange_is_anipose, exchange_read_anipose},
    [REC_EXCHANGE_JARVIS] = {exchange_is_jarvis, exchange_read_jarvis},
    [REC_EXCHANGE_AGISOFT] = {exchange_is_agisoft, exchange_read_agisoft},
    [REC_EXCHANGE_BLENDER] = {exchange_is_blender, exchange_read_blender},
};

static pvx_err exchange_read_tree(const struct exchange_in *in, enum rec_exchange_format from)
{
    if (exchange_is_rig(in->y))
        return pvx_fail(in->d, PVX_EFORMAT, "%s: is a rig.yaml already", in->path);
    if (from == REC_EXCHANGE_AUTO) {
        from = REC_EXCHANGE_OPENCV;
        for (unsigned f = 1; f < REC_EXCHANGE_FORMATS; f++)
            if (readers[f].is != NULL && readers[f].is(in->y)) {
                from = (enum rec_exchange_format)f;
                break;
            }
    }
    in->x->seen |= 1u << from;
    return readers[from].read(in);
}

pvx_err rec_exchange_parse(const char *text, size_t len, const char *path,
                           enum rec_exchange_format from, struct rec_exchange *x,
                           struct pvx_diag *d)
{
    char *other = NULL;
    size_t n = 0;
    pvx_yaml *y;
    const bool toml = exchange_ends(path, ".toml") || from == REC_EXCHANGE_ANIPOSE;
    if (from == REC_EXCHANGE_MATLAB || from == REC_EXCHANGE_COLMAP)
        return pvx_fail(d, PVX_EUNSUP, "%s: is read from its file only", path);
    if (exchange_first(text, len) == '<')
        PVX_TRY(exchange_from_xml(text, len, path, &other, &n, d));
    else if (toml)
        PVX_TRY(exchange_from_toml(text, len, path, &other, &n, d));
    else if (len >= 6 && memcmp(text, "%YAML:", 6) == 0) { /* FileStorage's, which is not YAML's */
        PVX_NEED(other = malloc(len + 1));
        memcpy(other, text, len);
        other[0] = '#';
        other[n = len] = '\0';
    }
    pvx_err e = pvx_yaml_parse(other != NULL ? other : text, other != NULL ? n : len, path, &y, d);
    free(other);
    PVX_TRY(e);
    const struct exchange_in in = {y, path, x, d};
    e = exchange_read_tree(&in, from);
    pvx_yaml_free(&y);
    return e;
}

pvx_err rec_exchange_read(const char *path, enum rec_exchange_format from, struct rec_exchange *x,
                          struct pvx_diag *d)
{
    const struct exchange_in in = {NULL, path, x, d};
    char *text;
    size_t len;
    if (from == REC_EXCHANGE_COLMAP || (from == REC_EXCHANGE_AUTO && exchange_is_colmap(path))) {
        x->seen |= 1u << REC_EXCHANGE_COLMAP;
        return exchange_read_colmap(&in);
    }
    PVX_TRY(pvx_file_read(path, MAX_FILE, &text, &len, d));
    pvx_err e;
    if (from == REC_EXCHANGE_MATLAB ||
        (from == REC_EXCHANGE_AUTO && exchange_is_matlab(text, len))) {
        x->seen |= 1u << REC_EXCHANGE_MATLAB;
        e = exchange_read_matlab(&in);
    } else
        e = rec_exchange_parse(text, len, path, from, x, d);
    free(text);
    return e;
}

/* X_cam = rect^T (X + shift), with X in the rectified frame of the first. */
static pvx_err exchange_end_rectified(struct rec_exchange *x, struct pvx_diag *d)
{
    const struct exchange_in in = {NULL, "projection_matrix", x, d};
    struct rec_exchange_camera *c = x->camera;
    if (x->n != 2 || c[0].pose || c[1].pose || !c[0].rectified || !c[1].rectified)
        return PVX_OK;
    const bool first = c[0].shift[0] == 0 && c[0].shift[1] == 0;
    const bool second = c[1].shift[0] == 0 && c[1].shift[1] == 0;
    if (first == second)
        return PVX_OK;
    for (int i = 0; i < 2; i++) {
        double R[9], t[3];
        exchange_transpose(c[i].rect, R);
        for (int k = 0; k < 3; k++)
            t[k] = R[3 * k] * c[i].shift[0] + R[3 * k + 1] * c[i].shift[1];
        PVX_TRY(exchange_pose(&in, 0, c[i].c.name, R, t, &c[i]));
    }
    exchange_note(x, "The world is the rectified frame of the camera with P[0,3] = 0.");
    return PVX_OK;
}

pvx_err rec_exchange_end(struct rec_exchange *x, struct pvx_diag *d)
{
    static const double one[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, zero[3];
    const struct exchange_in in = {NULL, "pair", x, d};
    if (!x->pair)
        return exchange_end_rectified(x, d);
    if (x->n != 2)
        return pvx_fail(d, PVX_EINVAL,
                        "R and T are of the second of two cameras, but the files have %zu: give "
                        "the file with M1 and M2, too",
                        x->n);
    x->pair = false;
    PVX_TRY(exchange_pose(&in, 0, "R", one, zero, &x->camera[0]));
    return exchange_pose(&in, 0, "R", x->R, x->t, &x->camera[1]);
}

/* The x with the least sum of squared distances to the axes: sum (I - d d^T) (x - c) = 0. */
bool rec_exchange_aim(const struct rec_exchange *x, double at[3])
{
    double A[9] = {0}, b[3] = {0}, c[3];
    for (size_t i = 0; i < x->n; i++) {
        const double *d = &x->camera[i].c.R[6];
        rec_camera_centre(&x->camera[i].c, c);
        for (int r = 0; r < 3; r++)
            for (int k = 0; k < 3; k++) {
                double m = (r == k) - d[r] * d[k];
                A[3 * r + k] += m;
                b[r] += m * c[k];
            }
    }
    const double cof[9] = {
        A[4] * A[8] - A[5] * A[7], A[2] * A[7] - A[1] * A[8], A[1] * A[5] - A[2] * A[4],
        A[5] * A[6] - A[3] * A[8], A[0] * A[8] - A[2] * A[6], A[2] * A[3] - A[0] * A[5],
        A[3] * A[7] - A[4] * A[6], A[1] * A[6] - A[0] * A[7], A[0] * A[4] - A[1] * A[3]};
    const double det = A[0] * cof[0] + A[1] * cof[3] + A[2] * cof[6];
    if (!(det > 1e-6))
        return false;
    for (int r = 0; r < 3; r++)
        at[r] = (cof[3 * r] * b[0] + cof[3 * r + 1] * b[1] + cof[3 * r + 2] * b[2]) / det;
    return true;
}
