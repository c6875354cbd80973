#include "daemon/cli/pictures/movie.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"
#include "capture/files/imgio.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/pictures/film.h"
#include "daemon/cli/pictures/strip.h"
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
    struct rec_grid box; /* the box that a turntable frames */
    struct look look;
    size_t pictures, period; /* all; after `period` the viewpoints repeat, 1: there is one */
    rec_view **view;         /* [period] viewpoints that repeat; NULL: none does, or no memory */
    struct rec_camera at;    /* where the picture is taken from */
    float *image;            /* [height][width][3] */
    struct film *film;       /* NULL: files in a folder */
    struct rec_grid grid;    /* of the volume that is loaded */
    float *dense;
    int nch;
    size_t loaded; /* its place in vol, or SIZE_MAX */
    size_t drawn, anew;
    int64_t anew_ns;
};

static pvx_err movie_load(struct movie *m, size_t i, struct pvx_diag *d)
{
    if (m->loaded == i)
        return PVX_OK;
    PVX_FREE(m->dense);
    m->loaded = SIZE_MAX;
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

static void movie_widen(struct rec_grid *box, const struct rec_grid *by)
{
    for (int a = 0; a < 3; a++) {
        box->min[a] = fmin(box->min[a], by->min[a]);
        box->max[a] = fmax(box->max[a], by->max[a]);
    }
}

/* The automatic exposure of the loaded volume.  0 = dark. */
static pvx_err exposure_of(struct movie *m, double *out)
{
    if (turntable(m))
        return dmn_flame_exposure(&m->grid, m->dense, m->nch, m->pool, out);
    struct rec_camera c = m->at;
    double k = fmin(1, (double)SMALL / c.width);
    c.width = (int32_t)fmax(1, c.width * k);
    c.height = (int32_t)fmax(1, c.height * k);
    c.fx *= k;
    c.fy *= k;
    c.blur.sigma *= k;
    c.cx = (c.cx + 0.5) * k - 0.5;
    c.cy = (c.cy + 0.5) * k - 0.5;
    size_t n = (size_t)c.width * (size_t)c.height * (size_t)m->nch;
    float *pix = pvx_calloc(n, sizeof *pix);
    PVX_NEED(pix);
    pvx_err e = rec_render(&m->grid, m->dense, m->nch,
                           &(struct rec_eye){.camera = &c, .bodies = &m->rig->bodies, .sub = 1},
                           m->pool, pix);
    PVX_THEN(e, dmn_auto_exposure(pix, n, out));
    free(pix);
    return e;
}

/* Look at a few volumes spread over all, for values that must not change from picture to picture: the box that a
 * turntable frames, and the exposure of the brightest volume. */
static pvx_err look_ahead(struct movie *m, struct pvx_diag *d)
{
    bool expose = m->o->format != RENDER_NPY && m->look.exposure == 0;
    size_t k = m->n < SAMPLES ? m->n : SAMPLES;
    bool boxed = turntable(m);
    for (size_t i = 0; i < k && (expose || boxed) && !cli_stop; i++) {
        PVX_TRY(movie_load(m, k > 1 ? i * (m->n - 1) / (k - 1) : 0, d));
        struct rec_grid box = dmn_lit_box(&m->grid, m->dense, m->nch);
        if (i == 0)
            m->box = box;
        movie_widen(&m->box, &box);
        double f = 0;
        if (expose)
            PVX_TRY(exposure_of(m, &f));
        if (f > 0 && (m->look.exposure == 0 || f < m->look.exposure))
            m->look.exposure = f;
    }
    if (expose)
        m->look.exposure *= look_headroom(&m->look);
    if (!(m->look.exposure > 0))
        m->look.exposure = 1;
    return PVX_OK;
}

/* The camera of picture i. */
static void movie_place(struct movie *m, size_t i)
{
    const struct render_options *o = m->o;
    double turn = (double)(i % m->period) / (double)m->period;
    if (turntable(m))
        rec_orbit_camera(&m->box, (o->deg0 + 360 * turn) * pi / 180, DMN_ELEVATION_DEG * pi / 180,
                         o->width, o->height, &m->at);
}

/* Set the number of pictures, and the number after which viewpoints repeat. */
static void movie_count(struct movie *m)
{
    size_t views = (size_t)m->o->views, turns = (size_t)m->o->rounds;
    m->pictures = m->n;
    m->period = 1;
    if (m->o->from != RENDER_ORBIT)
        return;
    m->period = views;
    m->pictures = views * (turns > 0 ? turns : (m->n + views - 1) / views);
}

static pvx_err movie_set_up(struct movie *m, struct pvx_diag *d)
{
    const struct render_options *o = m->o;
    m->look = o->look;
    movie_count(m);
    PVX_TRY(movie_load(m, 0, d));
    if (m->camera != NULL)
        m->at = *m->camera;
    else if (o->from == RENDER_EYE)
        PVX_TRY(render_eye(o, &m->grid, &m->at, d));
    PVX_TRY(look_ahead(m, d));
    movie_place(m, 0);
    if (o->film)
        PVX_TRY(film_new(o->out, o->fps, &m->look, &m->film, d));
    m->image = pvx_calloc((size_t)m->at.width * (size_t)m->at.height * 3, sizeof *m->image);
    if (m->image == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a picture", o->out);
    if (o->anew || m->pictures <= m->period)
        return PVX_OK;
    m->view = pvx_calloc(m->period, sizeof(rec_view *));
    return m->view != NULL ? PVX_OK : pvx_fail(d, PVX_ENOMEM, "%s: no memory for views", o->out);
}

static void free_views(struct movie *m)
{
    for (size_t i = 0; m->view != NULL && i < m->period; i++)
        rec_view_free(&m->view[i]);
    PVX_FREE(m->view);
}

/* Compute picture i of the loaded volume with stored rays.  PVX_ERANGE: the rays of all views need too much
 * memory. */
static pvx_err movie_multiply(struct movie *m, size_t i)
{
    rec_view **v = &m->view[i % m->period];
    size_t half = (size_t)sysconf(_SC_PHYS_PAGES) / 2 * (size_t)sysconf(_SC_PAGESIZE);
    if (*v == NULL)
        PVX_TRY(rec_view_new(
            &(struct rec_eye){.camera = &m->at, .bodies = &m->rig->bodies, .sub = m->o->sub},
            half / m->period, m->pool, v));
    return rec_view_render(*v, &m->grid, m->dense, m->nch, m->image);
}

/* Draw picture i of the loaded volume into m->image. */
static pvx_err draw_picture(struct movie *m, size_t i)
{
    if (m->view != NULL) {
        pvx_err e = movie_multiply(m, i);
        if (e != PVX_ERANGE)
            return e;
        fprintf(stderr,
                "pyrovox: the rays of %zu view%s need more than half of the memory: each picture "
                "is traced anew\n",
                m->period, m->period == 1 ? "" : "s");
        free_views(m);
    }
    int64_t t0 = pvx_now_mono();
    pvx_err e =
        rec_render(&m->grid, m->dense, m->nch,
                   &(struct rec_eye){.camera = &m->at, .bodies = &m->rig->bodies, .sub = m->o->sub},
                   m->pool, m->image);
    m->anew_ns += pvx_now_mono() - t0;
    m->anew++;
    return e;
}

/* "out/000012" of volume "dir/000012.npy", or of the i-th view. */
static void movie_name_of(const struct movie *m, size_t i, char *out, size_t size)
{
    if (m->o->from == RENDER_ORBIT) {
        snprintf(out, size, "%s/%06zu", m->o->out, i);
        return;
    }
    const char *slash = strrchr(m->vol[i], '/'), *name = slash != NULL ? slash + 1 : m->vol[i];
    snprintf(out, size, "%s/%.*s", m->o->out, (int)(strlen(name) - 4), name);
}

static pvx_err movie_save(struct movie *m, size_t i, struct pvx_diag *d)
{
    char stem[4096], path[4110];
    if (m->film != NULL)
        return film_add(m->film, m->image, m->at.width, m->at.height, m->nch, d);
    movie_name_of(m, i, stem, sizeof stem);
    if (m->o->format != RENDER_PNG) {
        snprintf(path, sizeof path, "%s.npy", stem);
        PVX_TRY(cap_image_save(path, m->image, m->at.width, m->at.height, m->nch, d));
    }
    if (m->o->format != RENDER_NPY) {
        snprintf(path, sizeof path, "%s.png", stem);
        PVX_TRY(look_save(&m->look, path, m->image, m->at.width, m->at.height, m->nch, d));
    }
    return PVX_OK;
}

static pvx_err draw_all(struct movie *m, struct pvx_diag *d)
{
    struct cli_progress bar = {.label = "render", .quiet = m->o->quiet};
    for (size_t i = 0; i < m->pictures; i++) {
        if (cli_stop)
            return PVX_ECANCELED;
        PVX_TRY(movie_load(m, i % m->n, d));
        movie_place(m, i);
        pvx_err e = draw_picture(m, i);
        if (e != PVX_OK)
            return pvx_fail(d, e, "%s: %s", m->vol[i % m->n], pvx_strerror(e));
        PVX_TRY(movie_save(m, i, d));
        m->drawn++;
        cli_progress(&bar, (double)(i + 1) / (double)m->pictures);
    }
    return PVX_OK;
}

static void say_how_fast(const struct movie *m)
{
    fprintf(stderr, "%zu picture%s in %s", m->drawn, m->drawn == 1 ? "" : "s", m->o->out);
    if (m->o->format != RENDER_NPY)
        fprintf(stderr, ", exposure %.4g", m->look.exposure);
    struct rec_view_stats all = {0};
    for (size_t i = 0; m->view != NULL && i < m->period; i++)
        if (m->view[i] != NULL) {
            struct rec_view_stats st;
            rec_view_get_stats(m->view[i], &st);
            all.product_ns += st.product_ns;
            all.trace_ns += st.trace_ns;
            all.rendered += st.rendered;
            all.traced += st.traced;
            all.entries += st.entries;
        }
    if (all.rendered > 0)
        fprintf(stderr,
                "; %.2f ms per picture as a product, against %.0f ms to trace its rays (done %u "
                "time%s, %.2f M entries)",
                (double)all.product_ns * 1e-6 / all.rendered,
                (double)all.trace_ns * 1e-6 / all.traced, all.traced, all.traced == 1 ? "" : "s",
                (double)all.entries * 1e-6);
    else if (m->anew > 0)
        fprintf(stderr, "; %.1f ms per picture, rays traced anew",
                (double)m->anew_ns * 1e-6 / (double)m->anew);
    fputc('\n', stderr);
}

pvx_err render_movie(const struct render_options *o, const struct rec_rig *rig,
                     const struct rec_camera *camera, char *const *vol, size_t n, pvx_pool *pool,
                     struct pvx_diag *d)
{
    struct movie m = {
        .o = o, .rig = rig, .camera = camera, .vol = vol, .n = n, .pool = pool, .loaded = SIZE_MAX};
    pvx_err e = o->film ? PVX_OK : pvx_mkdirs(o->out, d);
    PVX_THEN(e, movie_set_up(&m, d));
    PVX_THEN(e, draw_all(&m, d));
    if (m.film != NULL && (e == PVX_OK || e == PVX_ECANCELED)) {
        pvx_err written = film_end(&m.film, d); /* keeps the pictures before a Ctrl-C */
        e = written != PVX_OK ? written : e;
    }
    if (!o->quiet && (e == PVX_OK || e == PVX_ECANCELED))
        say_how_fast(&m);
    film_drop(&m.film);
    free_views(&m);
    free(m.dense);
    free(m.image);
    return e;
}
