/* test_draws.c - live error bars of the pipeline (daemon/pipeline/draws.h): they come with the volumes, in doubt at first and again
 * after a change of settings; every set is solved once more or counted by its cause; the volumes have the bits that they
 * have without; and nothing waits for a repeated solve. */
#include <unistd.h>

#include "base/clock.h"
#include "daemon/pipeline/pipeline.h"
#include "recon/frame/running.h"
#include "tests/lib/patience.h"
#include "tests/lib/scene.h"

#define MOST  2000
#define FIXED 24

struct bed {
    struct scene scene;
    dmn_pipeline *p;
    uint64_t sets, most, out;
    bool in_turn;       /* a set comes when the one before was solved once more, or counted */
    uint64_t dark_from; /* sets from this one on are dark; 0: none */
    uint64_t hash[MOST + 1];
    struct rec_bars_view bars[MOST + 1]; /* without what they point to */
    bool has_bars[MOST + 1];
    atomic_bool stop;
};

static uint64_t accounted(struct bed *b)
{
    struct dmn_draws_state s;
    dmn_pipeline_draws(b->p, &s);
    uint64_t all = s.made;
    for (int i = 0; i < DMN_N_LEFT_OUT; i++)
        all += s.left_out[i];
    return all;
}

static pvx_err bed_next(void *ctx, struct dmn_slot *s)
{
    struct bed *b = ctx;
    struct dmn_state state;
    dmn_pipeline_counts(b->p, &state);
    if (b->sets == b->most || atomic_load(&b->stop))
        return PVX_ECLOSED;
    if (state.published < b->sets || (b->in_turn && accounted(b) < b->sets)) {
        usleep(500);
        return PVX_ETIMEDOUT;
    }
    s->set = ++b->sets;
    s->t_last_mono_ns = pvx_now_mono();
    s->t_exposure_ns = (int64_t)s->set * 50 * PVX_NS_PER_MS;
    t_state = 77 + s->set;
    scene_shoot(&b->scene, s->frame, 0.01);
    for (size_t c = 0; c < b->scene.rig.n_cameras && b->dark_from != 0 && s->set >= b->dark_from;
         c++)
        memset(rec_frame_input(s->frame, c), 0,
               (b->scene.S->row0[c + 1] - b->scene.S->row0[c]) * 4 * sizeof(float));
    return PVX_OK;
}

static uint64_t bed_hash(const void *data, size_t n, uint64_t h)
{
    for (size_t i = 0; i < n; i++)
        h = (h ^ ((const uint8_t *)data)[i]) * 0x100000001B3u;
    return h;
}
static bool bed_put(void *ctx, const struct dmn_slot *s)
{
    struct bed *b = ctx;
    struct rec_sparse v;
    rec_frame_volume(s->frame, &v);
    b->hash[s->set] = bed_hash(v.index, (size_t)v.n * sizeof *v.index, 1);
    b->hash[s->set] =
        bed_hash(v.value, (size_t)v.n * (size_t)v.cs * sizeof *v.value, b->hash[s->set]);
    b->bars[s->set] = s->bars;
    b->has_bars[s->set] = s->bars.sd != NULL;
    T_OK(s->bars.sd == NULL || s->bars.n == v.n);
    for (size_t i = 0; s->bars.sd != NULL && i < (size_t)v.n * (size_t)v.cs; i++)
        T_OK(isfinite(s->bars.sd[i]) && s->bars.sd[i] >= 0);
    b->out++;
    return true;
}

static void bed_new(struct bed *b, bool draws, const struct rec_frame_params *frame, bool warm)
{
    memset(b, 0, sizeof *b);
    scene_new(&b->scene, 6, 64, 24, 1, 2);
    struct dmn_pipeline_params a = {.S = b->scene.S,
                                    .rig = &b->scene.rig,
                                    .pool = b->scene.pool,
                                    .frame = *frame,
                                    .warm = warm,
                                    .draws = draws,
                                    .waiting = DMN_WAITING_MAX, /* all slots */
                                    .period_ns = 50 * PVX_NS_PER_MS,
                                    .source = {bed_next, b},
                                    .sink = {.name = "put", .put = bed_put, .ctx = b}};
    T_EQ_I(dmn_pipeline_new(&a, &b->p, NULL), PVX_OK);
    b->in_turn = draws;
}
static void bed_run(struct bed *b, uint64_t most)
{
    b->most = most;
    T_EQ_I(dmn_pipeline_start(b->p, NULL), PVX_OK);
    dmn_pipeline_join(b->p);
}
static void bed_free(struct bed *b)
{
    dmn_pipeline_free(&b->p);
    scene_free(&b->scene);
}

