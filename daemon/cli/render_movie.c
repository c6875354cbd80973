#include "daemon/cli/render_movie.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"
#include "capture/files/imgio.h"
#include "daemon/cli/cli.h"
#include "daemon/cli/strip.h"
#include "daemon/pipeline/volume_file.h"
#include "recon/view/render.h"
#include "recon/view/view.h"

enum { SAMPLES = 8, SMALL = 160 /* px across of a picture that only finds the exposure */ };
static const double pi = 3.14159265358979323846;

struct movie {
    const struct render_options *o;
    const struct rec_rig *rig;
    const struct rec_camera *camera; /* of the rig, or NULL */
    char *const *vol;
    size_t n;
    pvx_pool *pool;
    struct rec_grid box; /* what a turntable frames */
    double exposure;
    rec_view *view;       /* of a fixed viewpoint; NULL = trace anew */
    rec_room *room;       /* NULL: none */
    size_t lit;           /* the volume that lights it, as `loaded` */
    struct rec_camera at; /* where the pictures are taken from */
    float *image, *shown; /* [height][width][3] */
    cap_apng *apng;       /* NULL: files in a folder, or no picture yet */
    int apng_nch;
    struct rec_grid grid; /* of the volume that is loaded */
    float *dense;
    int nch;
    size_t loaded; /* its place in vol, or SIZE_MAX */
    unsigned pictures;
    int64_t anew_ns;
    struct rec_view_stats stats;
};

static pvx_err load(struct movie *m, size_t i, struct pvx_diag *d)
{
    if (m->loaded == i)
        return PVX_OK;
    PVX_FREE(m->dense);
    m->loaded = m->lit = SIZE_MAX;
    m->grid = m->rig->grid;
    PVX_TRY(dmn_volume_load(m->vol[i], &m->grid, &m->nch, &m->dense, d));
    m->loaded = i;
    return PVX_OK;
}

pvx_err render_eye(const struct render_options *o, const struct rec_grid *g, struct rec_camera *out,
                   struct pvx_diag *d)
{
    double target[3];
    for (int a = 0; a < 3; a++)
        target[a] = o->target_given ? o->target[a] : (g->min[a] + g->max[a]) / 2;
    if (rec_look_at_camera(o->eye, target, o->up, o->fov_deg * pi / 180, o->width, o->height,
                           out) != PVX_OK)
        return pvx_fail(d, PVX_EINVAL,
                        "--eye %g,%g,%g is at what it looks at (%g,%g,%g), or --up %g,%g,%g lies "
                        "along its line of sight",
                        o->eye[0], o->eye[1], o->eye[2], target[0], target[1], target[2], o->up[0],
                        o->up[1], o->up[2]);
    return PVX_OK;
}

static bool turntable(const struct movie *m)
{
    return m->o->from == RENDER_ANGLE || m->o->from == RENDER_ORBIT;
}

static void widen(struct rec_grid *box, const struct rec_grid *by)
{
    for (int a = 0; a < 3; a++) {
        box->min[a] = fmin(box->min[a], by->min[a]);
        box->max[a] = fmax(box->max[a], by->max[a]);
    }
}

/* The factor that the loaded volume asks for, 0 = dark. */
static pvx_err exposure_of(struct movie *m, double *out)
{
    if (m->o->room)
        return dmn_room_exposure(&m->grid, m->dense, m->nch, m->pool, out);
    if (turntable(m))
        return dmn_flame_exposure(&m->grid, m->dense, m->nch, m->o->elevation_deg, m->pool, out);
    struct rec_camera c = m->at;
    double k = fmin(1, (double)SMALL / c.width);
    c.width = (int32_t)fmax(1, c.width * k);
    c.height = (int32_t)fmax(1, c.height * k);
    c.fx *= k;
    c.fy *= k;
    c.cx = (c.cx + 0.5) * k - 0.5;
    c.cy = (c.cy + 0.5) * k - 0.5;
    size_t n = (size_t)c.width * (size_t)c.height * (size_t)m->nch;
    float *pix = pvx_calloc(n, sizeof *pix);
    if (pix == NULL)
        return PVX_ENOMEM;
    pvx_err e = rec_render(&m->grid, m->dense, m->nch, &c, 1, m->pool, pix);
    if (e == PVX_OK)
        e = dmn_auto_exposure(pix, n, out);
    free(pix);
    return e;
}

/* What must not change from picture to picture, from a few volumes spread over all: the box that a
 * turntable frames or a room is made for, the exposure of the brightest. */
