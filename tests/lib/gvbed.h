/* gvbed.h - bed of the tests with GigE cameras of our own: a private network, and cameras with random
 * images whose first bytes are their number and the camera's. */
#ifndef GVBED_H
#define GVBED_H
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/gevsim/gvcam.h"
#include "capture/gevsim/netns.h"
#include "tests/lib/have_addresses.h"
#include "tests/lib/patience.h"
#include "tests/t.h"

#define BED_CAMERAS 4
#ifndef BED_FMT
#define BED_FMT  CAP_GREY8
#define BED_RING 64
#endif
#define BED_W     160
#define BED_H     120
#define BED_BYTES ((size_t)BED_W * BED_H * (BED_FMT == CAP_RGB8 ? 3 : 1))
#define BED_FPS   25.0
#define MS        PVX_NS_PER_MS

static const char *const bed_address[BED_CAMERAS] = {"127.0.0.2", "127.0.0.3", "127.0.0.4",
                                                     "127.0.0.5"};
static unsigned char *bed_image[BED_CAMERAS][BED_RING];
static cap_gvnet *bed_net;
static cap_gvcam *bed_cam[BED_CAMERAS];
static double bed_ring_fps = BED_FPS;
static bool bed_usable;

static struct cap_gvcam_config bed_config(int c)
{
    static const char *const serial[BED_CAMERAS] = {"T00", "T01", "T02", "T03"};
    static const char *const name[BED_CAMERAS] = {"view0", "view1", "view2", "view3"};
    return (struct cap_gvcam_config){.address = bed_address[c],
                                     .serial = serial[c],
                                     .user_name = name[c],
                                     .fmt = BED_FMT,
                                     .width = BED_W,
                                     .height = BED_H,
                                     .ring = (const void *const *)bed_image[c],
                                     .n_ring = BED_RING,
                                     .ring_fps = bed_ring_fps,
                                     .ptp_settle_ms = 300,
                                     .reboot_s = 1};
}

/* Kill the camera if it is there, and start it as configured.  The kernel gives its port free when the
 * thread that polled it has seen that it is closed. */
static void bed_restart(int c, const struct cap_gvcam_config *config)
{
    pvx_err e = PVX_EBUSY;
    cap_gvcam_free(&bed_cam[c]);
    for (int k = 0; k < 6000 && e == PVX_EBUSY; k++) {
        struct pvx_diag d = {""};
        if (k > 0)
            usleep(20000);
        e = cap_gvcam_new(bed_net, config, &bed_cam[c], &d);
        if (e != PVX_OK && e != PVX_EBUSY)
            printf("  %s\n", pvx_diag_text(&d, e));
    }
    T_EQ_I(e, PVX_OK);
    if (e != PVX_OK)
        exit(1); /* nothing here works without it */
}

static inline void bed_fresh(int c)
{
    struct cap_gvcam_config config = bed_config(c);
    bed_restart(c, &config);
}

/* All cameras new, with images of so many a second. */
static void bed_all(double ring_fps)
{
    bed_ring_fps = ring_fps;
    for (int c = 0; c < BED_CAMERAS; c++)
        bed_fresh(c);
}

static void bed_open(void)
{
    struct pvx_diag d = {""};
    pvx_log_set_level(PVX_LOG_ERROR);
    pvx_err e = cap_netns_enter(BED_CAMERAS, &d); /* still one thread */
    bed_usable = e == PVX_OK || have_addresses(bed_address[0], BED_CAMERAS);
    if (!bed_usable) {
        t_skip_all = "no private network and no addresses 127.0.0.2 to 127.0.0.5 here";
        printf("  %s\n", pvx_diag_text(&d, e));
    }
    for (int c = 0; c < BED_CAMERAS; c++)
        for (int i = 0; i < BED_RING; i++) {
            unsigned char *p = bed_image[c][i] = malloc(BED_BYTES);
            for (size_t k = 0; k < BED_BYTES; k++)
                p[k] = (unsigned char)(t_rand() >> 56);
            p[0] = (unsigned char)i;
            p[1] = (unsigned char)c;
        }
    if (bed_usable && cap_gvnet_new(&bed_net, &d) != PVX_OK) {
        printf("  %s\n", d.text);
        exit(1); /* the network is ours: a fault, not a reason to skip */
    }
    if (bed_usable)
        bed_all(BED_FPS);
}

static void bed_close(void)
{
    for (int c = 0; c < BED_CAMERAS; c++) {
        cap_gvcam_free(&bed_cam[c]);
        for (int i = 0; i < BED_RING; i++)
            free(bed_image[c][i]);
    }
    cap_gvnet_free(&bed_net);
}

static inline struct cap_gvcam_stats bed_stats(int c)
{
    struct cap_gvcam_stats st;
    cap_gvcam_stats(bed_cam[c], &st);
    return st;
}

static inline void bed_fault(int c, struct cap_gvcam_fault f)
{
    cap_gvcam_set_fault(bed_cam[c], &f);
}
#endif
