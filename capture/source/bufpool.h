/* bufpool.h - the fixed frame buffers of one source.
 *
 * `n` frames with their pixel memory are allocated once.  A driver thread takes one, fills it and pushes it.  Its
 * last user calls cap_frame_release.  The source and each frame in use hold a reference of the pool, so a source
 * may be closed while its frames are still in use.
 * A new frame has img.data = its memory, camera as given to cap_bufpool_new, exposure_us and gain NAN, release and
 * owner of the pool, and zero in all other fields.
 * Threads: all functions from any thread.  take, put-back: O(1), no allocation. */
#ifndef CAP_BUFPOOL_H
#define CAP_BUFPOOL_H
#include "capture/source/source.h"

typedef struct cap_bufpool cap_bufpool;

/* n (1..CAP_BUFFERS_MAX) frames of `bytes` each, 64-byte aligned.  The memory is touched here, not later.
 * Errors: PVX_EINVAL, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err cap_bufpool_new(unsigned n, size_t bytes, uint32_t camera,
                                       cap_bufpool **out);
/* The pool of a source, with memory as cap_source_memory says if c->held > 0. */
PVX_MUST_CHECK pvx_err cap_bufpool_of(const struct cap_source_config *c, unsigned n, size_t bytes,
                                      cap_bufpool **out);
/* A free frame.  NULL: none is free (the caller counts an underrun). */
struct cap_frame *cap_bufpool_get(cap_bufpool *p);
/* The same, but waits until one is free.  NULL only after cap_bufpool_cancel. */
struct cap_frame *cap_bufpool_get_wait(cap_bufpool *p);
/* get_wait returns NULL, to waiters and new callers, until cap_bufpool_resume. */
void cap_bufpool_cancel(cap_bufpool *p);
void cap_bufpool_resume(cap_bufpool *p);

/* A frame's pixel memory, writable (img.data is the const view of it). */
void *cap_bufpool_memory(const struct cap_frame *f);
size_t cap_bufpool_bytes(const cap_bufpool *p); /* per frame */

/* Drop the source's reference.  The memory is freed when the last frame in use is released. */
void cap_bufpool_unref(cap_bufpool **p);
#endif