static pvx_err look_ahead(struct movie *m, struct pvx_diag *d)
{
    bool expose = m->o->png && m->o->exposure == 0;
    size_t k = m->n < SAMPLES ? m->n : SAMPLES;
    m->exposure = m->o->exposure;
    bool boxed = turntable(m) || m->o->room;
    for (size_t i = 0; i < k && (expose || boxed) && !cli_stop; i++) {
        PVX_TRY(load(m, k > 1 ? i * (m->n - 1) / (k - 1) : 0, d));
        struct rec_grid box = dmn_lit_box(&m->grid, m->dense, m->nch);
        if (i == 0)
            m->box = box;
        widen(&m->box, &box);
        double f = 0;
        if (expose)
            PVX_TRY(exposure_of(m, &f));
        if (f > 0 && (m->exposure == 0 || f < m->exposure))
            m->exposure = f;
    }
    if (!(m->exposure > 0))
        m->exposure = 1;
    return PVX_OK;
}

/* The turntable's camera, `deg` degrees from where it begins. */
static void place(struct movie *m, double deg)
{
    const struct render_options *o = m->o;
    double angle = (o->deg0 + deg) * pi / 180, elevation = o->elevation_deg * pi / 180;
    if (m->room != NULL)
        rec_room_camera(m->room, angle, elevation, o->width, o->height, &m->at);
    else
        rec_orbit_camera(&m->box, angle, elevation, o->width, o->height, &m->at);
}

