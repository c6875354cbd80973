/* simcams_ring.h - the images that simulated cameras serve: the analytic flame as each camera of a
 * rig sees it, rendered once for every instant i/fps of one period n/fps, then served for ever.
 *
 *     pixel = round(255 (black + L + noise sigma)), clipped to 0..255                     (1)
 * black: the pedestal that real cameras have, so that noise is not clipped at 0 (a clipped background
 * has a positive mean, which reconstructs as haze).  L from rec_flame_render; Mono8: mean of the three channels; BayerRG8: each pixel its own colour.
 * All is a function of rig, n, fps, seed, black, noise: whoever knows these knows the truth.  Image i shows
 * rec_flame_at(f, i/fps) of simcams_flame(). */
#ifndef SIMCAMS_RING_H
#define SIMCAMS_RING_H
#include <stdbool.h>
#include "base/err.h"
#include "capture/pixel/image.h"
#include "daemon/cli/simcams_board.h"
#include "recon/view/flame.h"
#include "recon/geom/rig.h"

struct simcams_ring_params {
    enum cap_pixfmt fmt; /* CAP_GREY8, CAP_RGB8, CAP_BAYER_RG8 */
    size_t n;            /* images per camera */
    double fps;
    uint32_t seed;
    double black;                      /* pedestal, share of full scale */
    double noise;                      /* standard deviation, share of full scale */
    int sub;                           /* sub x sub rays per pixel */
    const struct simcams_board *board; /* instead of the flame: n is its pictures'; NULL: none */
};

struct simcams_ring {
    size_t n_cameras, n;
    void **image; /* [n_cameras][n], tightly packed */
};

/* The flame in the rig's volume with the ring's period. */
void simcams_flame(const struct rec_rig *rig, size_t n, double fps, uint32_t seed,
                   struct rec_flame *out);
size_t simcams_ring_bytes(const struct rec_rig *rig, const struct simcams_ring_params *p);

/* Renders on all CPUs.  progress(ctx, 0..1) false = stop: PVX_ECANCELED.  Owner: caller, until
 * simcams_ring_fini.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err simcams_ring_init(const struct rec_rig *rig,
                                         const struct simcams_ring_params *p,
                                         bool (*progress)(void *ctx, double done), void *ctx,
                                         struct simcams_ring *out);
/* Images i of all cameras to DIR/<camera>/<number, 6 digits>.png.  PVX_EUNSUP: Bayer. */
PVX_MUST_CHECK pvx_err simcams_ring_save(const struct simcams_ring *r, const struct rec_rig *rig,
                                         enum cap_pixfmt fmt, size_t i, size_t number,
                                         const char *dir, struct pvx_diag *d);
void simcams_ring_fini(struct simcams_ring *r);
#endif
