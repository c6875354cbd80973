#include "capture/gevsim/optics.h"

#include <math.h>
#include <string.h>

#include "base/random.h"

#define FLOODED 1000.0f /* full scales: saturated in every corner, at any gain that a sensor has */

const struct cap_optics cap_optics_none = {.gain = 1, .exposure = 1, .response = 1};

/* ---- where the light falls -------------------------------------------------------------------- */

/* out(x) = sum_k v[k] in(x + first + k) */
struct taps {
    int32_t first, n;
    float v[8 * CAP_OPTICS_BLUR_MAX + 1];
};

static void optics_add(float *restrict out, const float *restrict in, size_t n, float t)
{
    for (size_t i = 0; i < n; i++)
        out[i] += t * in[i];
}

/* Filter along rows, or (down) along columns.  The picture is dark outside. */
static void filter(const struct cap_optics_shape *s, const struct taps *t, bool down,
                   const float *in, float *out)
{
    size_t nch = (size_t)s->nch, row = (size_t)s->width * nch;
    memset(out, 0, (size_t)s->height * row * sizeof *out);
    for (int32_t y = 0; y < s->height; y++)
        for (int32_t k = 0; k < t->n; k++) {
            int32_t d = t->first + k, from = down ? y + d : y;
            int32_t x0 = down || d > 0 ? 0 : -d, x1 = down || d < 0 ? s->width : s->width - d;
            if (t->v[k] != 0 && from >= 0 && from < s->height && x0 < x1)
                optics_add(out + (size_t)y * row + (size_t)x0 * nch,
                           in + (size_t)from * row + (size_t)(down ? x0 : x0 + d) * nch,
                           (size_t)(x1 - x0) * nch, t->v[k]);
        }
}

/* F(x - by) lies between the pixels x - i - 1 and x - i, i = floor(by). */
static void shift_taps(double by, struct taps *t)
{
    double i = floor(by), u = 1 - (by - i), u2 = u * u, u3 = u2 * u;
    *t = (struct taps){.first = -(int32_t)i - 2, .n = 4};
    t->v[0] = (float)(-0.5 * u + u2 - 0.5 * u3);
    t->v[1] = (float)(1 - 2.5 * u2 + 1.5 * u3);
    t->v[2] = (float)(0.5 * u + 2 * u2 - 1.5 * u3);
    t->v[3] = (float)(-0.5 * u2 + 0.5 * u3);
}

static void blur_taps(double sigma, struct taps *t)
{
    int32_t r = (int32_t)ceil(4 * fmin(sigma, CAP_OPTICS_BLUR_MAX));
    double sum = 0;
    *t = (struct taps){.first = -r, .n = 2 * r + 1};
    for (int32_t k = -r; k <= r; k++)
        sum += exp(-0.5 * k * k / (sigma * sigma));
    for (int32_t k = -r; k <= r; k++)
        t->v[k + r] = (float)(exp(-0.5 * k * k / (sigma * sigma)) / sum);
}

static void mirror(const struct cap_optics_shape *s, float *image)
{
    size_t nch = (size_t)s->nch, w = (size_t)s->width;
    for (size_t y = 0; y < (size_t)s->height; y++)
        for (size_t x = 0; x < w / 2; x++)
            for (size_t ch = 0; ch < nch; ch++) {
                float *a = image + (y * w + x) * nch + ch;
                float *b = image + (y * w + w - 1 - x) * nch + ch, was = *a;
                *a = *b;
                *b = was;
            }
}

static void displace(const struct cap_optics *o, const struct cap_optics_shape *s, float *image,
                     float *scratch)
{
    struct taps t;
    if (o->shift[0] != 0 || o->shift[1] != 0) {
        shift_taps(fmax(-CAP_OPTICS_SHIFT_MAX, fmin(CAP_OPTICS_SHIFT_MAX, o->shift[0])), &t);
        filter(s, &t, false, image, scratch);
        shift_taps(fmax(-CAP_OPTICS_SHIFT_MAX, fmin(CAP_OPTICS_SHIFT_MAX, o->shift[1])), &t);
        filter(s, &t, true, scratch, image);
    }
    if (o->blur > 0) {
        blur_taps(o->blur, &t);
        filter(s, &t, false, image, scratch);
        filter(s, &t, true, scratch, image);
    }
    if (o->mirrored)
        mirror(s, image);
}

