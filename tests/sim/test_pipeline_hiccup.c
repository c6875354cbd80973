/* test_pipeline_hiccup.c - sim: sets that come while the solver is held up wait for it, as many as there are places,
 * and none is given up. */
#include <unistd.h>

#include "base/clock.h"
#include "daemon/pipeline/pipeline.h"
#include "tests/t.h"

#define BURST DMN_WAITING_MAX

struct bed {
    struct rec_rig rig;
    rec_sysmat *S;
    dmn_pipeline *p;
    uint64_t sets;
};

/* One set, then some at once, while the solver is at the first. */
static pvx_err next(void *ctx, struct dmn_slot *s)
{
    struct bed *b = ctx;
    struct dmn_state state;
    dmn_pipeline_counts(b->p, &state);
    if (b->sets == 1 && state.stage[1].queued > 0) {
        usleep(1000);
        return PVX_ETIMEDOUT;
    }
    if (b->sets == 1 + BURST)
        return PVX_ECLOSED;
    s->set = ++b->sets;
    s->t_last_mono_ns = pvx_now_mono();
    for (size_t c = 0; c < b->rig.n_cameras; c++) {
        size_t n = (size_t)b->rig.cameras[c].width * (size_t)b->rig.cameras[c].height * 4;
        float *in = rec_frame_input(s->frame, c);
        for (size_t i = 0; i < n; i++)
            in[i] = 0.2F + 0.5F * (float)t_uniform(0, 1);
        rec_frame_camera(s->frame, c)->present = true;
    }
    return PVX_OK;
}
static bool put(void *ctx, const struct dmn_slot *s)
{
    (void)ctx;
    (void)s;
    return true;
}

T_CASE(sets_wait_while_the_solver_is_held_up)
{
    struct bed b = {.sets = 0};
    struct dmn_state state;
    T_EQ_I(rec_rig_ring(4, 2.5, 40, 30, 16, &b.rig), PVX_OK);
    T_EQ_I(rec_sysmat_build(&b.rig, &rec_sysmat_defaults, NULL, NULL, NULL, &b.S, NULL), PVX_OK);
    struct dmn_pipeline_params a = {.S = b.S,
                                    .rig = &b.rig,
                                    .frame = rec_frame_defaults,
                                    .waiting = BURST,
                                    .deadline = {.limit_ns = PVX_NS_PER_S},
                                    .source = {next, &b},
                                    .sink = {.name = "put", .put = put}};
    a.frame.photo.threshold = 0.1F;
    a.frame.trust_all = true;
    a.frame.solve.solver = "mlem"; /* until its deadline */
    a.frame.solve.stop = REC_STOP_ITERATIONS;
    a.frame.solve.iterations = 1U << 30;
    T_EQ_I(dmn_pipeline_new(&a, &b.p, NULL), PVX_OK);
    T_EQ_I(dmn_pipeline_start(b.p, NULL), PVX_OK);
    dmn_pipeline_join(b.p);
    dmn_pipeline_counts(b.p, &state);
    T_EQ_I(state.produced, 1 + BURST);
    T_EQ_I(state.dropped[DMN_DROP_SOLVE], 0);
    T_EQ_I(state.inside, 0);
    dmn_pipeline_free(&b.p);
    rec_sysmat_free(&b.S);
    rec_rig_fini(&b.rig);
}
