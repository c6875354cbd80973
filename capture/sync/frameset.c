#include "capture/sync/frameset.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/mem.h"

#define MAX_OPEN        32
#define N_SETS          128 /* open + finished + with the consumer; those that are held come on top */
#define DEFAULT_WAIT_NS (150 * PVX_NS_PER_MS)
#define PATIENT_WAIT_NS (500 * PVX_NS_PER_MS) /* WAIT */

struct slot {
    struct cap_set set; /* first: a set's address is its slot's */
    atomic_uint refs;
    struct set_pool *pool;
    struct slot *next;     /* in the free list or among the finished */
    int64_t lo_ns, hi_ns;  /* earliest and latest exposure of the members */
    int64_t first_mono_ns; /* arrival of the first */
    uint64_t recorded;     /* the set's number + 1 in its recording; 0 = live */
    uint32_t size;         /* of the recorded set */
};

/* The consumer's threads release sets, which may outlive the assembler, like frames of a cap_bufpool. */
struct set_pool {
    pthread_mutex_t lock;
    struct slot *free;
    unsigned n, n_free;
    bool orphan;
    struct slot slots[]; /* [n] */
};

struct cap_assembler {
    struct cap_assembler_params p;
    struct cap_sink counts;
    struct set_pool *pool;
    struct slot *open[MAX_OPEN]; /* by lo_ns, oldest first */
    unsigned n_open;
    struct slot *ready, **ready_tail;
    uint64_t alive;                   /* bit per camera */
    int64_t last_ns[CAP_MAX_CAMERAS]; /* exposure of each camera's last frame */
    bool closed_any;
    int64_t closed_ns; /* lo of the newest closed set: up to tolerance after it frames are late */
    unsigned late_run; /* frames late in a row */
    uint64_t late_of;  /* bit per camera that sent them */
    uint64_t number, failed;
    uint64_t recorded;                       /* newest recorded set that is closed */
    uint64_t last_recorded[CAP_MAX_CAMERAS]; /* set of each camera's last frame */
};

static struct slot *get_slot(struct set_pool *p)
{
    pthread_mutex_lock(&p->lock);
    struct slot *s = p->free;
    if (s != NULL) {
        p->free = s->next;
        p->n_free--;
    }
    pthread_mutex_unlock(&p->lock);
    if (s != NULL) {
        s->set = (struct cap_set){0};
        s->next = NULL;
        atomic_store(&s->refs, 1);
    }
    return s;
}

static void destroy_pool(struct set_pool *p)
{
    pthread_mutex_destroy(&p->lock);
    free(p);
}

static void put_slot(struct slot *s)
{
    struct set_pool *p = s->pool;
    pthread_mutex_lock(&p->lock);
    s->next = p->free;
    p->free = s;
    p->n_free++;
    bool last = p->orphan && p->n_free == p->n;
    pthread_mutex_unlock(&p->lock);
    if (last)
        destroy_pool(p);
}

void cap_set_ref(struct cap_set *set)
{
    atomic_fetch_add(&((struct slot *)set)->refs, 1);
}

void cap_set_release(struct cap_set *set)
{
    if (set == NULL || atomic_fetch_sub(&((struct slot *)set)->refs, 1) > 1)
        return;
    for (unsigned c = 0; c < CAP_MAX_CAMERAS; c++)
        cap_frame_release(set->frame[c]);
    put_slot((struct slot *)set);
}

pvx_err cap_assembler_new(const struct cap_assembler_params *params, const struct cap_sink *counts,
                          cap_assembler **out)
{
    *out = NULL;
    struct cap_assembler_params p = *params;
    if (p.tolerance_ns == 0)
        p.tolerance_ns = p.period_ns / 4;
    if (p.max_wait_ns == 0)
        p.max_wait_ns = p.policy == CAP_POLICY_WAIT ? PATIENT_WAIT_NS : DEFAULT_WAIT_NS;
    if (p.cameras < 1 || p.cameras > CAP_MAX_CAMERAS || p.min_cameras > p.cameras ||
        p.period_ns < 0 || p.tolerance_ns <= 0 || p.max_wait_ns < 0)
        return PVX_EINVAL;
    /* With half a period and jitter, one frame could fit two sets: pairs off by one. */
    if (p.period_ns > 0 && p.tolerance_ns >= p.period_ns / 2)
        return PVX_EINVAL;
    cap_assembler *a = pvx_calloc(1, sizeof *a);
    size_t n = N_SETS + (size_t)p.held;
    struct set_pool *pool = pvx_calloc(1, sizeof *pool + n * sizeof pool->slots[0]);
    if (a == NULL || pool == NULL) {
        free(a);
        free(pool);
        return PVX_ENOMEM;
    }
    pthread_mutex_init(&pool->lock, NULL);
    pool->n = pool->n_free = (unsigned)n;
    for (unsigned i = 0; i < n; i++) {
        pool->slots[i].pool = pool;
        pool->slots[i].next = pool->free;
        pool->free = &pool->slots[i];
    }
    a->p = p;
    a->counts = *counts;
    a->pool = pool;
    a->ready_tail = &a->ready;
    a->alive = p.cameras == 64 ? UINT64_MAX : (1ull << p.cameras) - 1;
    for (uint32_t c = 0; c < p.cameras; c++)
        a->last_ns[c] = INT64_MIN;
    *out = a;
    return PVX_OK;
}