/* ---- exposure and sensor ---------------------------------------------------------------------- */

/* -1..1 from edge to edge */
static double optics_across(double x, int32_t n)
{
    return (2 * x + 1 - n) / n;
}

/* Light that does not come from the flame. */
struct source {
    double level, du, dv;      /* level + du u + dv v */
    double wave, p, q, dx, dy; /* background */
};

static struct source source_of(const struct cap_optics *o, const struct cap_optics_shape *s)
{
    struct source r = {0};
    if (o->cap)
        return r;
    if (o->flood) {
        r.level = FLOODED;
    } else if (o->flat >= 1) {
        double n = floor(o->flat) - 1, a = M_PI / 2 * n + M_PI / 4 * floor(n / 4);
        r.level = 0.5;
        r.du = 0.05 * cos(a);
        r.dv = 0.05 * sin(a);
    } else if (o->background > 0) {
        uint64_t mixed = pvx_mix(s->seed + 1);
        r.level = 0.6 * o->background;
        r.wave = 0.4 * o->background;
        r.p = (double)(mixed & 0xffff) * 1e-4;
        r.q = (double)(mixed >> 16 & 0xffff) * 1e-4;
        r.dx = o->shift[0];
        r.dy = o->shift[1];
    }
    return r;
}

static float optics_light(const struct source *r, const struct cap_optics_shape *s, int32_t x,
                          int32_t y)
{
    double p = r->level;
    if (r->du != 0 || r->dv != 0)
        p += r->du * optics_across(x, s->width) + r->dv * optics_across(y, s->height);
    if (r->wave != 0)
        p += r->wave * sin(7 * optics_across(x - r->dx, s->width) + r->p) *
             cos(5 * optics_across(y - r->dy, s->height) + r->q);
    return (float)p;
}

static float hot(const struct cap_optics *o, const struct cap_optics_shape *s, size_t pixel)
{
    uint64_t z = pvx_mix((s->seed << 32) + pixel);
    if ((double)(z >> 11) * 0x1p-53 >= o->hot)
        return 0;
    return 0.2f + 0.8f * (float)(pvx_mix(z) >> 40) * 0x1p-24f;
}

static void expose_row(const struct cap_optics *o, const struct cap_optics_shape *s,
                       const struct source *src, int32_t y, float *row)
{
    double w = s->width, h = s->height, corner2 = w * w + h * h;
    double t = 1 / sqrt(1 - fmin(o->vignetting, 0.99)) - 1, dy = 2 * y + 1 - h;
    float all = (float)(o->exposure * o->gain), black = (float)o->pedestal;
    bool curved = o->response != 1;
    for (int32_t x = 0; x < s->width; x++) {
        double dx = 2 * x + 1 - w, fall = 1 + t * (dx * dx + dy * dy) / corner2;
        float scale = all * (float)(1 / (fall * fall)), more = optics_light(src, s, x, y);
        float base = black;
        if (o->hot > 0)
            base += hot(o, s, (size_t)y * (size_t)s->width + (size_t)x);
        for (int ch = 0; ch < s->nch; ch++) {
            float *v = row + (size_t)x * (size_t)s->nch + ch;
            float p = scale * (*v + more);
            p = p > 0 ? p : 0; /* the cubic may go below 0 */
            p = p < FLOODED ? p : FLOODED;
            *v = base + (curved ? powf(p, (float)o->response) : p);
        }
    }
}

void cap_optics_apply(const struct cap_optics *o, const struct cap_optics_shape *s, float *image,
                      float *scratch)
{
    size_t row = (size_t)s->width * (size_t)s->nch;
    if (o->cap || o->flood || o->flat >= 1 || o->empty)
        memset(image, 0, (size_t)s->height * row * sizeof *image);
    else
        displace(o, s, image, scratch);
    struct source src = source_of(o, s);
    for (int32_t y = 0; y < s->height; y++)
        expose_row(o, s, &src, y, image + (size_t)y * row);
}
