/* curves.h - curves over wavelength: what a camera's channels see, what a filter passes, what a source emits.
 *
 * A file is text: a line for each wavelength, numbers apart by comma, semicolon, tab or space.  Lines that begin with #
 * and one line of names at the top are passed over.
 *     response      wavelength [nm], red, green, blue      >= 0, any unit, the same for all three
 *     one curve     wavelength [nm], value                 a filter's transmission, an emissivity: 0..1
 * Wavelengths ascend, in 200..2000 nm, at most REC_CURVE_MAX of them, at most 50 nm apart.  Values between two lines lie
 * on a straight line.  Outside the file a response is 0, and other curves are not known.
 * Threads: pure.  Cost: O(bytes). */
#ifndef REC_CURVES_H
#define REC_CURVES_H
#include <stdbool.h>
#include <stddef.h>

#include "base/err.h"
#include "recon/geom/spectral.h"

#define REC_CURVE_MAX 2048

struct rec_curve {
    int n;
    double nm[REC_CURVE_MAX], v[3][REC_CURVE_MAX]; /* one curve: v[0] */
};

/* Reads `columns` (1 or 3) values a line; `name` is the file's name in messages.  PVX_EFORMAT, PVX_EINVAL: "FILE:LINE:
 * reason". */
PVX_MUST_CHECK pvx_err rec_curve_parse(const char *text, size_t len, const char *name, int columns,
                                       struct rec_curve *out, struct pvx_diag *d);
/* Value of column k at a wavelength; `outside` beyond the file. */
double rec_curve_at(const struct rec_curve *c, int k, double nm, double outside);
bool rec_curve_covers(const struct rec_curve *c, double from_nm, double to_nm);

/* The response times the filter (or NULL) on the even steps that rig.yaml has: 5 nm, or more where that is more than
 * REC_SPECTRAL_MAX of them.  The largest value becomes 1.  quantum: the response counts photons (quantum
 * efficiency), so it is multiplied by the wavelength.  Only the response of s is set.
 * PVX_EINVAL: the filter does not cover the response; a channel sees nothing. */
PVX_MUST_CHECK pvx_err rec_curve_response(const struct rec_curve *response,
                                          const struct rec_curve *filter, bool quantum,
                                          struct rec_spectral *s, struct pvx_diag *d);
#endif
