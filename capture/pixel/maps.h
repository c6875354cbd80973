/* maps.h - what is known of a camera's own response to light, made ready for cap_convert.
 *
 * With s a raw sample over its full scale, p its pixel and c the channel:
 *     light = r(s),   out_c = sum over k of M_ck g_k (light - dark_p) / flat_p                     (1)
 * r: response^-1, straight between its n values at s = 0, 1/(n-1) .. 1, a table of integers per raw sample
 * as in transfer.h, which it stands in for; dark: light of a pixel that is not lit; flat: its sensitivity
 * over that of the picture's middle; g: gain; M: colours to those of another camera.
 * Of bins: mean(light) is exact as ever, so is mean(dark), and flat is mean(flat) over the same samples with
 * the same weights: exact where a bin is evenly lit; else the relative error is at most
 *     (rms variation of flat in the bin) (rms variation of light in the bin), both relative         (2)
 * (1 % by 10 %: 0.1 %).  nch = 1 from a colour image: the maps' mean over the channels, (2) over them too.
 * A bin's dark and g/flat are kept in 4 bytes a channel: g/flat in 2^-13 of its greatest, dark with 11 bits.
 * What is off by that: at most 2^-14 max(g/flat) light + 2^-11 dark g/flat.
 * A pixel whose dark or flat is NaN, flat less than CAP_FLAT_LEAST or mask 0 says nothing: its samples are left out
 * of sum and count; a channel of a bin without any other sample is NaN, and with nch = 1 the bin.
 * Saturation is judged by raw samples as without maps, but out then has cap_maps_saturated, which is above
 * everything that (1) can give; with M in all three channels.
 * Floats are linear: r is not for them, and they do not saturate.
 * Bound at binning 1: 4 bytes of maps are read for each value; cap_convert without takes 2 to 8 times what copying
 * its bytes does, so the operations count, 4 a value, done while it is in a register.
 * Cost (tests/bench/bench_pixels.c) of dark, flat and gain over cap_convert without: integers 1.14 to 1.32 at binning 1
 * (bilinear 1.28 to 1.38), 1.03 to 1.18 above; floats 1.5 and 2 at binning 1.  A matrix: 1.75 at binning 1, 1.25 and
 * less above.  r: nothing where samples are coded, else a look-up per raw sample, 2.4 to 4.2 for 8 bits.
 * Each masked pixel: its bin by the reference, 0.1 to 1 us; a copy where all of the bin is masked (a quarter of a picture:
 * 1.35 to 1.6 in all at binning 2 and more, 2.5 and 3.8 at 1).
 * Ownership: cap_maps is the caller's.  Threads: const after new, any. */
#ifndef CAP_MAPS_H
#define CAP_MAPS_H
#include "capture/pixel/pixfmt.h"

#define CAP_FLAT_LEAST   0.05
#define CAP_RESPONSE_MAX 65

struct cap_photometry {
    int32_t width, height; /* of the raw image */
    /* [height][width][1 or 3], 3 where a pixel has three samples (RGB, YUV, JPEG); NULL = none */
    const float *dark, *flat;
    int channels;           /* of these */
    const uint8_t *mask;    /* [height][width] 0 = a pixel says nothing; or NULL */
    const double *response; /* [n_response], ascending from 0 to 1; or NULL */
    int n_response;         /* 2..CAP_RESPONSE_MAX */
    const double *matrix;   /* [9] or NULL */
    float gain[3];          /* with nch = 1 the first */
};

/* For images like img (its format; pixels are not looked at) converted with p.  Errors: PVX_EINVAL (the diag
 * says why: maps of another size or number of channels; a matrix where there are no three channels in each
 * bin; a response that is not monotone), PVX_ENOMEM.  Cost: a pass over the maps. */
PVX_MUST_CHECK pvx_err cap_maps_new(const struct cap_photometry *c, const struct cap_image *img,
                                    const struct cap_convert_params *p, struct cap_maps **out,
                                    struct pvx_diag *d);
void cap_maps_free(struct cap_maps **m);
/* Whether they are for images of this format. */
bool cap_maps_fit(const struct cap_maps *m, const struct cap_image *img);
float cap_maps_saturated(const struct cap_maps *m);
/* Raw pixels that say nothing. */
size_t cap_maps_masked(const struct cap_maps *m);
/* r of (1) at s, 0..1. */
double cap_response(const double *response, int n, double s);
#endif
