/* rig_optics.h - what stands between a camera's lens and the flame in a rig file, for rig.c alone. */
#ifndef REC_RIG_OPTICS_H
#define REC_RIG_OPTICS_H
#include <stdio.h>
#include "base/yaml.h"
#include "recon/geom/rig.h"

/* Reads the list `seq` under `windows` of camera c, whose pose is known. */
PVX_MUST_CHECK pvx_err rec_windows_read(const pvx_yaml *y, int seq, const char *path,
                                        const struct rec_grid *g, struct rec_camera *c,
                                        struct pvx_diag *d);
/* Reads the mapping `map` under `blur`; windows and lens are known. */
PVX_MUST_CHECK pvx_err rec_blur_read(const pvx_yaml *y, int map, const char *path,
                                     const struct rec_grid *g, struct rec_camera *c,
                                     struct pvx_diag *d);
void rec_blur_write(FILE *f, const struct rec_camera *c);
void rec_windows_write(FILE *f, const struct rec_camera *c);

/* Reads `rays` of the camera `map`, whose size is known, in the file called `name`. */
PVX_MUST_CHECK pvx_err rec_rays_read(const pvx_yaml *y, int map, const char *path, const char *name,
                                     struct rec_camera *c, struct pvx_diag *d);
void rec_rays_write(FILE *f, const struct rec_camera *c);
/* Numbers of c's rays, for hashes; returns how many. */
size_t rec_rays_numbers(const struct rec_camera *c, double out[2]);

/* Numbers of c's windows, for hashes, into out[6 REC_WINDOWS]; returns how many. */
size_t rec_window_numbers(const struct rec_camera *c, double out[6 * REC_WINDOWS]);
#endif
