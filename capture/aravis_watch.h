/* aravis_watch.h - ticks of a camera's clock in ns (private to the aravis: files).
 *
 * aravis_watch.c also has the slow loop of a running camera (aravis_int.h): every 0.4 s whether it still
 * waits for what it was set to wait for, every 2 s its clock against the host's, its temperature, PTP and
 * the packets that were asked for again.
 *
 * The clock: the camera is told to latch it (TimestampLatch, GevTimestampControlLatch); it did so
 * between the command and its answer, which gives the bound.  The best of three counts.
 * PTP that is lost while running is logged once, and once when it is back. */
#ifndef CAP_ARAVIS_WATCH_H
#define CAP_ARAVIS_WATCH_H
#include <arv.h>
#include <stdint.h>

/* Ticks of the camera's clock per second; 0 = its stamps are ns. */
guint64 aravis_tick_hz(ArvCamera *cam);
/* As Aravis converts stamps; hz 0 = ns already. */
int64_t aravis_ticks_to_ns(uint64_t ticks, guint64 hz);
#endif
