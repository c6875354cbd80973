/* recording.h - raw recording in the daemon: the contents of a take beside the frames (rig, configuration,
 * cameras' settings), its file name, start and stop at run time.
 * Threads: start and stop from any, one at a time; the rest as cap_recorder. */
#ifndef DMN_RECORDING_H
#define DMN_RECORDING_H
#include "capture/take/recorder.h"
#include "capture/take/ring.h"
#include "daemon/config/config.h"
#include "daemon/pipeline/sources.h"

typedef struct dmn_recording dmn_recording;
/* Makes the recorder, and with record.ring the ring, and adds tap and buffers to `sources`.  Call it before the capture is made of them.
 * With record.queue: 0, *out = NULL.  Everything is copied, except that *capture is asked for its cameras' health
 * while it records. */
PVX_MUST_CHECK pvx_err dmn_recording_new(const struct dmn_config *c, const struct rec_rig *rig,
                                         struct dmn_sources *sources, cap_capture *const *capture,
                                         uint64_t session, dmn_recording **out, struct pvx_diag *d);
/* The file name that a key's strftime(3) pattern gives now, in local time like the names of the user's other files,
 * relative to base.  PVX_EINVAL, PVX_ERANGE: it gives no name. */
PVX_MUST_CHECK pvx_err dmn_recording_name(const char *key, const char *pattern, const char *base,
                                          char *out, size_t size, struct pvx_diag *d);
/* path NULL: record.path.  where: the file's name.  r may be NULL: PVX_EUNSUP. */
PVX_MUST_CHECK pvx_err dmn_recording_start(dmn_recording *r, const char *path, char *where,
                                           size_t size, struct pvx_diag *d);
/* Path and take head of a snapshot, both as for a recording.  name NULL: named by the time.  head borrows from r. */
PVX_MUST_CHECK pvx_err dmn_recording_snapshot(dmn_recording *r, const char *name, char *where,
                                              size_t size, struct cap_take_head *head,
                                              struct pvx_diag *d);
/* As cap_recorder_hurry. */
void dmn_recording_hurry(dmn_recording *r);
/* As cap_recorder_stop; where = the take that was ended. */
PVX_MUST_CHECK pvx_err dmn_recording_stop(dmn_recording *r, char *where, size_t size,
                                          struct pvx_diag *d);
void dmn_recording_stats(dmn_recording *r, struct cap_recorder_stats *out);
/* NULL: none. */
cap_ring *dmn_recording_ring(dmn_recording *r);
/* Call after the capture has been stopped.  Ends a take that still runs. */
void dmn_recording_free(dmn_recording **r);
#endif
