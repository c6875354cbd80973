/* ids.h - frame numbers of a stream, widened past their wrap (private to stream.c).
 *
 * GigE Vision 1: 16 bit, 1..65535, 0 is never sent.  GigE Vision 2 and USB3 Vision: 64 bit.  A camera does not
 * announce its kind; numbers above 65535 show the second one. */
#ifndef CAP_ARAVIS_IDS_H
#define CAP_ARAVIS_IDS_H
#include <stdbool.h>
#include <stdint.h>

struct aravis_ids {
    bool any, wide; /* wide: a number above 65535 was seen */
    uint64_t raw;   /* last number as sent */
    uint64_t id;    /* last number, widened */
};
/* Widened number of the next good frame: the last one plus the frames that the camera numbered since.  If the camera
 * starts counting again, the number goes on by one, because the number of lost frames is not known. */
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
