/* pipebed.h - a pipeline of sim: cameras in a folder of its own, and a subscriber that knows the flame. */
#ifndef PIPEBED_H
#define PIPEBED_H
#include "base/clock.h"
#include "base/file.h"
#include "base/log.h"
#include "daemon/pipeline/live.h"
#include "daemon/pipeline/pipeline.h"
#include "proto/clients/sub.h"
#include "recon/view/flame.h"
#include "recon/view/metrics.h"
#include "tests/lib/patience.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

static struct dmn_config cfg;
static struct dmn_state state;
static const char *bed_publish = "sample: f32, hwm: 10000";

static inline void bed_open(void)
{
    pvx_log_set_level(PVX_LOG_ERROR);
    scratch_new();
}

/* For main: nothing but the rig and its matrix may be left. */
static inline int bed_close(void)
{
    unlink(at("m"));
    unlink(at("rig.yaml"));
    if (rmdir(dir) == 0)
        return t_done();
    printf("FAIL %s is not empty\n", dir);
    return 1;
}

static inline void make_rig(size_t cameras, int32_t w, int32_t h, int32_t voxels)
{
    struct rec_rig rig;
    char *yaml;
    size_t len;
    T_EQ_I(rec_rig_ring(cameras, 2.5, w, h, voxels, &rig), PVX_OK);
    T_EQ_I(rec_rig_format(&rig, &yaml, &len), PVX_OK);
    T_EQ_I(pvx_file_write(at("rig.yaml"), yaml, len, NULL), PVX_OK);
    free(yaml);
    rec_rig_fini(&rig);
}

/* Configuration = common part + `more`.  Nothing in a test makes sense without it. */
static inline dmn_live *make(const char *more)
{
    char text[1600];
    struct pvx_diag d = {0};
    dmn_live *p = NULL;
    snprintf(text, sizeof text,
             "rig: %s/rig.yaml\nshared_clock: true\nmatrix_cache: %s/m\n"
             "publish: {endpoints: [\"ipc://%s/v\"], %s}\n%s",
             dir, dir, dir, bed_publish, more);
    T_EQ_I(dmn_config_parse(text, strlen(text), "test", &cfg, &d), PVX_OK);
    if (d.text[0] == '\0')
        T_EQ_I(dmn_live_new(&cfg, NULL, NULL, NULL, &p, &d), PVX_OK);
    T_EQ_S(d.text, "");
    if (p == NULL)
        exit(1);
    return p;
}

static inline dmn_live *started(const char *more)
{
    dmn_live *p = make(more);
    T_EQ_I(dmn_live_start(p, NULL), PVX_OK);
    return p;
}

/* Every set is published, dropped for a reason or inside, at any moment. */
static inline void look(dmn_live *p)
{
    dmn_live_snapshot(p, &state);
    uint64_t gone = state.published + state.inside;
    for (int i = 0; i < DMN_N_DROP; i++)
        gone += state.dropped[i];
    T_EQ_I(state.produced, gone);
    T_LE(state.inside, DMN_N_SLOTS + 1);
}

/* Until the condition holds of `state`. */
#define LOOK_UNTIL(p, condition)       \
    do {                               \
        UNTIL ((look(p), (condition))) \
            usleep(20000);             \
        T_OK(condition);               \
    } while (0)

static inline void finish(dmn_live **p)
{
    dmn_live_stop(*p, "end of the test");
    look(*p);
    T_EQ_I(state.inside, 0);
    T_EQ_I(state.latency_n, state.published);
    dmn_live_free(p);
}

/* Who hears the volumes of the configured pipeline, and sees sim:'s flame itself. */
struct audience {
    pvp_sub *sub;
    pvp_decoder *dec;
    struct rec_rig rig;
    struct rec_flame flame;
    double period_s;
    size_t n;
    float *got, *want;
    uint64_t others; /* messages that were no volumes */
};

static inline void audience_open(struct audience *a, uint32_t seed, double period_s)
{
    char endpoint[80];
    struct pvx_diag d = {0};
    *a = (struct audience){.period_s = period_s};
    snprintf(endpoint, sizeof endpoint, "ipc://%s/v", dir);
    T_EQ_I(pvp_sub_new(endpoint, NULL, &a->sub, &d), PVX_OK);
    T_EQ_I(pvp_decoder_new(&a->dec), PVX_OK);
    T_EQ_I(dmn_config_rig(&cfg, &a->rig, &d), PVX_OK);
    rec_flame_init(&a->flame, &a->rig.grid, seed);
    a->flame.period_s = period_s;
    a->n = rec_grid_count(&a->rig.grid) * 3;
    a->got = calloc(a->n, sizeof *a->got);
    a->want = calloc(a->n, sizeof *a->want);
}

/* The next message, if it is a volume, and its relative error; its pixels are gone with the next. */
static inline bool audience_next(struct audience *a, struct pvp_view *v, double *error)
{
    struct pvp_header h;
    struct pvx_diag d = {0};
    const void *msg;
    size_t len;
    int64_t period_ns = (int64_t)(a->period_s * 1e9);
    if (pvp_sub_next(a->sub, PVX_NS_PER_S, &h, &msg, &len, NULL) != PVX_OK)
        return false;
    if (h.type != PVP_VOLUME) {
        a->others++;
        return false;
    }
    struct rec_flame_pose pose;
    T_EQ_I(pvp_decode_volume(msg, len, v, &d), PVX_OK);
    T_EQ_I(pvp_volume_unpack(a->dec, v, a->got, a->n, &d), PVX_OK);
    rec_flame_at(&a->flame, (double)(v->v.t_exposure_ns % period_ns) * 1e-9, &pose);
    rec_flame_voxels(&pose, &a->rig.grid, 0, a->rig.grid.n[2], a->want);
    *error = rec_rel_l2(a->got, a->want, a->n);
    return true;
}

static inline void audience_close(struct audience *a)
{
    free(a->got);
    free(a->want);
    rec_rig_fini(&a->rig);
    pvp_decoder_free(&a->dec);
    pvp_sub_free(&a->sub);
}
#endif
