#include "daemon/cli/room_film.h"

#include <stdlib.h>

#include "base/mem.h"
#include "capture/files/imgio.h"
#include "daemon/cli/strip.h"

static const double pi = 3.14159265358979323846;

const struct dmn_room_film dmn_room_film_defaults = {.views = 72,
                                                     .width = 480,
                                                     .height = 360,
                                                     .elevation_deg = 20,
                                                     .sub = 2,
                                                     .exposure = 0,
                                                     .gamma = 2.2,
                                                     .fps = 15};

/* Once round; image [n] is a work area. */
static pvx_err draw_views(const rec_room *room, const struct dmn_room_film *p, float *image,
                          size_t n, double factor, cap_apng *film, struct pvx_diag *d)
{
    for (int v = 0; v < p->views; v++) {
        struct rec_camera c;
        rec_room_camera(room, 2 * pi * v / p->views, p->elevation_deg * pi / 180, p->width,
                        p->height, &c);
        PVX_TRY(rec_room_render(room, &c, p->sub, image));
        for (size_t i = 0; i < n; i++)
            image[i] *= (float)factor;
        PVX_TRY(cap_apng_add(film, image, p->gamma, d));
        if (p->progress != NULL && !p->progress(p->ctx, (double)(v + 1) / p->views))
            return PVX_ECANCELED;
    }
    return PVX_OK;
}

pvx_err dmn_room_film_save(const struct rec_grid *g, const float *dense, int nch,
                           const struct dmn_room_film *p, pvx_pool *pool, const char *path,
                           struct pvx_diag *d)
{
    rec_room *room = NULL;
    cap_apng *film = NULL;
    float *image = NULL;
    double factor = p->exposure;
    if (p->views < 1 || p->views > 100000)
        return pvx_fail(d, PVX_EINVAL, "%s: a film has 1 to 100000 views", path);
    pvx_err e = cap_apng_begin(path, p->width, p->height, nch, p->fps, &film, d);
    if (e != PVX_OK)
        return e;
    size_t n = (size_t)p->width * (size_t)p->height * (size_t)nch;
    image = pvx_calloc(n, sizeof *image);
    e = image != NULL ? dmn_room_of(g, dense, nch, pool, &room) : PVX_ENOMEM;
    if (e == PVX_OK && !(factor > 0))
        e = dmn_room_exposure(g, dense, nch, pool, &factor);
    if (e == PVX_OK)
        e = draw_views(room, p, image, n, factor > 0 ? factor : 1, film, d);
    if (e == PVX_OK || e == PVX_ECANCELED) {
        pvx_err written = cap_apng_end(&film, d);
        e = written != PVX_OK ? written : e;
    } else {
        pvx_fail(d, e, "%s: %s", path, pvx_strerror(e));
    }
    cap_apng_drop(&film);
    rec_room_free(&room);
    free(image);
    return e;
}
