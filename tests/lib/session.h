/* session.h - one source of the aravis: backend from open to close, into a box. */
#ifndef SESSION_H
#define SESSION_H
#include "capture/source/backends.h"
#include "tests/lib/box.h"
#include "tests/t.h"

static const struct cap_source_ops *const ops = &cap_source_aravis;

struct session {
    struct box box;
    cap_source *src;
    int cam;
    uint64_t good, first_id, last_id;
    int64_t last_stamp;
    int last_image;
};

static inline bool begin(struct session *s, const struct cap_source_config *c)
{
    *s = (struct session){.box = BOX_EMPTY, .cam = (int)c->camera};
    s->box.keep = true;
    struct pvx_diag d = {""};
    struct cap_sink sink = SINK_OF(&s->box);
    pvx_err e = ops->open(c, &s->src, &d);
    if (e == PVX_OK)
        e = ops->start(s->src, &sink, &d);
    T_EQ_S(d.text, "");
    T_EQ_I(e, PVX_OK);
    return e == PVX_OK;
}

static inline void end(struct session *s)
{
    if (s->src != NULL) {
        ops->stop(s->src);
        ops->close(&s->src);
    }
    empty_box(&s->box);
    pthread_mutex_destroy(&s->box.lock);
    pthread_cond_destroy(&s->box.change);
}

/* The next frame of a session: number and stamp go up. */
static inline void follows(struct session *s, const struct cap_frame *f)
{
    if (s->good++ > 0) {
        T_OK(f->id > s->last_id);
        T_OK(f->t_device_ns > s->last_stamp);
    } else {
        s->first_id = f->id;
    }
    s->last_id = f->id;
    s->last_stamp = f->t_device_ns;
}
#endif
