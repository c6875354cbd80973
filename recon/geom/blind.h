/* blind.h - the cameras of a rig that do not see its volume, and what was probably meant.
 *
 * Files of other programs have the pose the other way round (camera to world), the camera's place as t, OpenGL's axes,
 * millimetres, or a K for another size of picture or in another order.  Each of these readings, and those of pose, axes
 * and unit together, is tried on the cameras.  The one by which they see most of the volume is named, if they see a
 * fifth of it or more.
 * A volume that is smaller than 3 % of the picture counts as not seen, and so does one around the camera.  But ALL is
 * said only if it is smaller than 1 % in all pictures, and around no camera that sees some of it.
 * A camera that sees less than half of the volume is named, too, if the middle of its picture is beside the volume,
 * all other cameras look at it, and another pose shows 90 % of it or more, in the middle.
 * Two cameras of one pose are named, too, and principal points that are in the middle only if width and height are
 * swapped.  Cameras that look away and OpenGL's axes cannot be told apart: the flame is then upside down.
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

/* Reading i of those that are tried: the cameras as [n_cameras], and "if ..." in text [size].  Returns how many things
 * it changes, 1 to 3; 0: it is not tried. */
#define REC_READINGS 280
int rec_blind_reading(const struct rec_rig *r, size_t i, struct rec_camera *as, char *text,
                      size_t size);

#ifdef __cplusplus
}
#endif
#endif
