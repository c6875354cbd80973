/* colmap.c - a COLMAP model: cameras and images, .txt or .bin, in one folder.  Every image is a camera of the rig.
 * Source: COLMAP's documentation, "Output Format" and "Camera Models". */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/file.h"
#include "recon/exchange/fields.h"

#define MAX_FILE   (1u << 30)
#define MAX_LENSES 4096

static const struct {
    const char *name;
    int params;
    bool known;
} models[] = {{"SIMPLE_PINHOLE", 3, true},
              {"PINHOLE", 4, true},
              {"SIMPLE_RADIAL", 4, true},
              {"RADIAL", 5, true},
              {"OPENCV", 8, true},
              {"OPENCV_FISHEYE", 8, true},
              {"FULL_OPENCV", 12, true},
              {"FOV", 5, false},
              {"SIMPLE_RADIAL_FISHEYE", 4, true},
              {"RADIAL_FISHEYE", 5, true},
              {"THIN_PRISM_FISHEYE", 12, false}};
#define N_MODELS (sizeof models / sizeof *models)

struct colmap_lens {
    uint32_t id;
    size_t model;
    double wh[2], p[12];
};

struct colmap {
    struct exchange_in in; /* y NULL, path of the file that is read */
    struct colmap_lens *lens;
    size_t n;
    const char *p, *end;
    unsigned line;
};

bool exchange_is_colmap(const char *path)
{
    struct stat st;
    const char *slash = strrchr(path, '/'), *base = slash != NULL ? slash + 1 : path;
    return (stat(path, &st) == 0 && S_ISDIR(st.st_mode)) || strcmp(base, "cameras.txt") == 0 ||
           strcmp(base, "cameras.bin") == 0 || strcmp(base, "images.txt") == 0 ||
           strcmp(base, "images.bin") == 0;
}

static pvx_err colmap_fail(const struct colmap *m, const char *why)
{
    if (m->line > 0)
        return pvx_fail(m->in.d, PVX_EFORMAT, "%s:%u: %s", m->in.path, m->line, why);
    return pvx_fail(m->in.d, PVX_EFORMAT, "%s: %s", m->in.path, why);
}

static pvx_err colmap_add_lens(struct colmap *m, const struct colmap_lens *l)
{
    if (m->n == MAX_LENSES)
        return colmap_fail(m, "has more than 4096 cameras");
    for (size_t i = 0; i < m->n; i++)
        if (m->lens[i].id == l->id)
            return colmap_fail(m, "a CAMERA_ID is there twice");
    if ((m->n & (m->n - 1)) == 0) {
        struct colmap_lens *more = realloc(m->lens, 2 * (m->n + 1) * sizeof *more);
        PVX_NEED(more);
        m->lens = more;
    }
    m->lens[m->n++] = *l;
    return PVX_OK;
}

static pvx_err colmap_lens_of(const struct colmap *m, const struct colmap_lens *l,
                              struct rec_exchange_camera *c)
{
    const double *p = l->p;
    const char *name = models[l->model].name;
    const bool one = strncmp(name, "SIMPLE", 6) == 0 || strncmp(name, "RADIAL", 6) == 0;
    const bool fisheye = strstr(name, "FISHEYE") != NULL;
    const size_t first = one ? 3 : 4, n = (size_t)models[l->model].params - first;
    const double K[9] = {p[0], 0, p[one ? 1 : 2], 0, p[one ? 0 : 1], p[one ? 2 : 3], 0, 0, 1};
    double k[8] = {0};
    if (!models[l->model].known)
        return exchange_fail(&m->in, 0, name, PVX_EUNSUP,
                             "camera '%s': this lens model is not supported; use OPENCV, "
                             "FULL_OPENCV or OPENCV_FISHEYE",
                             c->c.name);
    for (size_t i = 0; i < n; i++)
        k[i] = p[first + i];
    PVX_TRY(exchange_lens(&m->in, 0, name, K, 0.5, c));
    PVX_TRY(exchange_distortion(&m->in, 0, name, fisheye ? REC_FISHEYE : REC_PINHOLE, k,
                                fisheye || n <= 4 ? 4 : 8, c));
    return exchange_size(&m->in, 0, name, l->wh, c);
}

