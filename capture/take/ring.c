#include "capture/take/ring.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"

#define N_ORDERS 16
#define N_MARKS  64   /* triggers whose rows wait for their take */
#define N_LOSSES 1024 /* rows of lost frames that wait */
#define LOOK_NS  (100 * PVX_NS_PER_MS)
#define GRACE_NS \
    (400 * PVX_NS_PER_MS)    /* frames without a set come so much later than sets, at most */
#define LATE_NS PVX_NS_PER_S /* wait so long for the last frames */
#define REORDER 64           /* a number so much lower than the last is a late frame */

struct item {
    struct cap_set *set;     /* or */
    struct cap_frame *stray; /* this one, or neither: */
    enum cap_count stray_why;
    struct cap_take_lost lost; /* frames that never came */
    enum cap_ring_why why;
    int64_t t_ns;
    uint64_t bytes;
    uint64_t fed; /* number of the take that got it */
};

/* A frame without a set, which the ring, its recorder and the next receiver may have at the same time. */
struct shared {
    atomic_uint refs;
    void (*release)(struct cap_frame *f); /* the frame's own */
    void *owner;
    cap_ring *ring;
    struct shared *free;
};

/* A take that was asked for. */
struct order {
    uint64_t number;
    struct cap_take_trigger first;
    int64_t t_from_ns, t_to_ns;
};

struct cap_ring {
    struct cap_ring_config cfg;
    cap_recorder *recorder;
    struct cap_tap to; /* the recorder's */
    pthread_mutex_t lock;
    pthread_cond_t came; /* an item, an order, the end */
    struct item *item;   /* [size], number n at n % size */
    uint64_t size, tail, end;
    uint32_t sets, held[CAP_MAX_CAMERAS];
    struct seen {
        bool known, gone;
        uint64_t id, gone_id; /* of the last frame; of the last that left the ring */
        int64_t t_ns, gone_ns;
        uint64_t charged[CAP_N_COUNT]; /* counts of capture that a loss was put down to */
    } seen[CAP_MAX_CAMERAS];

    struct order order[N_ORDERS];
    unsigned n_orders;
    uint64_t orders; /* so far */
    struct mark {
        uint64_t number;
        struct cap_take_trigger row;
    } mark[N_MARKS];
    unsigned n_marks;
    struct loss {
        uint64_t number;
        enum cap_ring_why why;
        struct cap_take_lost row;
    } loss[N_LOSSES];
    unsigned n_losses;

    bool active, closing; /* `now` is being written; it takes no more triggers */
    struct order now;
    int64_t t_came_ns;       /* mono: the last item, or the begin of the take */
    uint64_t fed;            /* frames handed to the recorder for it */
    uint64_t cursor, passed; /* next item; the first that was too late for it, UINT64_MAX = none */
    bool stopping, running;
    bool larger; /* it has been said that sets are larger than counted; the tap's */
    pthread_t thread;
    struct cap_ring_stats stats;

    pthread_mutex_t strays_lock;
    struct shared *strays, *free_stray;
};

const char *cap_ring_why_name(enum cap_ring_why why)
{
    static const char *const more[] = {"ring", "before", "disk", "stopped", "silent", "unknown"};
    return (int)why < CAP_N_COUNT ? cap_count_defs[why].name : more[(int)why - CAP_N_COUNT];
}

/* ---- frames without a set ---- */

static void shared_release(struct cap_frame *f)
{
    struct shared *s = f->owner;
    cap_ring *r = s->ring;
    if (atomic_fetch_sub(&s->refs, 1) > 1)
        return;
    f->release = s->release;
    f->owner = s->owner;
    cap_frame_release(f);
    pthread_mutex_lock(&r->strays_lock);
    s->free = r->free_stray;
    r->free_stray = s;
    pthread_mutex_unlock(&r->strays_lock);
}

