/* maps.h - a camera's own response to light (response, dark, flat, gain, matrix), prepared for cap_convert.
 *
 * With s a raw sample over its full scale, p its pixel and c the channel:
 *     light = r(s),   out_c = sum over k of M_ck g_k (light - dark_p) / flat_p                     (1)
 * r: response^-1, linear between its n values at s = 0, 1/(n-1) .. 1.  A table of integers per raw sample holds it,
 * in place of the table of transfer.h.  dark: light of a pixel that is not lit.  flat: the pixel's sensitivity over
 * that of the picture's middle.  g: gain.  M: colours to those of another camera.
 * In a bin, mean(light) and mean(dark) are exact.  flat is mean(flat) over the same samples with the same weights.
 * This is exact where a bin is evenly lit.  Otherwise the relative error is at most
 *     (rms variation of flat in the bin) (rms variation of light in the bin), both relative         (2)
 * (1 % times 10 %: 0.1 %).  nch = 1 from a colour image: the maps' mean over the channels, and (2) covers these too.
 * A bin's dark and g/flat take 4 bytes a channel: g/flat in steps of 2^-13 of its greatest value, dark with 11 bits.
 * The resulting error is at most 2^-14 max(g/flat) light + 2^-11 dark g/flat.
 * A pixel is masked if its dark or flat is NaN, its flat is less than CAP_FLAT_LEAST, or its mask is 0.  Its samples
 * are left out of sum and count.  A channel of a bin without any other sample is NaN; with nch = 1 the whole bin is.
 * Saturation is judged by raw samples, as without maps.  out is then cap_maps_saturated, which is above every value
 * that (1) can give; with M in all three channels.
 * Float images are linear: r does not apply to them, and they do not saturate.
 * Bound at binning 1: 4 bytes of maps are read for each value.  cap_convert without maps takes 2 to 8 times as long
 * as copying its bytes, so operations set the time.  Maps add 4 a value, done while it is in a register.
 * Cost over cap_convert without maps (tests/bench/bench_pixels.c).  dark, flat and gain: integers 1.14 to 1.32 at
 * binning 1 (bilinear 1.28 to 1.38), 1.03 to 1.18 above; floats 1.5 and 2 at binning 1.  A matrix: 1.75 at binning 1,
 * 1.25 and less above.  r: nothing for gamma-coded samples, else a look-up per raw sample, 2.4 to 4.2 for 8 bits.
 * A bin with a masked pixel is computed by the reference, 0.1 to 1 us.  A bin with all pixels masked is a copy (a
 * quarter of a picture: 1.35 to 1.6 in all at binning 2 and more, 2.5 and 3.8 at binning 1).
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
    const uint8_t *mask;    /* [height][width] 0 = masked pixel; or NULL */
    const double *response; /* [n_response], ascending from 0 to 1; or NULL */
    int n_response;         /* 2..CAP_RESPONSE_MAX */
    const double *matrix;   /* [9] or NULL */
    float gain[3];          /* nch = 1 uses the first */
};

/* For images of img's size and format (its pixels are not read), converted with p.  Errors: PVX_EINVAL (the diag
 * says why: maps of another size or number of channels; a matrix without three channels in each bin; a response
 * that is not monotone), PVX_ENOMEM.  Cost: a pass over the maps. */
PVX_MUST_CHECK pvx_err cap_maps_new(const struct cap_photometry *c, const struct cap_image *img,
                                    const struct cap_convert_params *p, struct cap_maps **out,
                                    struct pvx_diag *d);
void cap_maps_free(struct cap_maps **m);
/* Whether the maps are for images of this size and format. */
bool cap_maps_fit(const struct cap_maps *m, const struct cap_image *img);
float cap_maps_saturated(const struct cap_maps *m);
/* Number of masked raw pixels. */
size_t cap_maps_masked(const struct cap_maps *m);
/* r of (1) at s, 0..1. */
double cap_response(const double *response, int n, double s);
#endif
