/* fuzz_jpeg.c - JPEG bytes: a picture is decoded to exactly the expected size and can be converted, or
 * refused.  The decoder is kept from input to input, as in the daemon. */

#include "capture/pixel/jpeg.h"
#include "capture/pixel/pixfmt.h"
#include "tests/fuzz/fuzz.h"

enum { W = 32, H = 16 };

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static cap_jpeg *j;
    static float out[W * H * 4];
    MUST(j != NULL || cap_jpeg_new(W, H, &j) == PVX_OK);
    struct cap_image in = {data, size, W, H, 0, CAP_JPEG, 0}, img;
    if (cap_jpeg_decode(j, &in, &img, NULL) != PVX_OK)
        return 0;
    fuzz_taken++;
    MUST(img.width == W && img.height == H && cap_bin(&img, 1, 3, 0, H, out) == PVX_OK);
    for (size_t i = 0; i < W * H * 4; i++)
        if (!(out[i] >= 0 && out[i] <= 1))
            abort();
    return 0;
}
