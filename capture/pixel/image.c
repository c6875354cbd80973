#include "capture/pixel/image.h"

#include <stdio.h>
#include <string.h>

static const struct {
    const char *name;
    uint32_t pfnc;
    uint8_t depth, channels, layout;
} formats[CAP_N_FMT] = {
    /* clang-format off */
    [CAP_FMT_NONE] = {"none", 0x00000000, 0, 0, CAP_LAYOUT_NONE},
    [CAP_GREY8] = {"Mono8", 0x01080001, 8, 1, CAP_LAYOUT_8},
    [CAP_GREY10] = {"Mono10", 0x01100003, 10, 1, CAP_LAYOUT_16},
    [CAP_GREY12] = {"Mono12", 0x01100005, 12, 1, CAP_LAYOUT_16},
    [CAP_GREY14] = {"Mono14", 0x01100025, 14, 1, CAP_LAYOUT_16},
    [CAP_GREY16] = {"Mono16", 0x01100007, 16, 1, CAP_LAYOUT_16},
    [CAP_GREY10P] = {"Mono10p", 0x010a0046, 10, 1, CAP_LAYOUT_P},
    [CAP_GREY12P] = {"Mono12p", 0x010c0047, 12, 1, CAP_LAYOUT_P},
    [CAP_GREY10PACKED] = {"Mono10Packed", 0x010c0004, 10, 1, CAP_LAYOUT_PACKED},
    [CAP_GREY12PACKED] = {"Mono12Packed", 0x010c0006, 12, 1, CAP_LAYOUT_PACKED},
    [CAP_GREY10CSI] = {"Mono10csi", 0x00000000, 10, 1, CAP_LAYOUT_CSI},
    [CAP_GREY12CSI] = {"Mono12csi", 0x00000000, 12, 1, CAP_LAYOUT_CSI},
    [CAP_RGB8] = {"RGB8", 0x02180014, 8, 3, CAP_LAYOUT_8},
    [CAP_BGR8] = {"BGR8", 0x02180015, 8, 3, CAP_LAYOUT_8},
    [CAP_RGB16] = {"RGB16", 0x02300033, 16, 3, CAP_LAYOUT_16},
    [CAP_YUYV] = {"YUV422_8", 0x02100032, 8, 3, CAP_LAYOUT_YUV},
    [CAP_UYVY] = {"YUV422_8_UYVY", 0x0210001f, 8, 3, CAP_LAYOUT_YUV},
    [CAP_JPEG] = {"JPEG", 0x00000000, 8, 3, CAP_LAYOUT_JPEG},
    [CAP_BAYER_RG8] = {"BayerRG8", 0x01080009, 8, 3, CAP_LAYOUT_8},
    [CAP_BAYER_GR8] = {"BayerGR8", 0x01080008, 8, 3, CAP_LAYOUT_8},
    [CAP_BAYER_GB8] = {"BayerGB8", 0x0108000a, 8, 3, CAP_LAYOUT_8},
    [CAP_BAYER_BG8] = {"BayerBG8", 0x0108000b, 8, 3, CAP_LAYOUT_8},
    [CAP_BAYER_RG10] = {"BayerRG10", 0x0110000d, 10, 3, CAP_LAYOUT_16},
    [CAP_BAYER_GR10] = {"BayerGR10", 0x0110000c, 10, 3, CAP_LAYOUT_16},
    [CAP_BAYER_GB10] = {"BayerGB10", 0x0110000e, 10, 3, CAP_LAYOUT_16},
    [CAP_BAYER_BG10] = {"BayerBG10", 0x0110000f, 10, 3, CAP_LAYOUT_16},
    [CAP_BAYER_RG12] = {"BayerRG12", 0x01100011, 12, 3, CAP_LAYOUT_16},
    [CAP_BAYER_GR12] = {"BayerGR12", 0x01100010, 12, 3, CAP_LAYOUT_16},
    [CAP_BAYER_GB12] = {"BayerGB12", 0x01100012, 12, 3, CAP_LAYOUT_16},
    [CAP_BAYER_BG12] = {"BayerBG12", 0x01100013, 12, 3, CAP_LAYOUT_16},
    [CAP_BAYER_RG14] = {"BayerRG14", 0x0110010a, 14, 3, CAP_LAYOUT_16},
    [CAP_BAYER_GR14] = {"BayerGR14", 0x01100109, 14, 3, CAP_LAYOUT_16},
    [CAP_BAYER_GB14] = {"BayerGB14", 0x0110010b, 14, 3, CAP_LAYOUT_16},
    [CAP_BAYER_BG14] = {"BayerBG14", 0x0110010c, 14, 3, CAP_LAYOUT_16},
    [CAP_BAYER_RG16] = {"BayerRG16", 0x0110002f, 16, 3, CAP_LAYOUT_16},
    [CAP_BAYER_GR16] = {"BayerGR16", 0x0110002e, 16, 3, CAP_LAYOUT_16},
    [CAP_BAYER_GB16] = {"BayerGB16", 0x01100030, 16, 3, CAP_LAYOUT_16},
    [CAP_BAYER_BG16] = {"BayerBG16", 0x01100031, 16, 3, CAP_LAYOUT_16},
    [CAP_BAYER_RG10P] = {"BayerRG10p", 0x010a0058, 10, 3, CAP_LAYOUT_P},
    [CAP_BAYER_GR10P] = {"BayerGR10p", 0x010a0056, 10, 3, CAP_LAYOUT_P},
    [CAP_BAYER_GB10P] = {"BayerGB10p", 0x010a0054, 10, 3, CAP_LAYOUT_P},
    [CAP_BAYER_BG10P] = {"BayerBG10p", 0x010a0052, 10, 3, CAP_LAYOUT_P},
    [CAP_BAYER_RG12P] = {"BayerRG12p", 0x010c0059, 12, 3, CAP_LAYOUT_P},
    [CAP_BAYER_GR12P] = {"BayerGR12p", 0x010c0057, 12, 3, CAP_LAYOUT_P},
    [CAP_BAYER_GB12P] = {"BayerGB12p", 0x010c0055, 12, 3, CAP_LAYOUT_P},
    [CAP_BAYER_BG12P] = {"BayerBG12p", 0x010c0053, 12, 3, CAP_LAYOUT_P},
    [CAP_BAYER_RG10PACKED] = {"BayerRG10Packed", 0x010c0027, 10, 3, CAP_LAYOUT_PACKED},
    [CAP_BAYER_GR10PACKED] = {"BayerGR10Packed", 0x010c0026, 10, 3, CAP_LAYOUT_PACKED},
    [CAP_BAYER_GB10PACKED] = {"BayerGB10Packed", 0x010c0028, 10, 3, CAP_LAYOUT_PACKED},
    [CAP_BAYER_BG10PACKED] = {"BayerBG10Packed", 0x010c0029, 10, 3, CAP_LAYOUT_PACKED},
    [CAP_BAYER_RG12PACKED] = {"BayerRG12Packed", 0x010c002b, 12, 3, CAP_LAYOUT_PACKED},
    [CAP_BAYER_GR12PACKED] = {"BayerGR12Packed", 0x010c002a, 12, 3, CAP_LAYOUT_PACKED},
    [CAP_BAYER_GB12PACKED] = {"BayerGB12Packed", 0x010c002c, 12, 3, CAP_LAYOUT_PACKED},
    [CAP_BAYER_BG12PACKED] = {"BayerBG12Packed", 0x010c002d, 12, 3, CAP_LAYOUT_PACKED},
    [CAP_BAYER_RG10CSI] = {"BayerRG10csi", 0x00000000, 10, 3, CAP_LAYOUT_CSI},
    [CAP_BAYER_GR10CSI] = {"BayerGR10csi", 0x00000000, 10, 3, CAP_LAYOUT_CSI},
    [CAP_BAYER_GB10CSI] = {"BayerGB10csi", 0x00000000, 10, 3, CAP_LAYOUT_CSI},
    [CAP_BAYER_BG10CSI] = {"BayerBG10csi", 0x00000000, 10, 3, CAP_LAYOUT_CSI},
    [CAP_BAYER_RG12CSI] = {"BayerRG12csi", 0x00000000, 12, 3, CAP_LAYOUT_CSI},
    [CAP_BAYER_GR12CSI] = {"BayerGR12csi", 0x00000000, 12, 3, CAP_LAYOUT_CSI},
    [CAP_BAYER_GB12CSI] = {"BayerGB12csi", 0x00000000, 12, 3, CAP_LAYOUT_CSI},
    [CAP_BAYER_BG12CSI] = {"BayerBG12csi", 0x00000000, 12, 3, CAP_LAYOUT_CSI},
    [CAP_RGB10] = {"RGB10", 0x02300018, 10, 3, CAP_LAYOUT_16},
    [CAP_RGB12] = {"RGB12", 0x0230001a, 12, 3, CAP_LAYOUT_16},
    [CAP_RGB14] = {"RGB14", 0x0230005e, 14, 3, CAP_LAYOUT_16},
    [CAP_GREY_F32] = {"Mono32f", 0x00000000, 32, 1, CAP_LAYOUT_F32},
    [CAP_RGB_F32] = {"RGB32f", 0x00000000, 32, 3, CAP_LAYOUT_F32},
    /* clang-format on */
};

