/* ticks.h - ticks of a camera's clock in ns (private to the aravis: files). */
#ifndef CAP_ARAVIS_TICKS_H
#define CAP_ARAVIS_TICKS_H
#include <arv.h>
#include <stdint.h>

/* Ticks of the camera's clock per second; 0 = its stamps are ns. */
guint64 aravis_tick_hz(ArvCamera *cam);
/* As Aravis converts stamps; hz 0 = ns already. */
int64_t aravis_ticks_to_ns(uint64_t ticks, guint64 hz);
#endif
