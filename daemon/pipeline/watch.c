#include "daemon/pipeline/watch.h"

#include <math.h>
#include <limits.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#include "base/bell.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "recon/check/drift.h"
#include "recon/check/plausible.h"
#include "recon/frame/inside.h"
#include "recon/vote/wrong.h"

#define LEAST    19   /* nice */
#define REST     4    /* times as long as it worked */
#define ACROSS   160  /* bins across its pictures, about */
#define PATIENCE 2    /* checks */
#define DOUBT    0.02 /* share of the light outside the volume from which on hypotheses are tried */
#define NONE_NS  (5 * PVX_NS_PER_S) /* without a set, until a request fails */

/* What is kept of a frame set. */
struct glimpse {
    uint64_t number, mask, out; /* cameras that it has; those that the vote left out */
    uint8_t why[REC_MAX_CAMERAS];
    float *picture; /* [rows], one channel */
};

struct dmn_watch {
    const struct rec_rig *rig;
    char rig_path[PATH_MAX];
    bool at_least;
    struct rec_rig lenient; /* for checks, which leave small displacements to the drift */
    const rec_sysmat *S;
    int32_t times; /* a bin of its pictures is times x times bins of S */
    size_t row0[REC_MAX_CAMERAS + 1];
    struct glimpse last, kept[DMN_WATCH_SETS];
    struct glimpse *into; /* where the next set goes; owner as of more */
    int more;             /* sets still to come; offer owns it while wanted, else the thread */
    atomic_bool wanted, ending;
    _Atomic int64_t wanted_ns; /* mono, since when the next set is waited for */
    atomic_uint asked;         /* requests */
    unsigned answered;         /* of these; the thread's */
    struct pvx_bell bell;
    pthread_t thread;
    bool started;
    /* the thread's */
    rec_check *check;
    rec_drift *drift;
    rec_plausible *plausible;
    enum rec_cause said; /* what is wrong with rig and pictures, as it was said */
    bool asked_once;     /* whether they belong together, of sets with flame */
    const float *picture[REC_MAX_CAMERAS];
    struct rec_check_verdict verdict;
    int64_t since;        /* worked_ns when the check went on */
    pthread_mutex_t lock; /* of what follows */
    struct dmn_rig_state state[REC_MAX_CAMERAS];
    struct dmn_checks checks;
    struct dmn_belong belong;
    struct dmn_check_request request;
    bool broken; /* the thread could not begin */
};

/* ---- the carve stage's side ---------------------------------------------------------------------- */

/* One bin: the mean over the channels of each channel's mean over the values of positive weight; NAN if a channel has
 * none.  A camera that was left out has no weights; in a mosaic its b is then 0 where a channel has no value. */
static float bin(const rec_frame *f, bool out, size_t first, size_t pitch, int32_t times)
{
    const float *b = rec_frame_rhs(f), *w4 = rec_frame_weight4(f), *w = rec_frame_weight(f);
    size_t nch = (size_t)rec_frame_channels(f), cs = nch == 3 ? 4 : 1;
    float total = 0;
    for (size_t l = 0; l < nch; l++) {
        float sum = 0, n = 0;
        for (int32_t y = 0; y < times; y++)
            for (int32_t x = 0; x < times; x++) {
                size_t i = first + (size_t)y * pitch + (size_t)x;
                float v = b[i * cs + l];
                bool there = out ? w4 == NULL || v != 0 : (w4 != NULL ? w4[i * 4 + l] : w[i]) > 0;
                sum += there ? v : 0;
                n += there;
            }
        total += sum / n; /* 0/0: NAN */
    }
    return total / (float)nch;
}

static void watch_copy(const dmn_watch *w, const rec_frame *f, size_t c, struct glimpse *g)
{
    const struct rec_sysmat_block *B = &w->S->block[c];
    float *to = g->picture + w->row0[c];
    bool out = (g->out >> c & 1) != 0;
    for (int32_t y = 0; y + w->times <= B->bh; y += w->times)
        for (int32_t x = 0; x + w->times <= B->bw; x += w->times)
            *to++ = bin(f, out, w->S->row0[c] + (size_t)y * (size_t)B->bw + (size_t)x,
                        (size_t)B->bw, w->times);
}

