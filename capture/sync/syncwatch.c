/* syncwatch.c - phases and rates; numbers are in syncnumber.c. */
#include "capture/sync/syncwatch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/median.h"
#include "capture/sync/syncwatch_int.h"

#define WINDOW_NS     (500 * PVX_NS_PER_MS)
#define MIN_PERIODS   8 /* in a window */
#define FAR_PERIODS   4 /* a frame more than this from the others' has a clock of another time */
#define ROUND_OFF     CAP_SYNC_ROUND_OFF /* for triggers from outside, which may be irregular */
#define ROUND_OFF_OWN 0.45
#define COARSE        0.3
#define FINE          0.01
#define HOST_NS       (9 * PVX_NS_PER_S) /* shortest time for a rate from stamps of the host */
#define MIN_WALK      4                  /* windows that make a line */
#define WALK_NS       500e3
#define UNSURE_NS     600e3 /* per s: how wrong the maps of two clocks may be at first */
#define PI            3.14159265358979323846

void cap_syncwatch_init(struct cap_syncwatch *w, const struct cap_syncwatch_params *p,
                        const struct cap_sink *counts,
                        void (*detail)(void *ctx, uint32_t camera, enum cap_count what,
                                       const char *text))
{
    memset(w, 0, sizeof *w);
    w->p = *p;
    w->counts = *counts;
    w->detail = detail;
    w->window_ns = MIN_PERIODS * p->period_ns > WINDOW_NS ? MIN_PERIODS * p->period_ns : WINDOW_NS;
    for (uint32_t c = 0; c < p->cameras; c++)
        cap_syncwatch_restart(w, c);
}

void cap_syncwatch_restart(struct cap_syncwatch *w, uint32_t camera)
{
    w->camera[camera] = (struct cap_sync_camera){.phase_ns = NAN, .walk_ns_per_s = NAN, .hz = NAN};
}

void cap_syncwatch_shift(struct cap_syncwatch *w, int64_t by_ns)
{
    w->t_set_ns += by_ns;
    for (uint32_t c = 0; c < w->p.cameras; c++) {
        struct cap_sync_camera *k = &w->camera[c];
        k->t_ns += by_ns;
        k->t0 += by_ns;
        for (unsigned i = 0; i < CAP_WALK_WINDOWS; i++)
            k->walk[i].t_ns += by_ns;
        cap_rate_forget(&k->rate); /* its stamps may be from the clock that was stepped */
    }
}

void cap_sync_found(struct cap_syncwatch *w, uint32_t c, enum cap_count what, uint64_t n,
                    const char *text)
{
    if (w->detail != NULL)
        w->detail(w->counts.ctx, c, what, text);
    w->counts.count(w->counts.ctx, c, what, n);
}

static double wrapped(double ns, double period)
{
    return ns - period * rint(ns / period);
}

/* Add the phase of this frame: its exposure against the others' last, by the median.  If their number is even, the
 * two middle values may be half a period apart; the one nearer to zero counts. */
static void note_phase(struct cap_syncwatch *w, struct cap_sync_camera *k)
{
    double near[CAP_MAX_CAMERAS], far[CAP_MAX_CAMERAS], period = (double)w->p.period_ns;
    unsigned n = 0, n_far = 0;
    for (uint32_t b = 0; b < w->p.cameras; b++) {
        const struct cap_sync_camera *o = &w->camera[b];
        if (o == k || !o->any || k->arrival_ns - o->arrival_ns > 2 * w->p.period_ns)
            continue;
        double d = (double)(k->t_ns - o->t_ns);
        if (fabs(d) > FAR_PERIODS * period)
            far[n_far++] = d;
        else
            near[n++] = wrapped(d, period);
    }
    if (n + n_far == 0)
        return;
    if (n_far > n) {
        k->far++;
        k->far_ns = (int64_t)pvx_median(far, n_far);
        return;
    }
    qsort(near, n, sizeof *near, pvx_ascending);
    double m = near[n / 2];
    if (n % 2 == 0 && fabs(near[n / 2 - 1]) < fabs(m))
        m = near[n / 2 - 1];
    k->cos += cos(2 * PI * m / period);
    k->sin += sin(2 * PI * m / period);
    k->phases++;
}

/* How far phases may move because the maps of clocks move.  The largest of all cameras, as a phase is relative. */
static double doubt(const struct cap_syncwatch *w)
{
    double most = 0;
    for (uint32_t c = 0; c < w->p.cameras; c++)
        if (w->camera[c].any)
            most = fmax(most, w->camera[c].doubt_ns);
    return most;
}

