/* test_libcamera_modes.c - libcamera's formats in our names; the mode and the camera that a configuration
 * means.  No libcamera is needed here; the real one runs in tests/vm. */
#include "capture/libcamera/modes.h"
#include "tests/t.h"

static struct cap_lc_format code(const char *fourcc, uint64_t modifier)
{
    return (struct cap_lc_format){(uint32_t)fourcc[0] | (uint32_t)fourcc[1] << 8 |
                                      (uint32_t)fourcc[2] << 16 | (uint32_t)fourcc[3] << 24,
                                  modifier};
}

#define CSI ((uint64_t)11 << 56 | 1)

T_CASE(formats)
{
    static const struct {
        const char *fourcc;
        uint64_t modifier;
        const char *name;
    } want[] = {
        {"R8  ", 0, "Mono8"},          {"R10 ", 0, "Mono10"},        {"R16 ", 0, "Mono16"},
        {"YUYV", 0, "YUV422_8"},       {"UYVY", 0, "YUV422_8_UYVY"}, {"MJPG", 0, "JPEG"},
        {"BG24", 0, "RGB8"},           {"RG24", 0, "BGR8"},          {"RGGB", 0, "BayerRG8"},
        {"BA81", 0, "BayerBG8"},       {"BA10", 0, "BayerGR10"},     {"BG12", 0, "BayerBG12"},
        {"BYR2", 0, "BayerBG16"},      {"R10 ", CSI, "Mono10csi"},   {"RG10", CSI, "BayerRG10csi"},
        {"BA12", CSI, "BayerGR12csi"}, {"GB14", 0, "BayerGB14"},
    };
    for (size_t i = 0; i < sizeof want / sizeof want[0]; i++)
        T_EQ_S(cap_pixfmt_name(lc_pixfmt(code(want[i].fourcc, want[i].modifier))), want[i].name);
    T_EQ_I(lc_pixfmt(code("NV12", 0)), CAP_FMT_NONE);
    T_EQ_I(lc_pixfmt(code("RG10", (uint64_t)1 << 56 | 13)), CAP_FMT_NONE); /* IPU3's own packing */
}

T_CASE(yuv)
{
    T_EQ_I(lc_yuv(&(struct cap_lc_layout){0}), CAP_YUV_601);
    T_EQ_I(lc_yuv(&(struct cap_lc_layout){.rec709 = 1, .full_range = CAP_LC_RANGE_LIMITED}),
           CAP_YUV_709);
    T_EQ_I(lc_yuv(&(struct cap_lc_layout){.full_range = CAP_LC_RANGE_FULL}),
           CAP_YUV_601 | CAP_YUV_FULL);
    T_EQ_I(lc_yuv(&(struct cap_lc_layout){.rec709 = 1, .transfer_rec709 = 1}),
           CAP_YUV_709 | CAP_YUV_TRANSFER_709);
    struct cap_lc_layout jpeg = {.mode.format = code("MJPG", 0), .rec709 = 1, .transfer_rec709 = 1};
    T_EQ_I(lc_yuv(&jpeg), CAP_YUV_TRANSFER_709);
}

T_CASE(modes)
{
    const struct cap_lc_mode m[] = {
        {code("NV12", 0), 1920, 1080}, {code("MJPG", 0), 640, 480}, {code("YUYV", 0), 320, 240},
        {code("YUYV", 0), 640, 480},   {code("R8  ", 0), 640, 480},
    };
    struct cap_source_config c = {.uri = "x", .name = "left"};
    struct pvx_diag d = {""};
    int32_t w = 0, h = 0;
    T_EQ_I(lc_choose(&c, m, 5, &w, &h, &d), 1); /* the first that can be used */
    T_EQ_I(w, 640);
    c.fmt = CAP_YUYV;
    T_EQ_I(lc_choose(&c, m, 5, &w, &h, &d), 2);
    T_EQ_I(w, 320);
    c.width = 640;
    c.height = 480;
    T_EQ_I(lc_choose(&c, m, 5, &w, &h, &d), 3);
    c.width = 800;
    c.height = 600; /* not listed: its format, and the camera is asked */
    T_EQ_I(lc_choose(&c, m, 5, &w, &h, &d), 2);
    T_EQ_I(w, 800);
    T_EQ_I(h, 600);
    T_EQ_S(d.text, "");
    c.fmt = CAP_BAYER_RG10;
    T_EQ_I(lc_choose(&c, m, 5, &w, &h, &d), -1);
    T_CONTAINS(d.text, "camera left (libcamera:x): does not offer BayerRG10");
    T_CONTAINS(d.text, "JPEG YUV422_8 Mono8");
    d.text[0] = '\0';
    T_EQ_I(lc_choose(&c, m, 0, &w, &h, &d), -1);
    T_CONTAINS(d.text, "nothing");
}

T_CASE(names)
{
    const char *const id[] = {"\\_SB_.PCI0-1:1.0-046d:0825", "\\_SB_.PCI0-11:1.0-046d:0825",
                              "/base/i2c@1/imx219@10", "front"};
    struct cap_source_config c = {.uri = "u", .name = "cam3"};
    struct pvx_diag d = {""};
    size_t i = 99;
    T_EQ_I(lc_match("front", id, 4, &i, &c, &d), PVX_OK);
    T_EQ_I(i, 3);
    T_EQ_I(lc_match("imx219", id, 4, &i, &c, &d), PVX_OK);
    T_EQ_I(i, 2);
    T_EQ_I(lc_match("-1:1.0", id, 4, &i, &c, &d), PVX_OK);
    T_EQ_I(i, 0);
    T_EQ_S(d.text, "");
    T_EQ_I(lc_match("046d", id, 4, &i, &c, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "could be any of");
    T_CONTAINS(d.text, id[1]);
    d.text[0] = '\0';
    T_EQ_I(lc_match("back", id, 4, &i, &c, &d), PVX_ENOENT);
    T_CONTAINS(d.text, "imx219");
    d.text[0] = '\0';
    T_EQ_I(lc_match("", id, 4, &i, &c, &d), PVX_ENOENT);
    d.text[0] = '\0';
    T_EQ_I(lc_match("back", NULL, 0, &i, &c, &d), PVX_ENOENT);
    T_CONTAINS(d.text, "none at all");

    /* every short name means its own camera, and YAML has no escape in it */
    const char *const twins[] = {"\\A\\x", "\\B\\x"};
    for (size_t k = 0; k < 4; k++) {
        T_OK(strchr(lc_short_name(id, 4, k), '\\') == NULL);
        T_EQ_I(lc_match(lc_short_name(id, 4, k), id, 4, &i, &c, NULL), PVX_OK);
        T_EQ_I(i, k);
    }
    for (size_t k = 0; k < 2; k++)
        T_EQ_S(lc_short_name(twins, 2, k), twins[k]);
}
