/* recorder.h - writes a subscriber's volumes to a recording: a bounded queue and a thread that writes.
 *
 * A flush may stall for seconds; the caller never waits for it.  When the queue is more than half full, the writer is
 * told to hurry (volumes.h).  When it is full, the newest volume is left out and listed as a gap.
 * A new session begins a recording of its own: PATH/session-ID for folders, PATH-session-ID.EXT for files.  A
 * recording that is roll_ns old goes on in PATH-0002 or PATH-0002.EXT.
 * Threads: all calls from one. */
#ifndef VOL_RECORDER_H
#define VOL_RECORDER_H
#include "daemon/volumes/volumes.h"

#define VOL_QUEUE_BYTES ((size_t)512 << 20)

struct vol_recorder_config {
    enum vol_format format;
    const char *path;
    struct vol_options options;
    size_t queue_bytes; /* of volumes that wait; 0: VOL_QUEUE_BYTES */
    int64_t roll_ns;    /* of a recording; 0 = however long */
};
struct vol_recorder_stats {
    uint64_t written, bytes;
    uint64_t left_out; /* the queue was full */
    uint64_t clamped;  /* vol_beyond */
    size_t queued;     /* bytes */
    unsigned rolled;   /* recordings that continue an older one */
    pvx_err error;     /* why nothing more is written, PVX_OK = it goes on */
    struct pvx_diag why;
};

typedef struct vol_recorder vol_recorder;
/* Begins no recording yet, but checks its place: PVX_EBUSY, as vol_writer_open. */
PVX_MUST_CHECK pvx_err vol_recorder_new(const struct vol_recorder_config *c, vol_recorder **out,
                                        struct pvx_diag *d);
/* The volumes that follow are of this session.  The texts of head are copied; where gets the recording's path. */
PVX_MUST_CHECK pvx_err vol_recorder_session(vol_recorder *r, const struct vol_head *head,
                                            char *where, size_t size, struct pvx_diag *d);
/* Queues the message's volume.  bars: its error bars with their doubt, or NULL.  PVX_OK also if it had to be left out
 * (stats).  Errors: as pvp_volume_bricks. */
PVX_MUST_CHECK pvx_err vol_recorder_put(vol_recorder *r, pvp_decoder *dec,
                                        const struct pvp_view *view, const struct pvp_view *bars,
                                        uint32_t doubt, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err vol_recorder_gap(vol_recorder *r, const struct vol_gap *g);
void vol_recorder_stats(vol_recorder *r, struct vol_recorder_stats *out);
/* Waits until all is written, and closes.  Returns the first error.  last: the final statistics, may be NULL. */
pvx_err vol_recorder_finish(vol_recorder **r, struct vol_recorder_stats *last, struct pvx_diag *d);
#endif
