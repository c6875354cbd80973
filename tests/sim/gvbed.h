/* gvbed.h - bed of the tests of simulated cameras: a private network, cameras with random images, and
 * libaravis as the independent peer that looks at them. */
#ifndef GVBED_H
#define GVBED_H
#include <arv.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/gevsim/gvcam.h"
#include "capture/gevsim/netns.h"
#include "tests/t.h"

#define BED_CAMERAS 3
#define BED_RING    8
#define BED_W       160
#define BED_H       120
#define BED_FPS     25.0

static const char *const bed_address[BED_CAMERAS] = {"127.0.0.2", "127.0.0.3", "127.0.0.4"};
static unsigned char *bed_image[BED_CAMERAS][BED_RING]; /* RGB8 */
static cap_gvnet *bed_net;
static cap_gvcam *bed_cam[BED_CAMERAS];
static bool bed_usable;

#define NEED_BED()   \
    if (!bed_usable) \
    T_SKIP("no private network and no addresses 127.0.0.2 to 127.0.0.4 here")

static struct cap_gvcam_config bed_config(int c)
{
    static const char *const serial[BED_CAMERAS] = {"T00", "T01", "T02"};
    static const char *const name[BED_CAMERAS] = {"view0", "view1", "view2"};
    return (struct cap_gvcam_config){.address = bed_address[c],
                                     .serial = serial[c],
                                     .user_name = name[c],
                                     .fmt = CAP_RGB8,
                                     .width = BED_W,
                                     .height = BED_H,
                                     .ring = (const void *const *)bed_image[c],
                                     .n_ring = BED_RING,
                                     .ring_fps = BED_FPS};
}

/* Kill the camera if it is there, and start it as configured. */
__attribute__((unused)) static void bed_restart(int c, const struct cap_gvcam_config *config)
{
    struct pvx_diag d = {""};
    cap_gvcam_free(&bed_cam[c]);
    pvx_err e = cap_gvcam_new(bed_net, config, &bed_cam[c], &d);
    if (e != PVX_OK)
        printf("  %s\n", pvx_diag_text(&d, e));
    T_EQ_I(e, PVX_OK);
}

static void bed_open(void)
{
    struct pvx_diag d = {""};
    pvx_log_set_level(PVX_LOG_ERROR);
    pvx_err e = cap_netns_enter(BED_CAMERAS, &d); /* still one thread */
    bed_usable = e == PVX_OK || cap_netns_have(bed_address[0], BED_CAMERAS);
    if (!bed_usable)
        printf("  %s\n", pvx_diag_text(&d, e));
    for (int c = 0; c < BED_CAMERAS; c++)
        for (int i = 0; i < BED_RING; i++) {
            bed_image[c][i] = malloc(BED_W * BED_H * 3);
            for (size_t k = 0; k < BED_W * BED_H * 3; k++)
                bed_image[c][i][k] = (unsigned char)(t_rand() >> 56);
        }
    if (!bed_usable)
        return;
    bed_usable = cap_gvnet_new(&bed_net, &d) == PVX_OK;
    for (int c = 0; c < BED_CAMERAS && bed_usable; c++) {
        struct cap_gvcam_config config = bed_config(c);
        e = cap_gvcam_new(bed_net, &config, &bed_cam[c], &d);
        bed_usable = e == PVX_OK;
        if (!bed_usable) {
            printf("  %s\n", pvx_diag_text(&d, e));
            exit(1); /* the network is ours: this is a fault, not a reason to skip */
        }
    }
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

__attribute__((unused)) static struct cap_gvcam_stats bed_stats(int c)
{
    struct cap_gvcam_stats st;
    cap_gvcam_stats(bed_cam[c], &st);
    return st;
}

__attribute__((unused)) static void bed_fault(int c, struct cap_gvcam_fault f)
{
    cap_gvcam_set_fault(bed_cam[c], &f);
}

/* ---- Aravis as the client --------------------------------------------------------------------- */

__attribute__((unused)) static ArvCamera *bed_client(int c)
{
    GError *e = NULL;
    ArvCamera *cam = arv_camera_new(bed_address[c], &e);
    if (cam == NULL)
        printf("  %s: %s\n", bed_address[c], e != NULL ? e->message : "?");
    T_OK(cam != NULL);
    g_clear_error(&e);
    return cam;
}

#define BED_OK(e)                                                     \
    do {                                                              \
        T_CHECK_((e) == NULL, "%s", (e) != NULL ? (e)->message : ""); \
        g_clear_error(&(e));                                          \
    } while (0)

/* A stream with n buffers, started.  Without the packet socket, so that it is the same for everybody. */
__attribute__((unused)) static ArvStream *bed_start(ArvCamera *cam, int n, bool resend)
{
    GError *e = NULL;
    arv_camera_gv_set_packet_size_adjustment(cam, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
    arv_camera_gv_set_stream_options(cam, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    size_t payload = arv_camera_get_payload(cam, &e);
    BED_OK(e);
    ArvStream *s = arv_camera_create_stream(cam, NULL, NULL, &e);
    BED_OK(e);
    if (s == NULL)
        return NULL;
    g_object_set(s, "packet-resend",
                 resend ? ARV_GV_STREAM_PACKET_RESEND_ALWAYS : ARV_GV_STREAM_PACKET_RESEND_NEVER,
                 "packet-request-ratio", 1.0, NULL);
    for (int k = 0; k < n; k++)
        arv_stream_push_buffer(s, arv_buffer_new_allocate(payload));
    arv_camera_start_acquisition(cam, &e);
    BED_OK(e);
    return s;
}

__attribute__((unused)) static void bed_stop(ArvCamera *cam, ArvStream **s)
{
    GError *e = NULL;
    arv_camera_stop_acquisition(cam, &e);
    BED_OK(e);
    g_clear_object(s);
}

/* The next buffer with SUCCESS, NULL after 10 s; others are counted in *bad (may be NULL). */
__attribute__((unused)) static ArvBuffer *bed_next(ArvStream *s, int *bad)
{
    int64_t end = pvx_now_mono() + 10 * PVX_NS_PER_S;
    while (pvx_now_mono() < end) {
        ArvBuffer *b = arv_stream_timeout_pop_buffer(s, 100000);
        if (b != NULL && arv_buffer_get_status(b) == ARV_BUFFER_STATUS_SUCCESS)
            return b;
        if (b != NULL) {
            if (bad != NULL)
                ++*bad;
            arv_stream_push_buffer(s, b);
        }
    }
    return NULL;
}

/* The ring image that a stamp (host time) names. */
__attribute__((unused)) static const unsigned char *bed_truth(int c, int64_t stamp)
{
    return bed_image[c][cap_simgv_index(stamp, BED_FPS) % BED_RING];
}
#endif