static enum cap_pixfmt image_known(enum cap_pixfmt f)
{
    return (unsigned)f < CAP_N_FMT ? f : CAP_FMT_NONE;
}

const char *cap_pixfmt_name(enum cap_pixfmt f)
{
    return formats[image_known(f)].name;
}

enum cap_pixfmt cap_pixfmt_parse(const char *name)
{
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT; f++)
        if (strcmp(formats[f].name, name) == 0)
            return f;
    static const struct {
        const char *name;
        enum cap_pixfmt f;
    } also[] = {{"YUYV", CAP_YUYV}, {"UYVY", CAP_UYVY}, {"GREY", CAP_GREY8}, {"MJPG", CAP_JPEG}};
    for (size_t i = 0; i < sizeof also / sizeof also[0]; i++)
        if (strcmp(also[i].name, name) == 0)
            return also[i].f;
    return CAP_FMT_NONE;
}

size_t cap_pixfmt_names(char *out, size_t size)
{
    size_t n = 0;
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT && n < size; f++)
        if (cap_pixfmt_bayer(f) == NULL)
            n += (size_t)snprintf(out + n, size - n, "%s ", formats[f].name);
    for (enum cap_pixfmt f = CAP_BAYER_RG8; f <= CAP_BAYER_BG12CSI && n < size; f += 4)
        n += (size_t)snprintf(out + n, size - n, "%s ", formats[f].name);
    if (n < size)
        n += (size_t)snprintf(out + n, size - n, "(and GR, GB, BG in the place of RG)");
    return n < size ? n : size - 1;
}

