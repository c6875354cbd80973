/* Frames of our GVSP camera as libaravis receives them: pixels, numbers, stamps, resend, chunks. */
#include "gvbed.h"

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

/* Sample number k of a row, by the layouts of capture/image.h. */
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

static void discovery_names_them_all(void)
{
    NEED_BED();
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

static void every_format_bit_for_bit(void)
{
    NEED_BED();
    ArvCamera *cam = bed_client(0);
    if (cam == NULL)
        return;
    GError *e = NULL;
    guint n = 0;
    gint64 *codes = arv_camera_dup_available_pixel_formats(cam, &n, &e);
    BED_OK(e);
    T_EQ_I(n, 48); /* Mono: 9, Bayer: 4 x 9, RGB8 BGR8 RGB16 */
    arv_camera_gv_set_packet_size(cam, 9000, &e);
    BED_OK(e);
    for (guint k = 0; k < n; k++) {
        enum cap_pixfmt f = cap_pixfmt_from_pfnc((uint32_t)codes[k]);
        T_OK(f != CAP_FMT_NONE);
        arv_camera_set_pixel_format(cam, (ArvPixelFormat)codes[k], &e);
        BED_OK(e);
        ArvStream *s = bed_start(cam, 4, false);
        ArvBuffer *b = s != NULL ? bed_next(s, NULL) : NULL;
        T_OK(b != NULL);
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

static void software_trigger_is_one_frame(void)
{
    NEED_BED();
    ArvCamera *cam = bed_client(1);
    if (cam == NULL)
        return;
    GError *e = NULL;
    arv_camera_set_pixel_format(cam, ARV_PIXEL_FORMAT_RGB_8_PACKED, &e);
    BED_OK(e);
    arv_camera_set_trigger(cam, "Software", &e);
    BED_OK(e);
    ArvStream *s = bed_start(cam, 8, false);
    struct cap_gvcam_stats before = bed_stats(1);
    for (int k = 0; k < 6; k++) {
        int64_t t0 = pvx_now_real();
        arv_camera_software_trigger(cam, &e);
        BED_OK(e);
        int64_t t1 = pvx_now_real();
        ArvBuffer *b = bed_next(s, NULL);
        T_OK(b != NULL);
        if (b == NULL)
            break;
        int64_t stamp = (int64_t)arv_buffer_get_timestamp(b);
        T_OK(stamp >= t0 && stamp <= t1);
        size_t size;
        const void *data = arv_buffer_get_image_data(b, &size);
        T_EQ_I(size, BED_W * BED_H * 3);
        T_OK(memcmp(data, bed_truth(1, stamp), size) == 0);
        arv_stream_push_buffer(s, b);
        usleep(2000); /* exposure: 1 ms */
    }
    struct cap_gvcam_stats after = bed_stats(1);
    T_EQ_I(after.triggers - before.triggers, 6);
    T_EQ_I(after.frames - before.frames, 6);
    bed_stop(cam, &s);
    g_object_unref(cam);
}

int main(void)
{
    bed_open();
    T_RUN(discovery_names_them_all);
    T_RUN(every_format_bit_for_bit);
    T_RUN(software_trigger_is_one_frame);
    bed_close();
    return t_done();
}
