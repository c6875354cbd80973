/* sim.c - sim: cameras inside the process, on one common grid of exposure times.
 *
 * Every camera exposes at the multiples of its period on CLOCK_REALTIME, so equal cameras see the same instants
 * without communication.  The frame id is the number of the grid point.  The caller makes the pictures (struct
 * cap_scene).  Options make a camera fail as real cameras do, for tests and demonstrations. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "base/yaml.h"
#include "capture/source/backends.h"
#include "capture/source/player.h"
#include "base/random.h"

#define HOLD_MAX 64

struct faults {
    double skew_us, drift_ppm; /* of the camera's clock against the host's */
    double drop;               /* share of frames that are never delivered */
    double jitter_us;          /* each frame is delivered up to this much late */
    int64_t freeze;            /* 1: the same image and stamp for ever */
    int64_t die_after;         /* frames after each start, then the camera reports its loss */
    int64_t silent_after;      /* frames after each start, then no more frames and no report */
    int64_t short_every;       /* each n-th frame claims fewer bytes than it should have */
    int64_t end_after;         /* frames, then the sequence is finished */
    int64_t absent;            /* 1: cannot be opened */
    /* The faults below, and drop, freeze and short_every, act only between these times, s since 1970. */
    double from, to;
    double incomplete;    /* share of frames that arrive with parts missing */
    double rate;          /* its own rate over fps: 0.5 = every other, 0.999 = it runs freely */
    double phase_us;      /* it exposes this much after the others */
    double clock_jump_s;  /* its clock is this far off */
    double host_step_s;   /* the host's time of day was changed by this */
    int64_t silent;       /* 1: no frames come */
    int64_t gone;         /* 1: connection lost, cannot be opened */
    int64_t slip;         /* its numbers are this many ahead of its pictures */
    int64_t miss_every;   /* each n-th picture is neither exposed nor numbered */
    int64_t wide_every;   /* each n-th frame has another size than the camera's */
    int64_t other_format; /* 1: the frame claims another pixel format */
    int64_t hold;         /* this many of its buffers are held, as by a consumer that is too slow */
    double open_ms;       /* opening takes this long */
    int64_t seed;
};

struct sim {
    struct cap_source base;
    struct cap_player player; /* CLOCK_REALTIME: the grid's clock */
    struct faults fault;
    struct cap_scene scene;
    int32_t width, height;
    enum cap_pixfmt fmt;
    int64_t period_ns, own_period_ps; /* own: in picoseconds, so that rate=0.9999 is exact */
    bool triggered;                   /* by software */
    uint64_t rng;
    struct cap_frame *held[HOLD_MAX];
    int64_t n_held;
    int64_t trigger_real_ns; /* a trigger not yet served, 0 = none; under the player's lock */
};

/* ---- options ---------------------------------------------------------------------------------- */

struct option {
    const char *name;
    size_t offset;
    bool integer;
    double min, max;
};
#define OPT_D(n, lo, hi)                              \
    {                                                 \
#n, offsetof(struct faults, n), false, lo, hi \
    }
#define OPT_I(n, lo, hi)                             \
    {                                                \
#n, offsetof(struct faults, n), true, lo, hi \
    }
static const struct option options[] = {
    OPT_D(skew_us, -1e15, 1e15),
    OPT_D(drift_ppm, -1000, 1000),
    OPT_D(drop, 0, 1),
    OPT_D(jitter_us, 0, 1e6),
    OPT_I(freeze, 0, 1),
    OPT_I(die_after, 1, 1e9),
    OPT_I(silent_after, 1, 1e9),
    OPT_I(short_every, 1, 1e9),
    OPT_I(end_after, 1, 1e9),
    OPT_I(absent, 0, 1),
    OPT_D(open_ms, 0, 1e6),
    OPT_I(seed, 0, 1e9),
    OPT_D(from, 0, 1e10),
    OPT_D(to, 0, 1e10),
    OPT_D(incomplete, 0, 1),
    OPT_D(rate, 0.01, 100),
    OPT_D(phase_us, -1e6, 1e6),
    OPT_D(clock_jump_s, -1e9, 1e9),
    OPT_D(host_step_s, -1e9, 1e9),
    OPT_I(silent, 0, 1),
    OPT_I(gone, 0, 1),
    OPT_I(slip, -1000, 1000),
    OPT_I(miss_every, 1, 1e9),
    OPT_I(wide_every, 1, 1e9),
    OPT_I(other_format, 0, 1),
    OPT_I(hold, 1, HOLD_MAX),
};
#define N_OPTIONS (sizeof options / sizeof options[0])

