#include "tests/vm/uvc/descriptors.h"

#include <errno.h>
#include <string.h>

/* The tables of the specification, byte by byte; names of their fields in the comments. */
enum { DEVICE = 1, CONFIGURATION, STRING, QUALIFIER = 6 };
enum { CS_INTERFACE = 0x24 };

const uint32_t uvc_intervals[UVC_N_INTERVALS] = {333333, 666666, 2000000};

static uint32_t default_interval = 333333;

bool uvc_set_default_rate(int hz)
{
    for (int k = 0; k < UVC_N_INTERVALS; k++)
        if (hz > 0 && uvc_intervals[k] == 10000000u / (uint32_t)hz) {
            default_interval = uvc_intervals[k];
            return true;
        }
    return false;
}

uint32_t uvc_default_interval(void)
{
    return default_interval;
}

struct writer {
    uint8_t *out;
    int n;
};

static uint8_t *put(struct writer *w, const void *bytes, int n)
{
    uint8_t *at = w->out + w->n;
    memcpy(at, bytes, (size_t)n);
    w->n += n;
    return at;
}
#define PUT(w, ...) \
    put(w, (const uint8_t[]){__VA_ARGS__}, (int)sizeof((const uint8_t[]){__VA_ARGS__}))

static void control_interface(struct writer *w)
{
    PUT(w, 8, 0x0b, 0, 2, 0x0e, 3, 0, 2); /* association: interfaces 0 and 1 are a camera */
    PUT(w, 9, 4, 0, 0, 0, 0x0e, 1, 0, 2); /* interface 0: video control */
    uint8_t *head = PUT(w, 13, CS_INTERFACE, 1, 0x00, 0x01, /* bcdUVC 1.00, wTotalLength */
                        0, 0, 0x00, 0x6c, 0xdc, 0x02,       /* dwClockFrequency 48 MHz */
                        1, 1);                              /* streaming interfaces: number 1 */
    int start = w->n - 13;
    PUT(w, 18, CS_INTERFACE, 2, UVC_CAMERA_TERMINAL, 0x01, 0x02, 0, 0, /* ITT_CAMERA */
        0, 0, 0, 0, 0, 0, 3, 0x0a, 0, 0); /* bmControls: exposure mode, exposure time */
    PUT(w, 11, CS_INTERFACE, 5, UVC_PROCESSING_UNIT, UVC_CAMERA_TERMINAL, 0, 0, 2, 0x01, 0x02,
        0); /* bmControls: brightness, gain */
    PUT(w, 9, CS_INTERFACE, 3, UVC_OUTPUT_TERMINAL, 0x01, 0x01, 0, UVC_PROCESSING_UNIT, 0);
    uvc_put16(head + 5, (unsigned)(w->n - start));
}

static void frames(struct writer *w, const struct uvc_images *m, enum uvc_format f)
{
    for (int s = 0; s < UVC_N_SIZES; s++) {
        uint8_t d[26 + 4 * UVC_N_INTERVALS] = {sizeof d, CS_INTERFACE, f == UVC_MJPG ? 7 : 5,
                                               (uint8_t)(s + 1)};
        uint32_t bytes = (uint32_t)uvc_images_max(m, f, s);
        uvc_put16(d + 5, (unsigned)m->size[s].width);
        uvc_put16(d + 7, (unsigned)m->size[s].height);
        uvc_put32(d + 9, bytes * 8 * 5);   /* dwMinBitRate */
        uvc_put32(d + 13, bytes * 8 * 30); /* dwMaxBitRate */
        uvc_put32(d + 17, bytes);          /* dwMaxVideoFrameBufferSize */
        uvc_put32(d + 21, default_interval);
        d[25] = UVC_N_INTERVALS;
        for (int k = 0; k < UVC_N_INTERVALS; k++)
            uvc_put32(d + 26 + 4 * k, uvc_intervals[k]);
        put(w, d, sizeof d);
    }
}

