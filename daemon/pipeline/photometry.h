/* photometry.h - what a rig.yaml says of its cameras' response to light, read from its files for images.h.
 *
 * Ownership: caller; nothing of the rig is kept.  Threads: const after load, any. */
#ifndef DMN_PHOTOMETRY_H
#define DMN_PHOTOMETRY_H
#include "capture/pixel/maps.h"
#include "recon/geom/rig.h"

typedef struct dmn_photometry dmn_photometry;

/* Steps of it, in the order in which they are applied. */
enum dmn_light {
    DMN_LIGHT_RESPONSE = 1,
    DMN_LIGHT_DARK = 2,
    DMN_LIGHT_FLAT = 4,
    DMN_LIGHT_GAIN = 8,
    DMN_LIGHT_MATRIX = 16,
    DMN_LIGHT_MASK = 32,
    DMN_LIGHT_ALL = 63
};

/* Maps of the rig that was read from rig_path, of the steps in `what`; *out = NULL: no camera has any.
 * A camera that has some is given its gain with them: in the rig it becomes 1, so that nobody gives it
 * again, and its noise what it is behind the gain.  Errors name rig, camera and file: PVX_ENOENT,
 * PVX_ECORRUPT (not the file that the rig was made with), PVX_EINVAL (another size), those of .npy files. */
PVX_MUST_CHECK pvx_err dmn_photometry_load(const char *rig_path, unsigned what, struct rec_rig *rig,
                                           dmn_photometry **out, struct pvx_diag *d);
void dmn_photometry_free(dmn_photometry **p);
/* Camera c's, NULL = none; p may be NULL. */
const struct cap_photometry *dmn_photometry_of(const dmn_photometry *p, size_t c);

/* How pictures were taken, as far as it is known; NAN, NULL: not. */
struct dmn_photometry_taken {
    double exposure_s, gain_db, temperature_c;
    const char *serial, *device; /* its source, its serial number; "" too */
};
/* Darks that are warmer or colder than this are of other pictures: dark current doubles in some 7 degrees. */
#define DMN_DARK_DEGREES 5
/* Whether they are from the camera that was measured (by its serial number where both know it, else by its
 * source), and its darks of their exposure, gain and temperature (within 2 %, 0.1 dB and DMN_DARK_DEGREES); `where`
 * begins the sentence of the error, PVX_EINVAL. */
PVX_MUST_CHECK pvx_err dmn_photometry_check(const struct rec_camera *k,
                                            const struct dmn_photometry_taken *as,
                                            const char *where, struct pvx_diag *d);

/* Whether darks of k are for a sensor of this temperature: false only where both are known. */
bool dmn_photometry_too_far(const struct rec_camera *k, double temperature_c);

/* Names of maps that are relative to rig.yaml `from`, made right for one at `to`, whose folder is there; to NULL:
 * absolute.  PVX_ENOENT, PVX_ERANGE: a name would be too long. */
PVX_MUST_CHECK pvx_err dmn_photometry_move(struct rec_rig *rig, const char *from, const char *to,
                                           struct pvx_diag *d);

/* XXH3-64 of a file's bytes, as rig.yaml has it. */
PVX_MUST_CHECK pvx_err dmn_photometry_hash(const char *path, uint64_t *out, struct pvx_diag *d);
#endif