void dmn_watch_offer(dmn_watch *w, const struct dmn_slot *s)
{
    if (w == NULL || !atomic_load_explicit(&w->wanted, memory_order_acquire))
        return;
    const struct rec_verdict *v = &rec_frame_get_report(s->frame)->vote;
    struct glimpse *g = w->into++;
    g->number = s->set;
    g->mask = s->mask;
    g->out = v->out;
    memcpy(g->why, v->why, sizeof g->why);
    for (size_t c = 0; c < w->rig->n_cameras; c++)
        if ((g->mask >> c & 1) != 0)
            watch_copy(w, s->frame, c, g);
    atomic_store(&w->wanted_ns, pvx_now_mono());
    if (--w->more > 0)
        return;
    atomic_store(&w->wanted, false);
    pvx_bell_ring(&w->bell);
}

/* ---- the thread ---------------------------------------------------------------------------------- */

/* The watch ends, or a request waits. */
static bool watch_hurry(const dmn_watch *w)
{
    return atomic_load(&w->ending) || atomic_load(&w->asked) != w->answered;
}

/* Wait for the next n sets; false: the watch ends. */
static bool pipeline_take(dmn_watch *w, struct glimpse *into, int n)
{
    w->into = into;
    w->more = n;
    atomic_store(&w->wanted_ns, pvx_now_mono());
    atomic_store(&w->wanted, true);
    while (atomic_load(&w->wanted) && !atomic_load(&w->ending))
        pvx_bell_wait(&w->bell, INT64_MAX);
    return !atomic_load(&w->ending);
}

static void watch_tell(dmn_watch *w, const rec_drift *d, uint64_t changed)
{
    for (size_t c = 0; c < w->rig->n_cameras; c++) {
        const struct rec_drift_camera *k = rec_drift_of(d, c);
        const char *name = w->rig->cameras[c].name;
        double far = hypot(k->since[0], k->since[1]);
        const double *by = far > 0 ? k->since : k->px;
        pthread_mutex_lock(&w->lock);
        struct dmn_rig_state *s = &w->state[c];
        s->moved = k->moved;
        s->looks = k->looks;
        for (int a = 0; a < 2; a++)
            s->px[a] = k->px[a];
        s->alarms += (changed >> c & 1) && k->moved;
        pthread_mutex_unlock(&w->lock);
        if ((changed >> c & 1) == 0)
            continue;
        if (k->moved)
            LOG_ABOUT(
                PVX_LOG_WARN, DAEMON, ABOUT(.cause = "moved", .camera = name),
                "camera %s has moved: its pictures are %.1f px to the %s and %.1f px %s of where "
                "the others see the flame; %s",
                name, fabs(by[0]), by[0] < 0 ? "left" : "right", fabs(by[1]),
                by[1] < 0 ? "above" : "below", rec_wrong_remedy(REC_WRONG_MOVED));
        else
            LOG_ABOUT(PVX_LOG_INFO, DAEMON, ABOUT(.cause = "moved", .camera = name),
                      "camera %s is again where the rig says", name);
    }
}

/* Processor time of this thread. */
static int64_t worked_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return t.tv_sec * PVX_NS_PER_S + t.tv_nsec;
}

static void rest(dmn_watch *w, int64_t worked)
{
    int64_t until = pvx_now_mono() + REST * worked;
    while (!watch_hurry(w) && pvx_now_mono() < until)
        pvx_bell_wait(&w->bell, until);
}

/* The set's pictures of the cameras in mask, valid until the next call. */
static const float *const *watch_pictures(dmn_watch *w, const struct glimpse *g, uint64_t mask)
{
    for (size_t c = 0; c < w->rig->n_cameras; c++)
        w->picture[c] = (mask >> c & 1) != 0 ? g->picture + w->row0[c] : NULL;
    return w->picture;
}

/* One set for the drift.  Returns the processor time that it took. */
static int64_t pipeline_look(dmn_watch *w)
{
    uint64_t changed;
    if (!pipeline_take(w, &w->last, 1))
        return 0;
    int64_t t0 = worked_ns();
    if (rec_drift_add(w->drift, watch_pictures(w, &w->last, w->last.mask & ~w->last.out), true,
                      &changed) == PVX_OK)
        watch_tell(w, w->drift, changed);
    int64_t worked = worked_ns() - t0;
    rest(w, worked);
    return worked;
}

/* ---- a check ---- */

static pvx_err watch_get(void *ctx, size_t i, struct rec_check_set *out)
{
    dmn_watch *w = ctx;
    const struct glimpse *g = &w->kept[i];
    *out = (struct rec_check_set){g->number, watch_pictures(w, g, g->mask), true};
    return PVX_OK;
}

/* After a set of the check: rest, then work as long for the drift. */
static bool pause_for_others(void *ctx, double done)
{
    dmn_watch *w = ctx;
    int64_t worked = worked_ns() - w->since;
    (void)done;
    rest(w, worked);
    for (size_t i = 0; i < w->rig->n_cameras && worked > 0 && !watch_hurry(w); i++)
        worked -= pipeline_look(w);
    w->since = worked_ns();
    return !watch_hurry(w);
}

