/* volume_file.h - volumes on disk: NAME.npy, float32 [nz][ny][nx][channels], and NAME.json beside it.
 *
 * The .json says what the numbers mean: "origin" (corner of the box, m), "spacing" (m), "min", "max",
 * "shape", "basis", "units", "frame", "time_ns" with "clock", and the "solver" report.  The
 * coefficient (i,j,k) belongs to origin + (i+1/2, j+1/2, k+1/2) * spacing.  The .npy is written
 * last, so a volume that is there has its description.  Both are written atomically. */
#ifndef DMN_VOLUME_FILE_H
#define DMN_VOLUME_FILE_H
#include <cjson/cJSON.h>
#include "base/err.h"
#include "recon/frame/frame.h"

struct dmn_volume_meta {
    struct rec_grid grid;
    int nch;
    int64_t frame;
    int64_t time_ns;                       /* 0 = not known */
    const char *clock;                     /* "CLOCK_REALTIME", "frame-number", ... */
    const struct rec_frame_report *report; /* or NULL */
    bool bars; /* it has error bars, with these doubts (enum pvp_doubt) */
    uint32_t doubt;
};

/* dense [nz][ny][nx][nch]; sd, the same of its error bars, as sd/NAME.npy, if meta->bars.
 * `path` ends in .npy.  Errors name the file: PVX_ENOSPC, PVX_EPERM, ... */
PVX_MUST_CHECK pvx_err dmn_volume_save(const char *path, const struct dmn_volume_meta *meta,
                                       const float *dense, const float *sd, struct pvx_diag *d);

/* *grid in: the box to use when there is no .json; out: box, shape and basis of the volume.
 * A 3-dimensional array is one channel.  Owner of *dense: caller, free().
 * Errors: PVX_EFORMAT (not a volume, or .npy and .json disagree), PVX_ENOENT, ... */
PVX_MUST_CHECK pvx_err dmn_volume_load(const char *path, struct rec_grid *grid, int *nch,
                                       float **dense, struct pvx_diag *d);

/* Add "selfcal": what is known of the cameras, in the rig's order; null: nothing of this one. */
void dmn_selfcal_to_json(cJSON *object, const struct rec_selfcal_report *r);
/* Add the report's keys (solver, status, iterations, ..., ms) to a JSON object. */
void dmn_report_to_json(cJSON *object, const struct rec_frame_report *r);

#endif
