/* test_missing_camera.c - solve with what is there: a camera that comes and goes leaves the system and
 * joins it again; the volume stays right, from set to set and with warm starts, and says how many
 * cameras it was made from. */
#include "../t.h"

#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/log.h"
#include "daemon/pipeline.h"
#include "proto/clients/sub.h"
#include "recon/view/flame.h"
#include "recon/metrics.h"

#define CAMERAS   8
#define FPS       10
#define PERIOD_NS 1500000000 /* of the flame */

static char dir[32];
static struct dmn_config cfg;
static struct dmn_state state;

struct errors {
    int n;
    double sum, max;
};

struct seen {
    struct errors with[CAMERAS + 1]; /* by cameras present */
    struct errors changed;           /* first volume after a change of them */
    int changes, wrong_mask;
};

static void add(struct errors *e, double error)
{
    e->n++;
    e->sum += error;
    e->max = fmax(e->max, error);
}

static double mean(const struct errors *e)
{
    return e->n > 0 ? e->sum / e->n : 0;
}

static void make_rig(void)
{
    struct rec_rig rig;
    char *yaml, path[64];
    size_t len;
    T_EQ_I(rec_rig_ring(CAMERAS, 2.5, 80, 60, 24, &rig), PVX_OK);
    T_EQ_I(rec_rig_format(&rig, &yaml, &len), PVX_OK);
    snprintf(path, sizeof path, "%s/rig.yaml", dir);
    T_EQ_I(pvx_file_write(path, yaml, len, NULL), PVX_OK);
    free(yaml);
    rec_rig_fini(&rig);
}

static dmn_pipeline *make(const char *more)
{
    char text[1600];
    struct pvx_diag d = {0};
    dmn_pipeline *p = NULL;
    snprintf(text, sizeof text,
             "rig: %s/rig.yaml\nshared_clock: true\nmatrix_cache: %s/m\nfps: %d\n"
             "publish: {endpoints: [\"ipc://%s/v\"], sample: f32, hwm: 10000}\n"
             "sim: {seed: 3, period_s: 1.5}\nsolver: {deadline_ms: 0, warm_start: on}\n%s",
             dir, dir, FPS, dir, more);
    T_EQ_I(dmn_config_parse(text, strlen(text), "test", &cfg, &d), PVX_OK);
    if (d.text[0] == '\0')
        T_EQ_I(dmn_pipeline_new(&cfg, NULL, NULL, &p, &d), PVX_OK);
    T_EQ_S(d.text, "");
    return p;
}

static void look(struct seen *y, const struct pvp_view *v, double error, int *before)
{
    int present = (int)v->v.cameras_present;
    uint64_t mask = v->v.camera_mask;
    y->wrong_mask += __builtin_popcountll(mask) != present || mask >> CAMERAS != 0;
    add(&y->with[present], error);
    if (*before != 0 && *before != present) {
        y->changes++;
        add(&y->changed, error);
    }
    *before = present;
}

/* Volumes against the flame until there are `full` from all cameras and `less` from one fewer. */
static void watch(dmn_pipeline *p, struct seen *y, int full, int less)
{
    memset(y, 0, sizeof *y);
    char endpoint[64];
    snprintf(endpoint, sizeof endpoint, "ipc://%s/v", dir);
    pvp_sub *sub;
    pvp_decoder *dec;
    struct pvx_diag d = {0};
    struct rec_rig rig;
    struct rec_flame flame;
    T_EQ_I(pvp_sub_new(endpoint, &sub, &d), PVX_OK);
    T_EQ_I(pvp_decoder_new(&dec), PVX_OK);
    T_EQ_I(dmn_config_rig(&cfg, &rig, &d), PVX_OK);
    T_EQ_I(dmn_pipeline_start(p, &d), PVX_OK);
    size_t n = rec_grid_count(&rig.grid) * 3;
    float *got = calloc(n, sizeof *got), *want = calloc(n, sizeof *want);
    rec_flame_init(&flame, &rig.grid, 3);
    flame.period_s = PERIOD_NS * 1e-9;
    int before = 0;
    int64_t t0 = pvx_now_mono();
    while ((y->with[CAMERAS].n < full || y->with[CAMERAS - 1].n < less) &&
           pvx_now_mono() - t0 < 60 * PVX_NS_PER_S) {
        struct pvp_header h;
        const void *msg;
        size_t len;
        struct pvp_view v;
        struct rec_flame_pose pose;
        if (pvp_sub_next(sub, PVX_NS_PER_S, &h, &msg, &len) != PVX_OK || h.type != PVP_VOLUME)
            continue;
        T_EQ_I(pvp_decode_volume(msg, len, &v, &d), PVX_OK);
        T_EQ_I(pvp_volume_unpack(dec, &v, got, n, &d), PVX_OK);
        rec_flame_at(&flame, (double)(v.v.t_exposure_ns % PERIOD_NS) * 1e-9, &pose);
        rec_flame_voxels(&pose, &rig.grid, 0, rig.grid.n[2], want);
        look(y, &v, rec_rel_l2(got, want, n), &before);
    }
    free(got);
    free(want);
    rec_rig_fini(&rig);
    dmn_pipeline_stop(p, "end of the test");
    dmn_pipeline_snapshot(p, &state);
    pvp_decoder_free(&dec);
    pvp_sub_free(&sub);
}

