#include "daemon/pipeline/background.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "recon/light/light.h"

#define PATIENCE_NS (5 * PVX_NS_PER_S)
#define LEAST_SETS  2

/* In WANTED and BUSY the carve stage owns the struct, except `seen` and the members of begin's thread; in the other
 * states begin's thread owns it. */
enum { IDLE, WANTED, BUSY, DONE, FAILED };

struct dmn_background {
    const rec_sysmat *S;
    const struct rec_rig *rig;
    int nch, cs;
    atomic_int state;
    atomic_uint seen; /* sets */
    atomic_uint have; /* sets of the camera that has most */
    uint32_t sets;
    double *sum;                  /* [rows][cs] */
    uint32_t *n;                  /* [rows][cs] number of finite values */
    float *mean[REC_MAX_CAMERAS]; /* [rows of it][cs]; when done: the previous one, or NULL */
    uint32_t count[REC_MAX_CAMERAS];
    struct rec_light_still still[REC_MAX_CAMERAS];
    struct pvx_diag why;
    /* begin's thread: */
    unsigned request, looked; /* looked: `seen` when */
    int64_t looked_ns;
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
    return PVX_OK;
}

static void background_let_go(dmn_background *b)
{
    PVX_FREE(b->sum);
    PVX_FREE(b->n);
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        PVX_FREE(b->mean[c]);
}

void dmn_background_free(dmn_background **bp)
{
    if (*bp == NULL)
        return;
    background_let_go(*bp);
    PVX_FREE(*bp);
}

/* ---- the request ---- */

static bool background_get_room(dmn_background *b)
{
    size_t n = b->S->row0[b->S->n_cameras] * (size_t)b->cs;
    background_let_go(b);
    memset(b->count, 0, sizeof b->count);
    memset(b->still, 0, sizeof b->still);
    if (b->sets == 0)
        return true;
    b->sum = pvx_calloc(n, sizeof *b->sum);
    b->n = pvx_calloc(n, sizeof *b->n);
    bool ok = b->sum != NULL && b->n != NULL;
    for (size_t c = 0; c < b->S->n_cameras && ok; c++) {
        size_t rows = b->S->row0[c + 1] - b->S->row0[c];
        b->mean[c] = pvx_calloc(rows * (size_t)b->cs, sizeof(float));
        ok = b->mean[c] != NULL;
    }
    return ok;
}

/* Take the request back from the carve stage, which keeps it BUSY for a moment at most. */
static void background_give_up(dmn_background *b, const char *why)
{
    int wanted = WANTED;
    while (!atomic_compare_exchange_strong(&b->state, &wanted, IDLE)) {
        if (wanted != BUSY)
            return;
        wanted = WANTED;
        pvx_sleep_until_mono(pvx_now_mono() + PVX_NS_PER_MS / 10);
    }
    b->why.text[0] = '\0';
    pvx_fail(&b->why, PVX_ETIMEDOUT, "%s", why);
    atomic_store(&b->state, FAILED);
}

void dmn_background_state(dmn_background *b, struct dmn_background_state *out)
{
    unsigned seen = atomic_load(&b->seen);
    if (seen != b->looked) {
        b->looked = seen;
        b->looked_ns = pvx_now_mono();
    }
    if (pvx_now_mono() - b->looked_ns > PATIENCE_NS && atomic_load(&b->state) == WANTED)
        background_give_up(b, "no set came for 5 s: no background; look at `pyrovox status`");
    int state = atomic_load(&b->state);
    *out = (struct dmn_background_state){.request = b->request,
                                         .state = state == IDLE     ? DMN_TAKING_NONE
                                                  : state == DONE   ? DMN_TAKING_DONE
                                                  : state == FAILED ? DMN_TAKING_FAILED
                                                                    : DMN_TAKING_NOW,
                                         .sets = b->sets,
                                         .have = atomic_load(&b->have)};
    if (state == FAILED)
        out->why = b->why;
}

pvx_err dmn_background_begin(dmn_background *b, uint32_t sets, struct pvx_diag *d)
{
    struct dmn_background_state s;
    if (sets == 1 || sets > DMN_BACKGROUND_SETS_MAX)
        return pvx_fail(d, PVX_EINVAL, "sets should be 2 to %d, or 0 for no background",
                        DMN_BACKGROUND_SETS_MAX);
    dmn_background_state(b, &s);
    if (s.state == DMN_TAKING_NOW && sets > 0)
        return pvx_fail(d, PVX_EBUSY,
                        "a background is being taken already, %u of %u sets; --sets 0 ends that",
                        s.have, s.sets);
    if (s.state == DMN_TAKING_NOW)
        background_give_up(b, "another request ended it");
    b->sets = sets;
    if (!background_get_room(b)) {
        background_let_go(b);
        return pvx_fail(d, PVX_ENOMEM, "no memory for a background");
    }
    b->request++;
    b->looked = atomic_load(&b->seen);
    b->looked_ns = pvx_now_mono();
    b->why.text[0] = '\0';
    if (sets > 0)
        LOG_I(DAEMON, "taking a background of %u sets", sets);
    atomic_store(&b->have, 0);
    atomic_store(&b->state, WANTED);
    return PVX_OK;
}

/* ---- the carve stage ---- */

static void background_add(dmn_background *b, const struct dmn_slot *s, size_t c)
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

static pvx_err background_judge(dmn_background *b)
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

static void background_use(dmn_background *b, dmn_pipeline *p)
{
    for (size_t c = 0; c < b->rig->n_cameras; c++) {
        size_t at = b->S->row0[c] * (size_t)b->cs, n = b->S->row0[c + 1] * (size_t)b->cs - at;
        for (size_t i = 0; i < n && b->sets > 0; i++)
            b->mean[c][i] = b->n[at + i] > 0 ? (float)(b->sum[at + i] / b->n[at + i]) : 0;
        dmn_pipeline_background(p, c, &b->mean[c]);
    }
    if (b->sets == 0)
        LOG_I(DAEMON, "the background is removed");
    else
        LOG_I(DAEMON, "background: the mean of %u sets", b->sets);
}

void dmn_background_look(dmn_background *b, const struct dmn_slot *s, dmn_pipeline *p)
{
    int wanted = WANTED;
    if (atomic_load_explicit(&b->state, memory_order_relaxed) != WANTED ||
        !atomic_compare_exchange_strong(&b->state, &wanted, BUSY))
        return;
    for (size_t c = 0; c < b->rig->n_cameras && b->sets > 0; c++)
        if (s->mask >> c & 1)
            background_add(b, s, c);
    uint32_t most = 0;
    for (size_t c = 0; c < b->rig->n_cameras; c++)
        most = b->count[c] > most ? b->count[c] : most;
    atomic_store(&b->have, most);
    atomic_fetch_add(&b->seen, 1);
    bool good = most < b->sets || b->sets == 0 || background_judge(b) == PVX_OK;
    if (good && most >= b->sets)
        background_use(b, p);
    atomic_store(&b->state, !good ? FAILED : most < b->sets ? WANTED : DONE);
}
