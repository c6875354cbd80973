/* opencv.c - FileStorage files of OpenCV programs, and JARVIS's.  FileStorage is a container, and each program has its own
 * keys.  So the usual names are known, in any case and with or without '_'. */
#include <ctype.h>
#include <stdio.h>
#include <string.h>

#include "recon/exchange/fields.h"

static const char *const keys_K[] = {
    "cameramatrix", "intrinsicmatrix", "intrinsics", "intrinsic", "matrix", "mtx", "k", "m", NULL};
static const char *const keys_D[] = {"distortioncoefficients",
                                     "distcoeffs",
                                     "distcoefs",
                                     "distortioncoeffs",
                                     "distortions",
                                     "distortion",
                                     "dist",
                                     "d",
                                     NULL};
static const char *const keys_R[] = {"r",    "rotation", "rotationmatrix", "rmat",
                                     "rvec", "rcext",    "rotationvector", NULL};
static const char *const keys_t[] = {"t",    "translation", "translationvector",
                                     "tvec", "tcext",       NULL};
static const char *const keys_size[] = {"size",       "imagesize",        "imgsize",
                                        "resolution", "cameraresolution", NULL};
static const char *const keys_width[] = {"imagewidth", "width", NULL};
static const char *const keys_height[] = {"imageheight", "height", NULL};
static const char *const keys_fisheye[] = {"fisheyemodel", "fisheye", "model", "cameramodel", NULL};

/* Is `key` one of these, with `end` behind it? */
static bool opencv_is(const char *key, const char *const *names, const char *end)
{
    char plain[48];
    size_t n = 0;
    for (; *key != '\0' && n + 1 < sizeof plain; key++)
        if (*key != '_' && *key != '-' && *key != ' ')
            plain[n++] = (char)tolower((unsigned char)*key);
    plain[n] = '\0';
    if (*key != '\0' || n < strlen(end) || strcmp(plain + n - strlen(end), end) != 0)
        return false;
    plain[n - strlen(end)] = '\0';
    for (; *names != NULL; names++)
        if (strcmp(plain, *names) == 0)
            return true;
    return false;
}

/* The node under one of these keys, 0 if there is none; *twice: under two. */
static int opencv_find(const struct exchange_in *in, int map, const char *const *names,
                       const char *end, const char **key, bool *twice)
{
    int found = 0;
    for (size_t i = 0; i < pvx_yaml_length(in->y, map); i++)
        if (opencv_is(pvx_yaml_key(in->y, map, i), names, end)) {
            *twice = *twice || found != 0;
            found = pvx_yaml_value(in->y, map, i);
            *key = pvx_yaml_key(in->y, map, i);
        }
    return found;
}

struct opencv_nodes {
    int K, D, R, t, size, width, height, fisheye;
    const char *key_K, *key_D, *key_R, *key_t, *key_size, *key_f;
};

static pvx_err opencv_nodes_of(const struct exchange_in *in, int map, const char *end,
                               struct opencv_nodes *n)
{
    bool twice = false;
    memset(n, 0, sizeof *n);
    n->K = opencv_find(in, map, keys_K, end, &n->key_K, &twice);
    n->D = opencv_find(in, map, keys_D, end, &n->key_D, &twice);
    n->R = opencv_find(in, map, keys_R, end, &n->key_R, &twice);
    n->t = opencv_find(in, map, keys_t, end, &n->key_t, &twice);
    n->size = opencv_find(in, map, keys_size, "", &n->key_size, &twice);
    n->width = opencv_find(in, map, keys_width, "", &n->key_size, &twice);
    n->height = opencv_find(in, map, keys_height, "", &n->key_size, &twice);
    n->fisheye = opencv_find(in, map, keys_fisheye, "", &n->key_f, &twice);
    if (twice)
        return exchange_fail(in, map, "keys", PVX_EFORMAT,
                             "two of these keys mean the same (as camera_matrix and K): leave one");
    return PVX_OK;
}

static pvx_err opencv_size(const struct exchange_in *in, const struct opencv_nodes *n,
                           struct rec_exchange_camera *c)
{
    double wh[EXCHANGE_MAX];
    size_t count;
    if (n->size != 0) {
        PVX_TRY(exchange_numbers(in, n->size, n->key_size, 2, 2, wh, &count));
        return exchange_size(in, n->size, n->key_size, wh, c);
    }
    if (n->width == 0 || n->height == 0)
        return PVX_OK;
    PVX_TRY(pvx_yaml_double(in->y, n->width, "width", 0, 1e6, &wh[0], in->d));
    PVX_TRY(pvx_yaml_double(in->y, n->height, "height", 0, 1e6, &wh[1], in->d));
    return exchange_size(in, n->width, n->key_size, wh, c);
}

