/* ring.h - the images that simulated cameras serve: the analytic flame as each camera of a
 * rig sees it, rendered once for every instant i/fps of one period n/fps, then served repeatedly.
 *
 *     pixel = round(255 (v + noise sigma)), clipped to 0..255                             (1)
 * v: the output of lens and sensor for the flame's picture L (capture/gevsim/optics.h).  For a healthy camera it is L
 * and the pedestal that real cameras have.  The pedestal keeps noise from being clipped at 0: a clipped background
 * has a positive mean, which reconstructs as haze.  L comes from rec_flame_render, to 2^-14 of full scale, up to 4.
 * Mono8: mean of the three channels; BayerRG8: each pixel its own colour.  Everything is a function of rig, n, fps,
 * seed, state and noise, so these give the truth.  Image i shows rec_flame_at(f, i/fps) of simcams_flame(), or the
 * same in one colour.  With
 * `keep` the pictures L stay beside the images, at two bytes a sample.  Then an image can be made anew for other
 * optics: 640x480 RGB8 in 3 ms, more with a response, a background or blur. */
#ifndef SIMCAMS_RING_H
#define SIMCAMS_RING_H
#include <stdbool.h>
#include "base/err.h"
#include "capture/pixel/image.h"
#include "daemon/cli/simcams/board.h"
#include "daemon/cli/simcams/faults.h"
#include "recon/view/flame.h"
#include "recon/geom/rig.h"

struct simcams_ring_params {
    enum cap_pixfmt fmt; /* CAP_GREY8, CAP_RGB8, CAP_BAYER_RG8 */
    size_t n;            /* images per camera */
    double fps;
    uint32_t seed;
    double colour[3]; /* of all of the flame, the largest 1; 0 0 0: as simcams_flame() has it */
    double noise[3];  /* red, green, blue: standard deviation, share of full scale */
    int sub;          /* sub x sub rays per pixel */
    bool keep;
    const struct simcams_state *state; /* [n_cameras]; NULL: healthy, no pedestal */
    const struct simcams_board *board; /* instead of the flame, n is its pictures; NULL: none */
};

struct simcams_ring {
    size_t n_cameras, n;
    void **image;                 /* [n_cameras][n], tightly packed */
    size_t late[REC_MAX_CAMERAS]; /* frames, from the state at the start */
    /* what images are made from */
    const struct rec_rig *rig; /* borrowed */
    enum cap_pixfmt fmt;
    uint32_t seed;
    int nch; /* samples of a pixel of a scene */
    bool keep;
    uint16_t **scene;        /* L 2^14: [n_cameras][n] with keep, else [n_cameras], the latest */
    float **work;            /* [n_cameras], two pictures each */
    float *noise;            /* table, standard deviation 1 */
    float *sigma[2];         /* of even and of odd rows, a value for each sample */
    struct cap_optics *made; /* [n_cameras][n] optics with which the images were made */
};

/* The flame in the rig's volume with the ring's period. */
void simcams_flame(const struct rec_rig *rig, size_t n, double fps, uint32_t seed,
                   struct rec_flame *out);
size_t simcams_ring_bytes(const struct rec_rig *rig, const struct simcams_ring_params *p);

/* Render on all CPUs.  progress(ctx, 0..1) false = stop: PVX_ECANCELED.  Owner: caller, until simcams_ring_fini.
 * rig is borrowed until then.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err simcams_ring_init(const struct rec_rig *rig,
                                         const struct simcams_ring_params *p,
                                         bool (*progress)(void *ctx, double done), void *ctx,
                                         struct simcams_ring *out);
/* Make image k of camera c anew in its place, with these optics.  False: it was made with them already.
 * Needs `keep`.  Threads: one call per camera at a time. */
bool simcams_ring_renew(struct simcams_ring *r, size_t c, size_t k, const struct cap_optics *o);
/* Save set number `i` of every step-th image of all cameras to DIR/<camera>/<i, 6 digits>.png.  Late cameras stay
 * late.  PVX_EUNSUP: Bayer. */
PVX_MUST_CHECK pvx_err simcams_ring_save(const struct simcams_ring *r, size_t i, size_t step,
                                         const char *dir, struct pvx_diag *d);
void simcams_ring_fini(struct simcams_ring *r);
#endif