static pvx_err set_up(struct movie *m, struct pvx_diag *d)
{
    const struct render_options *o = m->o;
    PVX_TRY(load(m, 0, d));
    if (m->camera != NULL)
        m->at = *m->camera;
    else if (o->from == RENDER_EYE)
        PVX_TRY(render_eye(o, &m->grid, &m->at, d));
    PVX_TRY(look_ahead(m, d));
    if (o->room)
        PVX_TRY(rec_room_new(m->box.min, m->box.max, m->pool, &m->room));
    if (turntable(m))
        place(m, 0);
    size_t n = (size_t)m->at.width * (size_t)m->at.height * 3;
    m->image = pvx_calloc(n, sizeof *m->image);
    m->shown = pvx_calloc(n, sizeof *m->shown);
    if (m->image == NULL || m->shown == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a picture", o->out);
    if (o->from == RENDER_ORBIT || o->anew || m->n == 1 || o->room)
        return PVX_OK;
    size_t half = (size_t)sysconf(_SC_PHYS_PAGES) / 2 * (size_t)sysconf(_SC_PAGESIZE);
    return rec_view_new(&m->at, o->sub, half, m->pool, &m->view);
}

/* The room in the light of the loaded volume. */
static pvx_err draw_room(struct movie *m)
{
    if (m->lit != m->loaded)
        PVX_TRY(rec_room_light(m->room, &m->grid, m->dense, m->nch));
    m->lit = m->loaded;
    return rec_room_render(m->room, &m->at, m->o->sub, m->image);
}

/* The picture of the loaded volume into m->image. */
static pvx_err draw_picture(struct movie *m)
{
    if (m->view != NULL) {
        pvx_err e = rec_view_render(m->view, &m->grid, m->dense, m->nch, m->image);
        if (e != PVX_ERANGE)
            return e;
        fprintf(stderr, "pyrovox: the rays of this view take over half of the memory: each picture "
                        "is traced anew\n");
        rec_view_free(&m->view);
    }
    int64_t t0 = pvx_now_mono();
    pvx_err e = m->room != NULL
                    ? draw_room(m)
                    : rec_render(&m->grid, m->dense, m->nch, &m->at, m->o->sub, m->pool, m->image);
    m->anew_ns += pvx_now_mono() - t0;
    return e;
}

/* "out/000012" of volume "dir/000012.npy", or of the i-th view. */
static void name_of(const struct movie *m, size_t i, char *out, size_t size)
{
    if (m->o->from == RENDER_ORBIT) {
        snprintf(out, size, "%s/%06zu", m->o->out, i);
        return;
    }
    const char *slash = strrchr(m->vol[i], '/'), *name = slash != NULL ? slash + 1 : m->vol[i];
    snprintf(out, size, "%s/%.*s", m->o->out, (int)(strlen(name) - 4), name);
}

static void expose(struct movie *m)
{
    size_t n = (size_t)m->at.width * (size_t)m->at.height * (size_t)m->nch;
    for (size_t k = 0; k < n; k++)
        m->shown[k] = m->image[k] * (float)m->exposure;
}

/* As the next picture of the one file. */
static pvx_err append(struct movie *m, struct pvx_diag *d)
{
    if (m->apng == NULL)
        PVX_TRY(
            cap_apng_begin(m->o->out, m->at.width, m->at.height, m->nch, m->o->fps, &m->apng, d));
    if (m->pictures == 0)
        m->apng_nch = m->nch;
    if (m->apng_nch != m->nch)
        return pvx_fail(
            d, PVX_EFORMAT,
            "%s: %d channel(s), the first volume has %d; an animation in one file needs "
            "the same of all, a folder does not",
            m->vol[m->loaded], m->nch, m->apng_nch);
    expose(m);
    return cap_apng_add(m->apng, m->shown, m->o->gamma, d);
}

static pvx_err save(struct movie *m, size_t i, struct pvx_diag *d)
{
    char stem[4096], path[4110];
    if (m->o->apng)
        return append(m, d);
    name_of(m, i, stem, sizeof stem);
    if (m->o->npy) {
        snprintf(path, sizeof path, "%s.npy", stem);
        PVX_TRY(cap_image_save(path, m->image, m->at.width, m->at.height, m->nch, 1, d));
    }
    if (m->o->png) {
        expose(m);
        snprintf(path, sizeof path, "%s.png", stem);
        PVX_TRY(cap_image_save(path, m->shown, m->at.width, m->at.height, m->nch, m->o->gamma, d));
    }
    return PVX_OK;
}

static pvx_err draw_all(struct movie *m, struct pvx_diag *d)
{
    const struct render_options *o = m->o;
    size_t all = o->from == RENDER_ORBIT ? (size_t)o->views : m->n;
    struct cli_progress bar = {.label = "render"};
    for (size_t i = 0; i < all; i++) {
        if (cli_stop)
            return PVX_ECANCELED;
        PVX_TRY(load(m, i % m->n, d));
        if (o->from == RENDER_ORBIT)
            place(m, 360.0 * (double)i / (double)all);
        pvx_err e = draw_picture(m);
        if (e != PVX_OK)
            return pvx_fail(d, e, "%s: %s", m->vol[i % m->n], pvx_strerror(e));
        PVX_TRY(save(m, i, d));
        m->pictures++;
        if (!o->quiet)
            cli_progress(&bar, (double)(i + 1) / (double)all);
    }
    return PVX_OK;
}

static void say_how_fast(const struct movie *m)
{
    fprintf(stderr, "%u picture%s in %s", m->pictures, m->pictures == 1 ? "" : "s", m->o->out);
    if (m->o->png)
        fprintf(stderr, ", exposure %.4g", m->exposure);
    if (m->view != NULL) {
        struct rec_view_stats st;
        rec_view_get_stats(m->view, &st);
        double product = (double)st.product_ns * 1e-6 / (st.rendered > 0 ? st.rendered : 1);
        double trace = (double)st.trace_ns * 1e-6 / (st.traced > 0 ? st.traced : 1);
        fprintf(stderr,
                "; %.2f ms per picture as a product, against %.0f ms to trace its rays (done %u "
                "time%s, %.2f M entries)",
                product, trace, st.traced, st.traced == 1 ? "" : "s", (double)st.entries * 1e-6);
    } else if (m->pictures > 0) {
        fprintf(stderr, "; %.1f ms per picture, rays traced anew",
                (double)m->anew_ns * 1e-6 / m->pictures);
    }
    fputc('\n', stderr);
}

pvx_err render_movie(const struct render_options *o, const struct rec_rig *rig,
                     const struct rec_camera *camera, char *const *vol, size_t n, pvx_pool *pool,
                     struct pvx_diag *d)
{
    struct movie m = {.o = o,
                      .rig = rig,
                      .camera = camera,
                      .vol = vol,
                      .n = n,
                      .pool = pool,
                      .loaded = SIZE_MAX,
                      .lit = SIZE_MAX};
    pvx_err e = o->apng ? PVX_OK : pvx_mkdirs(o->out, d);
    if (e == PVX_OK)
        e = set_up(&m, d);
    if (e == PVX_OK)
        e = draw_all(&m, d);
    if (m.apng != NULL && (e == PVX_OK || e == PVX_ECANCELED)) {
        pvx_err written = cap_apng_end(&m.apng, d); /* what there is until Ctrl-C */
        e = written != PVX_OK ? written : e;
    }
    if (!o->quiet && (e == PVX_OK || e == PVX_ECANCELED))
        say_how_fast(&m);
    cap_apng_drop(&m.apng);
    rec_view_free(&m.view);
    rec_room_free(&m.room);
    free(m.dense);
    free(m.image);
    free(m.shown);
    return e;
}
