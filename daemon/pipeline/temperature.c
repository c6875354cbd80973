#include "daemon/pipeline/temperature.h"

#include <limits.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>

#include "base/bell.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "daemon/config/endpoints.h"
#include "daemon/pipeline/wire.h"
#include "proto/pub.h"
#include "recon/spectral/soot.h"

#define LEAST    19 /* nice */
#define LOOK_NS  (PVX_NS_PER_S / 10)
#define ENDPOINT "publish.temperature"

/* A voxel's emission, and its covariance: 00 11 22 01 02 12. */
struct seen {
    float e[3], N[6];
};

struct dmn_temperature {
    rec_soot *soot;
    pvp_pub *pub;
    struct pvp_grid grid;
    size_t room;       /* voxels of the grid */
    int32_t *index;    /* [room] of the set at hand */
    struct seen *seen; /* [room] */
    uint32_t n, doubt;
    struct pvp_volume message;
    int64_t t_last_mono_ns;
    int32_t *found;             /* [room] voxels with a temperature */
    float *kelvin, *sd;         /* [room] */
    atomic_bool wanted, ending; /* the publish stage owns the set while wanted, else the thread */
    atomic_int compress;        /* enum pvp_compress */
    atomic_size_t subscribers;
    _Atomic uint64_t made, left_out, without_bars;
    struct pvx_bell bell;
    pthread_t thread;
    bool started;
};

/* ---- the publish stage's side -------------------------------------------------------------------- */

static void copy_emission(dmn_temperature *t, const struct rec_sparse *v,
                          const struct rec_bars_view *b)
{
    t->n = (uint32_t)v->n;
    memcpy(t->index, v->index, t->n * sizeof *t->index);
    for (uint32_t i = 0; i < t->n; i++) {
        const float *e = v->value + (size_t)i * (size_t)v->cs,
                    *sd = b->sd + (size_t)i * (size_t)b->cs;
        t->seen[i] = (struct seen){{e[0], e[1], e[2]},
                                   {sd[0] * sd[0], sd[1] * sd[1], sd[2] * sd[2], 0, 0, 0}};
    }
    for (uint32_t k = 0; k < b->n_modes; k++)
        for (uint32_t i = 0; i < t->n; i++) {
            const float *m = b->modes + ((size_t)k * t->n + i) * (size_t)b->cs;
            float *N = t->seen[i].N;
            N[3] += m[0] * m[1];
            N[4] += m[0] * m[2];
            N[5] += m[1] * m[2];
        }
}

void dmn_temperature_offer(dmn_temperature *t, const struct dmn_slot *s, const struct pvp_volume *m)
{
    struct pvp_voxels sd;
    struct rec_sparse v;
    uint32_t doubt;
    if (t == NULL || atomic_load(&t->subscribers) == 0)
        return;
    rec_frame_volume(s->frame, &v);
    if (!dmn_wire_bars(s, &sd, &doubt) || s->bars.n != v.n) {
        atomic_fetch_add(&t->without_bars, 1);
        return;
    }
    if (!atomic_load_explicit(&t->wanted, memory_order_acquire)) {
        atomic_fetch_add(&t->left_out, 1);
        return;
    }
    copy_emission(t, &v, &s->bars);
    t->doubt = doubt;
    t->message = *m;
    t->message.grid = t->grid;
    t->t_last_mono_ns = s->t_last_mono_ns;
    atomic_store(&t->wanted, false);
    pvx_bell_ring(&t->bell);
}

/* ---- the thread ---------------------------------------------------------------------------------- */

/* Returns the number of voxels that have a temperature. */
static uint32_t temperature_solve(dmn_temperature *t)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < t->n; i++) {
        const struct seen *s = &t->seen[i];
        const float *N = s->N;
        const double e[3] = {(double)s->e[0], (double)s->e[1], (double)s->e[2]},
                     V[9] = {(double)N[0], (double)N[3], (double)N[4], (double)N[3], (double)N[1],
                             (double)N[5], (double)N[4], (double)N[5], (double)N[2]};
        struct rec_soot_voxel x = rec_soot_solve(t->soot, e, V);
        if (x.state != REC_SOOT_OK)
            continue;
        t->found[n] = t->index[i];
        t->kelvin[n] = (float)x.kelvin;
        t->sd[n++] = (float)x.kelvin_sd;
    }
    return n;
}

