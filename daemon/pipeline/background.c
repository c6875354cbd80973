#include "daemon/pipeline/background.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "recon/light/light.h"

#define PATIENCE_NS (5 * PVX_NS_PER_S)
#define LEAST_SETS  2

enum { IDLE, WANTED, DONE };

struct dmn_background {
    const rec_sysmat *S;
    const struct rec_rig *rig;
    int nch, cs;
    pthread_mutex_t one; /* request at a time */
    atomic_int state;    /* WANTED: the rest is the carve stage's */
    atomic_uint seen;    /* sets */
    uint32_t sets;
    double *sum; /* [rows][cs] */
    uint32_t *n; /* [rows][cs] finite ones */
    float *mean; /* [rows][cs] */
    uint32_t count[REC_MAX_CAMERAS];
    struct rec_light_still still[REC_MAX_CAMERAS];
    pvx_err e;
    struct pvx_diag why;
};

pvx_err dmn_background_new(const rec_sysmat *S, const struct rec_rig *rig, int nch,
                           dmn_background **out, struct pvx_diag *d)
{
    dmn_background *b = *out = pvx_calloc(1, sizeof *b);
    if (b == NULL)
        return pvx_fail(d, PVX_ENOMEM, "no memory for a background");
    b->S = S;
    b->rig = rig;
    b->nch = nch;
    b->cs = nch == 3 ? 4 : 1;
    pthread_mutex_init(&b->one, NULL);
    return PVX_OK;
}

static void let_go(dmn_background *b)
{
    PVX_FREE(b->sum);
    PVX_FREE(b->n);
    PVX_FREE(b->mean);
}

void dmn_background_free(dmn_background **bp)
{
    if (*bp == NULL)
        return;
    let_go(*bp);
    pthread_mutex_destroy(&(*bp)->one);
    PVX_FREE(*bp);
}

/* ---- the request ---- */

static pvx_err get_room(dmn_background *b)
{
    size_t n = b->S->row0[b->S->n_cameras] * (size_t)b->cs;
    let_go(b);
    b->sum = pvx_calloc(n, sizeof *b->sum);
    b->n = pvx_calloc(n, sizeof *b->n);
    b->mean = pvx_calloc(n, sizeof *b->mean);
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++) {
        b->count[c] = 0;
        b->still[c] = (struct rec_light_still){0};
    }
    return b->sum != NULL && b->n != NULL && b->mean != NULL ? PVX_OK : PVX_ENOMEM;
}

/* Until the carve stage has done it, or no set comes any more. */
static pvx_err await(dmn_background *b, struct pvx_diag *d)
{
    unsigned seen = atomic_load(&b->seen);
    int64_t last = pvx_now_mono();
    while (atomic_load(&b->state) != DONE) {
        pvx_sleep_until_mono(pvx_now_mono() + 5 * PVX_NS_PER_MS);
        if (atomic_load(&b->seen) != seen) {
            seen = atomic_load(&b->seen);
            last = pvx_now_mono();
        }
        int wanted = WANTED;
        if (pvx_now_mono() - last > PATIENCE_NS &&
            atomic_compare_exchange_strong(&b->state, &wanted, IDLE))
            return pvx_fail(d, PVX_ETIMEDOUT,
                            "no set came for 5 s: no background; look at `pyrovox status`");
    }
    if (b->e != PVX_OK && d != NULL)
        *d = b->why;
    return b->e;
}

pvx_err dmn_background_take(dmn_background *b, uint32_t sets, struct pvx_diag *d)
{
    if (sets == 1 || sets > DMN_BACKGROUND_SETS_MAX)
        return pvx_fail(d, PVX_EINVAL, "sets should be 2 to %d, or 0 for no background",
                        DMN_BACKGROUND_SETS_MAX);
    if (pthread_mutex_trylock(&b->one) != 0)
        return pvx_fail(d, PVX_EBUSY, "a background is being taken already");
    pvx_err e = get_room(b);
    if (e == PVX_OK) {
        b->sets = sets;
        b->e = PVX_OK;
        b->why.text[0] = '\0';
        atomic_store(&b->state, WANTED);
        e = await(b, d);
    }
    pthread_mutex_unlock(&b->one);
    return e;
}

/* ---- the carve stage ---- */

static void add(dmn_background *b, const struct dmn_slot *s, size_t c)
{
    const struct rec_sysmat_block *k = &b->S->block[c];
    const float *v = rec_frame_input(s->frame, c);
    size_t at = b->S->row0[c] * (size_t)b->cs, n = (size_t)k->bw * (size_t)k->bh * (size_t)b->cs;
    for (size_t i = 0; i < n; i++)
        if (isfinite(v[i])) {
            b->sum[at + i] += (double)v[i];
            b->n[at + i]++;
        }
    rec_light_still_add(&b->still[c], v, (const int32_t[]){k->bw, k->bh}, b->nch, b->cs);
    b->count[c]++;
}

static pvx_err judge(dmn_background *b)
{
    for (size_t c = 0; c < b->rig->n_cameras; c++) {
        const char *name = b->rig->cameras[c].name;
        double by;
        int region = rec_light_moves(&b->still[c], &by);
        if (b->count[c] * 2 < b->sets || b->count[c] < LEAST_SETS)
            return pvx_fail(&b->why, PVX_EINVAL,
                            "camera %s was in %u of %u sets only: no background; look at `pyrovox "
                            "status`",
                            name, b->count[c], b->sets);
        if (region >= 0)
            return pvx_fail(
                &b->why, PVX_EINVAL,
                "camera %s: something moves in the background (8ths of the picture: column "
                "%d, row %d; by %.4f of full scale): put the flame out first",
                name, region % 8 + 1, region / 8 + 1, by);
    }
    return PVX_OK;
}

static pvx_err use(dmn_background *b, dmn_pipeline *p)
{
    size_t n = b->S->row0[b->S->n_cameras] * (size_t)b->cs;
    for (size_t i = 0; i < n; i++)
        b->mean[i] = b->n[i] > 0 ? (float)(b->sum[i] / b->n[i]) : 0;
    for (size_t c = 0; c < b->rig->n_cameras; c++) {
        const float *of = b->sets == 0 ? NULL : b->mean + b->S->row0[c] * (size_t)b->cs;
        PVX_TRY(dmn_pipeline_background(p, c, of));
    }
    if (b->sets == 0)
        LOG_I(DAEMON, "no background any more");
    else
        LOG_I(DAEMON, "background: the mean of %u sets", b->sets);
    return PVX_OK;
}

void dmn_background_look(dmn_background *b, const struct dmn_slot *s, dmn_pipeline *p)
{
    if (atomic_load_explicit(&b->state, memory_order_acquire) != WANTED)
        return;
    for (size_t c = 0; c < b->rig->n_cameras && b->sets > 0; c++)
        if (s->mask >> c & 1)
            add(b, s, c);
    uint32_t most = 0;
    for (size_t c = 0; c < b->rig->n_cameras; c++)
        most = b->count[c] > most ? b->count[c] : most;
    atomic_fetch_add(&b->seen, 1);
    if (most < b->sets)
        return;
    b->e = b->sets > 0 ? judge(b) : PVX_OK;
    if (b->e == PVX_OK)
        b->e = use(b, p);
    atomic_store(&b->state, DONE);
}
