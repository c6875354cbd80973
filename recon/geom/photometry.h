/* photometry.h - a camera's response to light in rig.yaml: `photometry:`, every key optional.
 *
 *   photometry:
 *     serial: TEXT            the measured camera, named as in a take or configuration (its source)
 *     device: TEXT            the serial number that the camera reports: counts for more than `serial`
 *     exposure: s, gain_db: x, temperature: C     of its darks
 *     response: [2..65 numbers]   light at samples 0 .. full scale in even steps, rising from 0 to 1
 *     dark: { file: F, hash: H }  light that each pixel shows in the dark, .npy; NaN = a hot or dead pixel
 *     flat: { file: F, hash: H }  sensitivity of each pixel, .npy, 1 = the picture's middle; NaN as above
 *     mask: F                 picture of the camera's size, dark where something covers the view (a burner's edge, a
 *                             cable): such pixels are ignored and do not carve
 *     matrix: [9]             colours to those of one camera
 *     noise: { read: r, gain: g }    variance of a sample of light l: r^2 + g l, full scale = 1
 * Files are relative to rig.yaml.  H is XXH3-64 of the file's bytes, 16 digits: a changed map is refused.
 * Order of application: response, dark, flat, `gain` of the camera, matrix (capture/pixel/maps.h). */
#ifndef REC_PHOTOMETRY_H
#define REC_PHOTOMETRY_H
#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define REC_MAP_FILE_MAX 160
#define REC_SERIAL_MAX   128
#define REC_RESPONSE_MAX 65

struct rec_map {
    char file[REC_MAP_FILE_MAX]; /* "" = none */
    uint64_t hash;
};

/* All 0 = nothing is known. */
struct rec_photometry {
    char serial[REC_SERIAL_MAX], device[REC_SERIAL_MAX]; /* "" = not given */
    bool has_exposure, has_gain, has_temperature;
    double exposure, gain_db, temperature; /* s, dB, degrees C */
    int n_response;                        /* 0 = none */
    double response[REC_RESPONSE_MAX];
    struct rec_map dark, flat;
    char mask[REC_MAP_FILE_MAX]; /* "" = none; no hash: it may be redrawn at any time */
    bool has_matrix, has_noise;
    double matrix[9], read_noise, noise_gain;
};

/* Whether a text can be written in double quotes without escapes. */
bool rec_photometry_plain(const char *s);
/* Whether it changes pictures. */
bool rec_photometry_acts(const struct rec_photometry *p);

#ifdef __cplusplus
}
#endif
#endif
