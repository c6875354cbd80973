#include "capture/pixel/depth.h"

#include <stdio.h>

typedef uint16_t depth_word __attribute__((aligned(1), may_alias));

static unsigned depth_greatest(const depth_word *p, size_t n)
{
    uint16_t top = 0;
    for (size_t i = 0; i < n; i++)
        top = p[i] > top ? p[i] : top;
    return top;
}

static uint64_t depth_count(const depth_word *p, size_t n, unsigned v)
{
    uint32_t count = 0;
    for (size_t i = 0; i < n; i++)
        count += p[i] == v;
    return count;
}

void cap_depth_look(struct cap_depth *d, const struct cap_image *img, int32_t y0, int32_t y1,
                    int32_t step)
{
    size_t row = cap_pixfmt_row(img->fmt, img->width);
    if (cap_pixfmt_layout(img->fmt) != CAP_LAYOUT_16 || img->stride < 0 ||
        (size_t)img->stride < row ||
        (y1 > y0 && img->size < (size_t)img->stride * (size_t)(y1 - 1) + row))
        return;
    for (int32_t y = y0; y < y1; y += step) {
        const depth_word *p = (const void *)((const char *)img->data + y * img->stride);
        struct cap_depth one = {.top = depth_greatest(p, row / 2)};
        if (one.top >= d->top)
            one.n = depth_count(p, row / 2, one.top);
        cap_depth_join(d, &one);
    }
}

void cap_depth_join(struct cap_depth *d, const struct cap_depth *more)
{
    if (more->top > d->top)
        *d = *more;
    else if (more->top == d->top)
        d->n += more->n;
}

int cap_depth_bits(const struct cap_depth *d, uint64_t least)
{
    for (int bits = 10; bits < 16 && d->n >= least; bits++)
        if (d->top == (1u << bits) - 1)
            return bits;
    return 0;
}

const char *cap_depth_remedy(enum cap_pixfmt fmt, int bits, const char *option, char room[120])
{
    enum cap_pixfmt as = cap_pixfmt_of_depth(fmt, bits);
    if (as != CAP_FMT_NONE)
        snprintf(room, 120, "%s%s makes that full scale", option, cap_pixfmt_name(as));
    else
        snprintf(room, 120, "no format has %d bits: multiply the samples by 65535/%d", bits,
                 (1 << bits) - 1);
    return room;
}
