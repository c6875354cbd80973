/* assembly.c - the assembler thread: rings to sets.
 *
 * Live: frames are taken in order of arrival, deadlines are looked at when the rings are empty (a
 * frame that is in is never late because this thread was).
 * Lossless: the cameras are merged in order of exposure, which needs the next frame of each camera
 * that still may have one; so sets close by order alone and at most one set is open. */
#include <stdlib.h>

#include "base/clock.h"
#include "capture/capture_int.h"

#define STEP_NS  (2 * PVX_NS_PER_MS) /* the time of day was set, not steered */
#define START_NS (5 * PVX_NS_PER_S)  /* patience with a camera that is slow in its first start */

static void release_set(struct cap_capture *cap, struct cap_set *s)
{
    pthread_mutex_lock(&cap->lock);
    cap->sets_dropped++;
    for (uint32_t i = 0; i < cap->n; i++)
        cap->camera[i].count[CAP_OVERFLOW] += s->frame[i] != NULL;
    pthread_mutex_unlock(&cap->lock);
    cap_set_release(s);
}

static void count_skew(struct cap_skew_count *k, int64_t ns)
{
    unsigned i = 0;
    while (i < CAP_SKEW_BINS - 1 && ns >= cap_skew_edges_ns[i])
        i++;
    k->bin[i]++;
    k->sum_ns += (double)ns;
    pvx_hist_add(&k->abs, llabs(ns));
}

/* What a set says about the cameras.  Under the lock. */
static void look_at_set(struct cap_capture *cap, const struct cap_set *s)
{
    if (s->n == cap->n)
        cap->sets_complete++;
    else
        cap->sets_partial++;
    pvx_hist_add(&cap->spread, s->spread_ns);
    unsigned bin = 0;
    while (bin < CAP_SPREAD_BINS - 1 && s->spread_ns >= cap_skew_edges_ns[CAP_SKEW_BINS / 2 + bin])
        bin++;
    cap->spread_bin[bin]++;
    for (uint32_t i = 0; i < cap->n; i++)
        if (s->frame[i] != NULL)
            count_skew(&cap->camera[i].skew, s->frame[i]->t_exposure_ns - s->t_exposure_ns);
    if (cap->watches)
        cap_syncwatch_set(&cap->watch, s);
}

static void hand_over(struct cap_capture *cap)
{
    struct cap_set *s;
    while ((s = cap_assembler_pop(cap->assembler)) != NULL) {
        pthread_mutex_lock(&cap->lock);
        look_at_set(cap, s);
        pthread_mutex_unlock(&cap->lock);
        if (cap->cfg.tap.set != NULL)
            cap->cfg.tap.set(cap->cfg.tap.ctx, s);
        if (cap->cfg.lossless) {
            if (pvx_queue_put_wait(cap->out, s) != PVX_OK)
                release_set(cap, s); /* stopping */
            continue;
        }
        void *gone;
        pvx_queue_put(cap->out, s, &gone);
        if (gone != NULL)
            release_set(cap, gone);
    }
    uint64_t failed = cap_assembler_sets_failed(cap->assembler);
    pthread_mutex_lock(&cap->lock);
    cap->sets_failed = failed;
    pthread_mutex_unlock(&cap->lock);
}

/* The host's time of day, as the frames' two arrival stamps show it, against the clock that is never
 * set.  A thread may be held up between reading the one and the other, so one frame that says otherwise
 * is no step; three are, or one and our own reading. */
static void follow_host_clock(struct cap_capture *cap, const struct cap_frame *f)
{
    struct cap_host_clock *h = &cap->host;
    int64_t says = f->t_arrival_ns - f->t_arrival_mono_ns;
    if (!h->known) {
        h->known = true;
        h->offset_ns = says;
    }
    int64_t off = says - h->offset_ns;
    if (llabs(off) <= STEP_NS) {
        h->offset_ns += off / 64;
        h->n_doubts = 0;
        return;
    }
    h->n_doubts = llabs(says - h->doubt_ns) <= STEP_NS ? h->n_doubts + 1 : 1;
    h->doubt_ns = says;
    if (h->n_doubts < 3 && llabs(pvx_now_real() - pvx_now_mono() - says) > STEP_NS)
        return;
    h->offset_ns = says;
    h->n_doubts = 0;
    h->steps++;
    h->last_step_ns = off;
    if (cap->all_show_real)
        cap_assembler_forget_order(cap->assembler);
    else
        cap_assembler_shift(cap->assembler, off);
    cap_syncwatch_shift(&cap->watch, off);
}

