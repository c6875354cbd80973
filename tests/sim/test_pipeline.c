/* test_pipeline.c - sim: cameras through the whole pipeline: volumes are right and in order, and every
 * set is accounted for, with time enough and without. */
#include "../t.h"

#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/log.h"
#include "daemon/pipeline.h"
#include "proto/clients/sub.h"
#include "recon/view/flame.h"
#include "recon/metrics.h"

static char dir[32];
static struct dmn_config cfg;
static struct dmn_state state;

static void make_rig(size_t cameras, int32_t w, int32_t h, int32_t voxels)
{
    struct rec_rig rig;
    char *yaml, path[64];
    size_t len;
    T_EQ_I(rec_rig_ring(cameras, 2.5, w, h, voxels, &rig), PVX_OK);
    T_EQ_I(rec_rig_format(&rig, &yaml, &len), PVX_OK);
    snprintf(path, sizeof path, "%s/rig.yaml", dir);
    T_EQ_I(pvx_file_write(path, yaml, len, NULL), PVX_OK);
    free(yaml);
    rec_rig_fini(&rig);
}

/* Configuration = common part + `more`; NULL when it could not be set up. */
static dmn_pipeline *make(const char *more)
{
    char text[1200];
    struct pvx_diag d = {0};
    dmn_pipeline *p = NULL;
    snprintf(text, sizeof text,
             "rig: %s/rig.yaml\nshared_clock: true\nmatrix_cache: %s/m\n"
             "publish: {endpoints: [\"ipc://%s/v\"], sample: f32, hwm: 10000}\n%s",
             dir, dir, dir, more);
    T_EQ_I(dmn_config_parse(text, strlen(text), "test", &cfg, &d), PVX_OK);
    if (d.text[0] == '\0')
        T_EQ_I(dmn_pipeline_new(&cfg, NULL, NULL, &p, &d), PVX_OK);
    T_EQ_S(d.text, "");
    return p;
}

static void finish(dmn_pipeline **p)
{
    dmn_pipeline_stop(*p, "end of the test");
    dmn_pipeline_snapshot(*p, &state);
    uint64_t gone = state.published;
    for (int i = 0; i < DMN_N_DROP; i++)
        gone += state.dropped[i];
    T_EQ_I(state.produced, gone);
    T_EQ_I(state.inside, 0);
    T_EQ_I(state.latency_n, state.published);
    dmn_pipeline_free(p);
}

static void volumes_are_right_and_in_order(void)
{
    make_rig(8, 80, 60, 24);
    dmn_pipeline *p = make("cameras: \"sim:\"\nfps: 10\nsolver: {deadline_ms: 0}\n"
                           "sim: {seed: 3, period_s: 1.5}\n");
    if (p == NULL)
        return;
    char endpoint[64];
    snprintf(endpoint, sizeof endpoint, "ipc://%s/v", dir);
    pvp_sub *sub;
    pvp_decoder *dec;
    struct pvx_diag d = {0};
    T_EQ_I(pvp_sub_new(endpoint, &sub, &d), PVX_OK);
    T_EQ_I(pvp_decoder_new(&dec), PVX_OK);
    T_EQ_I(dmn_pipeline_start(p, &d), PVX_OK);
    struct rec_rig rig;
    T_EQ_I(dmn_config_rig(&cfg, &rig, &d), PVX_OK);
    size_t n = rec_grid_count(&rig.grid) * 3;
    float *got = calloc(n, sizeof *got), *want = calloc(n, sizeof *want);
    struct rec_flame flame;
    rec_flame_init(&flame, &rig.grid, 3);
    flame.period_s = 1.5;
    uint64_t last = 0;
    int volumes = 0, status = 0;
    int64_t t0 = pvx_now_mono();
    while (volumes < 25 && pvx_now_mono() - t0 < 30 * PVX_NS_PER_S) {
        struct pvp_header h;
        const void *msg;
        size_t len;
        if (pvp_sub_next(sub, PVX_NS_PER_S, &h, &msg, &len) != PVX_OK)
            continue;
        status += h.type == PVP_STATUS;
        if (h.type != PVP_VOLUME)
            continue;
        struct pvp_view v;
        T_EQ_I(pvp_decode_volume(msg, len, &v, &d), PVX_OK);
        T_OK(volumes == 0 || v.v.set > last);
        last = v.v.set;
        T_EQ_I(v.v.cameras_present, 8);
        T_EQ_I(v.v.camera_mask, 0xFF);
        T_OK(v.v.latency_ns > 0 && v.v.t_publish_ns > v.v.t_exposure_ns);
        T_EQ_I(pvp_volume_unpack(dec, &v, got, n, &d), PVX_OK);
        struct rec_flame_pose pose;
        rec_flame_at(&flame, (double)(v.v.t_exposure_ns % 1500000000) * 1e-9, &pose);
        rec_flame_voxels(&pose, &rig.grid, 0, rig.grid.n[2], want);
        T_LE(rec_rel_l2(got, want, n), 0.25);
        volumes++;
    }
    T_EQ_I(volumes, 25);
    T_OK(status >= 1);
    free(got);
    free(want);
    rec_rig_fini(&rig);
    finish(&p);
    pvp_decoder_free(&dec);
    pvp_sub_free(&sub);
}