/* False: there is no room to share it. */
static bool ring_share(cap_ring *r, struct cap_frame *f)
{
    pthread_mutex_lock(&r->strays_lock);
    struct shared *s = r->free_stray;
    if (s != NULL)
        r->free_stray = s->free;
    pthread_mutex_unlock(&r->strays_lock);
    if (s == NULL)
        return false;
    s->release = f->release;
    s->owner = f->owner;
    s->ring = r;
    atomic_store(&s->refs, 1);
    f->release = shared_release;
    f->owner = s;
    return true;
}

static void share_ref(struct cap_frame *f)
{
    atomic_fetch_add(&((struct shared *)f->owner)->refs, 1);
}

/* ---- what is lost.  All under the lock ---- */

static bool ring_is_in(int64_t from, int64_t to, const struct item *it)
{
    if (it->set == NULL && it->stray == NULL)
        return it->lost.t_first_ns < to && it->lost.t_last_ns > from;
    return it->t_ns >= from && it->t_ns <= to;
}

static void ring_lose(cap_ring *r, uint64_t number, enum cap_ring_why why,
                      const struct cap_take_lost *l)
{
    r->stats.lost[why] += l->frames;
    for (unsigned i = r->n_losses; i-- > 0;) {
        struct loss *k = &r->loss[i];
        if (k->number != number || k->why != why || k->row.camera != l->camera)
            continue;
        if (k->row.id_last + 1 != l->id_first && r->n_losses < N_LOSSES)
            break;
        k->row.frames += l->frames; /* goes on, or there is no room for another */
        k->row.id_last = l->id_last;
        k->row.t_last_ns = l->t_last_ns;
        return;
    }
    if (r->n_losses == N_LOSSES)
        return; /* counted */
    struct loss *k = &r->loss[r->n_losses++];
    *k = (struct loss){.number = number, .why = why, .row = *l};
    snprintf(k->row.why, sizeof k->row.why, "%s", cap_ring_why_name(why));
}

static void lose_frame(cap_ring *r, uint64_t number, enum cap_ring_why why,
                       const struct cap_frame *f)
{
    const struct cap_take_lost l = {.camera = f->camera,
                                    .frames = 1,
                                    .id_first = f->id,
                                    .id_last = f->id,
                                    .t_first_ns = f->t_exposure_ns,
                                    .t_last_ns = f->t_exposure_ns};
    ring_lose(r, number, why, &l);
}

/* The item will not be in take `number`. */
static void lose_item(cap_ring *r, uint64_t number, enum cap_ring_why why, const struct item *it)
{
    if (it->set == NULL && it->stray == NULL)
        ring_lose(r, number, it->why, &it->lost);
    if (it->stray != NULL)
        lose_frame(r, number, why, it->stray);
    for (uint32_t c = 0; it->set != NULL && c < r->cfg.n_cameras; c++)
        if (it->set->frame[c] != NULL)
            lose_frame(r, number, why, it->set->frame[c]);
}

/* ---- the ring.  All under the lock ---- */

static struct item *ring_at(cap_ring *r, uint64_t n)
{
    return &r->item[n % r->size];
}

static const struct cap_frame *ring_frame(const struct item *it, uint32_t c)
{
    if (it->set != NULL)
        return it->set->frame[c];
    return it->stray != NULL && it->stray->camera == c ? it->stray : NULL;
}

static void ring_hold(cap_ring *r, const struct item *it, int by)
{
    r->sets += it->set != NULL ? (uint32_t)by : 0;
    r->stats.bytes += by > 0 ? it->bytes : -it->bytes;
    for (uint32_t c = 0; c < r->cfg.n_cameras; c++)
        if (ring_frame(it, c) != NULL)
            r->held[c] += (uint32_t)by;
    if (r->stats.bytes > r->stats.bytes_most)
        r->stats.bytes_most = r->stats.bytes;
}

static bool ring_fits(const cap_ring *r, const struct item *it)
{
    bool fits = r->end - r->tail < r->size && r->stats.bytes + it->bytes <= r->cfg.bytes &&
                (it->set == NULL || r->sets < r->cfg.frames);
    for (uint32_t c = 0; c < r->cfg.n_cameras && fits; c++)
        fits = ring_frame(it, c) == NULL || r->held[c] < r->cfg.frames;
    return fits;
}

