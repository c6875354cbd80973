#include "daemon/pipeline/draws.h"

#include <errno.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <sys/resource.h>
#include <time.h>

#include "base/clock.h"
#include "base/mem.h"
#include "recon/frame/inside.h"
#include "recon/frame/running.h"

#define LEAST      19 /* nice */
#define PAUSE_NS   (2 * PVX_NS_PER_S)
#define PAUSE_SETS 40         /* or so many periods, if that is longer */
#define SHARE      (1 / 16.0) /* of the newest set in the mean of waiting */

struct dmn_draws {
    void (*give_back)(void *ctx, struct dmn_slot *s);
    void *ctx;
    pvx_pool *pool; /* of the stages, for dmn_draws_bars */
    rec_running *running;
    _Atomic(rec_kept *) spare;             /* NULL: a set has it, which is or will be repeated */
    rec_kept *kept;                        /* the same, for free */
    _Atomic(struct dmn_slot *) todo, done; /* for the thread, and by it */
    sem_t bell;                            /* todo, or ending */
    pthread_t thread;
    bool started;
    atomic_bool ending;
    atomic_uint_fast64_t made, left_out[DMN_N_LEFT_OUT];
    _Atomic int64_t busy_ns, cpu_ns; /* of the thread: wall time of the solves, processor time */
    atomic_uint solves, doubt;       /* of the last bars */
    atomic_bool none;                /* there were none */

    /* the solve stage's */
    struct dmn_draws_load before;
    double waiting;   /* share of the time that the solver waited lately */
    int64_t cpu[2];   /* processor time of the thread, of all else, */
    double lately[2]; /* and lately */
    int rest;         /* sets until the last drop is forgotten */
    uint32_t touched;
    bool gain, shift;
};

/* ---- the thread ---------------------------------------------------------------------------------*/

static int64_t draws_cpu_ns(clockid_t of)
{
    struct timespec t = {0};
    clock_gettime(of, &t);
    return t.tv_sec * PVX_NS_PER_S + t.tv_nsec;
}

static void draws_repeat(dmn_draws *w, struct dmn_slot *s)
{
    const struct rec_running_set set = {.seed = s->set, .t_ns = s->t_exposure_ns, .age = s->age};
    int64_t t0 = pvx_now_mono();
    bool added = !atomic_load(&w->ending) && rec_running_add(w->running, s->frame, &set);
    atomic_fetch_add(added ? &w->made : &w->left_out[DMN_LEFT_OUT_VOID], 1);
    if (added)
        atomic_fetch_add(&w->busy_ns, pvx_now_mono() - t0);
    atomic_store(&w->cpu_ns, draws_cpu_ns(CLOCK_THREAD_CPUTIME_ID));
}

static void *draws_run(void *arg)
{
    dmn_draws *w = arg;
    setpriority(PRIO_PROCESS, 0, LEAST); /* Linux: of this thread */
    for (;;) {
        while (sem_wait(&w->bell) != 0 && errno == EINTR)
            ;
        struct dmn_slot *s = atomic_exchange(&w->todo, NULL);
        if (s == NULL)
            return NULL; /* rung at the end */
        draws_repeat(w, s);
        atomic_store(&w->done, s);
    }
}

/* ---- what the stages call -----------------------------------------------------------------------*/

void dmn_draws_outdate(dmn_draws *w)
{
    if (w != NULL)
        rec_running_outdate(w->running);
}

void dmn_draws_carved(dmn_draws *w, struct dmn_slot *s)
{
    if (w != NULL)
        s->age = rec_running_age(w->running);
}

/* Whether the live path has no time to spare. */
static bool draws_pressed(dmn_draws *w, const struct dmn_draws_load *load)
{
    int64_t passed = load->now_ns - w->before.now_ns;
    if (w->before.now_ns != 0 && passed > 0) {
        double share = (double)(load->waited_ns - w->before.waited_ns) / (double)passed;
        w->waiting += SHARE * (share - w->waiting);
    }
    w->rest -= w->rest > 0;
    if (load->dropped != w->before.dropped)
        w->rest = DMN_DRAWS_REST;
    w->before = *load;
    return load->waiting || w->rest > 0 || w->waiting < DMN_DRAWS_LEAST;
}

/* Whether the thread has had its share of the processor time. */
static bool draws_dear(dmn_draws *w)
{
    int64_t own = atomic_load(&w->cpu_ns), all = draws_cpu_ns(CLOCK_PROCESS_CPUTIME_ID);
    const int64_t now[2] = {own, all - own};
    bool first = w->cpu[1] == 0;
    for (int i = 0; i < 2; i++) {
        w->lately[i] *= 1 - 1.0 / DMN_DRAWS_MEAN;
        w->lately[i] += first ? 0 : (double)(now[i] - w->cpu[i]);
        w->cpu[i] = now[i];
    }
    return w->lately[0] > DMN_DRAWS_SHARE * w->lately[1];
}

/* Other corrections of the cameras make other errors. */
static void draws_compare(dmn_draws *w, const struct rec_selfcal_report *r)
{
    uint32_t touched = 0;
    for (uint32_t c = 0; c < r->cameras; c++)
        touched += r->camera[c].touched;
    if (touched != w->touched || r->gain != w->gain || r->shift != w->shift)
        rec_running_outdate(w->running);
    w->touched = touched;
    w->gain = r->gain;
    w->shift = r->shift;
}