void cap_assembler_free(cap_assembler **ap)
{
    cap_assembler *a = *ap;
    if (a == NULL)
        return;
    *ap = NULL;
    for (unsigned i = 0; i < a->n_open; i++)
        cap_set_release(&a->open[i]->set);
    struct cap_set *s;
    while ((s = cap_assembler_pop(a)) != NULL)
        cap_set_release(s);
    struct set_pool *p = a->pool;
    pthread_mutex_lock(&p->lock);
    p->orphan = true;
    bool last = p->n_free == p->n;
    pthread_mutex_unlock(&p->lock);
    if (last)
        destroy_pool(p);
    free(a);
}

static void discard(cap_assembler *a, struct cap_frame *f, enum cap_count why)
{
    a->counts.count(a->counts.ctx, f->camera, why, 1);
    if (a->counts.push != NULL)
        a->counts.push(a->counts.ctx, f);
    else
        cap_frame_release(f);
}

static struct slot *remove_open(cap_assembler *a, unsigned i)
{
    struct slot *s = a->open[i];
    a->n_open--;
    for (; i < a->n_open; i++)
        a->open[i] = a->open[i + 1];
    return s;
}

static void frameset_emit(cap_assembler *a, struct slot *s)
{
    struct cap_set *set = &s->set;
    double sum = 0;
    for (unsigned c = 0; c < a->p.cameras; c++)
        if (set->frame[c] != NULL)
            sum += (double)(set->frame[c]->t_exposure_ns - s->lo_ns);
    set->t_exposure_ns = s->lo_ns + (int64_t)(sum / set->n + 0.5);
    set->spread_ns = s->hi_ns - s->lo_ns;
    if (s->recorded != 0)
        a->number = s->recorded - 1;
    set->number = a->number++;
    *a->ready_tail = s;
    a->ready_tail = &s->next;
}

static void mark_closed(cap_assembler *a, int64_t lo_ns)
{
    if (!a->closed_any || lo_ns > a->closed_ns)
        a->closed_ns = lo_ns;
    a->closed_any = true;
}

static bool all_alive_in(const cap_assembler *a, const struct cap_set *s)
{
    for (unsigned c = 0; c < a->p.cameras; c++)
        if ((a->alive >> c & 1) && s->frame[c] == NULL)
            return false;
    return true;
}

static bool worth_giving_out(const cap_assembler *a, const struct slot *slot)
{
    const struct cap_set *s = &slot->set;
    if (s->n == a->p.cameras || (slot->recorded != 0 && s->n == slot->size))
        return true;
    if (a->p.policy == CAP_POLICY_DROP || s->n < a->p.min_cameras)
        return false;
    return a->p.policy == CAP_POLICY_PARTIAL || all_alive_in(a, s);
}

/* Close the i-th open set.  Before a set is given out, all older ones are closed, so that the order holds.  A set
 * that fails does not touch the others: a single frame with a stamp from the future must neither tear open sets
 * apart nor make all following frames late. */
static void close_set(cap_assembler *a, unsigned i)
{
    if (a->open[i]->recorded > a->recorded)
        a->recorded = a->open[i]->recorded;
    if (worth_giving_out(a, a->open[i])) {
        for (; i > 0; i--)
            close_set(a, 0);
        struct slot *s = remove_open(a, 0);
        mark_closed(a, s->lo_ns);
        frameset_emit(a, s);
        return;
    }
    struct slot *s = remove_open(a, i);
    if (s->set.n > 1)
        mark_closed(a, s->lo_ns);
    a->failed++;
    for (unsigned c = 0; c < a->p.cameras; c++)
        if (s->set.frame[c] != NULL)
            discard(a, s->set.frame[c], CAP_UNMATCHED);
    s->set = (struct cap_set){0};
    cap_set_release(&s->set);
}