static void ring_evict(cap_ring *r)
{
    struct item *it = ring_at(r, r->tail);
    if (r->active && it->fed != r->now.number && r->tail >= r->cursor &&
        ring_is_in(r->now.t_from_ns, r->now.t_to_ns, it))
        lose_item(r, r->now.number, CAP_RING_OUTRUN, it);
    for (unsigned i = 0; i < r->n_orders; i++)
        if (ring_is_in(r->order[i].t_from_ns, r->order[i].t_to_ns, it))
            lose_item(r, r->order[i].number, CAP_RING_OUTRUN, it);
    for (uint32_t c = 0; c < r->cfg.n_cameras; c++) {
        const struct cap_frame *f = ring_frame(it, c);
        if (f != NULL && (!r->seen[c].gone || f->t_exposure_ns > r->seen[c].gone_ns)) {
            r->seen[c].gone = true;
            r->seen[c].gone_id = f->id;
            r->seen[c].gone_ns = f->t_exposure_ns;
        }
    }
    ring_hold(r, it, -1);
    cap_set_release(it->set);
    cap_frame_release(it->stray);
    *it = (struct item){0};
    r->tail++;
}

/* False: it does not fit even into an empty ring. */
static bool ring_push(cap_ring *r, const struct item *it)
{
    while (!ring_fits(r, it) && r->tail < r->end)
        ring_evict(r);
    if (!ring_fits(r, it))
        return false;
    *ring_at(r, r->end++) = *it;
    r->t_came_ns = pvx_now_mono();
    ring_hold(r, it, 1);
    return true;
}

/* ---- the tap: the assembler's thread ---- */

static void push_lost(cap_ring *r, const struct cap_frame *f, enum cap_ring_why why, uint64_t first,
                      uint64_t frames)
{
    const struct seen *s = &r->seen[f->camera];
    const struct item it = {.why = why,
                            .t_ns = s->t_ns,
                            .lost = {.camera = f->camera,
                                     .frames = frames,
                                     .id_first = first,
                                     .id_last = first == 0 ? 0 : first + frames - 1,
                                     .t_first_ns = s->t_ns,
                                     .t_last_ns = f->t_exposure_ns}};
    (void)ring_push(r, &it);
}

/* Frames of the camera between the last one and f did not come.  Which of the counts took them: those of frames that
 * were received and refused first. */
static void find_cause(cap_ring *r, const struct cap_frame *f, uint64_t missing)
{
    static const enum cap_count causes[] = {CAP_INCOMPLETE, CAP_BAD_SIZE, CAP_BAD_FORMAT,
                                            CAP_BAD_STAMP,  CAP_UNDERRUN, CAP_ID_GAP,
                                            CAP_OVERFLOW};
    struct seen *s = &r->seen[f->camera];
    uint64_t count[CAP_N_COUNT] = {0}, id = s->id + 1;
    if (r->cfg.counts != NULL)
        r->cfg.counts(r->cfg.ctx, f->camera, count);
    for (size_t i = 0; i < sizeof causes / sizeof causes[0] && missing > 0; i++) {
        enum cap_count k = causes[i];
        uint64_t n = count[k] > s->charged[k] ? count[k] - s->charged[k] : 0;
        n = n < missing ? n : missing;
        if (n == 0)
            continue;
        push_lost(r, f, (enum cap_ring_why)k, id, n);
        s->charged[k] += n;
        missing -= n;
        id += n;
    }
    bool lost = count[CAP_LOST_CAMERA] > s->charged[CAP_LOST_CAMERA];
    s->charged[CAP_LOST_CAMERA] = count[CAP_LOST_CAMERA];
    if (missing > 0)
        push_lost(r, f, lost ? (enum cap_ring_why)CAP_LOST_CAMERA : CAP_RING_UNKNOWN, id, missing);
}