static pvx_err colmap_add_image(struct colmap *m, const char *name, uint32_t lens,
                                const double q[4], const double t[3])
{
    struct rec_exchange_camera *c;
    double R[9], length = 0;
    char plain[256];
    size_t i = 0;
    while (i < m->n && m->lens[i].id != lens)
        i++;
    if (i == m->n)
        return colmap_fail(m, "an image has a CAMERA_ID that cameras has not");
    const char *dot = strrchr(name, '.');
    size_t n =
        dot != NULL && dot > name && strchr(dot, '/') == NULL ? (size_t)(dot - name) : strlen(name);
    if (n >= sizeof plain)
        return colmap_fail(m, "an image's name is too long");
    memcpy(plain, name, n);
    plain[n] = '\0';
    for (int k = 0; k < 4; k++)
        length += q[k] * q[k];
    if (!(fabs(length - 1) < 1e-3))
        return colmap_fail(m, "QW QX QY QZ is not of unit length");
    exchange_quaternion(q, R);
    for (int k = 0; k < 9; k++)
        R[k] /= length;
    PVX_TRY(exchange_camera(m->in.x, m->in.path, plain, &c, m->in.d));
    PVX_TRY(colmap_lens_of(m, &m->lens[i], c));
    return exchange_pose(&m->in, 0, "pose", R, t, c);
}

/* ---- text ------------------------------------------------------------------------------------- */

/* The next line that is no comment, with its length; false: the end.  `empty`: empty lines count. */
static bool colmap_line(struct colmap *m, const char **line, size_t *n, bool empty)
{
    while (m->p < m->end) {
        const char *eol = memchr(m->p, '\n', (size_t)(m->end - m->p));
        *line = m->p;
        *n = (size_t)((eol != NULL ? eol : m->end) - m->p);
        m->p = eol != NULL ? eol + 1 : m->end;
        m->line++;
        if (*n > 0 && (*line)[*n - 1] == '\r')
            --*n;
        if ((*n > 0 && **line != '#') || (*n == 0 && empty))
            return true;
    }
    return false;
}

static bool colmap_word(const char **p, const char *end, char *out, size_t room)
{
    size_t n = 0;
    while (*p < end && **p == ' ')
        ++*p;
    while (*p < end && **p != ' ') {
        if (n + 1 < room)
            out[n++] = **p;
        ++*p;
    }
    out[n] = '\0';
    return n > 0;
}

static bool colmap_number(const char **p, const char *end, double *v)
{
    char word[64];
    return colmap_word(p, end, word, sizeof word) && pvx_parse_double(word, -1e9, 1e9, v) == PVX_OK;
}

static bool colmap_id(const char **p, const char *end, uint32_t *id)
{
    double v;
    if (!colmap_number(p, end, &v) || v < 0 || v != floor(v))
        return false;
    *id = (uint32_t)v;
    return true;
}

static pvx_err colmap_text_cameras(struct colmap *m)
{
    const char *p;
    size_t n;
    while (colmap_line(m, &p, &n, false)) {
        struct colmap_lens l = {0};
        char model[32];
        const char *end = p + n;
        if (!colmap_id(&p, end, &l.id) || !colmap_word(&p, end, model, sizeof model) ||
            !colmap_number(&p, end, &l.wh[0]) || !colmap_number(&p, end, &l.wh[1]))
            return colmap_fail(m, "should be CAMERA_ID MODEL WIDTH HEIGHT PARAMS");
        while (l.model < N_MODELS && strcmp(model, models[l.model].name) != 0)
            l.model++;
        if (l.model == N_MODELS)
            return pvx_fail(m->in.d, PVX_EUNSUP, "%s:%u: the lens model '%s' is not known here",
                            m->in.path, m->line, model);
        for (int i = 0; i < models[l.model].params; i++)
            if (!colmap_number(&p, end, &l.p[i]))
                return colmap_fail(m, "has too few PARAMS for its model");
        PVX_TRY(colmap_add_lens(m, &l));
    }
    return PVX_OK;
}

/* Every image has two lines; the second, its points, may be empty. */
static pvx_err colmap_text_images(struct colmap *m)
{
    const char *p, *points;
    size_t n, n_points;
    while (colmap_line(m, &p, &n, false)) {
        uint32_t id, lens;
        double q[4], t[3];
        char name[256];
        const char *end = p + n;
        bool ok = colmap_id(&p, end, &id);
        for (int i = 0; i < 4; i++)
            ok = ok && colmap_number(&p, end, &q[i]);
        for (int i = 0; i < 3; i++)
            ok = ok && colmap_number(&p, end, &t[i]);
        ok = ok && colmap_id(&p, end, &lens);
        while (ok && p < end && *p == ' ')
            p++;
        if (!ok || p == end || (size_t)(end - p) >= sizeof name)
            return colmap_fail(m, "should be IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME");
        memcpy(name, p, (size_t)(end - p));
        name[end - p] = '\0';
        PVX_TRY(colmap_add_image(m, name, lens, q, t));
        (void)colmap_line(m, &points, &n_points, true);
    }
    return PVX_OK;
}

/* ---- binary, little endian -------------------------------------------------------------------- */

static bool colmap_take(struct colmap *m, void *out, size_t n)
{
    if ((size_t)(m->end - m->p) < n)
        return false;
    memcpy(out, m->p, n);
    m->p += n;
    return true;
}

