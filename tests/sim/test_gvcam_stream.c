/* Frames of our GVSP camera as libaravis receives them: pixels, numbers, stamps, resend, chunks. */
#include "capture/wire/be.h"
#include "tests/lib/gvclient.h"

/* ---- what the pixels should be, written down once more and in another way ----------------------- */

static unsigned source16(const unsigned char *rgb, int x, int y, int ch)
{
    unsigned v = rgb[3 * (y * BED_W + x) + ch];
    return v << 8 | v;
}

static unsigned wanted(const unsigned char *rgb, enum cap_pixfmt f, int x, int y, int ch)
{
    const uint8_t *cell = cap_pixfmt_bayer(f);
    unsigned v;
    if (cell != NULL)
        v = source16(rgb, x, y, cell[2 * (y % 2) + x % 2]);
    else if (cap_pixfmt_channels(f) == 3)
        v = source16(rgb, x, y, f == CAP_BGR8 ? 2 - ch : ch);
    else
        v = (source16(rgb, x, y, 0) + source16(rgb, x, y, 1) + source16(rgb, x, y, 2)) / 3;
    return v >> (16 - cap_pixfmt_depth(f));
}

static unsigned bits(const unsigned char *p, size_t at, int n)
{
    unsigned v = 0;
    for (int k = 0; k < n; k++, at++)
        v |= (unsigned)(p[at / 8] >> at % 8 & 1) << k;
    return v;
}

/* Sample number k of a row, by the layouts of capture/pixel/image.h. */
static unsigned sample(enum cap_pixfmt f, const unsigned char *row, size_t k)
{
    int depth = cap_pixfmt_depth(f), low = depth - 8;
    const unsigned char *p = row + k / 2 * 3;
    switch (cap_pixfmt_layout(f)) {
    case CAP_LAYOUT_8: return row[k];
    case CAP_LAYOUT_P: return bits(row, k * (size_t)depth, depth);
    case CAP_LAYOUT_PACKED:
        return k % 2 == 0 ? (unsigned)p[0] << low | bits(p + 1, 0, low)
                          : (unsigned)p[2] << low | bits(p + 1, 4, low);
    default: return (unsigned)row[2 * k] | (unsigned)row[2 * k + 1] << 8;
    }
}

static int count_wrong(enum cap_pixfmt f, const unsigned char *data, const unsigned char *rgb)
{
    int per = cap_pixfmt_channels(f) == 3 && cap_pixfmt_bayer(f) == NULL ? 3 : 1, bad = 0;
    for (int y = 0; y < BED_H; y++)
        for (int x = 0; x < BED_W; x++)
            for (int ch = 0; ch < per; ch++)
                bad += sample(f, data + (size_t)y * cap_pixfmt_row(f, BED_W),
                              (size_t)(x * per + ch)) != wanted(rgb, f, x, y, ch);
    return bad;
}

T_CASE(discovery_names_them_all)
{
    arv_update_device_list();
    int found = 0;
    for (unsigned i = 0; i < arv_get_n_devices(); i++)
        for (int c = 0; c < BED_CAMERAS; c++)
            if (g_strcmp0(arv_get_device_address(i), bed_address[c]) == 0) {
                char serial[8], mac[32];
                snprintf(serial, sizeof serial, "T%02d", c);
                snprintf(mac, sizeof mac, "02:50:7f:00:00:%02x", c + 2);
                T_EQ_S(arv_get_device_vendor(i), "Pyrovox");
                T_EQ_S(arv_get_device_model(i), "SimCam");
                T_EQ_S(arv_get_device_serial_nbr(i), serial);
                T_EQ_S(arv_get_device_physical_id(i), mac);
                found++;
            }
    T_EQ_I(found, BED_CAMERAS);
}

T_CASE(every_format_bit_for_bit)
{
    ArvCamera *cam = bed_client(0);
    if (cam == NULL)
        return;
    guint n = 0;
    gint64 *codes = NULL;
    BED(codes = arv_camera_dup_available_pixel_formats(cam, &n, &e));
    T_EQ_I(n, 51); /* Mono: 9, Bayer: 4 x 9, RGB8 BGR8 RGB10 RGB12 RGB14 RGB16 */
    BED(arv_camera_gv_set_packet_size(cam, 9000, &e));
    for (guint k = 0; k < n; k++) {
        enum cap_pixfmt f = cap_pixfmt_from_pfnc((uint32_t)codes[k]);
        T_OK(f != CAP_FMT_NONE);
        BED(arv_camera_set_pixel_format(cam, (ArvPixelFormat)codes[k], &e));
        ArvStream *s = bed_start(cam, 4, false);
        ArvBuffer *b = s != NULL ? bed_next(s, NULL) : NULL;
        if (b != NULL) {
            size_t size;
            const void *data = arv_buffer_get_image_data(b, &size);
            T_EQ_I(size, cap_pixfmt_image(f, BED_W, BED_H));
            T_EQ_I(arv_buffer_get_image_pixel_format(b), codes[k]);
            int wrong = count_wrong(f, data, bed_truth(0, (int64_t)arv_buffer_get_timestamp(b)));
            T_CHECK_(wrong == 0, "%s: %d samples wrong", cap_pixfmt_name(f), wrong);
            arv_stream_push_buffer(s, b);
        }
        bed_stop(cam, &s);
    }
    g_free(codes);
    g_object_unref(cam);
}

