/* photometry.h - the cameras' response to light as rig.yaml gives it, with its map files, for images.h.
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

/* Loads the maps of the rig that was read from rig_path, for the steps in `what`; *out = NULL: no camera has any.
 * The maps of a camera apply its gain too.  So the gain in the rig becomes 1, lest it is applied again, and the noise
 * in the rig becomes that behind the gain.  Errors name rig, camera and file: PVX_ENOENT, PVX_ECORRUPT (not the file
 * that the rig was made with), PVX_EINVAL (another size), those of .npy files. */
PVX_MUST_CHECK pvx_err dmn_photometry_load(const char *rig_path, unsigned what, struct rec_rig *rig,
                                           dmn_photometry **out, struct pvx_diag *d);
void dmn_photometry_free(dmn_photometry **p);
/* Photometry of camera c, NULL = none; p may be NULL. */
const struct cap_photometry *dmn_photometry_of(const dmn_photometry *p, size_t c);

/* How pictures were taken, as far as it is known; NAN, NULL: not known. */
struct dmn_photometry_taken {
    double exposure_s, gain_db, temperature_c;
    const char *serial, *device; /* the camera's source, its serial number; "": not known */
};
/* Darks that are warmer or colder by more than this do not fit: dark current doubles in some 7 degrees. */
#define DMN_DARK_DEGREES 5
/* Checks that pictures are from the camera that was measured (by serial number if both are known, else by source),
 * and that its darks fit their exposure, gain and temperature (within 2 %, 0.1 dB and DMN_DARK_DEGREES).
 * PVX_EINVAL: they do not; the message begins with `where`. */
PVX_MUST_CHECK pvx_err dmn_photometry_check(const struct rec_camera *k,
                                            const struct dmn_photometry_taken *as,
                                            const char *where, struct pvx_diag *d);

/* Whether the darks of k do not fit a sensor of this temperature; true only if both temperatures are known. */
bool dmn_photometry_too_far(const struct rec_camera *k, double temperature_c);

/* Map names that are relative to rig.yaml `from` become relative to a rig.yaml at `to`, whose folder must exist;
 * to NULL: they become absolute.  PVX_ENOENT, PVX_ERANGE: a name would be too long. */
PVX_MUST_CHECK pvx_err dmn_photometry_move(struct rec_rig *rig, const char *from, const char *to,
                                           struct pvx_diag *d);

/* XXH3-64 of a file's bytes, as rig.yaml has it. */
PVX_MUST_CHECK pvx_err dmn_photometry_hash(const char *path, uint64_t *out, struct pvx_diag *d);
#endif
