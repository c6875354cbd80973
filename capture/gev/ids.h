/* ids.h - frame numbers of a stream, widened past their wrap (private to stream.c).
 *
 * GigE Vision 1: 16 bit, 1..65535, 0 is never sent.  GigE Vision 2 and USB3 Vision: 64 bit.  Which
 * one is not announced; a camera whose numbers go past 65535 is of the second kind. */
#ifndef CAP_ARAVIS_IDS_H
#define CAP_ARAVIS_IDS_H
#include <stdbool.h>
#include <stdint.h>

struct aravis_ids {
    bool any, wide; /* wide: a number above 65535 was seen */
    uint64_t raw;   /* last as sent */
    uint64_t id;    /* last widened */
};
/* Widened number of the next good frame, above the last one by the frames that the camera numbered
 * since.  A camera that starts counting anew goes on by one: how many were lost is not known. */
static inline uint64_t aravis_ids_next(struct aravis_ids *s, uint64_t raw)
{
    s->wide |= raw > 65535;
    uint64_t step = raw - s->raw;
    if (!s->wide && raw < s->raw)
        step = raw + 65535 - s->raw;
    if (!s->any)
        s->id = raw;
    else
        s->id += step == 0 || step > 32767 ? 1 : step;
    s->any = true;
    s->raw = raw;
    return s->id;
}
#endif
