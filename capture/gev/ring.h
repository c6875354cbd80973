/* ring.h - keeps packets of other cameras out of a new stream (private to the aravis: files).
 *
 * Aravis 0.8.26 narrows its packet socket to one camera only after the socket's ring is in use.  Packets that other
 * cameras of this host sent in between lie in the ring too.  They would become complete frames of this camera, with
 * the picture of another.  (Measured: some 30 such packets in every second opening, with three cameras of 200 Hz.) */
#ifndef CAP_ARAVIS_RING_H
#define CAP_ARAVIS_RING_H
#include <arv.h>
#include <stdbool.h>

/* Waits until the stream's thread has processed all such packets.  Called after arv_camera_create_stream, which
 * returns when the socket is narrowed, and before the first buffer is pushed: without a buffer no packet begins a
 * frame.  The packets only change Aravis' last frame number, so up to 99 frames of this camera with lower numbers are
 * late for it.  Takes 50 ms; no time with plain UDP.  False: the thread did not get to run. */
bool aravis_ring_settle(ArvStream *stream);
#endif