/* The camera's numbers began again: it was opened again.  How many frames that took follows from the time. */
static void ring_restarted(cap_ring *r, const struct cap_frame *f)
{
    struct seen *s = &r->seen[f->camera];
    double n = (double)(f->t_exposure_ns - s->t_ns) * 1e-9 * r->cfg.fps - 1;
    if (n >= 0.5)
        push_lost(r, f, (enum cap_ring_why)CAP_LOST_CAMERA, 0, (uint64_t)llround(n));
    s->known = false;
}

static void ring_look(cap_ring *r, const struct cap_frame *f)
{
    struct seen *s = &r->seen[f->camera];
    if (s->known && f->id <= s->id && f->id + REORDER > s->id)
        return; /* it came out of order: what lay before it is known */
    if (s->known && f->id <= s->id)
        ring_restarted(r, f);
    else if (s->known && f->id > s->id + 1)
        find_cause(r, f, f->id - s->id - 1);
    if (!s->known && r->cfg.counts != NULL)
        r->cfg.counts(r->cfg.ctx, f->camera, s->charged);
    s->known = true;
    s->id = f->id;
    s->t_ns = f->t_exposure_ns;
}

static uint64_t bytes_of_set(const struct cap_set *s, uint32_t n)
{
    uint64_t bytes = 0;
    for (uint32_t c = 0; c < n; c++)
        bytes += s->frame[c] != NULL ? s->frame[c]->img.size : 0;
    return bytes;
}

static void say_larger(cap_ring *r, const struct item *it)
{
    if (r->larger || r->cfg.set_bytes == 0 || it->bytes <= r->cfg.set_bytes)
        return;
    r->larger = true;
    LOG_W(
        CAPTURE,
        "record.ring: a set has %.1f MB, and %.1f were counted for its memory: it takes more than "
        "it may; name pixel_format",
        (double)it->bytes * 1e-6, (double)r->cfg.set_bytes * 1e-6);
}

static void ring_tap_set(void *ctx, struct cap_set *s)
{
    cap_ring *r = ctx;
    const struct item it = {
        .set = s, .t_ns = s->t_exposure_ns, .bytes = bytes_of_set(s, r->cfg.n_cameras)};
    say_larger(r, &it);
    pthread_mutex_lock(&r->lock);
    for (uint32_t c = 0; c < r->cfg.n_cameras; c++)
        if (s->frame[c] != NULL)
            ring_look(r, s->frame[c]);
    cap_set_ref(s);
    bool in = ring_push(r, &it);
    pthread_cond_signal(&r->came);
    pthread_mutex_unlock(&r->lock);
    if (!in) {
        cap_set_release(s);
        LOG_EVERY(PVX_LOG_ERROR, CAPTURE,
                  "set %llu of %.1f MB is more than record.ring may hold: raise its memory",
                  (unsigned long long)s->number, (double)it.bytes * 1e-6);
    }
    if (r->cfg.next.set != NULL)
        r->cfg.next.set(r->cfg.next.ctx, s);
}

static void ring_tap_stray(void *ctx, struct cap_frame *f, enum cap_count why)
{
    cap_ring *r = ctx;
    if (!ring_share(r, f)) { /* as many as the ring has places: cannot happen */
        cap_frame_release(f);
        return;
    }
    const struct item it = {
        .stray = f, .stray_why = why, .t_ns = f->t_exposure_ns, .bytes = f->img.size};
    if (r->cfg.next.stray != NULL)
        share_ref(f);
    pthread_mutex_lock(&r->lock);
    ring_look(r, f);
    bool in = ring_push(r, &it);
    pthread_cond_signal(&r->came);
    pthread_mutex_unlock(&r->lock);
    if (r->cfg.next.stray != NULL)
        r->cfg.next.stray(r->cfg.next.ctx, f, why);
    if (!in)
        cap_frame_release(f);
}

struct cap_tap cap_ring_tap(cap_ring *r)
{
    return (struct cap_tap){.set = ring_tap_set, .stray = ring_tap_stray, .ctx = r};
}

/* ---- orders ---- */

