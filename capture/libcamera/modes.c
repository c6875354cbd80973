#include "capture/libcamera/modes.h"

#include <stdio.h>
#include <string.h>

#define FOURCC(a, b, c, d) \
    ((uint32_t)(a) | (uint32_t)(b) << 8 | (uint32_t)(c) << 16 | (uint32_t)(d) << 24)
#define CSI2P \
    ((uint64_t)0x0b << 56 | 1) /* MIPI packing: DRM_FORMAT_MOD of libcamera's own vendor */

/* The four orders of a sensor's colours, with DRM's (in part V4L2's) irregular names. */
static const struct {
    uint32_t fourcc;
    uint64_t modifier;
    enum cap_pixfmt fmt;
} table[] = {
    {FOURCC('R', '8', ' ', ' '), 0, CAP_GREY8},
    {FOURCC('R', '1', '0', ' '), 0, CAP_GREY10},
    {FOURCC('R', '1', '2', ' '), 0, CAP_GREY12},
    {FOURCC('R', '1', '6', ' '), 0, CAP_GREY16},
    {FOURCC('R', '1', '0', ' '), CSI2P, CAP_GREY10CSI},
    {FOURCC('R', '1', '2', ' '), CSI2P, CAP_GREY12CSI},
    {FOURCC('B', 'G', '2', '4'), 0, CAP_RGB8}, /* BGR888: R first in memory */
    {FOURCC('R', 'G', '2', '4'), 0, CAP_BGR8},
    {FOURCC('B', 'G', '4', '8'), 0, CAP_RGB16}, /* BGR161616 */
    {FOURCC('Y', 'U', 'Y', 'V'), 0, CAP_YUYV},
    {FOURCC('U', 'Y', 'V', 'Y'), 0, CAP_UYVY},
    {FOURCC('M', 'J', 'P', 'G'), 0, CAP_JPEG},
    {FOURCC('R', 'G', 'G', 'B'), 0, CAP_BAYER_RG8},
    {FOURCC('G', 'R', 'B', 'G'), 0, CAP_BAYER_GR8},
    {FOURCC('G', 'B', 'R', 'G'), 0, CAP_BAYER_GB8},
    {FOURCC('B', 'A', '8', '1'), 0, CAP_BAYER_BG8},
    {FOURCC('R', 'G', '1', '0'), 0, CAP_BAYER_RG10},
    {FOURCC('B', 'A', '1', '0'), 0, CAP_BAYER_GR10},
    {FOURCC('G', 'B', '1', '0'), 0, CAP_BAYER_GB10},
    {FOURCC('B', 'G', '1', '0'), 0, CAP_BAYER_BG10},
    {FOURCC('R', 'G', '1', '2'), 0, CAP_BAYER_RG12},
    {FOURCC('B', 'A', '1', '2'), 0, CAP_BAYER_GR12},
    {FOURCC('G', 'B', '1', '2'), 0, CAP_BAYER_GB12},
    {FOURCC('B', 'G', '1', '2'), 0, CAP_BAYER_BG12},
    {FOURCC('R', 'G', '1', '4'), 0, CAP_BAYER_RG14},
    {FOURCC('B', 'A', '1', '4'), 0, CAP_BAYER_GR14},
    {FOURCC('G', 'B', '1', '4'), 0, CAP_BAYER_GB14},
    {FOURCC('B', 'G', '1', '4'), 0, CAP_BAYER_BG14},
    {FOURCC('R', 'G', 'B', '6'), 0, CAP_BAYER_RG16},
    {FOURCC('G', 'R', '1', '6'), 0, CAP_BAYER_GR16},
    {FOURCC('G', 'B', '1', '6'), 0, CAP_BAYER_GB16},
    {FOURCC('B', 'Y', 'R', '2'), 0, CAP_BAYER_BG16},
    {FOURCC('R', 'G', '1', '0'), CSI2P, CAP_BAYER_RG10CSI},
    {FOURCC('B', 'A', '1', '0'), CSI2P, CAP_BAYER_GR10CSI},
    {FOURCC('G', 'B', '1', '0'), CSI2P, CAP_BAYER_GB10CSI},
    {FOURCC('B', 'G', '1', '0'), CSI2P, CAP_BAYER_BG10CSI},
    {FOURCC('R', 'G', '1', '2'), CSI2P, CAP_BAYER_RG12CSI},
    {FOURCC('B', 'A', '1', '2'), CSI2P, CAP_BAYER_GR12CSI},
    {FOURCC('G', 'B', '1', '2'), CSI2P, CAP_BAYER_GB12CSI},
    {FOURCC('B', 'G', '1', '2'), CSI2P, CAP_BAYER_BG12CSI},
};

