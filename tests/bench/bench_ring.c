/* bench_ring.c - what capture costs with raw frames kept in memory (capture/take/ring.h) and without, in turns: seconds
 * of a processor for the same number of sets, from cameras whose frames are written as a driver writes them (memory that
 * is filled once) to a consumer that gives them back. */
#include <stdatomic.h>

#include "base.h"
#include "base/log.h"
#include "capture/rig/capture.h"
#include "capture/take/ring.h"

enum { CAMERAS = 8, W = 640, H = 480, FPS = 60, SECONDS = 5, SETS = 240, BUFFERS = 20, ROUNDS = 5 };

static void bench_render(void *ctx, uint32_t camera, int64_t t, enum cap_pixfmt fmt, int32_t w,
                         int32_t h, void *data)
{
    (void)ctx, (void)fmt;
    memset(data, (int)(t + camera), (size_t)w * (size_t)h);
}

static pvx_err bench_place(void *ctx, const struct cap_take_trigger *t, char *path, size_t size,
                           struct cap_take_head *head, struct pvx_diag *d)
{
    (void)ctx, (void)t, (void)path, (void)size, (void)head;
    return pvx_fail(d, PVX_EUNSUP, "no take here");
}

/* Seconds of a processor for SETS sets, after the ring is full. */
static double capture_cost(bool with)
{
    static const struct cap_scene scene = {.render = bench_render};
    struct cap_source_config cam[CAMERAS];
    char name[CAMERAS][8];
    const uint32_t frames = SECONDS * FPS, held = with ? frames + CAP_RING_MORE : 0;
    const struct cap_ring_config rc = {.n_cameras = CAMERAS,
                                       .frames = frames,
                                       .bytes = (uint64_t)8 << 30,
                                       .fps = FPS,
                                       .place = bench_place};
    struct pvx_diag d = {""};
    cap_ring *ring = NULL;
    cap_capture *cap;
    for (int i = 0; i < CAMERAS; i++) {
        snprintf(name[i], sizeof name[i], "cam%d", i);
        cam[i] = (struct cap_source_config){.uri = "sim:",
                                            .name = name[i],
                                            .width = W,
                                            .height = H,
                                            .fmt = CAP_GREY8,
                                            .buffers = BUFFERS + held,
                                            .held = held,
                                            .exposure_us = -1,
                                            .gain = -1,
                                            .scene = &scene};
    }
    struct cap_capture_config c = {.n_cameras = CAMERAS,
                                   .camera = cam,
                                   .fps = FPS,
                                   .shared_clock = true,
                                   .sets = {.policy = CAP_POLICY_PARTIAL, .held = held}};
    if (with) {
        bench_check(cap_ring_new(&rc, &ring), &d);
        bench_check(cap_ring_start(ring, &d), &d);
        c.tap = cap_ring_tap(ring);
    }
    bench_check(cap_capture_new(&c, &cap, &d), &d);
    bench_check(cap_capture_start(cap, &d), &d);
    double from = 0, cost = 0;
    for (int i = 0; i < (int)frames + 20 + SETS; i++) {
        struct cap_set *s;
        if (cap_capture_next(cap, 5 * PVX_NS_PER_S, &s) != PVX_OK)
            break;
        cap_set_release(s);
        if (i == (int)frames + 20)
            from = bench_cpu();
        cost = bench_cpu() - from;
    }
    cap_capture_stop(cap);
    cap_ring_free(&ring);
    cap_capture_free(&cap);
    return cost;
}

int main(void)
{
    pvx_log_set_level(PVX_LOG_ERROR);
    double best[2] = {1e9, 1e9}, sum[2] = {0, 0};
    printf("\n-- raw frames in memory: %d x %dx%d Mono8 at %d Hz, %d s, %.0f MB\n", CAMERAS, W, H,
           FPS, SECONDS, 1e-6 * CAMERAS * W * H * SECONDS * FPS);
    for (int r = 0; r < ROUNDS; r++)
        for (int i = 0; i < 2; i++) {
            double c = capture_cost(i == 1);
            best[i] = fmin(best[i], c);
            sum[i] += c;
        }
    static const char *const what[] = {"without", "with"};
    for (int i = 0; i < 2; i++)
        printf("%-10s %8.3f ms of a processor per set, best of %d; mean %.3f\n", what[i],
               1e3 * best[i] / SETS, ROUNDS, 1e3 * sum[i] / ROUNDS / SETS);
    printf("with over without: %.3f best, %.3f mean\n", best[1] / best[0], sum[1] / sum[0]);
    return 0;
}