static struct rec_frame_params plain(void)
{
    struct rec_frame_params p = rec_frame_defaults;
    p.photo.saturation = 1e30F;
    return p;
}

static struct bed one, two;

/* Warm, with a prediction, and with the cameras corrected in every set. */
T_CASE(volumes_have_the_same_bits)
{
    for (int i = 0; i < 3; i++) {
        struct rec_frame_params p = plain();
        p.temporal = i == 1;
        p.selfcal = i == 2 ? REC_SELFCAL_ON : REC_SELFCAL_OFF;
        bed_new(&one, false, &p, i != 2);
        bed_run(&one, FIXED);
        bed_new(&two, true, &p, i != 2);
        bed_run(&two, FIXED);
        struct dmn_draws_state s;
        dmn_pipeline_draws(two.p, &s);
        T_EQ_I(one.out, FIXED);
        T_EQ_I(two.out, FIXED);
        T_OK(s.made > 0);
        T_EQ_I(accounted(&two), FIXED);
        T_OK(memcmp(one.hash, two.hash, sizeof one.hash) == 0);
        for (int k = 1; k <= FIXED; k++)
            T_OK(!one.has_bars[k]);
        dmn_pipeline_draws(one.p, &s);
        T_OK(!s.on);
        bed_free(&one);
        bed_free(&two);
    }
}

/* Sets until there is no doubt, then until there is one again by new settings, then until it is gone. */
T_CASE(in_doubt_at_first_and_after_new_settings)
{
    const struct rec_frame_params p = plain();
    bed_new(&one, true, &p, true);
    one.most = MOST;
    T_EQ_I(dmn_pipeline_start(one.p, NULL), PVX_OK);
    struct dmn_draws_state s = {.none = true};
#define IS_LATE ((s.doubt & REC_BARS_LATE) != 0)
    UNTIL ((dmn_pipeline_draws(one.p, &s), (!s.none && !IS_LATE) || dmn_pipeline_finished(one.p)))
        usleep(1000);
    T_OK(!s.none && !IS_LATE);
    const struct dmn_tuning t = {.photo = p.photo, .solve = p.solve, .warm = true};
    dmn_pipeline_tune(one.p, &t);
    UNTIL ((dmn_pipeline_draws(one.p, &s), IS_LATE || dmn_pipeline_finished(one.p)))
        usleep(100);
    T_OK(IS_LATE);
    UNTIL ((dmn_pipeline_draws(one.p, &s), !IS_LATE || dmn_pipeline_finished(one.p)))
        usleep(1000);
    T_OK(!IS_LATE);
    atomic_store(&one.stop, true);
    dmn_pipeline_join(one.p);
    T_OK(!one.has_bars[1] && !one.has_bars[2]); /* a set's own solve is not in its bars */
    for (uint64_t k = 3; k < one.out; k++) {
        T_OK(!one.has_bars[k] || one.bars[k].solves <= k - 1);
        if (one.has_bars[k] && one.bars[k].solves < 14) /* six cameras and eight draws */
            T_OK((one.bars[k].doubt & REC_BARS_LATE) != 0);
    }
    dmn_pipeline_draws(one.p, &s);
    T_EQ_I(accounted(&one), one.out);
    T_OK(s.mean_ms > 0);
    bed_free(&one);
}

/* Dark sets have nothing to repeat, and no bars. */
T_CASE(dark_sets_are_counted)
{
    const struct rec_frame_params p = plain();
    struct dmn_draws_state s;
    bed_new(&one, true, &p, true);
    one.dark_from = 6;
    bed_run(&one, 10);
    dmn_pipeline_draws(one.p, &s);
    T_EQ_I(one.out, 10);
    T_EQ_I(s.left_out[DMN_LEFT_OUT_VOID] + s.left_out[DMN_LEFT_OUT_SHARE] +
               s.left_out[DMN_LEFT_OUT_TIME] + s.left_out[DMN_LEFT_OUT_BUSY] + s.made,
           10);
    T_OK(s.made <= 5);
    T_OK(!one.has_bars[10]);
    bed_free(&one);
}

/* As many sets as come, whether a repeated solve is under way or not: none is dropped for it, all are accounted for. */
T_CASE(nothing_waits)
{
    const struct rec_frame_params p = plain();
    struct dmn_state state;
    bed_new(&one, true, &p, true);
    one.in_turn = false;
    bed_run(&one, 60);
    dmn_pipeline_counts(one.p, &state);
    T_EQ_I(one.out, 60);
    T_EQ_I(state.produced, 60);
    T_EQ_I(state.inside, 0);
    T_EQ_I(accounted(&one), 60);
    bed_free(&one);
}

int main(void)
{
    t_run();
    return t_done();
}
