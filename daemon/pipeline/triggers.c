#include "daemon/pipeline/triggers.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "daemon/control/json.h"

#define N_EVENTS   32
#define HEIGHT_TOP 0.02 /* share of the light above the flame's height */
#define CHANGE_MAX 1e6  /* %, from nothing to something */

struct dmn_triggers_run {
    const struct dmn_config *cfg;
    cap_ring *ring;
    bool replay; /* exposures are those of a recording */
    struct watched {
        bool ready;
        int64_t streak, t_first_ns, until_ns; /* until: end of hold_off */
        uint64_t first;
        double light;            /* of the set before; < 0 = none */
        bool done;               /* AT */
    } watched[DMN_TRIGGERS_MAX]; /* the publish stage's */
    struct wire {
        bool known, high; /* in the last frame */
        int64_t until_ns;
    } wire[DMN_TRIGGERS_MAX]; /* LINE: the thread's that brings frames */

    pthread_mutex_t lock;
    struct fired {
        struct cap_take_trigger t;
        enum dmn_when when;
        double value;
    } fired[N_EVENTS];
    unsigned n_fired;
    int64_t last_ns; /* newest exposure */
    struct dmn_triggers_state state;
    struct pvx_hist latency;
};

/* ---- values ---- */

struct span {
    int32_t lo[3], hi[3]; /* voxels lo..hi-1 */
};

static struct span span_of(const struct dmn_trigger *k, const struct rec_grid *g)
{
    struct span s;
    for (int a = 0; a < 3; a++) {
        double h = (g->max[a] - g->min[a]) / g->n[a];
        double lo = k->boxed ? ceil((k->box[a] - g->min[a]) / h - 0.5) : 0;
        double hi = k->boxed ? floor((k->box[a + 3] - g->min[a]) / h - 0.5) + 1 : g->n[a];
        s.lo[a] = (int32_t)fmin(fmax(lo, 0), g->n[a]);
        s.hi[a] = (int32_t)fmin(fmax(hi, 0), g->n[a]);
    }
    return s;
}

/* Light of each layer in the box, over the volume of a voxel; returns their sum.  *hull: voxels in it. */
static double light_of(const struct dmn_trigger *k, const struct rec_sparse *v,
                       double layer[REC_GRID_MAX], int64_t *hull)
{
    const struct rec_grid *g = v->grid;
    const struct span b = span_of(k, g);
    double sum = 0;
    *hull = 0;
    memset(layer, 0, sizeof *layer * (size_t)g->n[2]);
    for (int32_t i = 0; i < v->n; i++) {
        int32_t x = v->index[i] % g->n[0], y = v->index[i] / g->n[0] % g->n[1],
                z = v->index[i] / g->n[0] / g->n[1];
        if (x < b.lo[0] || x >= b.hi[0] || y < b.lo[1] || y >= b.hi[1] || z < b.lo[2] ||
            z >= b.hi[2])
            continue;
        double one = 0;
        for (int c = 0; c < v->nch; c++)
            one += (double)v->value[(size_t)i * (size_t)v->cs + (size_t)c];
        layer[z] += one / v->nch;
        sum += one / v->nch;
        ++*hull;
    }
    return sum;
}

double dmn_trigger_value(const struct dmn_trigger *k, const struct rec_sparse *v, double *light)
{
    static _Thread_local double layer[REC_GRID_MAX];
    const struct rec_grid *g = v->grid;
    double h[3], before = *light, top = 0;
    int64_t hull;
    for (int a = 0; a < 3; a++)
        h[a] = (g->max[a] - g->min[a]) / g->n[a];
    double sum = light_of(k, v, layer, &hull);
    int32_t z = g->n[2];
    *light = sum * h[0] * h[1] * h[2];
    switch (k->when) {
    case DMN_WHEN_LIGHT: return *light;
    case DMN_WHEN_HEIGHT:
        while (z > 0 && sum > 0 && top + layer[z - 1] < HEIGHT_TOP * sum)
            top += layer[--z];
        return sum > 0 ? g->min[2] + z * h[2] : g->min[2];
    case DMN_WHEN_CHANGE:
        if (before < 0 || before == *light)
            return 0;
        return before > 0 ? fmin(100 * fabs(*light - before) / before, CHANGE_MAX) : CHANGE_MAX;
    case DMN_WHEN_APPEARS:
    case DMN_WHEN_VANISHES: return (double)hull;
    default: return 0;
    }
}