static pvx_err opencv_model(const struct exchange_in *in, const struct opencv_nodes *n,
                            enum rec_camera_model *model)
{
    const char *text = pvx_yaml_text(in->y, n->fisheye);
    *model = REC_PINHOLE;
    if (n->fisheye == 0 || strcmp(text, "0") == 0 || strcasecmp(text, "false") == 0 ||
        strcmp(text, "pinhole") == 0)
        return PVX_OK;
    *model = REC_FISHEYE;
    if (strcmp(text, "1") == 0 || strcasecmp(text, "true") == 0 || strcmp(text, "fisheye") == 0)
        return PVX_OK;
    return exchange_fail(in, n->fisheye, n->key_f, PVX_EUNSUP,
                         "the lens model '%s' is not supported; pinhole or fisheye", text);
}

/* Rotation matrix or vector. */
static pvx_err opencv_rotation(const struct exchange_in *in, int node, const char *key, double R[9])
{
    double v[EXCHANGE_MAX];
    size_t n;
    PVX_TRY(exchange_numbers(in, node, key, 3, 9, v, &n));
    if (n == 3)
        exchange_rodrigues(v, R);
    else if (n == 9)
        memcpy(R, v, 9 * sizeof *R);
    else
        return exchange_fail(in, node, key, PVX_EFORMAT, "should have 3 or 9 numbers, not %zu", n);
    return PVX_OK;
}

static pvx_err opencv_lens(const struct exchange_in *in, const struct opencv_nodes *n,
                           struct rec_exchange_camera *c)
{
    double v[EXCHANGE_MAX];
    size_t count;
    enum rec_camera_model model;
    PVX_TRY(exchange_numbers(in, n->K, n->key_K, 9, 9, v, &count));
    PVX_TRY(exchange_lens(in, n->K, n->key_K, v, 0, c));
    PVX_TRY(opencv_model(in, n, &model));
    memset(v, 0, sizeof v);
    count = 0;
    if (n->D != 0)
        PVX_TRY(exchange_numbers(in, n->D, n->key_D, 0, 14, v, &count));
    if (n->fisheye == 0 && count == 4)
        exchange_note(in->x, "Four distortion numbers were read as k1 k2 p1 p2; of a fisheye, they "
                             "are k1 k2 k3 k4, and the file needs fisheye_model: 1.");
    return exchange_distortion(in, n->D, n->D != 0 ? n->key_D : "distortion", model, v, count, c);
}

static pvx_err opencv_camera(const struct exchange_in *in, const char *name,
                             const struct opencv_nodes *n)
{
    struct rec_exchange_camera *c;
    double R[9], t[EXCHANGE_MAX];
    size_t count;
    PVX_TRY(exchange_camera(in->x, in->path, name, &c, in->d));
    if (n->K != 0) {
        PVX_TRY(opencv_lens(in, n, c));
        PVX_TRY(opencv_size(in, n, c));
    }
    if ((n->R != 0) != (n->t != 0))
        return exchange_fail(in, n->R != 0 ? n->R : n->t, n->R != 0 ? n->key_R : n->key_t,
                             PVX_EFORMAT, "camera '%s' has %s but no %s", name,
                             n->R != 0 ? "a rotation" : "a translation",
                             n->R != 0 ? "translation" : "rotation");
    if (n->R == 0)
        return PVX_OK;
    PVX_TRY(opencv_rotation(in, n->R, n->key_R, R));
    PVX_TRY(exchange_numbers(in, n->t, n->key_t, 3, 3, t, &count));
    return exchange_pose(in, n->R, n->key_R, R, t, c);
}

/* stereo_calib: M1 D1 M2 D2, and R T of the second camera from the first. */
static pvx_err opencv_pair(const struct exchange_in *in, int root, bool *is)
{
    struct opencv_nodes one, two, both;
    double t[EXCHANGE_MAX];
    size_t count;
    PVX_TRY(opencv_nodes_of(in, root, "1", &one));
    PVX_TRY(opencv_nodes_of(in, root, "2", &two));
    PVX_TRY(opencv_nodes_of(in, root, "", &both));
    const bool lenses = one.K != 0 && two.K != 0;
    const bool pose = both.K == 0 && both.R != 0 && both.t != 0;
    *is = lenses || (pose && (one.R != 0 || in->x->n == 2));
    if (!*is)
        return PVX_OK;
    if (lenses) {
        one.R = one.t = two.R = two.t = 0; /* rectification */
        one.width = two.width = both.width;
        one.height = two.height = both.height;
        PVX_TRY(opencv_camera(in, "cam1", &one));
        PVX_TRY(opencv_camera(in, "cam2", &two));
    }
    if (!pose)
        return PVX_OK;
    if (in->x->pair)
        return exchange_fail(in, both.R, both.key_R, PVX_EINVAL, "a second R and T of a pair");
    PVX_TRY(opencv_rotation(in, both.R, both.key_R, in->x->R));
    PVX_TRY(exchange_numbers(in, both.t, both.key_t, 3, 3, t, &count));
    memcpy(in->x->t, t, sizeof in->x->t);
    in->x->pair = true;
    return PVX_OK;
}