static void temperature_publish(dmn_temperature *t)
{
    uint32_t n = temperature_solve(t);
    const struct pvp_voxels x = {n, t->found, t->kelvin, 1}, sd = {n, t->found, t->sd, 1};
    struct pvp_volume *m = &t->message;
    m->t_publish_ns = pvx_now_real();
    m->latency_ns = pvx_now_mono() - t->t_last_mono_ns;
    pvp_pub_compress(t->pub, (enum pvp_compress)atomic_load(&t->compress));
    pvx_err e = pvp_pub_bars(t->pub, m, t->doubt, &sd, NULL);
    PVX_THEN(e, pvp_pub_volume(t->pub, m, &x, NULL));
    if (e != PVX_OK)
        LOG_EVERY_ABOUT(PVX_LOG_ERROR, PROTO,
                        ABOUT(.cause = "not_published", .of_set = true, .set = m->set),
                        "temperatures of set %llu cannot be published: %s",
                        (unsigned long long)m->set, pvx_strerror(e));
    else
        atomic_fetch_add(&t->made, 1);
}

static void *temperature_run(void *arg)
{
    dmn_temperature *t = arg;
    bool asked = false;
    setpriority(PRIO_PROCESS, 0, LEAST); /* Linux: of this thread */
    while (!atomic_load(&t->ending)) {
        pvp_pub_tick(t->pub);
        atomic_store(&t->subscribers, pvp_pub_subscribers(t->pub));
        if (asked && !atomic_load_explicit(&t->wanted, memory_order_acquire)) {
            temperature_publish(t);
            asked = false;
        }
        if (!asked) {
            asked = true;
            atomic_store(&t->wanted, true);
        }
        pvx_bell_wait(&t->bell, pvx_now_mono() + LOOK_NS);
    }
    pvx_err e = pvp_pub_say(t->pub, PVP_END, "the daemon ends");
    if (e != PVX_OK)
        LOG_W(DAEMON, "temperatures: %s", pvx_strerror(e));
    return NULL;
}

/* ---- life ---------------------------------------------------------------------------------------- */

static pvx_err temperature_possible(const struct dmn_config *c, const struct rec_rig *rig,
                                    bool bars, const char *path, struct pvx_diag *d)
{
    if (rig->spectral == NULL)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: " ENDPOINT ": %s has no `spectral:`, so that colours say no "
                        "temperature: calibrate it (pyrovox calibrate spectral), or leave the "
                        "endpoint empty",
                        c->name, path);
    if (dmn_config_channels(c) != 3)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: " ENDPOINT ": a temperature needs three channels, and one is "
                        "reconstructed: see pixel_format and channels, or leave the endpoint empty",
                        c->name);
    if (!bars)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: " ENDPOINT ": a temperature needs the volumes' error bars: set "
                        "model.error_bars: true, or leave the endpoint empty",
                        c->name);
    return PVX_OK;
}

static pvx_err temperature_room(dmn_temperature *t)
{
    t->room = pvp_grid_count(&t->grid);
    t->index = pvx_reserve(t->room * sizeof *t->index);
    t->seen = pvx_reserve(t->room * sizeof *t->seen);
    t->found = pvx_reserve(t->room * sizeof *t->found);
    t->kelvin = pvx_reserve(t->room * sizeof *t->kelvin);
    t->sd = pvx_reserve(t->room * sizeof *t->sd);
    return t->index != NULL && t->seen != NULL && t->found != NULL && t->kelvin != NULL &&
                   t->sd != NULL
               ? PVX_OK
               : PVX_ENOMEM;
}

