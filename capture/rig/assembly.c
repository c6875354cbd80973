/* assembly.c - the assembler thread: rings to sets.
 *
 * Live: frames are taken in order of arrival.  Deadlines are checked when the rings are empty, so a frame in a ring is
 * never late because of this thread.
 * Lossless: the cameras are merged in order of exposure, which needs the next frame of each camera that still may have
 * one.  So sets close by order alone, and at most one set is open. */
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "capture/rig/capture_int.h"

#define STEP_NS  (2 * PVX_NS_PER_MS) /* a larger change: the time of day was set, not steered */
#define START_NS (5 * PVX_NS_PER_S)  /* patience with a camera that is slow in its first start */

static void release_set(struct cap_capture *cap, struct cap_set *s)
{
    pthread_mutex_lock(&cap->figures);
    cap->sets_dropped++;
    pthread_mutex_unlock(&cap->figures);
    for (uint32_t i = 0; i < cap->n; i++)
        cap->camera[i].count[CAP_OVERFLOW] += s->frame[i] != NULL;
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

/* Add a set to the statistics.  Under figures. */
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
            count_skew(&cap->camera[i].assembly.skew,
                       s->frame[i]->t_exposure_ns - s->t_exposure_ns);
    if (cap->watches)
        cap_syncwatch_set(&cap->watch, s);
}

