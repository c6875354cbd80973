#include "daemon/pipeline/instant.h"

#include <string.h>

#include "base/clock.h"
#include "base/mem.h"

#define SET_NS    (5 * PVX_NS_PER_S)
#define VOLUME_NS (30 * PVX_NS_PER_S)
#define LOOK_NS   (2 * PVX_NS_PER_MS)

/* The state says which thread owns `set` and the members after it.  IDLE and READY: the taker; WANTED: the carve
 * stage; CARRIED: the last stage; BUSY, for a moment: the thread that set it. */
enum { IDLE, WANTED, CARRIED, BUSY, READY };

struct dmn_instant {
    size_t count; /* voxels of the grid */
    int nch, cs;
    const atomic_bool *stopping;
    atomic_int state;
    atomic_uint carried; /* sets taken since the request */
    struct cap_set *set;
    struct pvp_volume volume;
    int32_t n;
    int32_t *index; /* [count] */
    float *value;   /* [count][cs] */
};

pvx_err dmn_instant_new(const struct rec_grid *g, int nch, const atomic_bool *stopping,
                        dmn_instant **out)
{
    dmn_instant *in = *out = pvx_calloc(1, sizeof *in);
    PVX_NEED(in);
    in->count = rec_grid_count(g);
    in->nch = nch;
    in->cs = nch == 3 ? 4 : 1;
    in->stopping = stopping;
    return PVX_OK;
}

static void instant_let_go(dmn_instant *in)
{
    cap_set_release(in->set);
    in->set = NULL;
    if (in->index != NULL)
        pvx_unreserve(in->index, in->count * sizeof *in->index);
    if (in->value != NULL)
        pvx_unreserve(in->value, in->count * (size_t)in->cs * sizeof *in->value);
    in->index = NULL;
    in->value = NULL;
}

void dmn_instant_free(dmn_instant **in)
{
    if (*in == NULL)
        return;
    instant_let_go(*in);
    PVX_FREE(*in);
}

/* ---- the stages ---- */

static bool becomes_busy(dmn_instant *in, int from)
{
    return in != NULL && atomic_load(&in->state) == from &&
           atomic_compare_exchange_strong(&in->state, &from, BUSY);
}

void dmn_instant_look(dmn_instant *in, struct cap_set *s)
{
    if (!becomes_busy(in, WANTED))
        return;
    cap_set_ref(s);
    in->set = s;
    atomic_fetch_add(&in->carried, 1);
    atomic_store(&in->state, CARRIED);
}

void dmn_instant_volume(dmn_instant *in, const struct pvp_volume *m, const struct rec_sparse *v)
{
    if (!becomes_busy(in, CARRIED))
        return;
    if (m->set < in->set->number) { /* an earlier set */
        atomic_store(&in->state, CARRIED);
        return;
    }
    if (m->set > in->set->number) { /* the set was dropped, as sets keep their order */
        cap_set_release(in->set);
        in->set = NULL;
        atomic_store(&in->state, WANTED);
        return;
    }
    in->volume = *m;
    in->n = v->n;
    memcpy(in->index, v->index, (size_t)v->n * sizeof *v->index);
    memcpy(in->value, v->value, (size_t)v->n * (size_t)v->cs * sizeof *v->value);
    atomic_store(&in->state, READY);
}

/* ---- the taker ---- */

/* Reserve room for a volume.  The expected part is touched here, not by the stage that fills it. */
static bool instant_get_room(dmn_instant *in, size_t voxels)
{
    in->index = pvx_reserve(in->count * sizeof *in->index);
    in->value = pvx_reserve(in->count * (size_t)in->cs * sizeof *in->value);
    if (in->index == NULL || in->value == NULL)
        return false;
    voxels = voxels < in->count ? voxels : in->count;
    memset(in->index, 0, voxels * sizeof *in->index);
    memset(in->value, 0, voxels * (size_t)in->cs * sizeof *in->value);
    return true;
}

/* Take the request back from a stage, which keeps it BUSY for a moment at most.  false: the volume came after all. */
static bool instant_give_up(dmn_instant *in)
{
    for (;;) {
        int state = atomic_load(&in->state);
        if (state == READY)
            return false;
        if (state != BUSY && atomic_compare_exchange_strong(&in->state, &state, IDLE))
            return true;
        pvx_sleep_until_mono(pvx_now_mono() + PVX_NS_PER_MS / 10);
    }
}

static pvx_err wait_for_it(dmn_instant *in, struct pvx_diag *d)
{
    int64_t t0 = pvx_now_mono();
    while (atomic_load(&in->state) != READY) {
        pvx_sleep_until_mono(pvx_now_mono() + LOOK_NS);
        unsigned sets = atomic_load(&in->carried);
        bool stop = atomic_load(in->stopping);
        if (!stop && pvx_now_mono() - t0 < (sets > 0 ? VOLUME_NS : SET_NS))
            continue;
        if (!instant_give_up(in))
            return PVX_OK;
        return stop ? pvx_fail(d, PVX_ECANCELED, "the daemon stops")
               : sets == 0
                   ? pvx_fail(d, PVX_ETIMEDOUT,
                              "no frame set came for 5 s, nothing is kept; look at "
                              "`pyrovox status`")
                   : pvx_fail(d, PVX_ETIMEDOUT,
                              "%u frame sets came within 30 s, and none became a volume; look at "
                              "what is dropped in `pyrovox status`",
                              sets);
    }
    return PVX_OK;
}

pvx_err dmn_instant_take(dmn_instant *in, size_t voxels, struct dmn_instant_got *out,
                         struct pvx_diag *d)
{
    pvx_err e =
        instant_get_room(in, voxels) ? PVX_OK : pvx_fail(d, PVX_ENOMEM, "no memory for a volume");
    if (e == PVX_OK) {
        atomic_store(&in->carried, 0);
        atomic_store(&in->state, WANTED);
        e = wait_for_it(in, d);
    }
    if (e != PVX_OK) {
        instant_let_go(in);
        return e;
    }
    *out = (struct dmn_instant_got){
        .set = in->set,
        .volume = in->volume,
        .x = {.nch = in->nch, .cs = in->cs, .n = in->n, .index = in->index, .value = in->value}};
    return PVX_OK;
}

void dmn_instant_done(dmn_instant *in, struct dmn_instant_got *got)
{
    instant_let_go(in);
    atomic_store(&in->state, IDLE);
    *got = (struct dmn_instant_got){0};
}
