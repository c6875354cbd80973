/* device.h - `pyrovox reconstruct --compute`: on which device the sets are solved.
 * Threads: one.  Owner: caller, dmn_compute_close. */
#ifndef RECONSTRUCT_DEVICE_H
#define RECONSTRUCT_DEVICE_H
#include <cjson/cJSON.h>
#include "daemon/cli/reconstruct/options.h"
#include "daemon/pipeline/compute.h"

/* Finds the device, before anything that takes long. */
PVX_MUST_CHECK pvx_err reconstruct_device_open(const struct reconstruct_options *o,
                                               struct dmn_compute *c, struct pvx_diag *d);
/* Sets p->card.  Measures with sets of `in`, if that decides, and says what was chosen. */
PVX_MUST_CHECK pvx_err reconstruct_device_choose(struct dmn_compute *c,
                                                 const struct dmn_compute_job *job,
                                                 struct frames_in *in, bool quiet,
                                                 struct rec_frame_params *p, struct pvx_diag *d);
/* After the last set: to the report, and on stderr if sets fell back. */
void reconstruct_device_tell(dmn_pipeline *p, cJSON *report);
#endif