/* The frames from `from` to `to` that left the ring before anything asked for them.  Under the lock. */
static void lose_before(cap_ring *r, uint64_t number, int64_t from, int64_t to)
{
    for (uint32_t c = 0; c < r->cfg.n_cameras; c++) {
        const struct seen *s = &r->seen[c];
        int64_t last = s->gone_ns < to ? s->gone_ns : to;
        if (!s->gone || last < from)
            continue;
        uint64_t n = (uint64_t)((double)(last - from) * 1e-9 * r->cfg.fps) + 1;
        const struct cap_take_lost l = {
            .camera = c, .frames = n, .t_first_ns = from, .t_last_ns = last};
        ring_lose(r, number, CAP_RING_BEFORE, &l);
    }
}

/* The order is part of o, whose times grow. */
static void ring_join(cap_ring *r, struct order *o, const struct cap_take_trigger *t)
{
    if (t->t_from_ns < o->t_from_ns) {
        lose_before(r, o->number, t->t_from_ns, o->t_from_ns);
        o->t_from_ns = t->t_from_ns;
    }
    if (t->t_to_ns > o->t_to_ns)
        o->t_to_ns = t->t_to_ns;
    r->stats.extended++;
}

static uint64_t ring_put_order(cap_ring *r, const struct cap_take_trigger *t)
{
    struct order *now = &r->now;
    if (r->active && !r->closing && t->t_from_ns >= now->t_from_ns &&
        t->t_from_ns <= now->t_to_ns) {
        ring_join(r, now, t);
        if (r->passed < r->cursor)
            r->cursor = r->passed;
        r->passed = UINT64_MAX;
        return now->number;
    }
    for (unsigned i = 0; i < r->n_orders; i++)
        if ((t->t_from_ns <= r->order[i].t_to_ns && t->t_to_ns >= r->order[i].t_from_ns) ||
            (r->n_orders == N_ORDERS && i == N_ORDERS - 1)) {
            ring_join(r, &r->order[i], t);
            return r->order[i].number;
        }
    struct order *o = &r->order[r->n_orders++];
    *o = (struct order){
        .number = ++r->orders, .first = *t, .t_from_ns = t->t_from_ns, .t_to_ns = t->t_to_ns};
    lose_before(r, o->number, o->t_from_ns, o->t_to_ns);
    return o->number;
}

pvx_err cap_ring_trigger(cap_ring *r, const struct cap_take_trigger *t)
{
    pthread_mutex_lock(&r->lock);
    bool closed = r->stopping || !r->running, marked = r->n_marks < N_MARKS;
    if (!closed) {
        r->stats.triggers++;
        uint64_t number = ring_put_order(r, t);
        if (marked)
            r->mark[r->n_marks++] = (struct mark){.number = number, .row = *t};
        pthread_cond_broadcast(&r->came);
    }
    pthread_mutex_unlock(&r->lock);
    if (!closed && !marked)
        LOG_EVERY(PVX_LOG_WARN, CAPTURE, "trigger %s: its take does not name it: too many wait",
                  t->name);
    return closed ? PVX_ECLOSED : PVX_OK;
}

/* ---- the ring's thread ---- */

/* The recorder's thread: rows of triggers and lost frames into the take. */
static pvx_err ring_beside(void *ctx, cap_take_writer *w, struct pvx_diag *d)
{
    cap_ring *r = ctx;
    for (;;) {
        struct mark m = {0};
        struct loss l = {0};
        pthread_mutex_lock(&r->lock);
        for (unsigned i = 0; i < r->n_marks && m.number == 0; i++)
            if (r->mark[i].number == r->now.number) {
                m = r->mark[i];
                r->n_marks--;
                memmove(&r->mark[i], &r->mark[i + 1], (r->n_marks - i) * sizeof m);
            }
        for (unsigned i = 0; i < r->n_losses && m.number == 0 && l.number == 0; i++)
            if (r->loss[i].number == r->now.number) {
                l = r->loss[i];
                r->n_losses--;
                memmove(&r->loss[i], &r->loss[i + 1], (r->n_losses - i) * sizeof l);
            }
        pthread_mutex_unlock(&r->lock);
        if (m.number != 0)
            PVX_TRY(cap_take_put_trigger(w, &m.row, d));
        else if (l.number != 0)
            PVX_TRY(cap_take_put_lost(w, &l.row, d));
        else
            return PVX_OK;
    }
}