static void assembly_hand_over(struct cap_capture *cap)
{
    struct cap_set *s;
    while ((s = cap_assembler_pop(cap->assembler)) != NULL) {
        pthread_mutex_lock(&cap->figures);
        look_at_set(cap, s);
        pthread_mutex_unlock(&cap->figures);
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
    pthread_mutex_lock(&cap->figures);
    cap->sets_failed = failed;
    pthread_mutex_unlock(&cap->figures);
}

/* Follow the offset of the host's time of day from the clock that is never set, by the two arrival stamps of frames.
 * A thread may be held up between reading the two clocks.  So one frame with another offset is no step; three such
 * frames are, or one and our own reading. */
static void follow_host_clock(struct cap_capture *cap, const struct cap_frame *f)
{
    struct cap_host_clock *h = &cap->host;
    int64_t says = f->t_arrival_ns - f->t_arrival_mono_ns, real, mono;
    if (!h->known) {
        h->known = true;
        h->offset_ns = says;
    }
    int64_t off = says - h->offset_ns;
    if (f->t_arrival_mono_ns <
        h->since_ns) /* from before the step, in the ring of another camera */
        return;
    if (llabs(off) <= STEP_NS) {
        h->offset_ns += off / 64;
        h->n_doubts = 0;
        return;
    }
    h->n_doubts = llabs(says - h->doubt_ns) <= STEP_NS ? h->n_doubts + 1 : 1;
    h->doubt_ns = says;
    pvx_now_both(&real, &mono);
    if (h->n_doubts < 3 && llabs(real - mono - says) > STEP_NS)
        return;
    h->offset_ns = says;
    h->n_doubts = 0;
    h->steps++;
    h->last_step_ns = off;
    h->since_ns = f->t_arrival_mono_ns;
    if (cap->all_show_real)
        cap_assembler_forget_order(cap->assembler);
    else
        cap_assembler_shift(cap->assembler, off);
    cap_syncwatch_shift(&cap->watch, off);
}

/* Compare the camera with the others.  After a jump of its clock, its past says nothing about its trigger. */
static void watch_frame(struct cap_capture *cap, struct cap_camera *cam, const struct cap_frame *f,
                        uint64_t jumps)
{
    struct cap_assembly *a = &cam->assembly;
    struct cap_sync_camera *k = &cap->watch.camera[cam->index];
    unsigned starts = cam->intake.starts;
    if (jumps != 0) {
        cam->count[CAP_CLOCK_JUMP] += jumps;
        a->starts = starts - 1; /* handled like a start */
        a->unsure_left = cam->own_clock ? CAP_SETTLE_FRAMES : 0;
        a->unsure_until_ns = f->t_arrival_mono_ns + CAP_SETTLE_NS;
    }
    /* The frame is not used while it is not certain whether the clock of its stamps was set. */
    if (!cap->watches || (cam->shows_real && cap->host.n_doubts > 0))
        return;
    if (a->starts != starts)
        cap_syncwatch_restart(&cap->watch, cam->index);
    a->starts = starts;
    k->doubt_ns = f->t_device_ns != 0 ? cap_clockmap_doubt(&a->clock) : 0;
    k->host_stamps = cam->ops->clock == CAP_CLOCK_MONO;
    cap_syncwatch_frame(&cap->watch, f);
}

/* Take the readings of the camera's clock. */
static unsigned pop_readings(struct cap_readings *r, struct cap_reading out[CAP_READINGS])
{
    pthread_mutex_lock(&r->lock);
    unsigned n = r->n;
    memcpy(out, r->reading, n * sizeof *out);
    r->n = 0;
    pthread_mutex_unlock(&r->lock);
    return n;
}

/* Device time to host time. */
static void map_clock(struct cap_capture *cap, struct cap_frame *f)
{
    struct cap_camera *cam = &cap->camera[f->camera];
    struct cap_clockmap *clock = &cam->assembly.clock;
    struct cap_reading r[CAP_READINGS];
    if (f->set != 0)
        return; /* the recording has the time of exposure */
    unsigned n = pop_readings(&cam->readings, r);
    pthread_mutex_lock(&cap->figures);
    follow_host_clock(cap, f);
    for (unsigned i = 0; i < n; i++)
        if (r[i].bound_ns < 0)
            (void)cap_clockmap_add(clock, r[i].device_ns, r[i].mono_ns);
        else
            cap_clockmap_measure(clock, r[i].device_ns, r[i].mono_ns, r[i].bound_ns);
    uint64_t jumps = clock->jumps;
    if (cam->shows_real)
        f->t_exposure_ns = cap_clockmap_add(clock, f->t_device_ns, f->t_arrival_ns);
    else
        f->t_exposure_ns =
            cap_clockmap_add(clock, f->t_device_ns, f->t_arrival_mono_ns) + cap->host.offset_ns;
    watch_frame(cap, cam, f, clock->jumps - jumps);
    pthread_mutex_unlock(&cap->figures);
}

static bool may_send(const struct cap_camera *cam)
{
    enum cap_state state = cam->life.state;
    return state == CAP_RUNNING || (state == CAP_OPENING && !cam->life.tried);
}

static bool assembly_empty(const struct cap_camera *cam)
{
    return cam->assembly.head == NULL && pvx_ring_length(cam->intake.ring) == 0;
}

/* Whether no more frames will come: some source has ended, none runs, and none is still to be tried.  The state is
 * read before the ring, because a source that has ended has pushed its frames before. */
static bool assembly_finished(const struct cap_capture *cap)
{
    bool ended = false;
    for (uint32_t i = 0; i < cap->n; i++) {
        const struct cap_camera *cam = &cap->camera[i];
        if (may_send(cam) || !assembly_empty(cam))
            return false;
        ended |= cam->life.state == CAP_ENDED;
    }
    return ended;
}

/* Whether the camera is being started for the first time.  No set should lack it only because another was faster. */
static bool on_its_way(const struct cap_capture *cap, const struct cap_camera *cam, int64_t now)
{
    return !cam->life.given_up && cam->count[CAP_RECEIVED] == 0 &&
           now - cap->started_mono_ns < START_NS;
}

static uint64_t waited_for(const struct cap_capture *cap)
{
    uint64_t mask = 0;
    int64_t now = pvx_now_mono();
    for (uint32_t i = 0; i < cap->n; i++)
        if (cap_delivers(&cap->camera[i]) || !assembly_empty(&cap->camera[i]) ||
            on_its_way(cap, &cap->camera[i], now))
            mask |= 1ull << i;
    return mask;
}

static bool assembly_earlier(const struct cap_frame *x, const struct cap_frame *y)
{
    if (x->set != 0 && y->set != 0)
        return x->set < y->set;
    return x->t_exposure_ns < y->t_exposure_ns;
}

/* The first of all cameras' next frames: live by arrival, lossless by exposure.  Lossless, every camera that may
 * still send must have a next frame, else NULL. */
static struct cap_frame *assembly_next_frame(struct cap_capture *cap)
{
    bool lossless = cap->cfg.lossless, wait = false;
    struct cap_frame **first = NULL;
    for (uint32_t i = 0; i < cap->n; i++) {
        struct cap_camera *cam = &cap->camera[i];
        struct cap_frame **head = &cam->assembly.head;
        bool more = may_send(cam); /* read before the ring */
        if (*head == NULL && (*head = cap_intake_pop(cam)) != NULL && lossless)
            map_clock(cap, *head);
        if (*head == NULL)
            wait |= lossless && more;
        else if (first == NULL ||
                 (lossless ? assembly_earlier(*head, *first)
                           : (*head)->t_arrival_mono_ns < (*first)->t_arrival_mono_ns))
            first = head;
    }
    if (wait || first == NULL)
        return NULL;
    struct cap_frame *f = *first;
    *first = NULL;
    if (!lossless)
        map_clock(cap, f);
    return f;
}

/* Tell the assembler which cameras to wait for, before the frame is put.  Sets may close. */
static void assembly_set_alive(struct cap_capture *cap, uint64_t mask)
{
    for (uint32_t i = 0; i < cap->n; i++)
        cap_assembler_alive(cap->assembler, i, mask >> i & 1);
}

/* The next frame, or NULL: then *end = no more frames will come, and all frames that came until *now were given out.
 * *alive: the cameras to wait for, just before the frame was taken; the frame's camera is one of them. */
static struct cap_frame *wait_for_frame(struct cap_capture *cap, bool wait, uint64_t *alive,
                                        bool *end, int64_t *now)
{
    int64_t deadline = cap->cfg.lossless ? INT64_MAX : cap_assembler_deadline(cap->assembler);
    uint64_t before = waited_for(cap);
    for (;;) {
        *alive = waited_for(cap);
        *now = pvx_now_mono();
        if ((*end = cap->stop))
            return NULL;
        struct cap_frame *f = assembly_next_frame(cap);
        if (f != NULL)
            *alive |= 1ull << f->camera;
        if (f != NULL || (*end = assembly_finished(cap)))
            return f;
        if (!wait || *alive != before || *now >= deadline)
            return NULL;
        pvx_bell_wait(&cap->work, deadline);
    }
}

/* Whether the camera's clock jumped a moment ago, so that the delay of its frames is not known well enough to match
 * them. */
static bool untimed(struct cap_capture *cap, const struct cap_frame *f)
{
    struct cap_assembly *a = &cap->camera[f->camera].assembly;
    if (a->unsure_left == 0)
        return false;
    a->unsure_left--;
    if (f->t_arrival_mono_ns >= a->unsure_until_ns)
        a->unsure_left = 0;
    return a->unsure_left > 0;
}

bool cap_assemble_some(struct cap_capture *cap, bool wait)
{
    bool end;
    uint64_t alive;
    int64_t now;
    struct cap_frame *f = wait_for_frame(cap, wait, &alive, &end, &now);
    assembly_set_alive(cap, alive);
    if (f != NULL && cap->cfg.look != NULL)
        cap->cfg.look(cap->cfg.look_ctx, f);
    if (f == NULL) {
        if (!cap->cfg.lossless)
            cap_assembler_tick(cap->assembler, now);
    } else if (untimed(cap, f)) {
        cap_assembler_refuse(cap->assembler, f);
    } else {
        if (cap->cfg.lossless)
            cap_assembler_close_before(cap->assembler, f);
        cap_assembler_put(cap->assembler, f);
    }
    if (end)
        cap_assembler_flush(cap->assembler);
    assembly_hand_over(cap);
    return !end;
}

void cap_assemble_nothing(struct cap_capture *cap)
{
    for (uint32_t i = 0; i < cap->n; i++) {
        struct cap_camera *cam = &cap->camera[i];
        struct cap_frame *f = cam->assembly.head;
        if (cam->intake.ring == NULL) /* set-up has failed */
            break;
        for (cam->assembly.head = NULL; f != NULL || (f = cap_intake_pop(cam)) != NULL; f = NULL) {
            cam->count[CAP_OVERFLOW]++;
            cap_frame_release(f);
        }
    }
}

void *cap_assemble(void *arg)
{
    struct cap_capture *cap = arg;
    while (cap_assemble_some(cap, true))
        ;
    pvx_queue_close(cap->out);
    return NULL;
}
