/* room_film.h - a turn around a flame in its virtual room, as one animated PNG (Figure 9 of the method's paper).
 * For views side by side use dmn_strip_save with .room (strip.h).
 *
 *     struct dmn_room_film p = dmn_room_film_defaults;
 *     p.progress = cli_progress, p.ctx = &bar;                    // optional
 *     e = dmn_room_film_save(&grid, dense, nch, &p, pool, "DIR/room.apng", d); */
#ifndef DMN_ROOM_FILM_H
#define DMN_ROOM_FILM_H
#include "daemon/cli/pictures/look.h"
#include "recon/matrix/sysmat.h"

struct dmn_room_film {
    int views;             /* 1..100000, from 0 degrees (the pillar in front) towards +y */
    int32_t width, height; /* px */
    double elevation_deg;
    int sub;                  /* rays per pixel side */
    struct look look;         /* automatic: dmn_room_exposure */
    int fps;                  /* 1..100 */
    rec_progress_fn progress; /* NULL: none; false from it stops after that view */
    void *ctx;
};
extern const struct dmn_room_film
    dmn_room_film_defaults; /* 72 views of 480x360, 20 degrees, 15 fps */

/* dense [nz][ny][nx][nch], nch 1 or 3, on g.  The light in the room is computed once.  Errors: PVX_EINVAL,
 * PVX_ENOMEM, the file's; PVX_ECANCELED: stopped, the file has the views until then.  Errors name the file. */
PVX_MUST_CHECK pvx_err dmn_room_film_save(const struct rec_grid *g, const float *dense, int nch,
                                          const struct dmn_room_film *p, pvx_pool *pool,
                                          const char *path, struct pvx_diag *d);

#endif