uint32_t cap_pixfmt_pfnc(enum cap_pixfmt f)
{
    return formats[image_known(f)].pfnc;
}

enum cap_pixfmt cap_pixfmt_from_pfnc(uint32_t code)
{
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT && code != 0; f++)
        if (formats[f].pfnc == code)
            return f;
    return CAP_FMT_NONE;
}

int cap_pixfmt_depth(enum cap_pixfmt f)
{
    return formats[image_known(f)].depth;
}

int cap_pixfmt_channels(enum cap_pixfmt f)
{
    return formats[image_known(f)].channels;
}

enum cap_layout cap_pixfmt_layout(enum cap_pixfmt f)
{
    return formats[image_known(f)].layout;
}

const uint8_t *cap_pixfmt_bayer(enum cap_pixfmt f)
{
    static const uint8_t cell[4][4] = {{0, 1, 1, 2}, {1, 0, 2, 1}, {1, 2, 0, 1}, {2, 1, 1, 0}};
    return f >= CAP_BAYER_RG8 && f <= CAP_BAYER_BG12CSI ? cell[(f - CAP_BAYER_RG8) % 4] : NULL;
}

enum cap_pixfmt cap_pixfmt_of_depth(enum cap_pixfmt f, int depth)
{
    for (enum cap_pixfmt g = CAP_GREY8; g < CAP_N_FMT; g++) {
        const uint8_t *a = cap_pixfmt_bayer(f), *b = cap_pixfmt_bayer(g);
        if (cap_pixfmt_layout(g) == cap_pixfmt_layout(f) && cap_pixfmt_depth(g) == depth &&
            cap_pixfmt_channels(g) == cap_pixfmt_channels(f) && a == b)
            return g;
    }
    return CAP_FMT_NONE;
}

bool cap_pixfmt_fits(enum cap_pixfmt have, enum cap_pixfmt want)
{
    bool single = cap_pixfmt_bayer(want) != NULL || cap_pixfmt_channels(want) == 1;
    bool rgb = cap_pixfmt_layout(want) == CAP_LAYOUT_16 && !single;
    return have == want ||
           (single && cap_pixfmt_layout(have) == cap_pixfmt_layout(want) &&
            cap_pixfmt_channels(have) == 1 &&
            (have == CAP_GREY16 || cap_pixfmt_depth(have) == cap_pixfmt_depth(want))) ||
           (rgb && have == CAP_RGB16);
}

size_t cap_pixfmt_row(enum cap_pixfmt f, int32_t width)
{
    size_t w = width > 0 ? (size_t)width : 0;
    size_t samples = cap_pixfmt_bayer(f) != NULL ? w : w * (size_t)cap_pixfmt_channels(f);
    size_t bits = samples * (size_t)cap_pixfmt_depth(f);
    switch (cap_pixfmt_layout(f)) {
    case CAP_LAYOUT_8: return samples;
    case CAP_LAYOUT_16: return samples * 2;
    case CAP_LAYOUT_P: return (bits + 7) / 8;
    case CAP_LAYOUT_PACKED: return (w + 1) / 2 * 3;
    case CAP_LAYOUT_CSI: return cap_pixfmt_depth(f) == 10 ? (w + 3) / 4 * 5 : (w + 1) / 2 * 3;
    case CAP_LAYOUT_YUV: return (w + 1) / 2 * 4;
    case CAP_LAYOUT_F32: return samples * 4;
    case CAP_LAYOUT_NONE:
    case CAP_LAYOUT_JPEG: break;
    }
    return 0;
}

size_t cap_pixfmt_image(enum cap_pixfmt f, int32_t width, int32_t height)
{
    if (width <= 0 || height <= 0)
        return 0;
    if (cap_pixfmt_layout(f) == CAP_LAYOUT_JPEG)
        return (size_t)width * (size_t)height * 3 + 4096;
    return cap_pixfmt_row(f, width) * (size_t)height;
}