/* Compare the camera with the others.  A clock that jumped says nothing about its trigger. */
static void watch_frame(struct cap_capture *cap, struct cap_camera *cam, const struct cap_frame *f,
                        uint64_t jumps)
{
    if (jumps != 0) {
        cam->count[CAP_CLOCK_JUMP] += jumps;
        cam->restarted = true;
        cam->unsure_left = cam->clock.shared ? 0 : CAP_SETTLE_FRAMES;
        cam->unsure_until_ns = f->t_arrival_mono_ns + CAP_SETTLE_NS;
    }
    /* while it is not sure whether the clock that it shows was set, the frame says nothing */
    if (!cap->watches || (cam->shows_real && cap->host.n_doubts > 0))
        return;
    if (cam->restarted)
        cap_syncwatch_restart(&cap->watch, cam->index);
    cam->restarted = false;
    cap->watch.camera[cam->index].doubt_ns =
        f->t_device_ns != 0 ? cap_clockmap_doubt(&cam->clock) : 0;
    cap->watch.camera[cam->index].host_stamps = cam->ops->clock == CAP_CLOCK_MONO;
    cap_syncwatch_frame(&cap->watch, f);
}

/* Device time to host time; under the lock for the sake of what stats() reads. */
static void map_clock(struct cap_capture *cap, struct cap_frame *f)
{
    struct cap_camera *cam = &cap->camera[f->camera];
    if (f->set != 0)
        return; /* the recording says when it was exposed */
    uint64_t jumps = cam->clock.jumps;
    follow_host_clock(cap, f);
    for (unsigned i = 0; i < cam->n_readings; i++)
        cap_clockmap_measure(&cam->clock, cam->reading[i].device_ns, cam->reading[i].mono_ns,
                             cam->reading[i].bound_ns);
    cam->n_readings = 0;
    if (cam->shows_real)
        f->t_exposure_ns = cap_clockmap_add(&cam->clock, f->t_device_ns, f->t_arrival_ns);
    else
        f->t_exposure_ns = cap_clockmap_add(&cam->clock, f->t_device_ns, f->t_arrival_mono_ns) +
                           cap->host.offset_ns;
    cam->drift_ppm = cap_clockmap_drift(&cam->clock) * 1e6;
    watch_frame(cap, cam, f, cam->clock.jumps - jumps);
}

/* All of these under the lock. */
static bool may_send(const struct cap_camera *cam)
{
    return cam->state == CAP_RUNNING || (cam->state == CAP_OPENING && !cam->tried);
}

static bool empty(const struct cap_camera *cam)
{
    return cam->ring_len == 0 && cam->head == NULL;
}

/* Nothing more will come: some source has ended, none runs, none has yet to be tried. */
static bool finished(const struct cap_capture *cap)
{
    bool ended = false;
    for (uint32_t i = 0; i < cap->n; i++) {
        const struct cap_camera *cam = &cap->camera[i];
        if (may_send(cam) || !empty(cam))
            return false;
        ended |= cam->state == CAP_ENDED;
    }
    return ended;
}

/* It is being started for the first time: no set is to lack it only because another was faster. */
static bool on_its_way(const struct cap_capture *cap, const struct cap_camera *cam, int64_t now)
{
    return !cam->given_up && cam->count[CAP_RECEIVED] == 0 && now - cap->started_mono_ns < START_NS;
}

static uint64_t waited_for(const struct cap_capture *cap)
{
    uint64_t mask = 0;
    int64_t now = pvx_now_mono();
    for (uint32_t i = 0; i < cap->n; i++)
        if (cap->camera[i].delivering || !empty(&cap->camera[i]) ||
            on_its_way(cap, &cap->camera[i], now))
            mask |= 1ull << i;
    return mask;
}

