/* backends.h - the sources built in, one file each. */
#ifndef CAP_BACKENDS_H
#define CAP_BACKENDS_H
#include "capture/source/source.h"

extern const struct cap_source_ops cap_source_aravis;    /* src_aravis.c */
extern const struct cap_source_ops cap_source_libcamera; /* src_libcamera.c */
extern const struct cap_source_ops cap_source_sim;       /* src_sim.c */
extern const struct cap_source_ops cap_source_files;     /* src_files.c */
extern const struct cap_source_ops cap_source_v4l2;      /* src_v4l2.c */
extern const struct cap_source_ops cap_source_take;      /* src_take.c */

#endif