/* Good frame: bytes and size are right for its stamp.  Its id. */
static uint64_t check_frame(int c, ArvBuffer *b)
{
    size_t size;
    const void *data = arv_buffer_get_image_data(b, &size);
    T_EQ_I(size, BED_W * BED_H * 3);
    T_OK(size == BED_W * BED_H * 3 &&
         memcmp(data, bed_truth(c, (int64_t)arv_buffer_get_timestamp(b)), size) == 0);
    return arv_buffer_get_frame_id(b);
}

T_CASE(numbers_of_64_bits_go_on)
{
    struct cap_gvcam_config config = bed_config(0);
    config.first_id = 65534;
    bed_restart(0, &config);
    ArvCamera *cam = bed_rgb(0, 1000);
    if (cam == NULL)
        return;
    BED(arv_camera_set_string(cam, "GevGVSPExtendedIDMode", "On", &e));
    BED(arv_camera_set_trigger(cam, "Software", &e));
    ArvStream *s = bed_start(cam, 10, true);
    g_object_set(s, "frame-retention", 5000000u, NULL);
    bed_fault(0, (struct cap_gvcam_fault){.packet_loss = 0.01}); /* they can be asked for again */
    int bad = 0;
    for (uint64_t want = 65534; want < 65534 + 25; want++) {
        ArvBuffer *b = bed_triggered(cam, s, &bad);
        if (b == NULL)
            break;
        T_EQ_I(check_frame(0, b), want);
        arv_stream_push_buffer(s, b);
    }
    T_EQ_I(bad, 0);
    T_LE(1, bed_stats(0).resent);
    bed_stop(cam, &s);
    bed_fault(0, (struct cap_gvcam_fault){0});
    BED(arv_camera_set_string(cam, "GevGVSPExtendedIDMode", "Off", &e));
    g_object_unref(cam);
}

static ArvCamera *chunk_client(const char *layout)
{
    ArvCamera *cam = bed_rgb(2, 1480);
    if (cam == NULL)
        return NULL;
    BED(arv_camera_set_string(cam, "ChunkPayloadType", layout, &e));
    BED(arv_camera_set_chunks(cam, "Timestamp,ExposureTime,FrameID,FrameCounter,Gain,LineStatusAll",
                              &e));
    BED(arv_camera_set_exposure_time(cam, 2500, &e));
    BED(arv_camera_set_gain(cam, 6.5, &e));
    BED(T_EQ_I(arv_camera_get_payload(cam, &e), BED_W * BED_H * 3 + 7 * 8 + 8 + 4 + 8 + 4 + 4 + 4));
    return cam;
}

/* Payload type 0x0005, which Aravis 0.8 takes for an image with something after it: by hand. */
T_CASE(chunks_of_the_older_kind)
{
    ArvCamera *cam = chunk_client("ExtendedChunk");
    if (cam == NULL)
        return;
    ArvStream *s = bed_start(cam, 4, false);
    ArvBuffer *b = bed_next(s, NULL);
    if (b != NULL) {
        static const struct {
            uint32_t id, bytes;
        } want[] = {{0x8006, 4},
                    {0x8005, 4},
                    {0x8004, 4},
                    {0x8003, 8},
                    {0x8002, 4},
                    {0x8001, 8},
                    {0x8000, BED_W * BED_H * 3}};
        size_t size;
        const uint8_t *data = arv_buffer_get_data(b, &size), *at = data + size;
        T_EQ_I(arv_buffer_get_payload_type(b), ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA);
        BED(T_EQ_I(size, arv_camera_get_payload(cam, &e)));
        for (size_t k = 0; k < G_N_ELEMENTS(want); k++) { /* read from the end */
            at -= 8;
            T_EQ_I(cap_get32(at), want[k].id);
            T_EQ_I(cap_get32(at + 4), want[k].bytes);
            at -= want[k].bytes;
            if (want[k].id == 0x8001)
                T_EQ_I(cap_get64(at), arv_buffer_get_timestamp(b));
        }
        T_OK(at == data);
        T_OK(memcmp(data, bed_truth(2, (int64_t)arv_buffer_get_timestamp(b)), BED_W * BED_H * 3) ==
             0);
        arv_stream_push_buffer(s, b);
    }
    bed_stop(cam, &s);
    BED(arv_camera_set_chunk_mode(cam, FALSE, &e));
    g_object_unref(cam);
}

/* Test packets with do-not-fragment find the largest that passes: on loopback all do. */
T_CASE(packet_size_is_negotiated)
{
    ArvCamera *cam = bed_rgb(0, 600);
    if (cam == NULL)
        return;
    guint size = 0;
    BED(size = arv_camera_gv_auto_packet_size(cam, &e));
    T_LE(16380, size);
    BED(T_EQ_I(arv_camera_gv_get_packet_size(cam, &e), size));
    /* a network that swallows the larger ones: the switch has a buffer of so many bytes */
    cap_gvnet_link(bed_net, 1000, 4000);
    BED(size = arv_camera_gv_auto_packet_size(cam, &e));
    T_LE(size, 4000);
    T_LE(3900, size);
    cap_gvnet_link(bed_net, 0, 0);
    g_object_unref(cam);
}