enum cap_pixfmt lc_pixfmt(struct cap_lc_format f)
{
    for (size_t i = 0; i < sizeof table / sizeof table[0]; i++)
        if (table[i].fourcc == f.fourcc && table[i].modifier == f.modifier)
            return table[i].fmt;
    return CAP_FMT_NONE;
}

/* JPEG is always full range, by its own standard. */
uint8_t lc_yuv(const struct cap_lc_layout *l)
{
    uint8_t transfer = l->transfer_rec709 ? CAP_YUV_TRANSFER_709 : 0;
    if (lc_pixfmt(l->mode.format) == CAP_JPEG)
        return transfer;
    return (uint8_t)((l->rec709 ? CAP_YUV_709 : CAP_YUV_601) |
                     (l->full_range == CAP_LC_RANGE_FULL ? CAP_YUV_FULL : 0) | transfer);
}

/* ---- modes -------------------------------------------------------------------------------------- */

static void say_formats(const struct cap_lc_mode *mode, size_t n, char *text, size_t size)
{
    text[0] = '\0';
    for (size_t i = 0; i < n; i++) {
        const char *name = cap_pixfmt_name(lc_pixfmt(mode[i].format));
        bool before = lc_pixfmt(mode[i].format) == CAP_FMT_NONE;
        for (size_t k = 0; k < i; k++)
            before |= lc_pixfmt(mode[k].format) == lc_pixfmt(mode[i].format);
        size_t at = strlen(text);
        if (!before && at + strlen(name) + 2 < size)
            snprintf(text + at, size - at, " %s", name);
    }
}

int lc_choose(const struct cap_source_config *c, const struct cap_lc_mode *mode, size_t n,
              int32_t *w, int32_t *h, struct pvx_diag *d)
{
    int best = -1;
    for (size_t i = 0; i < n; i++) {
        enum cap_pixfmt f = lc_pixfmt(mode[i].format);
        if (f == CAP_FMT_NONE || (c->fmt != CAP_FMT_NONE && f != c->fmt))
            continue;
        bool fits = mode[i].width == c->width && mode[i].height == c->height;
        if (best < 0 || (fits && lc_pixfmt(mode[best].format) == f))
            best = (int)i;
        if (fits)
            break;
    }
    if (best < 0) {
        char list[256];
        say_formats(mode, n, list, sizeof list);
        (void)CAP_FAIL(c, "libcamera", d, PVX_EUNSUP,
                       "does not offer %s; of what it offers can be used:%s",
                       c->fmt != CAP_FMT_NONE ? cap_pixfmt_name(c->fmt) : "a format",
                       list[0] != '\0' ? list : " nothing");
        return -1;
    }
    *w = c->width > 0 ? c->width : mode[best].width;
    *h = c->height > 0 ? c->height : mode[best].height;
    return best;
}

/* ---- names -------------------------------------------------------------------------------------- */

static void list_ids(const char *name, const char *const *id, size_t n, char *text, size_t size)
{
    text[0] = '\0';
    for (size_t i = 0; i < n; i++) {
        size_t at = strlen(text);
        if (strstr(id[i], name) != NULL && at + strlen(id[i]) + 3 < size)
            snprintf(text + at, size - at, "%s %s", at > 0 ? "," : "", id[i]);
    }
}

pvx_err lc_match(const char *name, const char *const *id, size_t n, size_t *out,
                 const struct cap_source_config *c, struct pvx_diag *d)
{
    size_t hits = 0;
    for (size_t i = 0; i < n; i++) {
        if (strcmp(id[i], name) == 0) {
            *out = i;
            return PVX_OK;
        }
        if (name[0] != '\0' && strstr(id[i], name) != NULL) {
            *out = i;
            hits++;
        }
    }
    if (hits == 1)
        return PVX_OK;
    char list[400];
    list_ids(hits > 0 ? name : "", id, n, list, sizeof list);
    if (hits > 0)
        return CAP_FAIL(c, "libcamera", d, PVX_EINVAL, "could be any of%s", list);
    return CAP_FAIL(c, "libcamera", d, PVX_ENOENT, "libcamera sees no such camera; %s%s",
                    n > 0 ? "there are" : "it sees none at all", list);
}

const char *lc_short_name(const char *const *id, size_t n, size_t i)
{
    const char *slash = strrchr(id[i], '\\');
    if (slash == NULL || slash[1] == '\0')
        return id[i];
    for (size_t k = 0; k < n; k++)
        if (k != i && strstr(id[k], slash + 1) != NULL)
            return id[i];
    return slash + 1;
}