static struct cap_frame *next_live(struct cap_capture *cap)
{
    struct cap_camera *first = NULL;
    int64_t t = INT64_MAX;
    for (uint32_t i = 0; i < cap->n; i++) {
        struct cap_camera *cam = &cap->camera[i];
        if (cam->ring_len > 0 && cam->ring[cam->ring_head]->t_arrival_mono_ns < t) {
            t = cam->ring[cam->ring_head]->t_arrival_mono_ns;
            first = cam;
        }
    }
    if (first == NULL)
        return NULL;
    struct cap_frame *f = cap_intake_pop(first);
    map_clock(cap, f);
    return f;
}

static bool earlier(const struct cap_frame *x, const struct cap_frame *y)
{
    if (x->set != 0 && y->set != 0)
        return x->set < y->set;
    return x->t_exposure_ns < y->t_exposure_ns;
}

static struct cap_frame *next_in_time(struct cap_capture *cap)
{
    struct cap_camera *first = NULL;
    bool wait = false;
    for (uint32_t i = 0; i < cap->n; i++) {
        struct cap_camera *cam = &cap->camera[i];
        if (cam->head == NULL && cam->ring_len > 0) {
            cam->head = cap_intake_pop(cam);
            map_clock(cap, cam->head);
        }
        if (cam->head == NULL)
            wait |= may_send(cam);
        else if (first == NULL || earlier(cam->head, first->head))
            first = cam;
    }
    if (wait || first == NULL)
        return NULL;
    struct cap_frame *f = first->head;
    first->head = NULL;
    return f;
}

/* Tell the assembler whom to wait for, before the frame is put; sets may close. */
static void set_alive(struct cap_capture *cap, uint64_t mask)
{
    for (uint32_t i = 0; i < cap->n; i++)
        cap_assembler_alive(cap->assembler, i, mask >> i & 1);
}

/* Next frame, or NULL: *end tells whether there will be one again.  *alive is of the same moment. */
static struct cap_frame *take(struct cap_capture *cap, bool wait, uint64_t *alive, bool *end)
{
    struct cap_frame *f = NULL;
    int64_t deadline = cap->cfg.lossless ? INT64_MAX : cap_assembler_deadline(cap->assembler);
    uint64_t before;
    *end = false;
    pthread_mutex_lock(&cap->lock);
    before = waited_for(cap);
    for (;;) {
        *alive = waited_for(cap);
        if ((*end = cap->stop))
            break;
        f = cap->cfg.lossless ? next_in_time(cap) : next_live(cap);
        if (f != NULL || (*end = finished(cap)))
            break;
        if (!wait || *alive != before || pvx_now_mono() >= deadline)
            break;
        if (deadline == INT64_MAX)
            pthread_cond_wait(&cap->work, &cap->lock);
        else
            cap_wait_until(&cap->work, &cap->lock, deadline);
    }
    pthread_mutex_unlock(&cap->lock);
    return f;
}

/* The camera's clock has jumped a moment ago: the delay of its frames is not known well enough to say
 * where they belong. */
static bool untimed(struct cap_capture *cap, const struct cap_frame *f)
{
    struct cap_camera *cam = &cap->camera[f->camera];
    if (cam->unsure_left == 0)
        return false;
    cam->unsure_left--;
    if (f->t_arrival_mono_ns >= cam->unsure_until_ns)
        cam->unsure_left = 0;
    return cam->unsure_left > 0;
}

bool cap_assemble_some(struct cap_capture *cap, bool wait)
{
    bool end;
    uint64_t alive;
    struct cap_frame *f = take(cap, wait, &alive, &end);
    set_alive(cap, alive);
    if (f == NULL) {
        if (!cap->cfg.lossless)
            cap_assembler_tick(cap->assembler, pvx_now_mono());
    } else if (untimed(cap, f)) {
        cap_assembler_refuse(cap->assembler, f);
    } else {
        if (cap->cfg.lossless && f->set == 0)
            cap_assembler_close_before(cap->assembler, f->t_exposure_ns);
        cap_assembler_put(cap->assembler, f);
    }
    if (end)
        cap_assembler_flush(cap->assembler);
    hand_over(cap);
    return !end;
}

void *cap_assemble(void *arg)
{
    struct cap_capture *cap = arg;
    while (cap_assemble_some(cap, true))
        ;
    pvx_queue_close(cap->out);
    return NULL;
}
