/* blind.h - the cameras of a rig that do not see its volume, and what was probably meant.
 *
 * Files of other programs have the pose the other way round (camera to world), the camera's place as t, OpenGL's axes,
 * millimetres, or a K for another size of picture.  Each of these readings, and those of pose, axes and unit together,
 * is tried on the cameras.  The one by which they see most of the volume is named, if they see a fifth of it or more.
 * A volume that is smaller than 3 % of the picture counts as not seen, and so does one around the camera.  But ALL is
 * said only if it is smaller than 1 % in all pictures, and around no camera that sees some of it.
 * Threads: pure. */
#ifndef REC_BLIND_H
#define REC_BLIND_H
#include "recon/geom/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

enum rec_blind {
    REC_BLIND_NONE, /* every camera sees the volume */
    REC_BLIND_SOME, /* some do not, or another reading shows all of them far more of it */
    REC_BLIND_ALL   /* no camera sees it */
};

/* text [size]: sentences that name the cameras and the reading; "" for NONE. */
enum rec_blind rec_rig_blind(const struct rec_rig *r, char *text, size_t size);

/* Reading i of those that are tried, but for three changes at once: the cameras as [n_cameras], and "if ..." in text
 * [size].  false: none has this number. */
#define REC_READINGS 160
bool rec_blind_reading(const struct rec_rig *r, size_t i, struct rec_camera *as, char *text,
                       size_t size);

#ifdef __cplusplus
}
#endif
#endif