static void too_fast_drops_the_oldest_and_counts(void)
{
    /* far more than can be solved: 200 iterations on every set at 300 Hz */
    make_rig(4, 80, 60, 24);
    dmn_pipeline *p =
        make("cameras: \"sim:\"\nfps: 300\nthreads: 1\n"
             "solver: {name: mlem, stop: iterations, iterations: 200, deadline_ms: 0}\n");
    if (p == NULL)
        return;
    struct pvx_diag d = {0};
    T_EQ_I(dmn_pipeline_start(p, &d), PVX_OK);
    int64_t t0 = pvx_now_mono();
    do {
        usleep(20000);
        dmn_pipeline_snapshot(p, &state);
        /* at any moment, not only at the end */
        uint64_t gone = state.published + state.inside;
        for (int i = 0; i < DMN_N_DROP; i++)
            gone += state.dropped[i];
        T_EQ_I(state.produced, gone);
        T_LE(state.inside, DMN_N_SLOTS + 1);
    } while ((state.published < 3 || state.dropped[DMN_DROP_SOLVE] == 0) &&
             pvx_now_mono() - t0 < 30 * PVX_NS_PER_S);
    T_OK(state.published >= 3);
    T_OK(state.dropped[DMN_DROP_SOLVE] > 0);
    finish(&p);
}

static void a_deadline_ends_the_solver(void)
{
    make_rig(4, 80, 60, 24);
    dmn_pipeline *p = make("cameras: \"sim:\"\nfps: 10\nthreads: 1\n"
                           "solver: {name: mlem, stop: iterations, iterations: 100000, "
                           "deadline_ms: 40}\n");
    if (p == NULL)
        return;
    struct pvx_diag d = {0};
    T_EQ_I(dmn_pipeline_start(p, &d), PVX_OK);
    int64_t t0 = pvx_now_mono();
    do {
        usleep(20000);
        dmn_pipeline_snapshot(p, &state);
    } while (state.published < 5 && pvx_now_mono() - t0 < 30 * PVX_NS_PER_S);
    T_OK(state.published >= 5);
    T_EQ_I(state.report.solve.status, REC_DEADLINE);
    T_OK(state.report.solve.iterations >= 1);
    finish(&p);
}

static void cameras_that_are_not_there_do_not_stop_the_others(void)
{
    make_rig(4, 80, 60, 24);
    dmn_pipeline *p = make("cameras: {cam0: \"sim:\", cam1: \"sim:absent\", cam2: \"sim:\", "
                           "cam3: \"sim:\"}\nfps: 20\nsync: {policy: partial, min_cameras: 3}\n");
    if (p == NULL)
        return;
    struct pvx_diag d = {0};
    T_EQ_I(dmn_pipeline_start(p, &d), PVX_OK);
    int64_t t0 = pvx_now_mono();
    do {
        usleep(20000);
        dmn_pipeline_snapshot(p, &state);
    } while (state.published < 10 && pvx_now_mono() - t0 < 30 * PVX_NS_PER_S);
    T_OK(state.published >= 10);
    T_EQ_I(state.report.cameras, 3);
    T_OK(state.capture.camera[1].state != CAP_RUNNING);
    T_OK(state.capture.camera[1].error[0] != '\0');
    T_OK(state.capture.sets_partial > 0);
    finish(&p);
}

static void an_end_is_an_end(void)
{
    make_rig(3, 80, 60, 16);
    dmn_pipeline *p = make("cameras: \"sim:end_after=12\"\nfps: 50\n");
    if (p == NULL)
        return;
    struct pvx_diag d = {0};
    T_EQ_I(dmn_pipeline_start(p, &d), PVX_OK);
    int64_t t0 = pvx_now_mono();
    while (!dmn_pipeline_finished(p) && pvx_now_mono() - t0 < 30 * PVX_NS_PER_S)
        usleep(20000);
    T_OK(dmn_pipeline_finished(p));
    finish(&p);
    T_OK(state.published >= 5 && state.published <= 12);
}

static void a_second_publisher_is_refused(void)
{
    make_rig(3, 80, 60, 16);
    dmn_pipeline *p = make("cameras: \"sim:\"\n"), *q = NULL;
    struct pvx_diag d = {0};
    T_EQ_I(dmn_pipeline_new(&cfg, NULL, NULL, &q, &d), PVX_EBUSY);
    T_OK(q == NULL);
    T_OK(d.text[0] != '\0');
    dmn_pipeline_free(&p);
}

int main(void)
{
    snprintf(dir, sizeof dir, "/tmp/pyrovox-test-XXXXXX");
    if (mkdtemp(dir) == NULL)
        return 1;
    pvx_log_set_level(PVX_LOG_ERROR);
    T_RUN(volumes_are_right_and_in_order);
    T_RUN(too_fast_drops_the_oldest_and_counts);
    T_RUN(a_deadline_ends_the_solver);
    T_RUN(cameras_that_are_not_there_do_not_stop_the_others);
    T_RUN(an_end_is_an_end);
    T_RUN(a_second_publisher_is_refused);
    char path[64];
    snprintf(path, sizeof path, "%s/m", dir);
    unlink(path);
    snprintf(path, sizeof path, "%s/rig.yaml", dir);
    unlink(path);
    if (rmdir(dir) != 0) {
        printf("FAIL test_pipeline: %s is not empty\n", dir);
        return 1;
    }
    return t_done();
}