/* Mappings that are cameras, by their key or their name; how many. */
static pvx_err opencv_inside(const struct exchange_in *in, int map, size_t *found)
{
    for (size_t i = 0; i < pvx_yaml_length(in->y, map); i++) {
        struct opencv_nodes n;
        int node = pvx_yaml_kind(in->y, map) == PVX_YAML_SEQ ? pvx_yaml_item(in->y, map, i)
                                                             : pvx_yaml_value(in->y, map, i);
        if (pvx_yaml_kind(in->y, node) != PVX_YAML_MAP)
            continue;
        PVX_TRY(opencv_nodes_of(in, node, "", &n));
        if (n.K == 0 && (n.R == 0 || n.t == 0))
            continue;
        const char *name = pvx_yaml_text(in->y, pvx_yaml_get(in->y, node, "name"));
        if (*name == '\0')
            name = pvx_yaml_key(in->y, map, i);
        if (*name == '\0')
            return exchange_fail(in, node, "cameras", PVX_EFORMAT, "camera %zu has no name", i + 1);
        PVX_TRY(opencv_camera(in, name, &n));
        ++*found;
    }
    return PVX_OK;
}

pvx_err exchange_read_opencv(const struct exchange_in *in)
{
    const int root = pvx_yaml_root(in->y);
    struct opencv_nodes n;
    size_t found = 0;
    bool pair = false;
    char name[REC_NAME_MAX];
    if (pvx_yaml_kind(in->y, root) != PVX_YAML_MAP)
        return pvx_fail(in->d, PVX_EFORMAT, "%s: holds no cameras that are known here", in->path);
    PVX_TRY(opencv_pair(in, root, &pair));
    if (pair)
        return PVX_OK;
    PVX_TRY(opencv_nodes_of(in, root, "", &n));
    if (n.K != 0 || (n.R != 0 && n.t != 0)) {
        const char *said = pvx_yaml_text(in->y, pvx_yaml_get(in->y, root, "camera_name"));
        exchange_stem(in->path, name);
        if (pvx_yaml_get(in->y, root, "extrinsic_parameters") != 0)
            exchange_note(in->x, "extrinsic_parameters are of the board in each picture, and no "
                                 "pose of the camera.");
        return opencv_camera(in, *said != '\0' ? said : name, &n);
    }
    int list = pvx_yaml_get(in->y, root, "cameras");
    PVX_TRY(opencv_inside(in, list != 0 ? list : root, &found));
    if (found == 0)
        return pvx_fail(in->d, PVX_EFORMAT,
                        "%s: holds no camera that is known here: none of the keys camera_matrix, "
                        "cameraMatrix, K, M1, intrinsicMatrix, R and T",
                        in->path);
    return PVX_OK;
}

/* ---- JARVIS ----------------------------------------------------------------------------------- */

/* A file per camera, with row vectors: [u v 1] ~ (X R + T) intrinsicMatrix.  So both matrices are transposed. */
bool exchange_is_jarvis(const pvx_yaml *y)
{
    int root = pvx_yaml_root(y);
    return pvx_yaml_get(y, root, "intrinsicMatrix") != 0 &&
           pvx_yaml_get(y, root, "distortionCoefficients") != 0;
}

pvx_err exchange_read_jarvis(const struct exchange_in *in)
{
    const int root = pvx_yaml_root(in->y);
    struct opencv_nodes n;
    struct rec_exchange_camera *c;
    double v[EXCHANGE_MAX], K[9], R[9];
    size_t count;
    char name[REC_NAME_MAX];
    PVX_TRY(opencv_nodes_of(in, root, "", &n));
    if (n.K == 0 || n.D == 0)
        return pvx_fail(in->d, PVX_EFORMAT,
                        "%s: is not JARVIS's: intrinsicMatrix or distortionCoefficients is missing",
                        in->path);
    exchange_stem(in->path, name);
    PVX_TRY(exchange_camera(in->x, in->path, name, &c, in->d));
    PVX_TRY(exchange_numbers(in, n.K, n.key_K, 9, 9, v, &count));
    exchange_transpose(v, K);
    if (K[2] == 0 && K[5] == 0 && (K[6] != 0 || K[7] != 0))
        return exchange_fail(in, n.K, n.key_K, PVX_EINVAL,
                             "is not transposed, as JARVIS writes it, so R may not be either: read "
                             "it with --from opencv, or let JARVIS write it");
    PVX_TRY(exchange_lens(in, n.K, n.key_K, K, 0, c));
    PVX_TRY(exchange_numbers(in, n.D, n.key_D, 4, 14, v, &count));
    PVX_TRY(exchange_distortion(in, n.D, n.key_D, REC_PINHOLE, v, count, c));
    PVX_TRY(opencv_size(in, &n, c));
    if (n.R == 0 || n.t == 0)
        return PVX_OK;
    PVX_TRY(exchange_numbers(in, n.R, n.key_R, 9, 9, v, &count));
    exchange_transpose(v, R);
    PVX_TRY(exchange_numbers(in, n.t, n.key_t, 3, 3, v, &count));
    return exchange_pose(in, n.R, n.key_R, R, v, c);
}