static pvx_err set_option(struct faults *f, char *text, struct pvx_diag *d)
{
    char *value = strchr(text, '=');
    if (value != NULL)
        *value++ = '\0';
    for (size_t i = 0; i < N_OPTIONS; i++) {
        const struct option *o = &options[i];
        if (strcmp(text, o->name) != 0)
            continue;
        void *at = (char *)f + o->offset;
        /* a bare word switches on */
        pvx_err e = value == NULL && !(o->integer && o->max == 1) ? PVX_EINVAL
                    : o->integer ? pvx_parse_int(value == NULL ? "1" : value, (int64_t)o->min,
                                                 (int64_t)o->max, at)
                                 : pvx_parse_double(value, o->min, o->max, at);
        if (e != PVX_OK)
            return pvx_fail(d, PVX_EINVAL, "sim: %s needs a%s between %g and %g", o->name,
                            o->integer ? " whole number" : " number", o->min, o->max);
        return PVX_OK;
    }
    char list[512] = "";
    for (size_t i = 0; i < N_OPTIONS; i++)
        snprintf(list + strlen(list), sizeof list - strlen(list), " %s", options[i].name);
    return pvx_fail(d, PVX_EINVAL, "sim: unknown option \"%s\" (there are%s)", text, list);
}

static pvx_err parse_options(const char *text, struct faults *f, struct pvx_diag *d)
{
    char copy[512];
    if (snprintf(copy, sizeof copy, "%s", text) >= (int)sizeof copy)
        return pvx_fail(d, PVX_EINVAL, "sim: options are too long");
    for (char *p = copy; p != NULL && *copy != '\0';) {
        char *comma = strchr(p, ',');
        if (comma != NULL)
            *comma++ = '\0';
        PVX_TRY(set_option(f, p, d));
        p = comma;
    }
    return PVX_OK;
}

/* ---- thread ----------------------------------------------------------------------------------- */

/* Wait for a trigger.  Returns its time; 0 = stop. */
static int64_t wait_trigger(struct sim *s)
{
    struct cap_player *p = &s->player;
    pthread_mutex_lock(&p->lock);
    while (!p->stop && s->trigger_real_ns == 0)
        pthread_cond_wait(&p->wake, &p->lock);
    int64_t t = p->stop ? 0 : s->trigger_real_ns;
    s->trigger_real_ns = 0;
    pthread_mutex_unlock(&p->lock);
    return t;
}

/* Whether now is between `from` and `to`. */
static bool now_faulty(const struct faults *o)
{
    double now = (double)pvx_now_real() * 1e-9;
    return now >= o->from && (o->to == 0 || now < o->to);
}

/* One exposure on its way. */
struct shot {
    int64_t t_image, t_device, number; /* number: of this run, from 1 */
    uint64_t id;
    bool faulty;
};

static bool nth(int64_t every, const struct shot *x)
{
    return x->faulty && every > 0 && x->number % every == 0;
}

static void sim_hold(struct sim *s, int64_t n)
{
    struct cap_frame *f;
    while (s->n_held < n && (f = cap_bufpool_get(s->player.pool)) != NULL)
        s->held[s->n_held++] = f;
    while (s->n_held > n)
        cap_frame_release(s->held[--s->n_held]);
}

