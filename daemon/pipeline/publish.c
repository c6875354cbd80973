#include "daemon/pipeline/publish.h"

#include <stdio.h>

#include "base/clock.h"
#include "base/log.h"
#include "daemon/config/endpoints.h"
#include "daemon/pipeline/wire.h"

#define TORN 16 /* log it after so many sets in which the cameras contradict each other */

#define STATUS_EVERY_NS PVX_NS_PER_S
#define LOOK_EVERY_NS   (200 * PVX_NS_PER_MS)

/* What changed in the corrections that all sets share (recon/solve/average.h). */
static void say_corrections(const struct rec_rig *rig, const struct rec_selfcal_report *was,
                            const struct rec_selfcal_report *is)
{
    bool before = was->sets > 0 && (was->gain || was->shift), now = is->gain || is->shift;
    for (size_t c = 0; c < rig->n_cameras; c++)
        if (is->camera[c].touched > was->camera[c].touched)
            LOG_ABOUT(PVX_LOG_WARN, DAEMON,
                      ABOUT(.cause = "touched", .camera = rig->cameras[c].name),
                      "camera %s was touched: its gain or aim has changed; it is learnt anew",
                      rig->cameras[c].name);
    if (is->sets == 0 || before == now)
        return;
    if (now)
        LOG_I(DAEMON,
              "cameras are corrected, by the mean of %u sets: `pyrovox status` shows gains and "
              "aims, `pyrovox calibrate gain` and `calibrate refine` mend the rig",
              is->sets);
    else
        LOG_I(DAEMON, "cameras agree with the rig, nothing is corrected any more");
}

static void say_event(void *ctx, const char *json)
{
    struct dmn_publish *p = ctx;
    pvx_err e = pvp_pub_say(p->pub, PVP_EVENT, json);
    if (e != PVX_OK)
        LOG_EVERY(PVX_LOG_WARN, PROTO, "event not published: %s", pvx_strerror(e));
}

/* The error bars of the volume that is published next, if it has any.  Without them it goes out all the same. */
static void publish_bars(struct dmn_publish *p, const struct dmn_slot *s,
                         const struct pvp_volume *m)
{
    struct pvp_voxels sd;
    uint32_t doubt;
    if (!dmn_wire_bars(s, &sd, &doubt))
        return;
    pvx_err e = pvp_pub_bars(p->pub, m, doubt, &sd, NULL);
    if (e != PVX_OK)
        LOG_EVERY_ABOUT(PVX_LOG_ERROR, PROTO,
                        ABOUT(.cause = "not_published", .of_set = true, .set = s->set),
                        "error bars of set %llu cannot be published: %s",
                        (unsigned long long)s->set, pvx_strerror(e));
}

static bool publish_put(void *ctx, const struct dmn_slot *s)
{
    struct dmn_publish *p = ctx;
    if (s->why != DMN_N_DROP)
        return false;
    const struct rec_frame_report *r = rec_frame_get_report(s->frame);
    struct pvp_volume m;
    struct pvp_voxels x;
    struct rec_sparse v;
    rec_frame_volume(s->frame, &v);
    dmn_triggers_look(p->triggers, &v, s->set, s->t_exposure_ns);
    dmn_triggers_events(p->triggers, &(struct dmn_events_listener){say_event, p});
    dmn_wire_volume(s, &p->start.grid, &m, &x);
    pvp_pub_compress(p->pub, (enum pvp_compress)atomic_load(&p->compress));
    publish_bars(p, s, &m);
    int64_t t0 = pvx_now_mono();
    m.session = p->start.session;
    m.t_publish_ns = pvx_now_real();
    m.latency_ns = t0 - s->t_last_mono_ns;
    size_t bytes = 0;
    pvx_err e = pvp_pub_volume(p->pub, &m, &x, &bytes);
    int64_t t1 = pvx_now_mono();
    if (e != PVX_OK) {
        LOG_EVERY_ABOUT(
            PVX_LOG_ERROR, PROTO, ABOUT(.cause = "not_published", .of_set = true, .set = s->set),
            "set %llu cannot be published: %s", (unsigned long long)s->set, pvx_strerror(e));
        return false;
    }
    pthread_mutex_lock(&p->lock);
    if (atomic_exchange(&p->reset_latency, false))
        p->latency = (struct pvx_hist){0};
    pvx_hist_add(&p->latency, t1 - s->t_last_mono_ns);
    say_corrections(p->rig, &p->report.selfcal, &r->selfcal);
    p->report = *r;
    dmn_votes_add(&p->votes, &r->vote, p->rig, &dmn_votes_log);
    p->last_set = s->set;
    p->last_exposure_ns = s->t_exposure_ns;
    p->bytes = bytes;
    pthread_mutex_unlock(&p->lock);
    p->published++;
    dmn_instant_volume(p->instant, &m, &v);
    dmn_temperature_offer(p->temperature, s, &m);
    return true;
}

/* Five times a second: the events. */
static void publish_look(struct dmn_publish *p, int64_t now)
{
    const struct dmn_events_listener to = {say_event, p};
    p->next_look_ns = now + LOOK_EVERY_NS;
    p->snapshot(p->ctx, &p->status);
    dmn_events_look(&p->events, &p->status, pvx_now_real(), now, &to);
}