static void ring_health(void *ctx, uint32_t camera, struct cap_health *out)
{
    cap_ring *r = ctx;
    *out = cap_health_unknown;
    if (r->cfg.health != NULL)
        r->cfg.health(r->cfg.ctx, camera, out);
}

/* The next item of the take that is written, with a reference; waits for it.  False: the take is complete. */
static bool ring_next(cap_ring *r, struct item *out)
{
    pthread_mutex_lock(&r->lock);
    for (;;) {
        if (r->cursor < r->tail)
            r->cursor = r->tail;
        while (r->cursor < r->end) {
            struct item *it = ring_at(r, r->cursor);
            if (it->set != NULL && it->t_ns > r->now.t_to_ns + GRACE_NS)
                goto complete;
            uint64_t n = r->cursor++;
            if (it->fed == r->now.number)
                continue;
            if (!ring_is_in(r->now.t_from_ns, r->now.t_to_ns, it)) {
                if (it->t_ns > r->now.t_to_ns && r->passed == UINT64_MAX)
                    r->passed = n;
                continue;
            }
            it->fed = r->now.number;
            *out = *it;
            if (it->set != NULL)
                cap_set_ref(it->set);
            if (it->stray != NULL)
                share_ref(it->stray);
            pthread_mutex_unlock(&r->lock);
            return true;
        }
        int64_t mono = pvx_now_mono(), t = mono + LOOK_NS;
        if (r->stopping ||
            (pvx_now_real() > r->now.t_to_ns + GRACE_NS && mono > r->t_came_ns + LATE_NS))
            goto complete;
        struct timespec ts = {.tv_sec = t / PVX_NS_PER_S, .tv_nsec = t % PVX_NS_PER_S};
        pthread_cond_timedwait(&r->came, &r->lock, &ts);
    }
complete:
    r->closing = true;
    pthread_mutex_unlock(&r->lock);
    return false;
}

/* Cameras that sent nothing up to the take's end.  If one has sent again since, what it did not send is known, but comes
 * after the set that ended the take.  Under the lock. */
static void ring_lose_rest(cap_ring *r)
{
    for (uint64_t n = r->cursor > r->tail ? r->cursor : r->tail; n < r->end; n++) {
        struct item *it = ring_at(r, n);
        if (it->set != NULL || it->stray != NULL || it->fed == r->now.number ||
            !ring_is_in(r->now.t_from_ns, r->now.t_to_ns, it))
            continue;
        it->fed = r->now.number;
        lose_item(r, r->now.number, it->why, it);
    }
    double period = 1e9 / r->cfg.fps;
    for (uint32_t c = 0; c < r->cfg.n_cameras; c++) {
        const struct seen *s = &r->seen[c];
        int64_t since = s->t_ns > r->now.t_from_ns ? s->t_ns : r->now.t_from_ns;
        double n = (double)(r->now.t_to_ns - since) / period;
        if (n < 1.5) /* one may come just after the end */
            continue;
        const struct cap_take_lost l = {
            .camera = c, .frames = (uint64_t)n, .t_first_ns = since, .t_last_ns = r->now.t_to_ns};
        ring_lose(r, r->now.number, r->stopping ? CAP_RING_STOPPED : CAP_RING_SILENT, &l);
    }
}

/* Hand an item, whose reference it takes, to the recorder, or count it as lost if there is no take of it. */
static void ring_feed(cap_ring *r, struct item *it, bool *take)
{
    struct cap_recorder_stats s;
    if (*take) {
        cap_recorder_stats(r->recorder, &s);
        *take = s.state == CAP_REC_RUNNING;
    }
    bool lost = it->set == NULL && it->stray == NULL;
    if (!*take || lost) {
        pthread_mutex_lock(&r->lock);
        lose_item(r, r->now.number, CAP_RING_DISK, it);
        pthread_mutex_unlock(&r->lock);
    } else if (it->set != NULL) {
        r->fed += it->set->n;
        r->to.set(r->to.ctx, it->set);
    } else {
        r->fed++;
        r->to.stray(r->to.ctx, it->stray, it->stray_why);
        it->stray = NULL;
    }
    cap_set_release(it->set);
    cap_frame_release(it->stray);
}