static void uncompressed(struct writer *w, const struct uvc_images *m, enum uvc_format f,
                         const char fourcc[4])
{
    uint8_t *p =
        PUT(w, 27, CS_INTERFACE, 4, (uint8_t)(f + 1), UVC_N_SIZES, 0, 0, 0, 0, 0x00, 0x00, 0x10,
            0x00, 0x80, 0x00, 0x00, 0xaa, 0x00, 0x38, 0x9b, 0x71, (uint8_t)uvc_bits[f], 1, 0, 0, 0,
            0); /* guidFormat: fourcc and the rest of every such GUID */
    memcpy(p + 5, fourcc, 4);
    frames(w, m, f);
}

static void streaming_interface(struct writer *w, const struct uvc_images *m)
{
    PUT(w, 9, 4, 1, 0, 1, 0x0e, 2, 0, 0); /* interface 1: video streaming, one endpoint */
    int start = w->n;
    uint8_t *head = PUT(w, 13 + UVC_N_FORMATS, CS_INTERFACE, 1, UVC_N_FORMATS, 0, 0, /* total */
                        0x81, 0, UVC_OUTPUT_TERMINAL, 0, 0, 0, 1);
    static const uint8_t no_controls[UVC_N_FORMATS]; /* of each format */
    put(w, no_controls, sizeof no_controls);
    PUT(w, 11, CS_INTERFACE, 6, UVC_MJPG + 1, UVC_N_SIZES, 0, 1, 0, 0, 0, 0);
    frames(w, m, UVC_MJPG);
    uncompressed(w, m, UVC_YUYV, "YUY2");
    uncompressed(w, m, UVC_GREY, "Y800");
    uncompressed(w, m, UVC_RGGB, "RGGB");
    uncompressed(w, m, UVC_RG16, "RG16");
    uncompressed(w, m, UVC_RW10, "RW10");
    PUT(w, 6, CS_INTERFACE, 13, 1, 1, 4); /* colour: BT.709 primaries, BT.601 matrix */
    uvc_put16(head + 4, (unsigned)(w->n - start));
    PUT(w, 7, 5, 0x81, 2, 0x00, 0x02, 0); /* endpoint 1 IN: bulk, 512 bytes */
}

static int configuration(const struct uvc_images *m, uint8_t *out)
{
    struct writer w = {out, 0};
    PUT(&w, 9, CONFIGURATION, 0, 0, 2, 1, 0, 0x80, 250);
    control_interface(&w);
    streaming_interface(&w, m);
    uvc_put16(out + 2, (unsigned)w.n);
    return w.n;
}

static int string(int index, const struct uvc_identity *id, uint8_t *out)
{
    const char *const text[] = {NULL, id->maker, id->model, id->serial};
    if (index == 0) {
        memcpy(out, (const uint8_t[]){4, STRING, 0x09, 0x04}, 4); /* English */
        return 4;
    }
    if (index > 3)
        return -EPIPE;
    int n = 2;
    for (const char *p = text[index]; *p != '\0' && n < 254; p++) {
        out[n++] = (uint8_t)*p;
        out[n++] = 0;
    }
    out[0] = (uint8_t)n;
    out[1] = STRING;
    return n;
}

int uvc_descriptor(int type, int index, const struct uvc_identity *id, const struct uvc_images *m,
                   uint8_t *out)
{
    struct writer w = {out, 0};
    switch (type) {
    case DEVICE: /* USB 2.0, composite with associations, 1d6d:0501, strings 1 2 3 */
        PUT(&w, 18, DEVICE, 0x00, 0x02, 0xef, 2, 1, 64, 0x6d, 0x1d, 0x01, 0x05, 0x00, 0x01, 1, 2, 3,
            1);
        return w.n;
    case QUALIFIER: PUT(&w, 10, QUALIFIER, 0x00, 0x02, 0xef, 2, 1, 64, 1, 0); return w.n;
    case CONFIGURATION: return configuration(m, out);
    case STRING: return string(index, id, out);
    default: return -EPIPE;
    }
}