/* ---- firing ---- */

static void triggers_fire(dmn_triggers_run *t, const struct dmn_trigger *k, double value,
                          int64_t t_ns, int64_t set)
{
    struct cap_take_trigger o = {
        .t_ns = t_ns,
        .set = set,
        .latency_ns = set >= 0 || k->when == DMN_WHEN_LINE ? pvx_now_real() - t_ns : -1,
        .t_from_ns = t_ns - (int64_t)(k->pre * 1e9),
        .t_to_ns = t_ns + (int64_t)(k->post * 1e9)};
    snprintf(o.name, sizeof o.name, "%s", k->name);
    if (cap_ring_trigger(t->ring, &o) != PVX_OK)
        return; /* the daemon stops */
    pthread_mutex_lock(&t->lock);
    if (t->n_fired < N_EVENTS)
        t->fired[t->n_fired++] = (struct fired){.t = o, .when = k->when, .value = value};
    for (size_t i = 0; i < t->state.n; i++)
        if (strcmp(t->state.item[i].name, k->name) == 0) {
            t->state.item[i].fired++;
            t->state.item[i].last_ns = t_ns;
        }
    pthread_mutex_unlock(&t->lock);
}

/* Whether the condition holds, and whether the trigger may fire again. */
static void judge_level(const struct dmn_trigger *k, double value, bool *holds, bool *released)
{
    bool falls = k->when == DMN_WHEN_VANISHES;
    *holds = falls ? value <= k->above : value > k->above;
    *released = falls ? value > k->release : value <= k->release;
}

static void triggers_judge(dmn_triggers_run *t, size_t i, double value, uint64_t set, int64_t t_ns)
{
    const struct dmn_trigger *k = &t->cfg->triggers.item[i];
    struct watched *w = &t->watched[i];
    bool holds, released;
    judge_level(k, value, &holds, &released);
    w->ready = w->ready || released;
    if (!holds || t_ns < w->until_ns) {
        w->streak = 0;
        return;
    }
    if (!w->ready)
        return;
    if (w->streak++ == 0) {
        w->t_first_ns = t_ns;
        w->first = set;
    }
    if (w->streak < k->agree)
        return;
    w->ready = false;
    w->streak = 0;
    w->until_ns = w->t_first_ns + (int64_t)(k->hold_off * 1e9);
    LOG_I(DAEMON, "trigger %s: %s is %.4g %s in set %llu", k->name, dmn_when_names[k->when], value,
          dmn_when_units[k->when], (unsigned long long)w->first);
    triggers_fire(t, k, value, w->t_first_ns, (int64_t)w->first);
}

void dmn_triggers_look(dmn_triggers_run *t, const struct rec_sparse *v, uint64_t set,
                       int64_t t_exposure_ns)
{
    if (t == NULL)
        return;
    for (size_t i = 0; i < t->cfg->triggers.n; i++) {
        const struct dmn_trigger *k = &t->cfg->triggers.item[i];
        if (k->when < DMN_WHEN_LIGHT)
            continue;
        double value = dmn_trigger_value(k, v, &t->watched[i].light);
        triggers_judge(t, i, value, set, t_exposure_ns);
        pthread_mutex_lock(&t->lock);
        t->state.item[i].value = value;
        t->state.item[i].ready = t->watched[i].ready;
        pthread_mutex_unlock(&t->lock);
    }
    pthread_mutex_lock(&t->lock);
    t->last_ns = t_exposure_ns;
    pthread_mutex_unlock(&t->lock);
}

