/* free_frames.h - how many frames of a pool are free: they are got, counted and given back. */
#ifndef FREE_FRAMES_H
#define FREE_FRAMES_H
#include "capture/source/bufpool.h"

static inline unsigned free_frames(cap_bufpool *p)
{
    struct cap_frame *f[1024]; /* a pool has no more */
    unsigned n = 0;
    while ((f[n] = cap_bufpool_get(p)) != NULL)
        n++;
    for (unsigned i = n; i-- > 0;)
        cap_frame_release(f[i]);
    return n;
}
#endif