static pvx_err ring_begin(cap_ring *r, char *path, size_t size, struct pvx_diag *d)
{
    struct cap_take_head head;
    PVX_TRY(r->cfg.place(r->cfg.ctx, &r->now.first, path, size, &head, d));
    head.triggered = true;
    return cap_recorder_start(r->recorder, path, &head, d);
}

/* Forget the rows of a take that has no file for them. */
static void ring_forget(cap_ring *r)
{
    unsigned m = 0, l = 0;
    for (unsigned i = 0; i < r->n_marks; i++)
        if (r->mark[i].number != r->now.number)
            r->mark[m++] = r->mark[i];
    for (unsigned i = 0; i < r->n_losses; i++)
        if (r->loss[i].number != r->now.number)
            r->loss[l++] = r->loss[i];
    r->n_marks = m;
    r->n_losses = l;
}

static void ring_write(cap_ring *r)
{
    char path[sizeof r->stats.path] = "";
    struct pvx_diag d = {""};
    struct item it;
    struct cap_recorder_stats s = {0};
    pvx_err e = ring_begin(r, path, sizeof path, &d);
    bool begun = e == PVX_OK, take = begun;
    if (begun)
        LOG_I(CAPTURE, "trigger %s: writing %s", r->now.first.name, path);
    pthread_mutex_lock(&r->lock);
    snprintf(r->stats.path, sizeof r->stats.path, "%s", begun ? path : "");
    pthread_mutex_unlock(&r->lock);
    while (ring_next(r, &it))
        ring_feed(r, &it, &take);
    pthread_mutex_lock(&r->lock);
    ring_lose_rest(r);
    pthread_mutex_unlock(&r->lock);
    if (begun) {
        e = cap_recorder_stop(r->recorder, &d);
        cap_recorder_stats(r->recorder, &s);
    }
    pthread_mutex_lock(&r->lock);
    r->stats.takes += e == PVX_OK;
    r->stats.failed += e != PVX_OK;
    r->stats.written += s.frames;
    r->stats.lost[CAP_RING_DISK] += r->fed - s.frames; /* 0, unless the recording ended by itself */
    if (e != PVX_OK)
        snprintf(r->stats.error, sizeof r->stats.error, "%.*s", (int)sizeof r->stats.error - 1,
                 pvx_diag_text(&d, e));
    ring_forget(r);
    r->active = r->closing = r->stats.writing = false;
    pthread_mutex_unlock(&r->lock);
    if (e != PVX_OK)
        LOG_E(CAPTURE, "trigger %s: its frames are not all written: %s", r->now.first.name,
              pvx_diag_text(&d, e));
}

/* Wait for an order, and make it the one that is written.  False: there will be none. */
static bool ring_wait_order(cap_ring *r)
{
    pthread_mutex_lock(&r->lock);
    while (r->n_orders == 0 && !r->stopping)
        pthread_cond_wait(&r->came, &r->lock);
    bool any = r->n_orders > 0;
    if (any) {
        r->now = r->order[0];
        memmove(&r->order[0], &r->order[1], --r->n_orders * sizeof r->now);
        r->active = r->stats.writing = true;
        r->cursor = r->tail;
        r->passed = UINT64_MAX;
        r->fed = 0;
        r->t_came_ns = pvx_now_mono();
        memcpy(r->stats.name, r->now.first.name, sizeof r->stats.name);
        r->stats.t_ns = r->now.first.t_ns;
    }
    pthread_mutex_unlock(&r->lock);
    return any;
}

static void *ring_loop(void *arg)
{
    cap_ring *r = arg;
    while (ring_wait_order(r))
        ring_write(r);
    return NULL;
}

/* ---- from outside ---- */