/* Gives back what the thread has done with. */
static void draws_collect(dmn_draws *w)
{
    struct dmn_slot *s = atomic_exchange(&w->done, NULL);
    if (s == NULL)
        return;
    rec_kept *k = rec_frame_release(s->frame);
    s->again = false;
    w->give_back(w->ctx, s);
    atomic_store(&w->spare, k); /* after that: no two sets may hold systems for it */
}

bool dmn_draws_offer(dmn_draws *w, struct dmn_slot *s, const struct dmn_draws_load *load)
{
    if (w == NULL)
        return false;
    const struct rec_frame_report *r = rec_frame_get_report(s->frame);
    draws_compare(w, &r->selfcal);
    enum dmn_left_out why = DMN_N_LEFT_OUT;
    rec_kept *k = NULL;
    draws_collect(w);
    bool dear = draws_dear(w);
    if (draws_pressed(w, load) || r->solve.status == REC_DEADLINE)
        why = DMN_LEFT_OUT_TIME;
    else if (r->active_voxels == 0 || s->age != rec_running_age(w->running))
        why = DMN_LEFT_OUT_VOID;
    else if (dear)
        why = DMN_LEFT_OUT_SHARE;
    else if ((k = atomic_exchange(&w->spare, NULL)) == NULL)
        why = DMN_LEFT_OUT_BUSY;
    if (why != DMN_N_LEFT_OUT) {
        atomic_fetch_add(&w->left_out[why], 1);
        return false;
    }
    rec_frame_keep(s->frame, k, NULL);
    return s->again = true;
}

void dmn_draws_bars(dmn_draws *w, struct dmn_slot *s)
{
    if (w == NULL)
        return;
    rec_running_bars(w->running, s->frame, s->t_exposure_ns, w->pool, &s->bars);
    atomic_store(&w->solves, s->bars.solves);
    atomic_store(&w->doubt, s->bars.doubt);
    atomic_store(&w->none, s->bars.sd == NULL);
}

void dmn_draws_take(dmn_draws *w, struct dmn_slot *s)
{
    atomic_store(&w->todo, s); /* one set at a time has the spare problem */
    sem_post(&w->bell);
}

void dmn_draws_cancel(dmn_draws *w, struct dmn_slot *s)
{
    if (w == NULL || !s->again)
        return;
    atomic_fetch_add(&w->left_out[DMN_LEFT_OUT_VOID], 1);
    rec_kept *k = rec_frame_release(s->frame);
    s->again = false;
    atomic_store(&w->spare, k);
}

/* ---- life ---------------------------------------------------------------------------------------*/

pvx_err dmn_draws_new(const struct dmn_pipeline_params *p,
                      void (*give_back)(void *ctx, struct dmn_slot *s), void *ctx, dmn_draws **out,
                      struct pvx_diag *d)
{
    dmn_draws *w = *out = pvx_calloc(1, sizeof *w);
    int64_t sets = PAUSE_SETS * p->period_ns;
    PVX_NEED(w);
    w->give_back = give_back;
    w->ctx = ctx;
    w->pool = p->pool;
    w->waiting = 1;
    atomic_store(&w->none, true);
    pvx_err e =
        rec_running_new(p->S, p->frame.nch, sets > PAUSE_NS ? sets : PAUSE_NS, &w->running, d);
    PVX_THEN(e, rec_kept_new(p->S, p->frame.nch, &w->kept));
    atomic_store(&w->spare, w->kept);
    (void)sem_init(&w->bell, 0, 0); /* with 0 it cannot fail */
    if (e != PVX_OK)
        dmn_draws_free(out);
    return e;
}

pvx_err dmn_draws_start(dmn_draws *w)
{
    if (pthread_create(&w->thread, NULL, draws_run, w) != 0)
        return PVX_EIO;
    w->started = true;
    pthread_setname_np(w->thread, "bars");
    return PVX_OK;
}

void dmn_draws_join(dmn_draws *w)
{
    if (w == NULL || !w->started)
        return;
    atomic_store(&w->ending, true);
    sem_post(&w->bell);
    pthread_join(w->thread, NULL);
    w->started = false;
}

void dmn_draws_free(dmn_draws **w)
{
    if (*w == NULL)
        return;
    rec_running_free(&(*w)->running);
    rec_kept_free(&(*w)->kept);
    sem_destroy(&(*w)->bell);
    PVX_FREE(*w);
}

void dmn_draws_state(dmn_draws *w, struct dmn_draws_state *out)
{
    *out = (struct dmn_draws_state){.on = w != NULL};
    if (w == NULL)
        return;
    out->made = atomic_load(&w->made);
    for (int i = 0; i < DMN_N_LEFT_OUT; i++)
        out->left_out[i] = atomic_load(&w->left_out[i]);
    out->none = atomic_load(&w->none);
    out->doubt = atomic_load(&w->doubt);
    out->in_average = atomic_load(&w->solves);
    out->mean_ms = out->made > 0 ? (double)atomic_load(&w->busy_ns) * 1e-6 / (double)out->made : 0;
}
