/* backends.h - the source of each backend; capture/rig/backends.c has the table. */
#ifndef CAP_BACKENDS_H
#define CAP_BACKENDS_H
#include "capture/source/source.h"

extern const struct cap_source_ops cap_source_aravis;    /* gev/gev.c */
extern const struct cap_source_ops cap_source_libcamera; /* libcamera/libcamera.c */
extern const struct cap_source_ops cap_source_sim;       /* sim.c */
extern const struct cap_source_ops cap_source_files;     /* files/files.c */
extern const struct cap_source_ops cap_source_v4l2;      /* v4l2/v4l2.c */
extern const struct cap_source_ops cap_source_take;      /* take/source.c */

#endif