pvx_err cap_ring_new(const struct cap_ring_config *c, cap_ring **out)
{
    *out = NULL;
    if (c->n_cameras < 1 || c->n_cameras > CAP_MAX_CAMERAS || c->frames < 1 ||
        c->frames > CAP_BUFFERS_MAX || !(c->fps > 0) || c->place == NULL)
        return PVX_EINVAL;
    cap_ring *r = pvx_calloc(1, sizeof *r);
    PVX_NEED(r);
    r->cfg = *c;
    r->size = 2 * (uint64_t)c->frames + 64 * (uint64_t)c->n_cameras;
    uint64_t strays = r->size + 2 * CAP_RECORDER_QUEUE_MAX * (uint64_t)c->n_cameras;
    const struct cap_recorder_config rc = {.n_cameras = c->n_cameras,
                                           .queue = CAP_RING_QUEUE,
                                           .lossless = true,
                                           .limit_bytes = c->limit_bytes,
                                           .keep_free_bytes = c->keep_free_bytes,
                                           .sync_ns = c->sync_ns,
                                           .health = ring_health,
                                           .beside = ring_beside,
                                           .ctx = r};
    pthread_mutex_init(&r->lock, NULL);
    pthread_mutex_init(&r->strays_lock, NULL);
    pvx_cond_init(&r->came, CLOCK_MONOTONIC);
    r->item = pvx_calloc(r->size, sizeof *r->item);
    r->strays = pvx_calloc(strays, sizeof *r->strays);
    pvx_err e =
        r->item != NULL && r->strays != NULL ? cap_recorder_new(&rc, &r->recorder) : PVX_ENOMEM;
    if (e != PVX_OK) {
        cap_ring_free(&r);
        return e;
    }
    for (uint64_t i = 0; i < strays; i++) {
        r->strays[i].free = r->free_stray;
        r->free_stray = &r->strays[i];
    }
    r->to = cap_recorder_tap(r->recorder);
    r->stats.frames = c->frames;
    r->stats.bytes_max = c->bytes;
    *out = r;
    return PVX_OK;
}

pvx_err cap_ring_start(cap_ring *r, struct pvx_diag *d)
{
    if (pthread_create(&r->thread, NULL, ring_loop, r) != 0)
        return pvx_fail(d, PVX_EIO, "record.ring: no thread to be had");
    pthread_setname_np(r->thread, "ring");
    pthread_mutex_lock(&r->lock);
    r->running = true;
    pthread_mutex_unlock(&r->lock);
    return PVX_OK;
}

void cap_ring_stats(cap_ring *r, struct cap_ring_stats *out)
{
    pthread_mutex_lock(&r->lock);
    *out = r->stats;
    out->waiting = r->n_orders;
    out->behind = r->active ? r->end - (r->cursor > r->tail ? r->cursor : r->tail) : 0;
    for (uint32_t c = 0; c < r->cfg.n_cameras; c++)
        out->held = r->held[c] > out->held ? r->held[c] : out->held;
    if (r->end > r->tail)
        out->seconds = (double)(ring_at(r, r->end - 1)->t_ns - ring_at(r, r->tail)->t_ns) * 1e-9;
    pthread_mutex_unlock(&r->lock);
}

void cap_ring_stop(cap_ring *r)
{
    pthread_mutex_lock(&r->lock);
    bool running = r->running;
    r->running = false;
    r->stopping = true;
    pthread_cond_broadcast(&r->came);
    pthread_mutex_unlock(&r->lock);
    if (running) {
        cap_recorder_hurry(r->recorder);
        pthread_join(r->thread, NULL);
    }
    while (r->tail < r->end)
        ring_evict(r);
}

void cap_ring_free(cap_ring **rp)
{
    cap_ring *r = *rp;
    if (r == NULL)
        return;
    *rp = NULL;
    if (r->item != NULL)
        cap_ring_stop(r);
    cap_recorder_free(&r->recorder);
    pthread_mutex_destroy(&r->lock);
    pthread_mutex_destroy(&r->strays_lock);
    pthread_cond_destroy(&r->came);
    free(r->item);
    free(r->strays);
    free(r);
}