static void triggers_wire(dmn_triggers_run *t, size_t i, const struct cap_frame *f)
{
    const struct dmn_trigger *k = &t->cfg->triggers.item[i];
    struct wire *w = &t->wire[i];
    const struct wire was = *w;
    w->known = true;
    w->high = (f->lines >> k->line & 1) != 0;
    if (was.known && was.high == w->high)
        return;
    pthread_mutex_lock(&t->lock);
    t->state.item[i].value = w->high;
    t->state.item[i].ready = !w->high;
    pthread_mutex_unlock(&t->lock);
    if (!was.known || !w->high || f->t_exposure_ns < w->until_ns)
        return;
    w->until_ns = f->t_exposure_ns + (int64_t)(k->hold_off * 1e9);
    triggers_fire(t, k, 1, f->t_exposure_ns, -1);
}

void dmn_triggers_frame(dmn_triggers_run *t, const char *camera, const struct cap_frame *f)
{
    if (t == NULL || !f->lines_known)
        return;
    for (size_t i = 0; i < t->cfg->triggers.n; i++) {
        const struct dmn_trigger *k = &t->cfg->triggers.item[i];
        if (k->when == DMN_WHEN_LINE && strcmp(k->camera, camera) == 0)
            triggers_wire(t, i, f);
    }
}

void dmn_triggers_tick(dmn_triggers_run *t, int64_t now_ns)
{
    for (size_t i = 0; t != NULL && i < t->cfg->triggers.n; i++) {
        const struct dmn_trigger *k = &t->cfg->triggers.item[i];
        if (k->when != DMN_WHEN_AT || t->watched[i].done || now_ns < k->at_ns)
            continue;
        t->watched[i].done = true;
        triggers_fire(t, k, 0, k->at_ns, -1);
    }
}

static size_t event_text(const struct fired *f, int64_t now, char *text, size_t size)
{
    struct dmn_json j;
    dmn_json_init(&j, text, size);
    dmn_json_open(&j, NULL, '{');
    dmn_json_int(&j, "version", 1);
    dmn_json_int(&j, "time_ns", now);
    dmn_json_str(&j, "kind", "trigger");
    dmn_json_str(&j, "name", f->t.name);
    dmn_json_str(&j, "when", dmn_when_names[f->when]);
    dmn_json_int(&j, "t_ns", f->t.t_ns);
    if (f->t.set >= 0) {
        dmn_json_int(&j, "set", f->t.set);
        dmn_json_num(&j, "value", f->value);
    }
    dmn_json_int(&j, "latency_ns", now - f->t.t_ns);
    dmn_json_int(&j, "t_from_ns", f->t.t_from_ns);
    dmn_json_int(&j, "t_to_ns", f->t.t_to_ns);
    dmn_json_close(&j, '}');
    return dmn_json_end(&j);
}

void dmn_triggers_events(dmn_triggers_run *t, const struct dmn_events_listener *to)
{
    for (;;) {
        struct fired f;
        char text[1024];
        if (t == NULL)
            return;
        pthread_mutex_lock(&t->lock);
        bool any = t->n_fired > 0;
        int64_t now = pvx_now_real();
        if (any) {
            f = t->fired[0];
            memmove(&t->fired[0], &t->fired[1], --t->n_fired * sizeof f);
            if ((f.t.set >= 0 || f.when == DMN_WHEN_LINE) && !t->replay)
                pvx_hist_add(&t->latency, now - f.t.t_ns);
        }
        pthread_mutex_unlock(&t->lock);
        if (!any)
            return;
        if (f.when == DMN_WHEN_LINE)
            LOG_I(DAEMON, "trigger %s: its line is high, %.1f ms after the exposure", f.t.name,
                  (double)(now - f.t.t_ns) * 1e-6);
        if (event_text(&f, now, text, sizeof text) > 0)
            to->say(to->ctx, text);
    }
}

