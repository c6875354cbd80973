/* gvclient.h - libaravis as the independent peer that looks at simulated cameras. */
#ifndef GVCLIENT_H
#define GVCLIENT_H
#include <arv.h>

#define BED_FMT  CAP_RGB8
#define BED_RING 8
#include "tests/lib/gvbed.h"

static inline ArvCamera *bed_client(int c)
{
    GError *e = NULL;
    ArvCamera *cam = arv_camera_new(bed_address[c], &e);
    if (cam == NULL)
        printf("  %s: %s\n", bed_address[c], e != NULL ? e->message : "?");
    T_OK(cam != NULL);
    g_clear_error(&e);
    return cam;
}

/* A call that may leave an error in `e`, which it must not. */
#define BED(call)                                               \
    do {                                                        \
        GError *e = NULL;                                       \
        call;                                                   \
        T_CHECK_(e == NULL, "%s", e != NULL ? e->message : ""); \
        g_clear_error(&e);                                      \
    } while (0)

/* A stream with n buffers, started.  Without the packet socket, so that it is the same for everybody. */
static inline ArvStream *bed_start(ArvCamera *cam, int n, bool resend)
{
    size_t payload = 0;
    ArvStream *s = NULL;
    arv_camera_gv_set_packet_size_adjustment(cam, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
    arv_camera_gv_set_stream_options(cam, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    BED(payload = arv_camera_get_payload(cam, &e));
    BED(s = arv_camera_create_stream(cam, NULL, NULL, &e));
    if (s == NULL)
        return NULL;
    g_object_set(s, "packet-resend",
                 resend ? ARV_GV_STREAM_PACKET_RESEND_ALWAYS : ARV_GV_STREAM_PACKET_RESEND_NEVER,
                 "packet-request-ratio", 1.0, NULL);
    for (int k = 0; k < n; k++)
        arv_stream_push_buffer(s, arv_buffer_new_allocate(payload));
    BED(arv_camera_start_acquisition(cam, &e));
    return s;
}

static inline void bed_stop(ArvCamera *cam, ArvStream **s)
{
    BED(arv_camera_stop_acquisition(cam, &e));
    g_clear_object(s);
}

/* The next buffer with SUCCESS; others are counted in *bad (may be NULL).  NULL: none comes, and a check fails. */
static inline ArvBuffer *bed_next(ArvStream *s, int *bad)
{
    UNTIL (false) {
        ArvBuffer *b = arv_stream_timeout_pop_buffer(s, 100000);
        if (b != NULL && arv_buffer_get_status(b) == ARV_BUFFER_STATUS_SUCCESS)
            return b;
        if (b != NULL) {
            if (bad != NULL)
                ++*bad;
            arv_stream_push_buffer(s, b);
        }
    }
    T_CHECK_(false, "no buffer came");
    return NULL;
}

/* RGB8 in packets of this size. */
static inline ArvCamera *bed_rgb(int c, guint packet)
{
    ArvCamera *cam = bed_client(c);
    if (cam == NULL)
        return NULL;
    BED(arv_camera_set_pixel_format(cam, ARV_PIXEL_FORMAT_RGB_8_PACKED, &e));
    BED(arv_camera_gv_set_packet_size(cam, (gint)packet, &e));
    BED(T_EQ_I(arv_camera_gv_get_packet_size(cam, &e), packet));
    return cam;
}

/* A frame by software trigger. */
static inline ArvBuffer *bed_triggered(ArvCamera *cam, ArvStream *s, int *bad)
{
    usleep(3000); /* exposure: 2.5 ms at most */
    BED(arv_camera_software_trigger(cam, &e));
    return bed_next(s, bad);
}

/* The ring image that a stamp (host time) names. */
static inline const unsigned char *bed_truth(int c, int64_t stamp)
{
    return bed_image[c][cap_gvcam_index(stamp, BED_FPS) % BED_RING];
}
#endif