/* Straight line through the phases of the last n windows.  True if the line fits and the phase changes along it. */
static bool walks_over(const struct cap_syncwatch *w, const struct cap_sync_camera *k, unsigned n,
                       double doubt_ns, double *per_s)
{
    double mx = 0, my = 0, sxx = 0, sxy = 0, rest = 0;
    unsigned first = k->walk_head + CAP_WALK_WINDOWS - n;
    int64_t t0 = k->walk[first % CAP_WALK_WINDOWS].t_ns;
    double x[CAP_WALK_WINDOWS], y[CAP_WALK_WINDOWS];
    for (unsigned i = 0; i < n; i++) {
        x[i] = (double)(k->walk[(first + i) % CAP_WALK_WINDOWS].t_ns - t0) * 1e-9;
        y[i] = k->walk[(first + i) % CAP_WALK_WINDOWS].phase_ns;
        mx += x[i] / n;
        my += y[i] / n;
    }
    for (unsigned i = 0; i < n; i++) {
        sxx += (x[i] - mx) * (x[i] - mx);
        sxy += (x[i] - mx) * (y[i] - my);
    }
    *per_s = sxx > 0 ? sxy / sxx : 0;
    for (unsigned i = 0; i < n; i++) {
        double off = y[i] - my - *per_s * (x[i] - mx);
        rest += off * off / n;
    }
    double change = fabs(*per_s) * x[n - 1], scatter = sqrt(rest);
    double known = isfinite(doubt_ns) ? doubt_ns : 0;
    if (change > fmax((double)w->p.period_ns / 20, WALK_NS) + known && change > 6 * scatter)
        return true;
    double error = scatter * sqrt(n / ((n - 2) * sxx)) * x[n - 1];
    return n <= k->n_sure && change > WALK_NS + known &&
           change > cap_rate_quantile(n - 2) * error && change > 8 * scatter; /* a step gives 6 */
}

/* Tries few and many of the last windows: a walk may have begun a moment ago, or be slow. */
static bool walks(const struct cap_syncwatch *w, struct cap_sync_camera *k)
{
    double by = doubt(w), least = isfinite(by) ? 0 : UNSURE_NS;
    k->n_sure = isfinite(by) ? k->n_sure + 1 : 0;
    k->walk_ns_per_s = NAN;
    for (unsigned n = MIN_WALK; n <= k->n_walk; n += n / 4)
        if (walks_over(w, k, n, by, &k->walk_ns_per_s) && fabs(k->walk_ns_per_s) >= least)
            return true;
    return false;
}

static void judge_phase(struct cap_syncwatch *w, uint32_t c)
{
    struct cap_sync_camera *k = &w->camera[c];
    char text[96];
    double period = (double)w->p.period_ns;
    if (k->far > k->phases) {
        snprintf(text, sizeof text, "its clock is %.3f s away from the others'",
                 (double)k->far_ns * 1e-9);
        cap_sync_found(w, c, CAP_OUT_OF_STEP, 1, text);
        k->phase_ns = NAN;
        k->n_walk = k->walk_head = 0;
        return;
    }
    double length = k->phases > 0 ? hypot(k->cos, k->sin) / k->phases : 0;
    if (length < 0.5) { /* phases all over the period: it runs at another rate, or the others do */
        k->phase_ns = NAN;
        k->n_walk = k->walk_head = 0;
        return;
    }
    double phase = atan2(k->sin, k->cos) / (2 * PI) * period;
    k->phase_ns = phase;
    if (k->n_walk > 0) {
        unsigned last = (k->walk_head + CAP_WALK_WINDOWS - 1) % CAP_WALK_WINDOWS;
        double before = k->walk[last].phase_ns;
        phase = before + wrapped(phase - before, period);
    }
    k->walk[k->walk_head].t_ns = k->t_ns;
    k->walk[k->walk_head].phase_ns = phase;
    k->walk_head = (k->walk_head + 1) % CAP_WALK_WINDOWS;
    k->n_walk += k->n_walk < CAP_WALK_WINDOWS;
    if (fabs(k->phase_ns) > (double)w->p.tolerance_ns) {
        snprintf(text, sizeof text, "it exposes %.2f ms %s the others", fabs(k->phase_ns) * 1e-6,
                 k->phase_ns > 0 ? "after" : "before");
        cap_sync_found(w, c, CAP_OUT_OF_STEP, 1, text);
    }
    if (walks(w, k)) {
        snprintf(text, sizeof text, "its exposures move by %.3f ms per second against the others",
                 k->walk_ns_per_s * 1e-6);
        cap_sync_found(w, c, CAP_PHASE_WALK, 1, text);
    }
}

/* Whether the rate differs from most of the others', of those known for m blocks.  Of two cameras, the one farther
 * from nominal is wrong.  *theirs: the others' pictures per second. */
static bool unlike_the_others(const struct cap_syncwatch *w, const struct cap_sync_camera *k,
                              unsigned m, double *theirs)
{
    double rate[CAP_MAX_CAMERAS], nominal = 1e9 / (double)w->p.period_ns;
    unsigned n = 0, unlike = 0;
    for (uint32_t b = 0; b < w->p.cameras; b++) {
        const struct cap_sync_camera *o = &w->camera[b];
        if (o == k || o->rate.n < m || k->arrival_ns - o->arrival_ns > w->window_ns ||
            ((k->rate_by_host || o->rate_by_host) && cap_rate_span_ns(&k->rate, m) < HOST_NS))
            continue;
        rate[n++] = cap_rate_hz(&o->rate, m, w->p.period_ns);
        unlike += cap_rate_unlike(&k->rate, &o->rate, m, w->p.period_ns) != 0;
    }
    if (2 * unlike <= n)
        return false;
    *theirs = pvx_median(rate, n);
    double mine = cap_rate_hz(&k->rate, m, w->p.period_ns);
    return n > 1 || fabs(mine - nominal) >= fabs(*theirs - nominal);
}