static bool colmap_finite(const double *v, int n)
{
    for (int i = 0; i < n; i++)
        if (!(fabs(v[i]) <= 1e9))
            return false;
    return true;
}

static pvx_err colmap_binary_cameras(struct colmap *m)
{
    uint64_t n, wh[2];
    if (!colmap_take(m, &n, sizeof n))
        return colmap_fail(m, "is cut off");
    for (uint64_t i = 0; i < n; i++) {
        struct colmap_lens l = {0};
        int32_t model;
        if (!colmap_take(m, &l.id, 4) || !colmap_take(m, &model, 4) || !colmap_take(m, wh, 16))
            return colmap_fail(m, "is cut off");
        if (model < 0 || (size_t)model >= N_MODELS)
            return pvx_fail(m->in.d, PVX_EUNSUP, "%s: lens model %d is not known here", m->in.path,
                            model);
        l.model = (size_t)model;
        l.wh[0] = (double)wh[0];
        l.wh[1] = (double)wh[1];
        if (!colmap_take(m, l.p, (size_t)models[model].params * sizeof *l.p))
            return colmap_fail(m, "is cut off");
        if (!colmap_finite(l.p, models[model].params))
            return colmap_fail(m, "a camera's PARAMS are not finite numbers below 1e9");
        PVX_TRY(colmap_add_lens(m, &l));
    }
    return PVX_OK;
}

static pvx_err colmap_binary_images(struct colmap *m)
{
    uint64_t n, points;
    if (!colmap_take(m, &n, sizeof n))
        return colmap_fail(m, "is cut off");
    for (uint64_t i = 0; i < n; i++) {
        uint32_t id, lens;
        double qt[7];
        if (!colmap_take(m, &id, 4) || !colmap_take(m, qt, sizeof qt) || !colmap_take(m, &lens, 4))
            return colmap_fail(m, "is cut off");
        const char *name = m->p, *zero = memchr(name, '\0', (size_t)(m->end - name));
        if (zero == NULL)
            return colmap_fail(m, "is cut off");
        m->p = zero + 1;
        if (!colmap_take(m, &points, 8) || points > (uint64_t)(m->end - m->p) / 24)
            return colmap_fail(m, "is cut off");
        m->p += points * 24;
        if (!colmap_finite(qt, 7))
            return colmap_fail(m, "an image's pose is not of finite numbers below 1e9");
        PVX_TRY(colmap_add_image(m, name, lens, qt, qt + 4));
    }
    return PVX_OK;
}

/* ---- the folder ------------------------------------------------------------------------------- */

static pvx_err colmap_part(struct colmap *m, const char *folder, bool images)
{
    static const char *const ends[] = {"txt", "bin"};
    char path[4096], *text;
    size_t len;
    for (int binary = 0; binary < 2; binary++) {
        int n = snprintf(path, sizeof path, "%s/%s.%s", folder, images ? "images" : "cameras",
                         ends[binary]);
        if (n < 0 || (size_t)n >= sizeof path)
            return pvx_fail(m->in.d, PVX_ERANGE, "%s: too long", folder);
        if (access(path, F_OK) != 0)
            continue;
        PVX_TRY(pvx_file_read(path, MAX_FILE, &text, &len, m->in.d));
        m->in.path = path;
        m->p = text;
        m->end = text + len;
        m->line = 0;
        pvx_err e = binary ? (images ? colmap_binary_images(m) : colmap_binary_cameras(m))
                           : (images ? colmap_text_images(m) : colmap_text_cameras(m));
        free(text);
        m->in.path = folder;
        return e;
    }
    return pvx_fail(m->in.d, PVX_ENOENT,
                    "%s: holds no %s.txt or %s.bin of COLMAP; a sparse model's folder is wanted "
                    "(sparse/0), or FILEs by their names",
                    folder, images ? "images" : "cameras", images ? "images" : "cameras");
}

pvx_err exchange_read_colmap(const struct exchange_in *in)
{
    struct colmap m = {.in = *in};
    char folder[4096];
    struct stat st;
    snprintf(folder, sizeof folder, "%s", in->path);
    if (stat(folder, &st) != 0)
        return pvx_fail(in->d, pvx_err_from_errno(errno), "%s: %s", in->path, strerror(errno));
    if (!S_ISDIR(st.st_mode)) {
        char *slash = strrchr(folder, '/');
        if (slash != NULL)
            *slash = '\0';
        else
            snprintf(folder, sizeof folder, ".");
    }
    m.in.y = NULL;
    m.in.path = folder;
    pvx_err e = colmap_part(&m, folder, false);
    PVX_THEN(e, colmap_part(&m, folder, true));
    free(m.lens);
    return e;
}