#define ALL_BUT_3                                                                            \
    "cam0: \"sim:\", cam1: \"sim:\", cam2: \"sim:\", cam4: \"sim:\", cam5: \"sim:\", cam6: " \
    "\"sim:\", cam7: \"sim:\""

/* The camera dies after each 8 pictures and is back a quarter of a second later. */
static void a_flapping_camera_does_no_harm(void)
{
    dmn_pipeline *p = make("cameras: {" ALL_BUT_3 ", cam3: \"sim:die_after=8\"}\n"
                           "sync: {policy: solve-with-what-is-there, min_cameras: 4}\n");
    static struct seen y;
    if (p == NULL)
        return;
    watch(p, &y, 20, 12);
    printf("  relative L2 error: 8 views %.3f mean %.3f worst (%d), 7 views %.3f mean %.3f worst "
           "(%d), "
           "first after a change %.3f worst (%d)\n",
           mean(&y.with[8]), y.with[8].max, y.with[8].n, mean(&y.with[7]), y.with[7].max,
           y.with[7].n, y.changed.max, y.changed.n);
    T_OK(y.with[8].n >= 20);
    T_OK(y.with[7].n >= 12);
    T_OK(y.changes >= 4);
    T_EQ_I(y.wrong_mask, 0);
    T_LE(y.with[8].max, 0.2);
    T_LE(y.with[7].max, 0.2);
    T_LE(mean(&y.with[7]), 1.25 * mean(&y.with[8]));
    T_LE(y.changed.max, 0.2);
    T_OK(state.capture.sets_partial > 0);
    T_OK(state.capture.camera[3].count[CAP_LOST_CAMERA] >= 2);
    dmn_pipeline_free(&p);
}

/* drop: only whole sets.  wait: whole ones as long as the camera lives, then those of the others. */
static void the_other_policies_do_what_they_say(void)
{
    static struct seen y;
    dmn_pipeline *p = make("cameras: {" ALL_BUT_3 ", cam3: \"sim:drop=0.3\"}\n"
                           "sync: {policy: wait}\n");
    if (p == NULL)
        return;
    watch(p, &y, 15, 0);
    T_OK(y.with[8].n >= 15);
    T_EQ_I(y.with[7].n, 0); /* it lives: no set lacks it */
    T_OK(state.capture.sets_failed > 0);
    dmn_pipeline_free(&p);
    p = make("cameras: {" ALL_BUT_3 ", cam3: \"sim:die_after=8\"}\nsync: {policy: wait}\n");
    if (p == NULL)
        return;
    watch(p, &y, 8, 2);
    T_OK(y.with[8].n >= 8);
    T_OK(y.with[7].n >= 2); /* gone: the others go on */
    dmn_pipeline_free(&p);
    p = make("cameras: {" ALL_BUT_3 ", cam3: \"sim:die_after=8\"}\nsync: {policy: drop}\n");
    if (p == NULL)
        return;
    watch(p, &y, 15, 0);
    T_OK(y.with[8].n >= 15);
    T_EQ_I(y.with[7].n, 0);
    T_EQ_I(state.capture.sets_partial, 0);
    dmn_pipeline_free(&p);
}

/* hull.min_views holds for the cameras that are there. */
static void min_views_is_respected(void)
{
    static struct seen y;
    dmn_pipeline *p = make("cameras: {" ALL_BUT_3 ", cam3: \"sim:absent\"}\n"
                           "sync: {policy: solve-with-what-is-there}\nhull: {min_views: 8}\n");
    if (p == NULL)
        return;
    watch(p, &y, 0, 3);
    T_OK(y.with[7].n >= 3);
    T_EQ_I(state.report.cameras, 7);
    T_EQ_I(state.report.active_voxels, 0); /* no voxel is seen by eight */
    dmn_pipeline_free(&p);
    p = make("cameras: {" ALL_BUT_3 ", cam3: \"sim:absent\"}\n"
             "sync: {policy: solve-with-what-is-there}\nhull: {min_views: 7}\n");
    if (p == NULL)
        return;
    watch(p, &y, 0, 3);
    T_EQ_I(state.report.cameras, 7);
    T_OK(state.report.active_voxels > 100);
    dmn_pipeline_free(&p);
}

int main(void)
{
    snprintf(dir, sizeof dir, "/tmp/pyrovox-test-XXXXXX");
    if (mkdtemp(dir) == NULL)
        return 1;
    pvx_log_set_level(PVX_LOG_ERROR);
    make_rig();
    T_RUN(a_flapping_camera_does_no_harm);
    T_RUN(the_other_policies_do_what_they_say);
    T_RUN(min_views_is_respected);
    char path[64];
    snprintf(path, sizeof path, "%s/m", dir);
    unlink(path);
    snprintf(path, sizeof path, "%s/rig.yaml", dir);
    unlink(path);
    if (rmdir(dir) != 0) {
        printf("FAIL test_missing_camera: %s is not empty\n", dir);
        return 1;
    }
    return t_done();
}
