/* arvbed.h - bed of the tests of the aravis: source against GigE cameras of our own. */
#ifndef ARVBED_H
#define ARVBED_H
#include "tests/lib/gvbed.h"
#include "tests/lib/rig.h"
#include "tests/lib/session.h"

static inline struct cap_source_config bed_source(int c)
{
    static const char *const name[BED_CAMERAS] = {"a", "b", "c", "d"};
    struct cap_source_config k = source_of(bed_address[c], BED_W, BED_H, CAP_GREY8, bed_ring_fps);
    k.name = name[c];
    k.camera = (uint32_t)c;
    k.buffers = 64;
    return k;
}

/* A capture of the first n. */
static inline void bed_rig(struct rig *r, uint32_t n, double fps)
{
    rig_init(r, n, fps, bed_source(0));
    for (int c = 0; c < (int)n; c++) {
        r->cam[c] = bed_source(c);
        r->cam[c].uri = r->uri[c];
        snprintf(r->uri[c], sizeof r->uri[c], "aravis:%s", bed_address[c]);
    }
}

/* All of them, started together at this rate; whole sets for half a second of waiting. */
static inline void bed_together(struct rig *r, double fps, enum cap_trigger trigger, bool ptp)
{
    bed_rig(r, BED_CAMERAS, fps);
    r->cfg.trigger = trigger;
    r->cfg.discard_first = 1;
    r->cfg.sets.max_wait_ns = 500 * MS;
    for (int c = 0; c < BED_CAMERAS; c++) {
        r->cam[c].fps = 0;
        r->cam[c].ptp = ptp;
    }
}

/* Is it, to the last byte, the image that it says it is?  Its number, -1 = no. */
static inline int bed_truth(const struct cap_frame *f, int c)
{
    if (f->img.size != BED_BYTES || f->img.width != BED_W || f->img.height != BED_H)
        return -1;
    int i = ((const unsigned char *)f->img.data)[0];
    return i < BED_RING && memcmp(f->img.data, bed_image[c][i], BED_BYTES) == 0 ? i : -1;
}

/* Next frame: its bytes are those of one of the camera's images, number and stamp go up.  False = none
 * came. */
static inline bool next_good(struct session *s)
{
    struct cap_frame *f = next_frame(&s->box);
    T_OK(f != NULL);
    if (f == NULL)
        return false;
    s->last_image = bed_truth(f, s->cam);
    T_OK(s->last_image >= 0);
    follows(s, f);
    cap_frame_release(f);
    return true;
}
#endif