/* ---- from outside ---- */

pvx_err dmn_triggers_order(dmn_triggers_run *t, const char *name, int64_t *t_ns, struct pvx_diag *d)
{
    if (t == NULL)
        return pvx_fail(d, PVX_EUNSUP,
                        "this daemon keeps no frames in memory: its record.ring is empty");
    const struct dmn_triggers *all = &t->cfg->triggers;
    pthread_mutex_lock(&t->lock);
    *t_ns = t->replay ? t->last_ns : pvx_now_real();
    pthread_mutex_unlock(&t->lock);
    if (name == NULL) {
        const struct dmn_trigger k = {
            .name = "order", .pre = t->cfg->ring.pre, .post = t->cfg->ring.post};
        triggers_fire(t, &k, 0, *t_ns, -1);
        return PVX_OK;
    }
    char list[DMN_TRIGGERS_MAX * (DMN_TRIGGER_NAME_MAX + 2)] = "";
    size_t n = 0;
    for (size_t i = 0; i < all->n; i++) {
        const struct dmn_trigger *k = &all->item[i];
        if (strcmp(k->name, name) == 0) {
            struct dmn_trigger o = *k;
            o.when = DMN_WHEN_ORDER;
            triggers_fire(t, &o, 0, *t_ns, -1);
            return PVX_OK;
        }
        n += (size_t)snprintf(list + n, sizeof list - n, "%s %s", i > 0 ? "," : "", k->name);
    }
    return pvx_fail(d, PVX_ENOENT, "no trigger '%.40s'; `triggers` has%s", name,
                    all->n > 0 ? list : " none");
}

pvx_err dmn_triggers_new(const struct dmn_config *c, cap_ring *ring, dmn_triggers_run **out)
{
    dmn_triggers_run *t = *out = pvx_calloc(1, sizeof *t);
    PVX_NEED(t);
    t->cfg = c;
    t->ring = ring;
    pthread_mutex_init(&t->lock, NULL);
    for (size_t i = 0; i < c->cameras.n; i++)
        t->replay |= strncmp(c->cameras.item[i].value, "take:", 5) == 0 ||
                     strncmp(c->cameras.item[i].value, "files:", 6) == 0;
    t->state.n = c->triggers.n;
    for (size_t i = 0; i < c->triggers.n; i++) {
        const struct dmn_trigger *k = &c->triggers.item[i];
        t->watched[i].light = -1;
        t->watched[i].done = k->at_ns < pvx_now_real();
        snprintf(t->state.item[i].name, sizeof t->state.item[i].name, "%s", k->name);
        t->state.item[i].when = k->when;
        t->state.item[i].above = k->above;
        if (k->when == DMN_WHEN_LINE)
            t->state.item[i].value = NAN;
        if (k->when == DMN_WHEN_AT && t->watched[i].done)
            LOG_W(DAEMON, "trigger %s: its time has passed", k->name);
    }
    return PVX_OK;
}

void dmn_triggers_free(dmn_triggers_run **tp)
{
    if (*tp == NULL)
        return;
    pthread_mutex_destroy(&(*tp)->lock);
    PVX_FREE(*tp);
}

void dmn_triggers_state(dmn_triggers_run *t, struct dmn_triggers_state *out)
{
    if (t == NULL)
        return;
    pthread_mutex_lock(&t->lock);
    *out = t->state;
    out->latency_n = t->latency.count;
    out->latency_p50_ms = (double)pvx_hist_quantile(&t->latency, 0.5) * 1e-6;
    out->latency_p99_ms = (double)pvx_hist_quantile(&t->latency, 0.99) * 1e-6;
    out->latency_max_ms = (double)t->latency.max_ns * 1e-6;
    pthread_mutex_unlock(&t->lock);
}
