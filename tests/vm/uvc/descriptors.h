/* descriptors.h - what a virtual UVC camera says it is.
 *
 * USB Device Class Definition for Video Devices 1.0: one control interface (camera terminal with
 * exposure, processing unit with brightness and gain, output terminal) and one streaming interface
 * with a bulk endpoint; MJPEG, YUY2, Y800 and the kernel's names for raw Bayer (RGGB, RG16, RW10), two
 * sizes each, 30, 15 and 5 Hz. */
#ifndef VM_UVC_DESCRIPTORS_H
#define VM_UVC_DESCRIPTORS_H
#include <stdbool.h>
#include "tests/vm/uvc/images.h"

enum { UVC_CAMERA_TERMINAL = 1, UVC_OUTPUT_TERMINAL, UVC_PROCESSING_UNIT };
enum { UVC_N_INTERVALS = 3 };
extern const uint32_t uvc_intervals[UVC_N_INTERVALS]; /* 100 ns, shortest first */
/* Frame rate of hosts that ask for none; false: it is not one of them.  Before any camera is plugged. */
bool uvc_set_default_rate(int hz);
uint32_t uvc_default_interval(void);

struct uvc_identity {
    const char *maker, *model, *serial;
};

/* Descriptor `type` (1 device, 2 configuration, 3 string, 6 device qualifier) number `index` into
 * out [USBIP_MAX_ANSWER]; its bytes, or -EPIPE: there is none. */
int uvc_descriptor(int type, int index, const struct uvc_identity *id, const struct uvc_images *m,
                   uint8_t *out);

static inline void uvc_put16(uint8_t *p, unsigned v)
{
    p[0] = (uint8_t)v;
    p[1] = (uint8_t)(v >> 8);
}
static inline void uvc_put32(uint8_t *p, uint32_t v)
{
    uvc_put16(p, v & 0xffff);
    uvc_put16(p + 2, v >> 16);
}
static inline unsigned uvc_get16(const uint8_t *p)
{
    return (unsigned)(p[0] | p[1] << 8);
}
static inline uint32_t uvc_get32(const uint8_t *p)
{
    return uvc_get16(p) | (uint32_t)uvc_get16(p + 2) << 16;
}
#endif