/* Camera c's frame of this set will not come, because a later one has come.  A stamp far in the future does not
 * count: the stamp is wrong then. */
static bool passed_by(const cap_assembler *a, unsigned c, const struct slot *s)
{
    if (s->recorded != 0)
        return a->last_recorded[c] > s->recorded;
    int64_t ahead = a->p.max_wait_ns * 2 + a->p.tolerance_ns;
    return a->last_ns[c] > s->lo_ns + a->p.tolerance_ns && a->last_ns[c] <= s->lo_ns + ahead;
}

/* No frame that this set waits for can come any more. */
static bool is_final(const cap_assembler *a, const struct slot *s)
{
    if (s->recorded != 0 && s->set.n == s->size)
        return true;
    for (unsigned c = 0; c < a->p.cameras; c++)
        if ((a->alive >> c & 1) && s->set.frame[c] == NULL && !passed_by(a, c, s))
            return false;
    return a->alive != 0 || s->set.n == a->p.cameras;
}

/* Close all final sets, oldest first.  Closing one may close others too. */
static void close_final(cap_assembler *a)
{
    for (unsigned i = 0; i < a->n_open;) {
        if (is_final(a, a->open[i])) {
            close_set(a, i);
            i = 0;
        } else {
            i++;
        }
    }
}

/* Index of the open set that t fits, the one with the nearest middle; n_open if t fits none. */
static unsigned find_open(const cap_assembler *a, int64_t t)
{
    unsigned best = a->n_open;
    int64_t best_d = INT64_MAX;
    for (unsigned i = 0; i < a->n_open; i++) {
        int64_t lo = a->open[i]->lo_ns, hi = a->open[i]->hi_ns;
        if (a->open[i]->recorded != 0)
            continue;
        if ((t > hi ? t : hi) - (t < lo ? t : lo) > a->p.tolerance_ns)
            continue;
        int64_t d = llabs(t - (lo + (hi - lo) / 2));
        if (d < best_d) {
            best_d = d;
            best = i;
        }
    }
    return best;
}

static unsigned find_recorded(const cap_assembler *a, uint64_t recorded)
{
    unsigned i = 0;
    while (i < a->n_open && a->open[i]->recorded != recorded)
        i++;
    return i;
}

static bool older(const struct slot *x, const struct slot *y)
{
    if (x->recorded != 0 && y->recorded != 0)
        return x->recorded < y->recorded;
    return x->lo_ns < y->lo_ns;
}

/* Keep open[] sorted after open[i] has become older. */
static void sink_down(cap_assembler *a, unsigned i)
{
    for (; i > 0 && older(a->open[i], a->open[i - 1]); i--) {
        struct slot *s = a->open[i];
        a->open[i] = a->open[i - 1];
        a->open[i - 1] = s;
    }
}

/* Whether t is older than the sets given out.  When all cameras send only late frames for long, time has been
 * stepped back instead, and the order starts again. */
static bool is_late(cap_assembler *a, uint32_t camera, int64_t t)
{
    if (!a->closed_any || t > a->closed_ns + a->p.tolerance_ns) {
        a->late_run = 0;
        a->late_of = 0;
        return false;
    }
    a->late_of |= 1ull << camera;
    if (++a->late_run <= 4 * a->p.cameras || (a->alive & ~a->late_of) != 0)
        return true;
    cap_assembler_forget_order(a);
    return false;
}