T_CASE(part_of_the_sensor)
{
    ArvCamera *cam = bed_rgb(1, 9000);
    if (cam == NULL)
        return;
    BED(arv_camera_set_region(cam, 20, 10, 64, 48, &e));
    BED(arv_camera_clear_triggers(cam, &e));
    ArvStream *s = bed_start(cam, 4, false);
    ArvBuffer *b = bed_next(s, NULL);
    if (b != NULL) {
        const unsigned char *got = arv_buffer_get_image_data(b, NULL);
        const unsigned char *all = bed_truth(1, (int64_t)arv_buffer_get_timestamp(b));
        T_EQ_I(arv_buffer_get_image_width(b), 64);
        T_EQ_I(arv_buffer_get_image_height(b), 48);
        T_EQ_I(arv_buffer_get_image_x(b), 20);
        T_EQ_I(arv_buffer_get_image_y(b), 10);
        for (size_t y = 0; y < 48; y++)
            T_OK(memcmp(got + y * 64 * 3, all + ((y + 10) * BED_W + 20) * 3, 64 * 3) == 0);
        arv_stream_push_buffer(s, b);
    }
    bed_stop(cam, &s);
    BED(arv_camera_set_region(cam, 0, 0, BED_W, BED_H, &e));
    g_object_unref(cam);
}

/* The images come 25 times a second, and the camera takes 15: its frames are 1/15 s apart. */
T_CASE(a_camera_slower_than_its_images)
{
    ArvCamera *cam = bed_rgb(1, 9000);
    if (cam == NULL)
        return;
    BED(arv_camera_set_frame_rate(cam, 15, &e));
    ArvStream *s = bed_start(cam, 8, false);
    int64_t last = 0;
    for (int k = 0; k < 6; k++) {
        ArvBuffer *b = bed_next(s, NULL);
        if (b == NULL)
            break;
        int64_t stamp = (int64_t)arv_buffer_get_timestamp(b);
        T_OK(memcmp(arv_buffer_get_image_data(b, NULL), bed_truth(1, stamp), BED_BYTES) == 0);
        if (last != 0)
            T_LE(llabs((stamp - last + 1) % 66666667 - 1), 2); /* one or more, rounded */
        last = stamp;
        arv_stream_push_buffer(s, b);
    }
    bed_stop(cam, &s);
    g_object_unref(cam);
}

T_CASE(features_are_set_and_read)
{
    struct cap_gvcam_config config = bed_config(0);
    config.zip = true; /* the same from a zipped description */
    bed_restart(0, &config);
    ArvCamera *cam = bed_client(0);
    if (cam == NULL)
        return;
    double lo, hi;
    int w, h;
    BED(arv_camera_set_frame_rate(cam, 12.5, &e));
    BED(T_NEAR(arv_camera_get_frame_rate(cam, &e), 12.5, 0));
    BED(arv_camera_get_frame_rate_bounds(cam, &lo, &hi, &e));
    T_NEAR(hi, 1000, 0);
    BED(arv_camera_set_exposure_time(cam, 1234, &e));
    BED(T_NEAR(arv_camera_get_exposure_time(cam, &e), 1234, 0));
    BED(arv_camera_set_gain(cam, 3, &e));
    BED(T_NEAR(arv_camera_get_gain(cam, &e), 3, 0));
    BED(arv_camera_get_sensor_size(cam, &w, &h, &e));
    T_EQ_I(w, BED_W);
    T_EQ_I(h, BED_H);
    BED(arv_camera_set_trigger(cam, "Line1", &e));
    BED(T_EQ_S(arv_camera_get_trigger_source(cam, &e), "Line1"));
    BED(arv_camera_clear_triggers(cam, &e));
    BED(T_EQ_S(arv_camera_get_string(cam, "TriggerMode", &e), "Off"));
    BED(T_EQ_S(arv_camera_get_string(cam, "DeviceUserID", &e), "view0"));
    BED(arv_camera_set_boolean(cam, "GevIEEE1588", TRUE, &e));
    BED(T_OK(arv_camera_get_boolean(cam, "PtpEnable", &e))); /* one register, two names */
    BED(arv_camera_set_boolean(cam, "PtpEnable", FALSE, &e));
    BED(arv_camera_set_integer(cam, "GevSCPD", 1000, &e));
    BED(T_EQ_I(arv_camera_gv_get_packet_delay(cam, &e), 1000));
    BED(T_NEAR(arv_camera_get_float(cam, "DeviceTemperature", &e), 42, 10));
    GError *e = NULL;
    arv_camera_set_integer(cam, "Width", BED_W + 8, &e); /* out of range: refused */
    T_OK(e != NULL || arv_camera_get_integer(cam, "Width", NULL) == BED_W);
    g_clear_error(&e);
    g_object_unref(cam);
}

T_MAIN(bed_open(), bed_close())
