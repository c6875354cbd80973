/* test_v4l2_formats.c - the kernel's four-letter codes and colour fields, as its documentation has them. */
#include "../t.h"

#include "capture/v4l2/v4l2.h"

static uint32_t code(const char *s)
{
    return v4l2_fourcc(s[0], s[1], s[2], s[3]);
}

T_CASE(codes)
{
    static const struct {
        const char *code, *name;
    } k[] = {{"GREY", "Mono8"},        {"Y10 ", "Mono10"},        {"Y12 ", "Mono12"},
             {"Y14 ", "Mono14"},       {"Y16 ", "Mono16"},        {"Y10P", "Mono10csi"},
             {"Y12P", "Mono12csi"},    {"RGB3", "RGB8"},          {"BGR3", "BGR8"},
             {"YUYV", "YUV422_8"},     {"UYVY", "YUV422_8_UYVY"}, {"MJPG", "JPEG"},
             {"JPEG", "JPEG"},         {"BA81", "BayerBG8"},      {"GBRG", "BayerGB8"},
             {"GRBG", "BayerGR8"},     {"RGGB", "BayerRG8"},      {"BG10", "BayerBG10"},
             {"GB10", "BayerGB10"},    {"BA10", "BayerGR10"},     {"RG10", "BayerRG10"},
             {"pBAA", "BayerBG10csi"}, {"pGAA", "BayerGB10csi"},  {"pgAA", "BayerGR10csi"},
             {"pRAA", "BayerRG10csi"}, {"BG12", "BayerBG12"},     {"GB12", "BayerGB12"},
             {"BA12", "BayerGR12"},    {"RG12", "BayerRG12"},     {"pBCC", "BayerBG12csi"},
             {"pGCC", "BayerGB12csi"}, {"pgCC", "BayerGR12csi"},  {"pRCC", "BayerRG12csi"},
             {"BG14", "BayerBG14"},    {"GB14", "BayerGB14"},     {"GR14", "BayerGR14"},
             {"RG14", "BayerRG14"},    {"BYR2", "BayerBG16"},     {"GB16", "BayerGB16"},
             {"GR16", "BayerGR16"},    {"RG16", "BayerRG16"}};
    for (size_t i = 0; i < sizeof k / sizeof k[0]; i++)
        T_EQ_S(cap_pixfmt_name(v4l_pixfmt(code(k[i].code))), k[i].name);
    T_EQ_I(v4l_pixfmt(code("NV12")), CAP_FMT_NONE);
    T_EQ_I(v4l_pixfmt(V4L2_PIX_FMT_Y16_BE), CAP_FMT_NONE); /* not Y16 */
    T_EQ_I(v4l_pixfmt(0), CAP_FMT_NONE);
    T_EQ_S(v4l_fourcc_text(V4L2_PIX_FMT_Y10).s, "Y10");
    T_EQ_S(v4l_fourcc_text(V4L2_PIX_FMT_Y16_BE).s, "Y16-BE");
    T_EQ_S(v4l_fourcc_text(0x01020304).s, "");
}

T_CASE(colours)
{
    const enum cap_pixfmt YUV = CAP_YUYV, JPG = CAP_JPEG;
    /* what UVC cameras say: sRGB, the rest left to it */
    T_EQ_I(v4l_yuv(YUV, V4L2_COLORSPACE_SRGB, 0, 0, 0), 0);
    T_EQ_I(v4l_yuv(YUV, V4L2_COLORSPACE_DEFAULT, 0, 0, 0), 0);
    T_EQ_I(v4l_yuv(YUV, V4L2_COLORSPACE_JPEG, 0, 0, 0), CAP_YUV_FULL);
    T_EQ_I(v4l_yuv(YUV, V4L2_COLORSPACE_SMPTE170M, 0, 0, 0), CAP_YUV_TRANSFER_709);
    T_EQ_I(v4l_yuv(YUV, V4L2_COLORSPACE_REC709, 0, 0, 0), CAP_YUV_709 | CAP_YUV_TRANSFER_709);
    T_EQ_I(v4l_yuv(YUV, V4L2_COLORSPACE_REC709, V4L2_YCBCR_ENC_601, V4L2_QUANTIZATION_FULL_RANGE,
                   V4L2_XFER_FUNC_SRGB),
           CAP_YUV_FULL);
    T_EQ_I(v4l_yuv(YUV, V4L2_COLORSPACE_SRGB, V4L2_YCBCR_ENC_XV709, V4L2_QUANTIZATION_LIM_RANGE,
                   V4L2_XFER_FUNC_709),
           CAP_YUV_709 | CAP_YUV_TRANSFER_709);
    /* a JPEG's matrix and range are in its own header */
    T_EQ_I(v4l_yuv(JPG, V4L2_COLORSPACE_REC709, 0, 0, 0), CAP_YUV_TRANSFER_709);
    T_EQ_I(v4l_yuv(JPG, V4L2_COLORSPACE_JPEG, 0, 0, 0), 0);
    T_EQ_I(v4l_yuv(CAP_RGB8, V4L2_COLORSPACE_REC709, 0, 0, 0), 0);
    T_EQ_I(v4l_yuv(CAP_GREY8, V4L2_COLORSPACE_REC709, 0, 0, 0), 0);
}

T_CASE(text_that_does_not_fit_is_cut)
{
    char s[12];
    struct v4l_text t = {s, sizeof s, 0};
    s[0] = '\0';
    v4l_say(&t, "%s", "12345");
    v4l_say(&t, "%s", "67890");
    T_EQ_S(s, "1234567890");
    v4l_say(&t, "%s", "abc");
    T_EQ_S(s, "12345678...");
    v4l_say(&t, "%s", "more");
    T_EQ_S(s, "12345678...");
}
