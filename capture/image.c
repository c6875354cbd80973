#include "capture/image.h"

#include <string.h>

static const struct {
    const char *name;
    size_t bytes;
    int channels;
} formats[CAP_N_FMT] = {
    [CAP_FMT_NONE] = {"none", 0, 0},      [CAP_GREY8] = {"Mono8", 1, 1},
    [CAP_GREY16] = {"Mono16", 2, 1},      [CAP_RGB8] = {"RGB8", 3, 3},
    [CAP_RGB16] = {"RGB16", 6, 3},        [CAP_BAYER_RG8] = {"BayerRG8", 1, 3},
    [CAP_BAYER_GR8] = {"BayerGR8", 1, 3}, [CAP_BAYER_GB8] = {"BayerGB8", 1, 3},
    [CAP_BAYER_BG8] = {"BayerBG8", 1, 3}, [CAP_GREY_F32] = {"Mono32f", 4, 1},
    [CAP_RGB_F32] = {"RGB32f", 12, 3},
};

static enum cap_pixfmt known(enum cap_pixfmt f)
{
    return (unsigned)f < CAP_N_FMT ? f : CAP_FMT_NONE;
}

const char *cap_pixfmt_name(enum cap_pixfmt f)
{
    return formats[known(f)].name;
}

enum cap_pixfmt cap_pixfmt_parse(const char *name)
{
    for (enum cap_pixfmt f = CAP_GREY8; f < CAP_N_FMT; f++)
        if (strcmp(formats[f].name, name) == 0)
            return f;
    return CAP_FMT_NONE;
}

size_t cap_pixfmt_bytes(enum cap_pixfmt f)
{
    return formats[known(f)].bytes;
}

int cap_pixfmt_channels(enum cap_pixfmt f)
{
    return formats[known(f)].channels;
}