static void sim_expose(struct sim *s, const struct shot *x)
{
    const struct faults *o = &s->fault;
    sim_hold(s, x->faulty ? o->hold : 0);
    struct cap_frame *f = cap_player_get(&s->player);
    if (f == NULL)
        return;
    s->scene.render(s->scene.ctx, s->player.camera, x->t_image, s->fmt, s->width, s->height,
                    cap_bufpool_memory(f));
    f->img.size = cap_pixfmt_image(s->fmt, s->width, s->height) / (nth(o->short_every, x) ? 2 : 1);
    f->img.width = s->width / (nth(o->wide_every, x) ? 2 : 1);
    f->img.height = s->height;
    f->img.stride = (ptrdiff_t)cap_pixfmt_row(s->fmt, s->width);
    f->img.fmt = !x->faulty || !o->other_format ? s->fmt
                 : s->fmt == CAP_GREY8          ? CAP_BAYER_RG8
                                                : CAP_GREY8;
    f->id = x->id;
    f->t_device_ns = x->t_device;
    pvx_now_both(&f->t_arrival_ns, &f->t_arrival_mono_ns);
    f->t_arrival_ns += now_faulty(o) ? (int64_t)(o->host_step_s * 1e9) : 0;
    s->player.sink.push(s->player.sink.ctx, f);
}

/* Time of grid point k; the grid may be the camera's own.  It does not include the phase. */
static int64_t grid_ns(const struct sim *s, int64_t k)
{
    return (int64_t)((__int128)k * s->own_period_ps / 1000);
}

/* The next grid point after now.  A camera that begins to run by itself gets a grid of its own. */
static int64_t next_point(struct sim *s, bool faulty)
{
    s->own_period_ps = s->period_ns * 1000;
    if (faulty && s->fault.rate > 0)
        s->own_period_ps = (int64_t)((double)s->own_period_ps / s->fault.rate);
    return (int64_t)((__int128)pvx_now_real() * 1000 / s->own_period_ps) + 1;
}

static bool sim_lost(struct sim *s, const struct shot *x)
{
    const struct faults *o = &s->fault;
    if (x->faulty && o->incomplete > 0 && pvx_uniform(&s->rng) < o->incomplete) {
        cap_player_count(&s->player, CAP_INCOMPLETE, 1);
        return true;
    }
    if (x->faulty && o->drop > 0 && pvx_uniform(&s->rng) < o->drop) {
        cap_player_count(&s->player, CAP_ID_GAP, 1);
        return true;
    }
    return false;
}

static void *sim_run(void *arg)
{
    struct sim *s = arg;
    const struct faults *o = &s->fault;
    int64_t start = pvx_now_real(), frozen = 0, missed = 0;
    bool was = now_faulty(o);
    int64_t k = next_point(s, was), renumbered = 0;
    for (int64_t n = 1;; n++) {
        struct shot x = {.number = n, .faulty = now_faulty(o)};
        if (x.faulty != was && o->rate > 0) { /* frame numbers go on without a gap */
            int64_t next = next_point(s, x.faulty);
            renumbered += k - next;
            k = next;
        }
        was = x.faulty;
        int64_t t;
        if (s->triggered) {
            if ((t = wait_trigger(s)) == 0)
                return NULL;
        } else {
            t = grid_ns(s, k) + (x.faulty ? (int64_t)(o->phase_us * 1e3) : 0);
            if (!cap_player_wait_until(&s->player, t))
                return NULL;
        }
        if (o->jitter_us > 0) {
            int64_t late = (int64_t)(pvx_uniform(&s->rng) * o->jitter_us * 1e3);
            if (!cap_player_wait_until(&s->player, t + late))
                return NULL;
        }
        if (x.faulty && o->gone) {
            cap_player_event(&s->player, CAP_EV_LOST);
            return NULL;
        }
        x.t_image = x.faulty && o->freeze && frozen != 0 ? frozen : t;
        frozen = x.t_image;
        x.t_device = x.t_image + (int64_t)(o->skew_us * 1e3) +
                     (int64_t)(o->drift_ppm * 1e-6 * (double)(x.t_image - start)) +
                     (x.faulty ? (int64_t)(o->clock_jump_s * 1e9) : 0);
        if (nth(o->miss_every, &x))
            missed++;
        x.id = (uint64_t)((s->triggered ? n : k) + renumbered - missed + (x.faulty ? o->slip : 0));
        if (!nth(o->miss_every, &x) && !(x.faulty && o->silent) && !sim_lost(s, &x))
            sim_expose(s, &x);
        if (n == o->silent_after)
            return NULL;
        if (n == o->die_after || n == o->end_after) {
            cap_player_event(&s->player, n == o->die_after ? CAP_EV_LOST : CAP_EV_END);
            return NULL;
        }
        /* Grid points that passed while this thread could not run are lost frames. */
        int64_t next = (int64_t)((__int128)pvx_now_real() * 1000 / s->own_period_ps);
        if (!s->triggered && next > k + 1) {
            cap_player_count(&s->player, CAP_ID_GAP, (uint64_t)(next - k - 1));
            k = next;
        } else {
            k++;
        }
    }
}