/* Doubted cameras stay out of the check's volumes: missing ones, those left out of all sets by the vote, those that
 * the drift or earlier checks found wrong.  If too few others are left to agree, only missing cameras are doubted.
 * False: too few cameras are present. */
static bool whom_to_doubt(const dmn_watch *w, uint64_t *there, bool doubted[REC_MAX_CAMERAS])
{
    uint64_t mask = 0, out = UINT64_MAX;
    size_t n = w->rig->n_cameras, present = 0, left = 0;
    for (int i = 0; i < DMN_WATCH_SETS; i++) {
        mask |= w->kept[i].mask;
        out &= w->kept[i].out;
    }
    for (size_t c = 0; c < n; c++) {
        bool in = (mask >> c & 1) != 0;
        doubted[c] = !in || (out >> c & 1) != 0 || rec_drift_of(w->drift, c)->moved ||
                     w->checks.camera[c].figures.wrong != REC_WRONG_NOTHING;
        present += in;
        left += !doubted[c];
    }
    for (size_t c = 0; c < n && (left < REC_CHECK_LEAST || 2 * left <= n); c++)
        doubted[c] = (mask >> c & 1) == 0;
    *there = mask;
    return present >= REC_CHECK_LEAST;
}

/* What the drift and the vote say of the cameras. */
static void what_is_known(const dmn_watch *w, uint8_t known[REC_MAX_CAMERAS])
{
    const struct glimpse *g = &w->last;
    for (size_t c = 0; c < w->rig->n_cameras; c++)
        known[c] = rec_drift_of(w->drift, c)->moved ? REC_WRONG_MOVED
                   : (g->out >> c & 1) != 0         ? g->why[c]
                                                    : REC_WRONG_NOTHING;
}

/* Hypotheses are worth their time. */
static bool watch_doubts(const dmn_watch *w, const struct rec_plausible_verdict *facts)
{
    return !w->asked_once || w->said != REC_CAUSE_NONE || w->checks.n_wrong > 0 ||
           w->kept[DMN_WATCH_SETS - 1].out != 0 || facts->cause != REC_CAUSE_NONE ||
           facts->outside > DOUBT;
}

/* Whether the kept sets and the rig belong together.  A change is a line in the log. */
static pvx_err watch_belong(dmn_watch *w, bool asked, struct dmn_belong *out)
{
    static const char take[] = "TAKE.h5"; /* of `pyrovox ctl record` */
    rec_unseen *u = rec_check_unseen(w->check);
    struct rec_plausible_verdict *v = &out->verdict;
    char line[REC_PLAUSIBLE_LINE];
    const int64_t t0 = worked_ns();
    rec_plausible_begin(w->plausible);
    for (int i = 0; i < DMN_WATCH_SETS; i++) {
        rec_unseen_load(u, watch_pictures(w, &w->kept[i], w->kept[i].mask), true);
        rec_plausible_add_unseen(w->plausible, u, w->kept[i].number);
    }
    PVX_TRY(rec_plausible_judge(w->plausible, REC_PLAUSIBLE_FACTS, w->rig_path, take, v));
    const bool all = asked || watch_doubts(w, v);
    if (all)
        PVX_TRY(rec_plausible_judge(w->plausible, REC_PLAUSIBLE_HYPOTHESES, w->rig_path, take, v));
    else
        v->before = w->belong.verdict.before;
    out->set = w->kept[DMN_WATCH_SETS - 1].number;
    if (v->cause != REC_CAUSE_DARK) {
        rec_plausible_line(v, line);
        if (v->cause != w->said || (!w->asked_once && all))
            LOG_ABOUT(v->cause == REC_CAUSE_NONE ? PVX_LOG_INFO : PVX_LOG_WARN, DAEMON,
                      ABOUT(.cause = "implausible"), "pictures and rig: %s", line);
        w->said = v->cause;
        w->asked_once = true;
        pthread_mutex_lock(&w->lock);
        out->judged = w->belong.judged + 1;
        w->belong = *out;
        pthread_mutex_unlock(&w->lock);
    }
    if (!asked)
        rest(w, worked_ns() - t0);
    return PVX_OK;
}