/* Once a second: the rate, the status message, the repeated start message. */
static void publish_tick(void *ctx)
{
    struct dmn_publish *p = ctx;
    pvp_pub_tick(p->pub);
    atomic_store(&p->subscribers, pvp_pub_subscribers(p->pub));
    int64_t now = pvx_now_mono();
    dmn_triggers_tick(p->triggers, pvx_now_real());
    dmn_triggers_events(p->triggers, &(struct dmn_events_listener){say_event, p});
    if (now >= p->next_look_ns)
        publish_look(p, now);
    if (now < p->next_status_ns)
        return;
    p->next_status_ns = now + STATUS_EVERY_NS;
    pthread_mutex_lock(&p->lock);
    p->sets_per_s = (double)(p->published - p->rate_n) / ((double)(now - p->rate_t_ns) * 1e-9);
    pthread_mutex_unlock(&p->lock);
    p->rate_n = p->published;
    p->rate_t_ns = now;
    p->snapshot(p->ctx, &p->status);
    if (dmn_state_json(&p->status, p->status_json, sizeof p->status_json) == 0)
        return;
    pvx_err e = pvp_pub_say(p->pub, PVP_STATUS, p->status_json);
    if (e != PVX_OK)
        LOG_EVERY(PVX_LOG_WARN, PROTO, "status not published: %s", pvx_strerror(e));
}

static void publish_end(void *ctx)
{
    struct dmn_publish *p = ctx;
    const char *why = atomic_load(&p->end_reason);
    pvx_err e = pvp_pub_say(p->pub, PVP_END, why != NULL ? why : "end of the recording");
    if (e != PVX_OK)
        LOG_W(PROTO, "end not published: %s", pvx_strerror(e));
}

struct dmn_sink dmn_publish_sink(struct dmn_publish *p)
{
    return (struct dmn_sink){
        .name = "publish", .put = publish_put, .tick = publish_tick, .end = publish_end, .ctx = p};
}

void dmn_publish_compress(struct dmn_publish *p, const struct dmn_config *c)
{
    atomic_store(&p->compress, (int)dmn_endpoints_compress(c));
}

pvx_err dmn_publish_open(struct dmn_publish *p, const struct dmn_config *c,
                         const struct rec_rig *rig, pvp_auth *auth, struct pvx_diag *d)
{
    p->votes.patience = TORN;
    static const enum pvp_sample samples[] = {PVP_F16, PVP_F32};
    dmn_publish_compress(p, c);
    const char *open[DMN_TEXTS_MAX], *guarded[DMN_TEXTS_MAX];
    size_t n = c->endpoints.n == 0 ? 1 : c->endpoints.n, n_open = 0, n_guarded = 0;
    for (size_t i = 0; i < n; i++) {
        const char *e = c->endpoints.n == 0 ? dmn_default_endpoint(DMN_VOLUMES) : c->endpoints.v[i];
        PVX_TRY(dmn_endpoint_prepare(e, d));
        if (dmn_endpoint_guarded(c, e, DMN_VOLUMES))
            guarded[n_guarded++] = e;
        else
            open[n_open++] = e;
    }
    p->rig = rig;
    uint64_t session = p->start.session;
    dmn_wire_start(rig, dmn_config_channels(c), c->fps, "pyrovoxd", &p->start);
    p->start.session = session;
    struct pvp_pub_params pp = {.endpoints = open,
                                .n_endpoints = n_open,
                                .guarded = guarded,
                                .n_guarded = n_guarded,
                                .auth = auth,
                                .rig = p->rig_text,
                                .send_hwm = (int)c->hwm,
                                .sample = samples[c->sample],
                                .comp = (enum pvp_compress)atomic_load(&p->compress),
                                .lossless = c->lossless};
    pthread_mutex_init(&p->lock, NULL);
    return pvp_pub_new(&pp, &p->start, &p->pub, d);
}

void dmn_publish_close(struct dmn_publish *p)
{
    if (p->pub == NULL)
        return;
    pvp_pub_free(&p->pub);
    pthread_mutex_destroy(&p->lock);
}

static double publish_to_ms(int64_t ns)
{
    return (double)ns * 1e-6;
}

void dmn_publish_state(struct dmn_publish *p, struct dmn_state *out)
{
    pthread_mutex_lock(&p->lock);
    out->subscribers = atomic_load(&p->subscribers);
    out->sets_per_s = p->sets_per_s;
    out->latency_n = p->latency.count;
    out->latency_sum_s = (double)p->latency.sum_ns * 1e-9;
    out->latency_p50_ms = publish_to_ms(pvx_hist_quantile(&p->latency, 0.5));
    out->latency_p99_ms = publish_to_ms(pvx_hist_quantile(&p->latency, 0.99));
    out->latency_max_ms = publish_to_ms(p->latency.max_ns);
    out->bytes = p->bytes;
    out->last_set = p->last_set;
    out->last_exposure_ns = p->last_exposure_ns;
    out->report = p->report;
    out->votes = p->votes;
    pthread_mutex_unlock(&p->lock);
}
