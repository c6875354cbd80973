#include "capture/gevsim/link.h"

#include "base/clock.h"

bool gvcam_link_silent(const struct gvcam_link *l, int64_t now)
{
    return now < l->silent_until;
}

/* A leaky bucket: the switch's buffer drains at the rate of the link. */
bool gvcam_link_pass(struct gvcam_link *l, size_t bytes, int64_t now, uint64_t *cut)
{
    bool ok = !gvcam_link_silent(l, now);
    if (ok && l->bytes_per_ns > 0) {
        int64_t t = pvx_now_real(); /* a batch takes a while */
        l->level -= (double)(t - l->at) * l->bytes_per_ns;
        l->level = l->level > 0 ? l->level : 0;
        l->at = t;
        ok = l->level + (double)bytes <= (double)l->buffer;
        if (ok)
            l->level += (double)bytes;
    }
    *cut += !ok;
    return ok;
}
