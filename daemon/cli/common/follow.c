#include "daemon/cli/common/follow.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "capture/gevsim/gvcam.h"
#include "recon/view/metrics.h"

pvx_err follow_init(struct follow *f, const char *endpoint, const char *key,
                    const struct follow_truth *truth, struct pvx_diag *d)
{
    memset(f, 0, sizeof *f);
    f->error = -1;
    if (truth != NULL)
        f->truth = *truth;
    PVX_TRY(pvp_decoder_new(&f->decoder));
    PVX_TRY(pvp_sub_new(endpoint, &(struct pvp_sub_options){.key = key}, &f->sub, d));
    follow_mark(f);
    return PVX_OK;
}

void follow_fini(struct follow *f)
{
    pvp_sub_free(&f->sub);
    pvp_decoder_free(&f->decoder);
    cJSON_Delete(f->status);
    free(f->dense);
    free(f->want);
    memset(f, 0, sizeof *f);
}

void follow_mark(struct follow *f)
{
    struct pvp_sub_stats st;
    pvp_sub_stats(f->sub, &st);
    f->lost_base = st.lost;
    f->volumes = f->missing = f->lost = f->error_n = 0;
    f->error_sum = f->error_worst = 0;
    f->latency = (struct pvx_hist){0};
    f->mark_ns = pvx_now_mono();
}

double follow_rate(const struct follow *f)
{
    double s = (double)(pvx_now_mono() - f->mark_ns) * 1e-9;
    return s > 0.5 ? (double)f->volumes / s
                   : 0; /* before that a volume or two would make thousands */
}

static void to_grid(const struct pvp_grid *w, struct rec_grid *out)
{
    for (int a = 0; a < 3; a++) {
        out->n[a] = (int32_t)w->n[a];
        out->min[a] = w->min[a];
        out->max[a] = w->max[a];
    }
    out->basis = w->basis == 1 ? REC_TRILINEAR : REC_BOX;
}

bool follow_grid(const struct follow *f, struct rec_grid *out, int *channels)
{
    const struct pvp_start *s = pvp_sub_start(f->sub);
    if (s == NULL)
        return false;
    to_grid(&s->grid, out);
    *channels = (int)s->grid.channels;
    return true;
}

/* Scene time of the pictures that were exposed at `t`, s. */
static double scene_time(const struct follow_truth *t, int64_t t_ns)
{
    if (t->ring_fps > 0) {
        int64_t n = llround(t->period_s * t->ring_fps);
        return (double)(cap_gvcam_index(t_ns, t->ring_fps) % n) / t->ring_fps;
    }
    return (double)(t_ns % (int64_t)(t->period_s * (double)PVX_NS_PER_S)) * 1e-9;
}

static pvx_err follow_room(float **p, size_t *have, size_t want)
{
    if (*have >= want)
        return PVX_OK;
    free(*p);
    *have = 0;
    *p = pvx_calloc(want, sizeof **p);
    PVX_NEED(*p);
    *have = want;
    return PVX_OK;
}

static pvx_err follow_compare(struct follow *f, const struct rec_grid *g, int channels,
                              int64_t t_ns)
{
    size_t n = rec_grid_count(g);
    PVX_TRY(follow_room(&f->want, &f->want_n, n * 3));
    struct rec_flame flame;
    struct rec_flame_pose pose;
    rec_flame_init(&flame, g, f->truth.seed);
    flame.period_s = f->truth.period_s;
    rec_flame_at(&flame, scene_time(&f->truth, t_ns), &pose);
    rec_flame_voxels(&pose, g, 0, g->n[2], f->want);
    if (channels == 1)
        for (size_t i = 0; i < n; i++) /* in place: index 3 i is never behind i */
            f->want[i] = (f->want[3 * i] + f->want[3 * i + 1] + f->want[3 * i + 2]) / 3;
    f->error = rec_rel_l2(f->dense, f->want, n * (size_t)channels);
    f->error_sum += f->error;
    f->error_n++;
    if (f->error > f->error_worst)
        f->error_worst = f->error;
    return PVX_OK;
}

/* Count the sets that should have come between this volume and the one before. */
static void count_missing(struct follow *f, const struct pvp_volume *v)
{
    const struct pvp_start *s = pvp_sub_start(f->sub);
    if (f->session == v->session && s != NULL && s->fps > 0) {
        double periods = (double)(v->t_exposure_ns - f->last_exposure_ns) * 1e-9 * s->fps;
        if (periods > 1.5 && periods < 1e6)
            f->missing += (uint64_t)(llround(periods) - 1);
    }
    f->session = v->session;
    f->last_exposure_ns = v->t_exposure_ns;
}

static pvx_err got_volume(struct follow *f, const void *msg, size_t len, struct pvx_diag *d)
{
    struct pvp_view v;
    PVX_TRY(pvp_decode_volume(msg, len, &v, d));
    f->volumes++;
    f->last = v.v;
    f->ended = false;
    pvx_hist_add(&f->latency, v.v.latency_ns);
    count_missing(f, &v.v);
    int64_t now = pvx_now_mono();
    if (now < f->next_unpack_ns)
        return PVX_OK;
    f->next_unpack_ns = now + FOLLOW_UNPACK_NS;
    struct rec_grid g;
    to_grid(&v.v.grid, &g);
    size_t count = rec_grid_count(&g) * v.v.grid.channels;
    f->have_dense = false;
    PVX_TRY(follow_room(&f->dense, &f->dense_n, count));
    PVX_TRY(pvp_volume_unpack(f->decoder, &v, f->dense, count, d));
    f->have_dense = true;
    return f->truth.known ? follow_compare(f, &g, (int)v.v.grid.channels, v.v.t_exposure_ns)
                          : PVX_OK;
}

static pvx_err got_message(struct follow *f, const struct pvp_header *h, const void *msg,
                           size_t len, struct pvx_diag *d)
{
    const char *json;
    size_t n;
    uint64_t session;
    switch (h->type) {
    case PVP_VOLUME: return got_volume(f, msg, len, d);
    case PVP_STATUS:
        PVX_TRY(pvp_decode_status(msg, len, &json, &n, d));
        cJSON_Delete(f->status);
        f->status = cJSON_ParseWithLength(json, n);
        return PVX_OK;
    case PVP_END:
        PVX_TRY(pvp_decode_end(msg, len, &session, f->end_reason, d));
        f->ended = true;
        return PVX_OK;
    default: return PVX_OK; /* start and rig are kept by the subscriber */
    }
}

pvx_err follow_poll(struct follow *f, int64_t timeout_ns, struct pvx_diag *d)
{
    for (;;) {
        struct pvp_header h;
        const void *msg;
        size_t len;
        pvx_err e = pvp_sub_next(f->sub, timeout_ns, &h, &msg, &len, d);
        if (e == PVX_ETIMEDOUT || e == PVX_ECANCELED)
            break;
        if (e != PVX_OK)
            return e;
        PVX_TRY(got_message(f, &h, msg, len, d));
        timeout_ns = 0;
    }
    struct pvp_sub_stats st;
    pvp_sub_stats(f->sub, &st);
    f->lost = st.lost - f->lost_base;
    return PVX_OK;
}