static void watch_answer(dmn_watch *w)
{
    struct dmn_belong found = {.judged = 0};
    unsigned n = atomic_load(&w->asked);
    if (!pipeline_take(w, w->kept, DMN_WATCH_SETS))
        return;
    pvx_err e = watch_belong(w, true, &found);
    pthread_mutex_lock(&w->lock);
    w->request.state = e == PVX_OK ? DMN_TAKING_DONE : DMN_TAKING_FAILED;
    w->request.found = found;
    snprintf(w->request.why.text, sizeof w->request.why.text, "%s", pvx_strerror(e));
    w->answered = n;
    pthread_mutex_unlock(&w->lock);
}

static void watch_check(dmn_watch *w)
{
    bool doubted[REC_MAX_CAMERAS];
    uint8_t known[REC_MAX_CAMERAS];
    struct dmn_checks_news news = {.verdict = &w->verdict, .known = known};
    struct pvx_diag why = {""};
    struct dmn_belong belong;
    const struct rec_check_source sets = {DMN_WATCH_SETS, watch_get, pause_for_others, w, doubted};
    if (!whom_to_doubt(w, &news.mask, doubted))
        return;
    pvx_err e = watch_belong(w, false, &belong);
    w->since = worked_ns();
    PVX_THEN(e, rec_check_run(w->check, &w->lenient, &sets, &w->verdict, &why));
    if (e == PVX_ECANCELED)
        return;
    what_is_known(w, known);
    pthread_mutex_lock(&w->lock);
    if (e == PVX_OK)
        dmn_checks_add(&w->checks, &news, w->rig, &dmn_votes_log);
    else
        w->checks.failed++;
    pthread_mutex_unlock(&w->lock);
}

/* ---- all of it ---- */

static pvx_err watch_begin(dmn_watch *w, struct pvx_diag *d)
{
    const struct rec_drift_params p = REC_DRIFT_DEFAULTS;
    struct rec_unseen_params u = REC_UNSEEN_DEFAULTS;
    int32_t longest = 0;
    for (int a = 0; a < 3; a++)
        longest = w->S->grid.n[a] > longest ? w->S->grid.n[a] : longest;
    if (u.voxels > longest) /* no finer than the volumes */
        u.voxels = longest > 4 ? longest : 4;
    u.binning = w->S->binning * w->times;
    PVX_TRY(rec_rig_copy(w->rig, &w->lenient));
    for (size_t c = 0; c < w->rig->n_cameras; c++) {
        double *px = &w->lenient.cameras[c].uncertainty.px_95;
        *px = fmax(*px, rec_drift_off(&p, u.binning));
    }
    PVX_TRY(rec_check_new(&w->lenient, &u, NULL, &w->check, d));
    if (rec_plausible_new(w->rig, u.binning, &w->plausible) != PVX_OK)
        return pvx_fail(d, PVX_ENOMEM, "watch: out of memory");
    if (w->at_least)
        rec_plausible_at_least(w->plausible);
    rec_plausible_stop(w->plausible, &w->ending);
    return rec_drift_new(rec_check_unseen(w->check), &p, &w->drift, d);
}

static void *watch_run(void *arg)
{
    dmn_watch *w = arg;
    struct pvx_diag why = {""};
    struct dmn_belong first;
    setpriority(PRIO_PROCESS, 0,
                LEAST); /* Linux: of this thread; if it is refused, the rests suffice */
    if (watch_begin(w, &why) != PVX_OK) {
        LOG_W(DAEMON, "cameras that go wrong are not noticed: %s", why.text);
        pthread_mutex_lock(&w->lock);
        w->broken = true;
        pthread_mutex_unlock(&w->lock);
        return NULL;
    }
    if (pipeline_take(w, w->kept, DMN_WATCH_SETS) && watch_belong(w, false, &first) == PVX_ENOMEM)
        LOG_W(DAEMON, "rig and pictures are not compared: out of memory");
    while (!atomic_load(&w->ending)) {
        if (watch_hurry(w)) {
            watch_answer(w);
            continue;
        }
        bool all = true;
        for (int i = 0; i < DMN_WATCH_SETS && all; i += DMN_WATCH_RUN) {
            for (size_t c = 0; c < w->rig->n_cameras && !watch_hurry(w); c++)
                pipeline_look(w); /* the flame moves on meanwhile */
            all = !watch_hurry(w) && pipeline_take(w, &w->kept[i], DMN_WATCH_RUN);
        }
        if (all && !watch_hurry(w))
            watch_check(w);
    }
    return NULL;
}

/* ---- life ---------------------------------------------------------------------------------------- */