static void odd_rate(struct cap_syncwatch *w, uint32_t c, const char *text)
{
    w->camera[c].rate_odd_mono_ns = w->camera[c].arrival_ns;
    cap_sync_found(w, c, CAP_RATE, 1, text);
}

/* Whether an odd rate was counted less than (about) a window ago. */
static bool counted(const struct cap_syncwatch *w, const struct cap_sync_camera *k)
{
    return k->rate_odd_mono_ns != 0 && k->arrival_ns - k->rate_odd_mono_ns < w->window_ns * 9 / 10;
}

/* A block of the camera is full. */
static void compare_rates(struct cap_syncwatch *w, uint32_t c)
{
    struct cap_sync_camera *k = &w->camera[c];
    char text[96];
    double theirs = 0;
    for (unsigned m = CAP_RATE_FEWEST; m <= k->rate.n && !counted(w, k); m += m / 4)
        if (unlike_the_others(w, k, m, &theirs)) {
            snprintf(text, sizeof text, "%.3f pictures a second, the others %.3f",
                     cap_rate_hz(&k->rate, m, w->p.period_ns), theirs);
            odd_rate(w, c, text);
        }
}

static void judge_rate(struct cap_syncwatch *w, uint32_t c, int64_t ns)
{
    struct cap_sync_camera *k = &w->camera[c];
    double nominal = 1e9 / (double)w->p.period_ns;
    char text[96];
    uint64_t n = k->id > k->id0 ? k->id - k->id0 : k->frames;
    if (n > 16 * (k->frames + 1)) /* the numbers were started again */
        n = k->frames;
    double by_number = (double)n * 1e9 / (double)ns;
    k->hz = by_number;
    bool coarse = !w->p.paced_outside && fabs(by_number / nominal - 1) > COARSE;
    if (!coarse && k->periods > 0) /* else triggers are irregular */
        k->hz = (double)k->periods * 1e9 / (double)ns;
    if (counted(w, k) || (!coarse && (k->periods <= 0 || fabs(k->hz / nominal - 1) <= FINE)))
        return;
    snprintf(text, sizeof text, "%.2f pictures a second instead of %.2f", k->hz, nominal);
    odd_rate(w, c, text);
}

/* Intervals that are not multiples of the period give no rate: the triggers are irregular, or a clock was
 * changed. */
static void note_rate(struct cap_syncwatch *w, const struct cap_frame *f)
{
    struct cap_sync_camera *k = &w->camera[f->camera];
    int64_t t = f->t_device_ns != 0 ? f->t_device_ns : f->t_exposure_ns;
    bool host = f->t_device_ns == 0 || k->host_stamps;
    if (host != k->rate_by_host)
        cap_rate_forget(&k->rate);
    k->rate_by_host = host;
    int64_t step = cap_sync_minus(t, k->rate.t_ns);
    double periods = (double)step / (double)w->p.period_ns;
    double most = w->p.paced_outside ? ROUND_OFF : ROUND_OFF_OWN;
    if (step <= 0 || step > 4 * w->window_ns || periods < 0.5 ||
        fabs(periods - rint(periods)) > most)
        cap_rate_forget(&k->rate);
    if (cap_rate_add(&k->rate, t, llrint(periods), w->p.period_ns))
        compare_rates(w, f->camera);
}

static void begin_window(struct cap_sync_camera *k)
{
    k->t0 = k->t_ns;
    k->id0 = k->id;
    k->frames = k->far = 0;
    k->periods = 0;
    k->phases = 0;
    k->cos = k->sin = 0;
}

void cap_syncwatch_frame(struct cap_syncwatch *w, const struct cap_frame *f)
{
    struct cap_sync_camera *k = &w->camera[f->camera];
    bool first = !k->any;
    int64_t step = f->t_exposure_ns - k->t_ns;
    k->any = true;
    k->id = f->id;
    k->t_ns = f->t_exposure_ns;
    k->arrival_ns = f->t_arrival_mono_ns;
    if (w->p.period_ns == 0)
        return;
    note_rate(w, f);
    if (first || step <= 0 || step > 4 * w->window_ns) {
        begin_window(k); /* after a pause, measure from here */
        return;
    }
    k->frames++;
    double periods = (double)step / (double)w->p.period_ns;
    double most = w->p.paced_outside ? ROUND_OFF : ROUND_OFF_OWN;
    if (periods < 0.5 || fabs(periods - rint(periods)) > most)
        k->periods = -1;
    else if (k->periods >= 0)
        k->periods += llrint(periods);
    note_phase(w, k);
    if (k->t_ns - k->t0 < w->window_ns)
        return;
    judge_phase(w, f->camera);
    judge_rate(w, f->camera, k->t_ns - k->t0);
    begin_window(k);
}
