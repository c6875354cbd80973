/* test_log.c - the log: a fault that repeats for a week writes few lines, and the last word is never lost. */
#include "../t.h"

#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"

#define S    PVX_NS_PER_S
#define WEEK (7 * 24 * 3600)

static int64_t now_ns;
static int64_t virtual_clock(void)
{
    return now_ns;
}

static struct {
    size_t n;
    enum pvx_log_level level;
    char text[2048], cause[64], camera[64];
    uint64_t told; /* lines, and those that lines said were kept back */
} got;

static bool sink(enum pvx_log_level level, const struct pvx_about *about, const char *text)
{
    got.n++;
    got.level = level;
    snprintf(got.text, sizeof got.text, "%s", text);
    snprintf(got.cause, sizeof got.cause, "%s",
             about != NULL && about->cause != NULL ? about->cause : "");
    snprintf(got.camera, sizeof got.camera, "%s",
             about != NULL && about->camera != NULL ? about->camera : "");
    const char *held = strrchr(text, '(');
    got.told += 1 + (held != NULL ? strtoull(held + 1, NULL, 10) : 0);
    return true;
}

static void begin(void)
{
    now_ns += 100000 * S; /* what another case has said is long ago */
    pvx_log_flush(true);
    memset(&got, 0, sizeof got);
    pvx_log_set_sink(sink);
    pvx_log_set_clock(virtual_clock);
}

/* A camera that is lost and comes back every 2 s, for a week, beside one that does so every half an hour; the
 * daemon lets out what is due five times a second (here once). */
T_CASE(a_week_of_a_cable_that_is_loose)
{
    begin();
    size_t seldom = 0;
    for (int t = 0; t < WEEK; t++) {
        now_ns += S;
        LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = "lost_camera", .camera = "cam0"),
                  "cam0: %s", t % 2 == 0 ? "gone" : "back");
        if (t % 1800 == 0) {
            size_t before = got.n;
            LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = "lost_camera", .camera = "cam1"),
                      "cam1: gone");
            seldom += got.n - before;
        }
        pvx_log_flush(false);
    }
    pvx_log_flush(true);
    T_EQ_I(got.told, WEEK + WEEK / 1800); /* every one is a line or counted by one */
    T_LE(got.n, 2 * 187 + 2);
    T_LE(180, got.n); /* but once an hour it is told */
    T_LE(15, seldom); /* of 336 at once, the others within an hour */
    T_OK(strstr(got.text, "cam1") != NULL || strncmp(got.text, "capture: cam0: back", 19) == 0);
}

/* What is the case is what the log said last, though it was kept back at first. */
T_CASE(the_last_word)
{
    begin();
    for (int i = 0; i < 20; i++) {
        now_ns += S / 100;
        LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = "lost_camera", .camera = "cam0"), "gone");
        LOG_ABOUT(PVX_LOG_INFO, CAPTURE, ABOUT(.cause = "lost_camera", .camera = "cam0"), "back");
    }
    T_EQ_I(got.n, 8);
    LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = "lost_camera", .camera = "cam0"), "gone %d", 7);
    pvx_log_flush(false);
    T_EQ_I(got.n, 8);
    now_ns += 2 * S;
    pvx_log_flush(false);
    T_EQ_I(got.n, 9);
    T_EQ_S(got.text, "capture: gone 7 (32 more like it held back)");
    T_EQ_S(got.cause, "lost_camera");
    T_EQ_S(got.camera, "cam0");
    T_EQ_I(got.level, PVX_LOG_WARN);
    pvx_log_flush(true);
    T_EQ_I(got.n, 9); /* once */
}

T_CASE(causes_and_cameras_have_bounds_of_their_own)
{
    begin();
    static const char *const causes[] = {"late", "incomplete"}, *const cameras[] = {"cam0", "cam1"};
    for (int i = 0; i < 100; i++)
        LOG_ABOUT(PVX_LOG_WARN, CAPTURE,
                  ABOUT(.cause = causes[i % 2], .camera = cameras[i / 2 % 2]), "it");
    T_EQ_I(got.n, 4 * 8);
    now_ns += 3601 * S; /* quiet: it begins anew */
    for (int i = 0; i < 10; i++)
        LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = "late", .camera = "cam0"), "it");
    T_EQ_I(got.n, 4 * 8 + 8);
    pvx_log_set_level(PVX_LOG_ERROR);
    LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = "new"), "not wanted");
    pvx_log_set_level(PVX_LOG_INFO);
    T_EQ_I(got.n, 4 * 8 + 8);
}

/* More causes than there are places: bounded all the same. */
T_CASE(more_than_there_is_room_for)
{
    begin();
    char cause[32];
    for (int round = 0; round < 20; round++)
        for (int i = 0; i < 2000; i++) {
            snprintf(cause, sizeof cause, "cause %d", i % 2 != 0 ? i % 600 : i % 500);
            LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = cause), "it");
        }
    T_LE(got.n, 20 * 600 / 2 + 512 * 8);
}

T_CASE(a_week_of_one_place)
{
    begin();
    for (int64_t t = 0; t < 10LL * WEEK; t++) {
        now_ns += S / 10;
        LOG_EVERY_ABOUT(PVX_LOG_WARN, RECON, ABOUT(.of_set = true, .set = (uint64_t)t), "set %lld",
                        (long long)t);
    }
    T_LE(got.n, 187);
    T_LE(180, got.n);
    size_t n = got.n;
    now_ns += 3600 * S;
    LOG_EVERY(PVX_LOG_WARN, RECON, "another place");
    T_EQ_I(got.n, n + 1);
    pvx_log_set_sink(NULL);
    pvx_log_set_clock(NULL);
}