/* Put f into its set, or discard it with a count. */
static void insert(cap_assembler *a, struct cap_frame *f, int64_t t)
{
    unsigned i = f->set != 0 ? find_recorded(a, f->set) : find_open(a, t);
    struct slot *s;
    if (i < a->n_open) {
        a->late_run = 0;
        a->late_of = 0;
        s = a->open[i];
        if (s->set.frame[f->camera] != NULL) {
            discard(a, f, CAP_UNMATCHED);
            return;
        }
        s->lo_ns = t < s->lo_ns ? t : s->lo_ns;
        s->hi_ns = t > s->hi_ns ? t : s->hi_ns;
    } else {
        if (f->set != 0 ? f->set <= a->recorded : is_late(a, f->camera, t)) {
            discard(a, f, CAP_LATE);
            return;
        }
        if (a->n_open == MAX_OPEN)
            close_set(a, 0);
        s = get_slot(a->pool);
        if (s == NULL) {
            discard(a, f, CAP_OVERFLOW);
            return;
        }
        s->lo_ns = s->hi_ns = t;
        s->recorded = f->set;
        s->size = f->set_size;
        s->first_mono_ns = f->t_arrival_mono_ns;
        s->set.t_last_mono_ns = f->t_arrival_mono_ns;
        i = a->n_open++;
        a->open[i] = s;
    }
    s->set.frame[f->camera] = f;
    s->set.n++;
    if (f->t_arrival_mono_ns > s->set.t_last_mono_ns)
        s->set.t_last_mono_ns = f->t_arrival_mono_ns;
    sink_down(a, i);
}

void cap_assembler_put(cap_assembler *a, struct cap_frame *f)
{
    int64_t t = f->t_exposure_ns;
    a->last_ns[f->camera] = t;
    a->last_recorded[f->camera] = f->set;
    insert(a, f, t);
    close_final(a);
}

void cap_assembler_refuse(cap_assembler *a, struct cap_frame *f)
{
    discard(a, f, CAP_UNMATCHED);
}

void cap_assembler_alive(cap_assembler *a, uint32_t camera, bool alive)
{
    uint64_t bit = 1ull << camera;
    if (alive == ((a->alive & bit) != 0))
        return;
    a->alive ^= bit;
    close_final(a);
}

void cap_assembler_shift(cap_assembler *a, int64_t by_ns)
{
    a->closed_ns += by_ns;
    for (unsigned c = 0; c < a->p.cameras; c++)
        if (a->last_ns[c] != INT64_MIN)
            a->last_ns[c] += by_ns;
    for (unsigned i = 0; i < a->n_open; i++) {
        struct slot *s = a->open[i];
        s->lo_ns += by_ns;
        s->hi_ns += by_ns;
        for (unsigned c = 0; c < a->p.cameras; c++)
            if (s->set.frame[c] != NULL)
                s->set.frame[c]->t_exposure_ns += by_ns;
    }
}

void cap_assembler_forget_order(cap_assembler *a)
{
    a->closed_any = false;
    a->late_run = 0;
    a->late_of = 0;
    for (unsigned c = 0; c < a->p.cameras; c++)
        a->last_ns[c] = INT64_MIN;
}

void cap_assembler_tick(cap_assembler *a, int64_t now_mono_ns)
{
    for (unsigned i = 0; i < a->n_open;) {
        if (a->open[i]->first_mono_ns + a->p.max_wait_ns <= now_mono_ns) {
            close_set(a, i);
            i = 0;
        } else {
            i++;
        }
    }
}

int64_t cap_assembler_deadline(const cap_assembler *a)
{
    int64_t first = INT64_MAX;
    for (unsigned i = 0; i < a->n_open; i++)
        if (a->open[i]->first_mono_ns < first)
            first = a->open[i]->first_mono_ns;
    return first == INT64_MAX ? first : first + a->p.max_wait_ns;
}

static bool is_before(const cap_assembler *a, const struct slot *s, const struct cap_frame *next)
{
    if (next->set != 0)
        return s->recorded != 0 && s->recorded < next->set;
    return s->lo_ns + a->p.tolerance_ns < next->t_exposure_ns;
}

void cap_assembler_close_before(cap_assembler *a, const struct cap_frame *next)
{
    while (a->n_open > 0 && is_before(a, a->open[0], next))
        close_set(a, 0);
}

struct cap_set *cap_assembler_pop(cap_assembler *a)
{
    struct slot *s = a->ready;
    if (s == NULL)
        return NULL;
    a->ready = s->next;
    if (a->ready == NULL)
        a->ready_tail = &a->ready;
    s->next = NULL;
    return &s->set;
}

void cap_assembler_flush(cap_assembler *a)
{
    while (a->n_open > 0)
        close_set(a, 0);
}

uint32_t cap_assembler_open(const cap_assembler *a)
{
    uint32_t n = 0;
    for (unsigned i = 0; i < a->n_open; i++)
        n += a->open[i]->set.n;
    return n;
}

uint64_t cap_assembler_sets_failed(const cap_assembler *a)
{
    return a->failed;
}