/* ---- operations ------------------------------------------------------------------------------- */

static void sim_close(cap_source **sp)
{
    struct sim *s = (struct sim *)*sp;
    if (s == NULL)
        return;
    *sp = NULL;
    cap_player_fini(&s->player);
    free(s);
}

static pvx_err sim_open(const struct cap_source_config *c, cap_source **out, struct pvx_diag *d)
{
    *out = NULL;
    struct faults fault = {0};
    PVX_TRY(parse_options(c->uri, &fault, d));
    if (c->scene == NULL || c->scene->render == NULL)
        return pvx_fail(d, PVX_EINVAL, "sim: needs a scene to look at");
    if (c->width < 1 || c->height < 1)
        return pvx_fail(d, PVX_EINVAL, "sim: needs an image size");
    if (c->fmt == CAP_JPEG)
        return pvx_fail(d, PVX_EUNSUP, "sim: cannot make JPEG pictures; any other pixel_format");
    if (fault.open_ms > 0)
        pvx_sleep_until_mono(pvx_now_mono() + (int64_t)(fault.open_ms * 1e6));
    if (fault.absent || (fault.gone && now_faulty(&fault)))
        return pvx_fail(d, PVX_ENODEV, "sim: the camera is absent");
    struct sim *s = pvx_calloc(1, sizeof *s);
    PVX_NEED(s);
    s->base.ops = &cap_source_sim;
    s->fault = fault;
    s->scene = *c->scene;
    s->width = c->width;
    s->height = c->height;
    s->fmt = c->fmt == CAP_FMT_NONE ? CAP_RGB8 : c->fmt;
    s->period_ns = (int64_t)(1e9 / (c->fps > 0 ? c->fps : 30) + 0.5);
    s->triggered = c->trigger == CAP_TRIGGER_SOFTWARE;
    s->rng = ((uint64_t)fault.seed * 64 + c->camera + 1) * 0x9E3779B97F4A7C15u;
    cap_player_init(&s->player, c, CLOCK_REALTIME);
    s->player.lossless = false; /* a camera does not wait */
    pvx_err e = cap_player_make_pool(&s->player, c, cap_pixfmt_image(s->fmt, c->width, c->height));
    cap_source *base = &s->base;
    if (e != PVX_OK)
        sim_close(&base);
    *out = base;
    return e;
}

static pvx_err sim_start(cap_source *base, const struct cap_sink *sink, struct pvx_diag *d)
{
    struct sim *s = (struct sim *)base;
    s->trigger_real_ns = 0;
    return cap_player_start(&s->player, "sim", sink, sim_run, s, d);
}

static pvx_err sim_trigger(cap_source *base)
{
    struct sim *s = (struct sim *)base;
    if (!s->triggered)
        return PVX_EUNSUP;
    pthread_mutex_lock(&s->player.lock);
    s->trigger_real_ns = pvx_now_real(); /* a trigger not yet served is lost, as in a real camera */
    pthread_cond_broadcast(&s->player.wake);
    pthread_mutex_unlock(&s->player.lock);
    return PVX_OK;
}

static void sim_stop(cap_source *base)
{
    struct sim *s = (struct sim *)base;
    cap_player_stop(&s->player);
    sim_hold(s, 0);
}

const struct cap_source_ops cap_source_sim = {
    .scheme = "sim",
    .help = "camera in the process, looking at the given scene; options to break it: "
            "skew_us=500,drift_ppm=50,drop=0.01,jitter_us=300,freeze,die_after=100,... "
            "(a word that it does not know makes it list them)",
    .open = sim_open,
    .start = sim_start,
    .trigger = sim_trigger,
    .stop = sim_stop,
    .close = sim_close,
};
