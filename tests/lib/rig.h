/* rig.h - a capture for tests: its cameras, its start, and waits for what it says.
 * Waits are for conditions and long: the machine may be busy. */
#ifndef TESTS_RIG_H
#define TESTS_RIG_H
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/rig/capture.h"
#include "tests/lib/patience.h"
#include "tests/lib/source.h"
#include "tests/t.h"

#define RIG_MAX 8

/* What sim: cameras see: the true time of exposure and the camera. */
struct truth {
    int64_t t;
    uint32_t camera;
};
static inline void render_truth(void *ctx, uint32_t camera, int64_t t, enum cap_pixfmt fmt,
                                int32_t w, int32_t h, void *data)
{
    (void)ctx, (void)fmt, (void)w, (void)h;
    struct truth truth = {t, camera};
    memcpy(data, &truth, sizeof truth);
}
static const struct cap_scene true_scene = {.render = render_truth};
static inline struct cap_source_config sim_camera(void)
{
    struct cap_source_config c = source_of(NULL, 16, 4, CAP_GREY8, 0);
    c.scene = &true_scene;
    c.buffers = 16;
    return c;
}

struct rig {
    struct cap_source_config cam[RIG_MAX];
    struct cap_capture_config cfg;
    char uri[RIG_MAX][256], name[RIG_MAX][32];
    cap_capture *cap;
    struct cap_stats st; /* as it was last asked for */
};

/* n cameras like `one`, named cam0 ... and found by one->uri; sets of whatever is there. */
static inline void rig_init(struct rig *r, uint32_t n, double fps, struct cap_source_config one)
{
    *r = (struct rig){.cfg = {.n_cameras = n,
                              .camera = r->cam,
                              .fps = fps,
                              .sets = {.policy = CAP_POLICY_PARTIAL, .min_cameras = 1}}};
    for (uint32_t i = 0; i < n; i++) {
        r->cam[i] = one;
        r->cam[i].camera = i;
        r->cam[i].uri = r->uri[i];
        r->cam[i].name = r->name[i];
        snprintf(r->uri[i], sizeof r->uri[i], "%s", one.uri != NULL ? one.uri : "");
        snprintf(r->name[i], sizeof r->name[i], "cam%u", i);
    }
}

/* Nothing else in a test makes sense without it. */
static inline void rig_start(struct rig *r)
{
    struct pvx_diag d = {""};
    pvx_err e = cap_capture_new(&r->cfg, &r->cap, &d);
    if (e == PVX_OK)
        e = cap_capture_start(r->cap, &d);
    T_CHECK_(e == PVX_OK, "%s", pvx_diag_text(&d, e));
    if (e != PVX_OK)
        exit(1);
}

static inline const struct cap_stats *rig_stats(struct rig *r)
{
    cap_capture_stats(r->cap, &r->st);
    return &r->st;
}

/* A little later. */
static inline void rig_wait(struct rig *r)
{
    usleep(10000);
    rig_stats(r);
}

/* The next set, if one comes soon, is given back. */
static inline void rig_next(struct rig *r)
{
    struct cap_set *set;
    if (cap_capture_next(r->cap, 20 * PVX_NS_PER_MS, &set) == PVX_OK)
        cap_set_release(set);
}

/* When the first set with all cameras came whose frames arrived after `after_ns`; 0 = none does. */
static inline int64_t rig_whole_after(struct rig *r, int64_t after_ns)
{
    bool whole = false;
    UNTIL (whole) {
        struct cap_set *set;
        if (cap_capture_next(r->cap, 20 * PVX_NS_PER_MS, &set) != PVX_OK)
            continue;
        whole = set->n == r->cfg.n_cameras && set->t_last_mono_ns > after_ns;
        cap_set_release(set);
    }
    return whole ? pvx_now_mono() : 0;
}

/* Sets are taken until camera i has counted n. */
static inline bool rig_counts(struct rig *r, uint32_t i, enum cap_count what, uint64_t n)
{
    UNTIL (rig_stats(r)->camera[i].count[what] >= n)
        rig_next(r);
    return r->st.camera[i].count[what] >= n;
}

/* What it has counted stays in st. */
static inline void rig_end(struct rig *r)
{
    cap_capture_stop(r->cap);
    rig_stats(r);
    cap_capture_free(&r->cap);
}
#endif
