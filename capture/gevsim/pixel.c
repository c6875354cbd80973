/* pixel.c - the ring's images in the format and region that the client has set. */
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/gevsim/gevsim.h"
#include "capture/pixel/pixfmt_pack.h"

static bool is_bayer(enum cap_pixfmt f)
{
    return cap_pixfmt_bayer(f) != NULL;
}

static bool is_packed(enum cap_pixfmt f)
{
    enum cap_layout l = cap_pixfmt_layout(f);
    return l == CAP_LAYOUT_P || l == CAP_LAYOUT_PACKED;
}

/* Whether f can be made from the ring's format: grey -> grey; a Bayer pattern -> the same; RGB -> all. */
bool gvcam_offers(const struct cap_gvcam *c, enum cap_pixfmt f)
{
    enum cap_layout l = cap_pixfmt_layout(f);
    enum cap_pixfmt from = c->c.fmt;
    if (cap_pixfmt_pfnc(f) == 0 || (l != CAP_LAYOUT_8 && l != CAP_LAYOUT_16 && !is_packed(f)))
        return false;
    if (is_packed(f) && c->c.width % 4 != 0)
        return false;
    if (is_bayer(from))
        return is_bayer(f) && memcmp(cap_pixfmt_bayer(f), cap_pixfmt_bayer(from), 4) == 0;
    bool grey = cap_pixfmt_channels(f) == 1;
    return grey || cap_pixfmt_channels(from) == 3;
}

size_t gvcam_formats(const struct cap_gvcam *c, enum cap_pixfmt *out, size_t max)
{
    size_t n = 0;
    for (int f = 1; f < CAP_N_FMT && n < max; f++)
        if (gvcam_offers(c, (enum cap_pixfmt)f))
            out[n++] = (enum cap_pixfmt)f;
    return n;
}

/* Sample of the ring's image as 16 bits; ch only for RGB. */
static uint16_t ring_sample(const struct cap_gvcam *c, const uint8_t *image, uint32_t x, uint32_t y,
                            unsigned ch)
{
    bool rgb = cap_pixfmt_channels(c->c.fmt) == 3 && !is_bayer(c->c.fmt);
    size_t at = (size_t)y * (size_t)c->c.width + x;
    at = rgb ? 3 * at + ch : at;
    if (cap_pixfmt_depth(c->c.fmt) == 8)
        return (uint16_t)(image[at] * 257);
    uint16_t v;
    memcpy(&v, image + 2 * at, 2);
    return v;
}

/* One row of the region as samples of the format's depth. */
static void row_samples(const struct cap_gvcam *c, const uint8_t *image, uint32_t y, uint16_t *out)
{
    uint32_t w = c->image.region[0], x0 = c->image.region[2], sy = y + c->image.region[3];
    bool from_rgb = cap_pixfmt_channels(c->c.fmt) == 3 && !is_bayer(c->c.fmt);
    const uint8_t *cell = cap_pixfmt_bayer(c->image.fmt);
    bool to_rgb = cap_pixfmt_channels(c->image.fmt) == 3 && cell == NULL;
    for (uint32_t x = 0; x < w; x++) {
        uint32_t sx = x + x0;
        if (!from_rgb)
            out[x] = ring_sample(c, image, sx, sy, 0);
        else if (to_rgb)
            for (unsigned ch = 0; ch < 3; ch++)
                out[3 * x + ch] = ring_sample(c, image, sx, sy, ch);
        else if (cell != NULL)
            out[x] = ring_sample(c, image, sx, sy, cell[(y & 1) * 2 + (x & 1)]);
        else
            out[x] =
                (uint16_t)((ring_sample(c, image, sx, sy, 0) + ring_sample(c, image, sx, sy, 1) +
                            ring_sample(c, image, sx, sy, 2)) /
                           3);
    }
    const int down = 16 - cap_pixfmt_depth(c->image.fmt);
    for (size_t k = 0; k < (to_rgb ? 3 : 1) * (size_t)w; k++)
        out[k] = (uint16_t)(out[k] >> down);
}

static uint8_t *pixel_convert(const struct cap_gvcam *c, const uint8_t *image)
{
    size_t row = cap_pixfmt_row(c->image.fmt, (int32_t)c->image.region[0]);
    uint16_t *samples = pvx_calloc(3 * (size_t)c->image.region[0], sizeof *samples);
    uint8_t *out = pvx_calloc(c->image.region[1], row);
    for (uint32_t y = 0; samples != NULL && out != NULL && y < c->image.region[1]; y++) {
        row_samples(c, image, y, samples);
        cap_pixfmt_pack_row(c->image.fmt, (int32_t)c->image.region[0], samples, out + y * row);
    }
    if (samples == NULL)
        PVX_FREE(out);
    free(samples);
    return out;
}

size_t gvcam_image_number(const struct cap_gvcam *c, int64_t index)
{
    int64_t n = (int64_t)c->c.n_ring;
    return (size_t)((index % n + n) % n);
}

const uint8_t *gvcam_image_of(struct cap_gvcam *c, int64_t index)
{
    size_t k = gvcam_image_number(c, index);
    if (c->image.fmt == c->c.fmt && c->image.region[0] == (uint32_t)c->c.width &&
        c->image.region[1] == (uint32_t)c->c.height)
        return c->ring[k];
    if (c->image.conv[k] == NULL)
        c->image.conv[k] = pixel_convert(c, c->ring[k]);
    return c->image.conv[k];
}

void gvcam_image_start(struct cap_gvcam *c)
{
    struct gvcam_image *m = &c->image;
    gvcam_image_drop(c);
    m->fmt = cap_pixfmt_from_pfnc(c->reg.v[GVF_PIXEL_FORMAT]);
    m->region[0] = c->reg.v[GVF_WIDTH];
    m->region[1] = c->reg.v[GVF_HEIGHT];
    m->region[2] = c->reg.v[GVF_OFFSET_X];
    m->region[3] = c->reg.v[GVF_OFFSET_Y];
    m->frame_bytes = cap_pixfmt_row(m->fmt, (int32_t)m->region[0]) * m->region[1];
}

void gvcam_image_drop(struct cap_gvcam *c)
{
    for (size_t k = 0; k < c->c.n_ring; k++)
        PVX_FREE(c->image.conv[k]);
}
