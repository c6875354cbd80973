/* spectral.h - what the three channels see of the spectrum, in rig.yaml: `spectral:`, written by `pyrovox calibrate
 * spectral`.
 *
 *   spectral:
 *     from: nm, step: nm         wavelength of the first number below, and between two
 *     red: [2..512 numbers]      response of a channel to radiance, its filter in it, 0..1, straight between two
 *     green: [..], blue: [..]    as many
 *     constant: [3]              pixel value over the response's integral of radiance, per W m^-2 sr^-1, per channel
 *     covariance: [9]            of the logarithms of the three, row by row
 *     absolute: true|false       false: the constants have one unknown factor in common (a thermocouple alone)
 *     exposure: s                (optional) of the pictures that the constants are from
 *
 * Emission of a volume is common to all cameras, so this is too: one camera's colours and light must be those of the
 * others (`calibrate gain`, `calibrate colour`).  The equations are in recon/spectral.
 * Refused with "file:line: key: reason": wavelengths outside 200..2000 nm, a negative response, a channel that sees
 * nothing, a constant that is not positive, a covariance that is not one. */
#ifndef REC_SPECTRAL_H
#define REC_SPECTRAL_H
#include <stdbool.h>

#define REC_SPECTRAL_MAX  512
#define REC_SPECTRAL_LO   200.0 /* nm */
#define REC_SPECTRAL_HI   2000.0
#define REC_SPECTRAL_MOST 0.25 /* variance of a constant's logarithm: half of it is a guess */

struct rec_spectral {
    int n;             /* of each response */
    double from, step; /* nm */
    double response[3][REC_SPECTRAL_MAX];
    double constant[3], covariance[9];
    bool absolute, has_exposure;
    double exposure; /* s */
};
static inline const char *rec_spectral_channel(int q)
{
    static const char *const name[3] = {"red", "green", "blue"};
    return name[q];
}
#endif
