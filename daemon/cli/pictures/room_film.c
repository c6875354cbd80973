#include "daemon/cli/pictures/room_film.h"

#include <stdlib.h>

#include "base/mem.h"
#include "daemon/cli/pictures/film.h"
#include "daemon/cli/pictures/strip.h"

static const double pi = 3.14159265358979323846;

const struct dmn_room_film dmn_room_film_defaults = {.views = 72,
                                                     .width = 480,
                                                     .height = 360,
                                                     .elevation_deg = 20,
                                                     .sub = 2,
                                                     .look = {.gamma = 2.2, .depth = 8},
                                                     .fps = 15};

/* Draw all views of the turn.  image is a work area. */
static pvx_err draw_views(const rec_room *room, const struct dmn_room_film *p, int nch,
                          float *image, struct film *film, struct pvx_diag *d)
{
    for (int v = 0; v < p->views; v++) {
        struct rec_camera c;
        rec_room_camera(room, 2 * pi * v / p->views, p->elevation_deg * pi / 180, p->width,
                        p->height, &c);
        PVX_TRY(rec_room_render(room, &c, p->sub, image));
        PVX_TRY(film_add(film, image, p->width, p->height, nch, d));
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
    struct film *film = NULL;
    struct look look = p->look;
    if (p->views < 1 || p->views > 100000)
        return pvx_fail(d, PVX_EINVAL, "%s: a film has 1 to 100000 views", path);
    float *image = pvx_calloc((size_t)p->width * (size_t)p->height * (size_t)nch, sizeof *image);
    pvx_err e = image != NULL ? dmn_room_of(g, dense, nch, pool, &room) : PVX_ENOMEM;
    if (e == PVX_OK && !(look.exposure > 0))
        e = dmn_room_exposure(g, dense, nch, pool, &look.exposure);
    PVX_THEN(e, film_new(path, p->fps, &look, &film, d));
    PVX_THEN(e, draw_views(room, p, nch, image, film, d));
    if (film != NULL && (e == PVX_OK || e == PVX_ECANCELED)) {
        pvx_err written = film_end(&film, d);
        e = written != PVX_OK ? written : e;
    } else {
        pvx_fail(d, e, "%s: %s", path, pvx_strerror(e));
    }
    film_drop(&film);
    rec_room_free(&room);
    free(image);
    return e;
}