pvx_err dmn_temperature_new(const struct dmn_config *c, const struct rec_rig *rig, bool bars,
                            dmn_temperature **out, struct pvx_diag *d)
{
    char path[PATH_MAX];
    struct pvp_start s;
    struct pvx_diag why = {""};
    *out = NULL;
    if (c->temperature[0] == '\0')
        return PVX_OK;
    dmn_config_path(c, c->rig, path, sizeof path);
    PVX_TRY(temperature_possible(c, rig, bars, path, d));
    dmn_temperature *t = *out = pvx_calloc(1, sizeof *t);
    PVX_NEED(t);
    pvx_bell_init(&t->bell);
    dmn_temperature_compress(t, c);
    dmn_wire_start(rig, 1, c->fps, "pyrovoxd", &s);
    t->grid = s.grid;
    t->grid.basis = 0; /* a temperature is a voxel's: nothing lies between two of them */
    pvx_err e = rec_soot_new(rig->spectral, &rec_soot_defaults, &t->soot, &why);
    if (e != PVX_OK)
        e = pvx_fail(d, e, "%s: " ENDPOINT ": %s: %s", c->name, path, pvx_diag_text(&why, e));
    PVX_THEN(e, temperature_room(t));
    if (e != PVX_OK)
        dmn_temperature_free(out);
    return e;
}

static pvx_err temperature_pub(dmn_temperature *t, const struct dmn_temperature_params *p,
                               struct pvx_diag *d)
{
    const char *endpoint = p->config->temperature;
    bool guarded = dmn_endpoint_guarded(p->config, endpoint, DMN_VOLUMES);
    struct pvp_start s = *p->start;
    s.grid = t->grid;
    snprintf(s.units, sizeof s.units, "K");
    struct pvp_pub_params pp = {.auth = p->auth,
                                .rig = p->rig_text,
                                .send_hwm = (int)p->config->hwm,
                                /* half floats have steps of 1 K */ .sample = PVP_F32,
                                .comp = (enum pvp_compress)atomic_load(&t->compress)};
    *(guarded ? &pp.guarded : &pp.endpoints) = &endpoint;
    *(guarded ? &pp.n_guarded : &pp.n_endpoints) = 1;
    PVX_TRY(dmn_endpoint_prepare(endpoint, d));
    return pvp_pub_new(&pp, &s, &t->pub, d);
}

pvx_err dmn_temperature_open(dmn_temperature *t, const struct dmn_temperature_params *p,
                             struct pvx_diag *d)
{
    if (t == NULL)
        return PVX_OK;
    pvx_err e = temperature_pub(t, p, d);
    if (e == PVX_OK && pthread_create(&t->thread, NULL, temperature_run, t) != 0)
        e = PVX_EIO;
    if (e != PVX_OK)
        return pvx_fail(d, e, ENDPOINT ": %s", pvx_strerror(e));
    t->started = true;
    pthread_setname_np(t->thread, "temperature");
    return PVX_OK;
}

void dmn_temperature_free(dmn_temperature **tp)
{
    dmn_temperature *t = *tp;
    if (t == NULL)
        return;
    atomic_store(&t->ending, true);
    pvx_bell_ring(&t->bell);
    if (t->started)
        pthread_join(t->thread, NULL);
    pvp_pub_free(&t->pub);
    rec_soot_free(&t->soot);
    pvx_unreserve(t->index, t->room * sizeof *t->index);
    pvx_unreserve(t->seen, t->room * sizeof *t->seen);
    pvx_unreserve(t->found, t->room * sizeof *t->found);
    pvx_unreserve(t->kelvin, t->room * sizeof *t->kelvin);
    pvx_unreserve(t->sd, t->room * sizeof *t->sd);
    pvx_bell_fini(&t->bell);
    PVX_FREE(*tp);
}

void dmn_temperature_compress(dmn_temperature *t, const struct dmn_config *c)
{
    if (t != NULL)
        atomic_store(&t->compress, (int)dmn_endpoint_compress(c, c->temperature));
}

void dmn_temperature_state(dmn_temperature *t, struct dmn_state *out)
{
    if (t == NULL)
        return;
    out->temperature.on = true;
    out->temperature.subscribers = atomic_load(&t->subscribers);
    out->temperature.made = atomic_load(&t->made);
    out->temperature.left_out = atomic_load(&t->left_out);
    out->temperature.without_bars = atomic_load(&t->without_bars);
}
