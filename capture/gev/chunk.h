/* chunk.h - exposure time, gain, number, time and levels of lines that a camera sends with each frame (private to
 * the aravis: files).
 *
 * Aravis 0.8.26 reads the chunk data of GigE Vision 2 and USB3 Vision, but not those of payload type 5 (GigE Vision
 * 1.2).  Such frames are good, but their exposure, gain and lines stay unknown.  One message says so.
 * Threads: set up before the stream starts, then the stream's thread alone.  It has a parser of its own, so it does
 * not touch the camera's features. */
#ifndef CAP_ARAVIS_CHUNK_H
#define CAP_ARAVIS_CHUNK_H
#include <arv.h>
#include <stdatomic.h>
#include "capture/source/source.h"

struct aravis_chunks {
    ArvChunkParser *parser; /* NULL = off */
    bool exposure, gain, id, time, lines;
    guint64 tick_hz;    /* of ChunkTimestamp; 0 = ns */
    atomic_bool unread; /* frames came with chunk data that Aravis does not read */
};
/* Switch on the chunks that c asks for and the camera has.  PVX_EINVAL: it has no chunks, or neither exposure nor gain,
 * or no levels of lines.
 * Owner: caller, aravis_chunks_fini. */
PVX_MUST_CHECK pvx_err aravis_chunks_init(struct aravis_chunks *k,
                                          const struct cap_source_config *c, ArvCamera *cam,
                                          struct pvx_diag *d);
void aravis_chunks_fini(struct aravis_chunks *k);
/* Fill f's exposure_us and gain (NAN = none), its lines, its time of exposure if it agrees with the frame's stamp, and *id if
 * the camera numbers in 64 bits.  False: requested chunk data are missing or make no sense, so the rest of the frame
 * may be wrong too. */
bool aravis_chunks_read(struct aravis_chunks *k, ArvBuffer *b, struct cap_frame *f, uint64_t *id);
#endif
