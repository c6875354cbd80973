#include "daemon/pipeline/watch.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#include "base/bell.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "recon/check/drift.h"
#include "recon/vote/wrong.h"

#define LEAST  19  /* nice */
#define REST   4   /* times as long as it worked */
#define ACROSS 160 /* bins across its pictures, about */

struct dmn_watch {
    const struct rec_rig *rig;
    const rec_sysmat *S;
    int32_t times; /* its bins are so many of S's, squared */
    size_t row0[REC_MAX_CAMERAS + 1];
    float *picture; /* [rows], one channel */
    uint64_t mask;  /* cameras of the set in it */
    atomic_bool wanted, full, ending;
    struct pvx_bell bell;
    pthread_t thread;
    bool started;
    pthread_mutex_t lock; /* of what follows */
    struct dmn_rig_state state[REC_MAX_CAMERAS];
};

/* ---- the carve stage's side ---------------------------------------------------------------------- */

/* One bin: the mean of its channels' means over what the set's weights leave; NAN where a channel has none. */
static float bin(const rec_frame *f, size_t first, size_t pitch, int32_t times)
{
    const float *b = rec_frame_rhs(f), *w4 = rec_frame_weight4(f), *w = rec_frame_weight(f);
    size_t nch = (size_t)rec_frame_channels(f), cs = nch == 3 ? 4 : 1;
    float total = 0;
    for (size_t l = 0; l < nch; l++) {
        float sum = 0, n = 0;
        for (int32_t y = 0; y < times; y++)
            for (int32_t x = 0; x < times; x++) {
                size_t i = first + (size_t)y * pitch + (size_t)x;
                float weight = w4 != NULL ? w4[i * 4 + l] : w[i];
                sum += weight > 0 ? b[i * cs + l] : 0;
                n += weight > 0;
            }
        total += sum / n; /* 0/0: NAN */
    }
    return total / (float)nch;
}

void dmn_watch_offer(dmn_watch *w, const rec_frame *f, uint64_t mask)
{
    if (w == NULL || !atomic_load_explicit(&w->wanted, memory_order_acquire))
        return;
    atomic_store(&w->wanted, false);
    for (size_t c = 0; c < w->rig->n_cameras; c++) {
        const struct rec_sysmat_block *B = &w->S->block[c];
        float *out = w->picture + w->row0[c];
        if ((mask >> c & 1) == 0)
            continue;
        for (int32_t y = 0; y + w->times <= B->bh; y += w->times)
            for (int32_t x = 0; x + w->times <= B->bw; x += w->times)
                *out++ = bin(f, w->S->row0[c] + (size_t)y * (size_t)B->bw + (size_t)x,
                             (size_t)B->bw, w->times);
    }
    w->mask = mask;
    atomic_store(&w->full, true);
    pvx_bell_ring(&w->bell);
}

/* ---- the thread ---------------------------------------------------------------------------------- */

static void tell(dmn_watch *w, const rec_drift *d, uint64_t changed)
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
            LOG_W(DAEMON,
                  "camera %s has moved: its pictures are %.1f px to the %s and %.1f px %s of where "
                  "the "
                  "others see the flame; %s",
                  name, fabs(by[0]), by[0] < 0 ? "left" : "right", fabs(by[1]),
                  by[1] < 0 ? "above" : "below", rec_wrong_remedy(REC_WRONG_MOVED));
        else
            LOG_I(DAEMON, "camera %s is again where the rig says", name);
    }
}

/* This thread, on a processor. */
static int64_t worked_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return t.tv_sec * PVX_NS_PER_S + t.tv_nsec;
}

static void *run(void *arg)
{
    dmn_watch *w = arg;
    struct rec_drift_params p = REC_DRIFT_DEFAULTS;
    rec_drift *d;
    struct pvx_diag why = {""};
    setpriority(PRIO_PROCESS, 0,
                LEAST); /* Linux: of this thread; where it is refused, the rests do */
    int32_t longest = 0;
    for (int a = 0; a < 3; a++)
        longest = w->S->grid.n[a] > longest ? w->S->grid.n[a] : longest;
    if (p.unseen.voxels > longest) /* no finer than the volumes */
        p.unseen.voxels = longest > 4 ? longest : 4;
    p.unseen.binning = w->S->binning * w->times;
    if (rec_drift_new(w->rig, &p, NULL, &d, &why) != PVX_OK) {
        LOG_W(DAEMON, "cameras that move are not noticed: %s", why.text);
        return NULL;
    }
    while (!atomic_load(&w->ending)) {
        atomic_store(&w->wanted, true);
        while (!atomic_load(&w->full) && !atomic_load(&w->ending))
            pvx_bell_wait(&w->bell, INT64_MAX);
        if (atomic_load(&w->ending))
            break;
        const float *picture[REC_MAX_CAMERAS] = {0};
        uint64_t changed;
        for (size_t c = 0; c < w->rig->n_cameras; c++)
            picture[c] = (w->mask >> c & 1) != 0 ? w->picture + w->row0[c] : NULL;
        int64_t t0 = worked_ns();
        if (rec_drift_add(d, picture, true, &changed) == PVX_OK)
            tell(w, d, changed);
        atomic_store(&w->full, false);
        int64_t until = pvx_now_mono() + REST * (worked_ns() - t0);
        while (!atomic_load(&w->ending) && pvx_now_mono() < until)
            pvx_bell_wait(&w->bell, until);
    }
    rec_drift_free(&d);
    return NULL;
}

/* ---- life ---------------------------------------------------------------------------------------- */

pvx_err dmn_watch_new(const struct rec_rig *rig, const rec_sysmat *S, dmn_watch **out,
                      struct pvx_diag *d)
{
    *out = NULL;
    if (rig->n_cameras < REC_DRIFT_LEAST)
        return PVX_OK;
    dmn_watch *w = *out = pvx_calloc(1, sizeof *w);
    if (w == NULL)
        return pvx_fail(d, PVX_ENOMEM, "watch: out of memory");
    w->rig = rig;
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
    w->picture = pvx_calloc(w->row0[rig->n_cameras], sizeof *w->picture);
    pvx_err e = w->picture == NULL ? PVX_ENOMEM : PVX_OK;
    if (e == PVX_OK && pthread_create(&w->thread, NULL, run, w) != 0)
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
    free(w->picture);
    PVX_FREE(*wp);
}

void dmn_watch_state(dmn_watch *w, struct dmn_state *out)
{
    if (w == NULL)
        return;
    pthread_mutex_lock(&w->lock);
    memcpy(out->rig, w->state, sizeof out->rig);
    pthread_mutex_unlock(&w->lock);
}