pvx_err dmn_watch_new(const struct rec_rig *rig, const char *rig_path, bool at_least,
                      const rec_sysmat *S, dmn_watch **out, struct pvx_diag *d)
{
    *out = NULL;
    if (rig->n_cameras < REC_DRIFT_LEAST)
        return PVX_OK;
    dmn_watch *w = *out = pvx_calloc(1, sizeof *w);
    if (w == NULL)
        return pvx_fail(d, PVX_ENOMEM, "watch: out of memory");
    w->rig = rig;
    snprintf(w->rig_path, sizeof w->rig_path, "%s", rig_path);
    w->at_least = at_least;
    w->S = S;
    pthread_mutex_init(&w->lock, NULL);
    pvx_bell_init(&w->bell);
    w->times = 1;
    for (bool more = true; more;) {
        for (size_t c = 0; c < rig->n_cameras; c++)
            more = more && S->block[c].bw / (2 * w->times) >= ACROSS &&
                   S->block[c].bw % (2 * w->times) == 0 && S->block[c].bh % (2 * w->times) == 0;
        w->times *= more ? 2 : 1;
    }
    for (size_t c = 0; c < rig->n_cameras; c++)
        w->row0[c + 1] =
            w->row0[c] + (size_t)(S->block[c].bw / w->times) * (size_t)(S->block[c].bh / w->times);
    w->checks.patience = PATIENCE;
    size_t rows = w->row0[rig->n_cameras];
    w->last.picture = pvx_calloc(rows * (1 + DMN_WATCH_SETS), sizeof(float));
    for (size_t i = 0; i < DMN_WATCH_SETS && w->last.picture != NULL; i++)
        w->kept[i].picture = w->last.picture + rows * (i + 1);
    pvx_err e = w->last.picture == NULL ? PVX_ENOMEM : PVX_OK;
    if (e == PVX_OK && pthread_create(&w->thread, NULL, watch_run, w) != 0)
        e = PVX_EIO;
    if (e != PVX_OK) {
        dmn_watch_free(out);
        return pvx_fail(d, e, "watch: %s", pvx_strerror(e));
    }
    w->started = true;
    pthread_setname_np(w->thread, "watch");
    return PVX_OK;
}

void dmn_watch_free(dmn_watch **wp)
{
    dmn_watch *w = *wp;
    if (w == NULL)
        return;
    atomic_store(&w->ending, true);
    pvx_bell_ring(&w->bell);
    if (w->started)
        pthread_join(w->thread, NULL);
    pvx_bell_fini(&w->bell);
    pthread_mutex_destroy(&w->lock);
    rec_drift_free(&w->drift);
    rec_check_free(&w->check);
    rec_plausible_free(&w->plausible);
    rec_rig_fini(&w->lenient);
    free(w->last.picture);
    PVX_FREE(*wp);
}

void dmn_watch_state(dmn_watch *w, struct dmn_state *out)
{
    if (w == NULL)
        return;
    pthread_mutex_lock(&w->lock);
    memcpy(out->rig, w->state, sizeof out->rig);
    out->checks = w->checks;
    out->belong = w->belong;
    pthread_mutex_unlock(&w->lock);
}

/* ---- a request ---- */

pvx_err dmn_watch_ask(dmn_watch *w, struct pvx_diag *d)
{
    if (w == NULL)
        return pvx_fail(d, PVX_ENOENT,
                        "fewer than %d cameras cannot contradict each other: nothing is checked",
                        REC_DRIFT_LEAST);
    pthread_mutex_lock(&w->lock);
    bool broken = w->broken;
    if (!broken && w->request.state != DMN_TAKING_NOW) {
        w->request.state = DMN_TAKING_NOW;
        w->request.request++;
        atomic_fetch_add(&w->asked, 1);
    }
    pthread_mutex_unlock(&w->lock);
    pvx_bell_ring(&w->bell);
    return broken ? pvx_fail(d, PVX_ENOMEM, "no memory for a check") : PVX_OK;
}

void dmn_watch_asked(dmn_watch *w, struct dmn_check_request *out)
{
    pthread_mutex_lock(&w->lock);
    if (w->request.state == DMN_TAKING_NOW && atomic_load(&w->wanted) &&
        pvx_now_mono() - atomic_load(&w->wanted_ns) > NONE_NS) {
        w->request.state = DMN_TAKING_FAILED;
        pvx_fail(&w->request.why, PVX_ETIMEDOUT,
                 "no frame set came for 5 s; look at `pyrovox status`");
    }
    *out = w->request;
    pthread_mutex_unlock(&w->lock);
    out->n_cameras = w->rig->n_cameras;
    for (size_t c = 0; c < out->n_cameras; c++)
        snprintf(out->camera[c], sizeof out->camera[c], "%s", w->rig->cameras[c].name);
}
