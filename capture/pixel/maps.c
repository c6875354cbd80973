#include "capture/pixel/maps.h"

#include <stdatomic.h>
#include <stdlib.h>

#include "base/mem.h"
#include "capture/pixel/pixfmt_priv.h"

/* Largest light of a sample below full scale, so that a mean of such samples stays below 1. */
#define LIGHT_BELOW (CAP_LIGHT_ONE - 16)

double cap_response(const double *response, int n, double s)
{
    double at = s * (n - 1);
    int i = at < n - 2 ? (int)at : n - 2;
    return response[i] + (response[i + 1] - response[i]) * (at - i);
}

static pvx_err make_table(struct cap_maps *m, const struct cap_photometry *c, int bits)
{
    uint32_t full = (1u << bits) - 1;
    m->table[bits] = pvx_calloc((size_t)full + 1, sizeof *m->table[bits]);
    if (m->table[bits] == NULL)
        return PVX_ENOMEM;
    for (uint32_t v = 0; v <= full; v++) {
        double light = cap_response(c->response, c->n_response, (double)v / full) * CAP_LIGHT_ONE;
        m->table[bits][v] = (uint32_t)lrint(v < full && light > LIGHT_BELOW ? LIGHT_BELOW : light);
    }
    return PVX_OK;
}

static pvx_err tables(struct cap_maps *m, const struct cap_photometry *c, struct pvx_diag *d)
{
    static const int bits[] = {8, 10, 12, 14, 16};
    if (c->response == NULL)
        return PVX_OK;
    bool good = c->n_response >= 2 && c->n_response <= CAP_RESPONSE_MAX && c->response[0] == 0 &&
                c->response[c->n_response - 1] == 1;
    for (int i = 1; i < c->n_response && good; i++)
        good = c->response[i] >= c->response[i - 1];
    if (!good)
        return pvx_fail(d, PVX_EINVAL, "the response does not rise from 0 to 1");
    for (size_t i = 0; i < sizeof bits / sizeof *bits; i++)
        PVX_TRY(make_table(m, c, bits[i]));
    return PVX_OK;
}

/* ---- masked pixels ---- */

static bool says_nothing(const struct cap_photometry *c, size_t pixel)
{
    bool bad = c->mask != NULL && c->mask[pixel] == 0;
    for (int k = 0; k < c->channels; k++) {
        size_t at = pixel * (size_t)c->channels + (size_t)k;
        bad |= c->dark != NULL && !isfinite(c->dark[at]);
        bad |= c->flat != NULL && !(c->flat[at] >= CAP_FLAT_LEAST && c->flat[at] < INFINITY);
    }
    return bad;
}

/* Whether none, some or all of the pixels that count in a bin are masked. */
enum masked { NONE, SOME, ALL };
static enum masked masked_of(const struct cap_maps *m, int32_t X, int32_t Y)
{
    int b = m->p.binning, more = m->cell != NULL; /* Bayer: neighbour pixels count too */
    bool any = false, all = true;
    for (int32_t y = Y * b - more; y < (Y + 1) * b + more; y++)
        for (int32_t x = X * b - more; x < (X + 1) * b + more; x++)
            if (x >= 0 && y >= 0 && x < m->width && y < m->height) {
                bool masked = cap_pix_masked(m, x, y);
                any |= masked;
                all &= masked;
            }
    return all ? ALL : any ? SOME : NONE;
}

static pvx_err maps_mask(struct cap_maps *m, const struct cap_photometry *c)
{
    size_t pixels = (size_t)m->width * (size_t)m->height;
    int32_t bw = m->width / m->p.binning, bh = m->height / m->p.binning;
    if (c->dark == NULL && c->flat == NULL && c->mask == NULL)
        return PVX_OK;
    m->mask = pvx_calloc(pixels / 8 + 1, 1);
    if (m->mask == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < pixels; i++)
        if (says_nothing(c, i)) {
            m->mask[i / 8] |= (uint8_t)(1u << i % 8);
            m->n_masked++;
        }
    if (m->n_masked == 0) {
        PVX_FREE(m->mask);
        return PVX_OK;
    }
    m->patch = pvx_calloc((size_t)bw * (size_t)bh, sizeof *m->patch);
    if (m->patch == NULL)
        return PVX_ENOMEM;
    for (int32_t Y = 0; Y < bh; Y++)
        for (int32_t X = 0; X < bw; X++) {
            enum masked how = masked_of(m, X, Y);
            if (how != NONE)
                m->patch[m->n_patches++] = (uint32_t)(Y * bw + X) | (how == ALL ? CAP_BLANK : 0);
        }
    return PVX_OK;
}

/* ---- maps of bins ---- */

/* The mean of a map in each bin, with the same samples and weights as for pictures.  Without a map: `none`. */
static void maps_bins_of(const struct cap_maps *m, const float *map, float none,
                         const struct cap_image *img, float *out)
{
    struct cap_pix j = {.img = *img,
                        .binning = m->p.binning,
                        .nch = m->p.nch,
                        .rays = m->p.mosaic == CAP_MOSAIC_RAYS && m->p.nch == 3,
                        .cell = m->cell,
                        .samples = m->samples,
                        .grey = m->samples == 1 && m->cell == NULL,
                        .maps = m,
                        .plane = map};
    size_t n = (size_t)(m->width / m->p.binning) * (size_t)(m->height / m->p.binning);
    j.img.width = m->width;
    j.img.height = m->height;
    if (map != NULL)
        cap_pix_ref(&j, 0, m->height / m->p.binning, out);
    else
        for (size_t i = 0; i < n * (m->p.nch == 3 ? 4 : 1); i++)
            out[i] = none;
}

/* Channel (0 to 2) of bin i of plane c. */
static size_t channel_of(const struct cap_maps *m, size_t i, size_t c)
{
    size_t w = (size_t)m->width;
    return m->p.nch == 1 || m->planes == 3 ? c : m->cell[i / w % 2 * 2 + i % w % 2];
}

/* Index of a bin's value in dark and flat [bins][cs]; SIZE_MAX: the bin has no finite value. */
static size_t maps_place(const struct cap_maps *m, size_t i, size_t c, const float *dark,
                         const float *flat)
{
    size_t at = m->p.nch == 3 ? i * 4 + channel_of(m, i, c) : i;
    return isfinite(dark[at]) && isfinite(flat[at]) ? at : SIZE_MAX;
}

static double as_float(uint32_t word)
{
    float f;
    memcpy(&f, &word, sizeof f);
    return (double)f;
}

/* The word whose least bits are `factor` and which, read as a float, is nearest to dark.  It is never subnormal,
 * because arithmetic with subnormal numbers may be slow. */
static uint32_t word_of(double dark, uint32_t factor)
{
    const uint32_t least = 0x00800000 | factor;
    float f = (float)fabs(dark);
    uint32_t word;
    memcpy(&word, &f, sizeof word);
    word = (word & ~CAP_MAP_FACTOR) | factor;
    if (word < least)
        return least;
    uint32_t other = as_float(word) > fabs(dark) && word > least ? word - CAP_MAP_FACTOR - 1
                                                                 : word + CAP_MAP_FACTOR + 1;
    if (fabs(as_float(other) - fabs(dark)) < fabs(as_float(word) - fabs(dark)))
        word = other;
    return dark < 0 ? word | 0x80000000 : word;
}

/* dark and flat [bins][cs] to words (a bin without a value: 0), and `saturated`, a value above all others. */
static void maps_words(struct cap_maps *m, const float *dark, const float *flat,
                       const float gain[3])
{
    size_t bins = (size_t)(m->width / m->p.binning) * (size_t)(m->height / m->p.binning);
    double most_dark = 0, most = 0, sum = 1;
    for (size_t c = 0; c < m->planes; c++)
        for (size_t i = 0; i < bins; i++) {
            size_t at = maps_place(m, i, c, dark, flat);
            if (at == SIZE_MAX)
                continue;
            most_dark = fmax(most_dark, fabs((double)dark[at]));
            most = fmax(most, (double)gain[channel_of(m, i, c)] / (double)flat[at]);
        }
    m->unit = most > 0 ? (float)(most / CAP_MAP_FACTOR) : 1;
    for (size_t c = 0; c < m->planes; c++)
        for (size_t i = 0; i < bins; i++) {
            size_t at = maps_place(m, i, c, dark, flat);
            if (at == SIZE_MAX)
                continue;
            double factor = (double)gain[channel_of(m, i, c)] / (double)flat[at];
            m->word[c * m->plane + i] =
                word_of((double)dark[at] * (double)m->unit,
                        (uint32_t)lrint(fmin(factor / (double)m->unit, CAP_MAP_FACTOR)));
        }
    for (int c = 0; c < 3 && m->has_matrix; c++)
        sum = fmax(sum, fabs((double)m->matrix[3 * c]) + fabs((double)m->matrix[3 * c + 1]) +
                            fabs((double)m->matrix[3 * c + 2]));
    m->saturated = (float)(2 * fmax(1, (1 + most_dark) * most * sum));
}

/* Words beyond the end that the widest vectors may read. */
#define SLACK 16

static pvx_err bin_maps(struct cap_maps *m, const struct cap_photometry *c,
                        const struct cap_image *img)
{
    size_t bins = (size_t)(m->width / m->p.binning) * (size_t)(m->height / m->p.binning);
    size_t cs = m->p.nch == 3 ? 4 : 1;
    float *dark = pvx_calloc(bins * cs, sizeof *dark), *flat = pvx_calloc(bins * cs, sizeof *flat);
    m->plane = bins + SLACK;
    m->word = pvx_calloc(m->plane * m->planes, sizeof *m->word);
    pvx_err e = dark != NULL && flat != NULL && m->word != NULL ? PVX_OK : PVX_ENOMEM;
    if (e == PVX_OK) {
        maps_bins_of(m, c->dark, 0, img, dark);
        maps_bins_of(m, c->flat, 1, img, flat);
        maps_words(m, dark, flat, c->gain);
    }
    free(dark);
    free(flat);
    return e;
}

/* ---- all of it ---- */

static pvx_err maps_check(const struct cap_maps *m, const struct cap_photometry *c,
                          const struct cap_image *img, struct pvx_diag *d)
{
    bool maps = c->dark != NULL || c->flat != NULL;
    if (c->width != img->width || c->height != img->height)
        return pvx_fail(d, PVX_EINVAL, "maps of %dx%d pixels, but the image has %dx%d", c->width,
                        c->height, img->width, img->height);
    if (m->p.binning < 1 || img->width % m->p.binning != 0 || img->height % m->p.binning != 0 ||
        (m->cell != NULL && (img->width < 2 || img->height < 2)))
        return pvx_fail(d, PVX_EINVAL, "%d x %d pixels do not make bins of %d", img->width,
                        img->height, m->p.binning);
    if (maps && c->channels != m->samples)
        return pvx_fail(d, PVX_EINVAL, "maps of %d channels, but a %s pixel has %d", c->channels,
                        cap_pixfmt_name(img->fmt), m->samples);
    if (c->matrix != NULL &&
        (m->p.nch != 3 || cap_pixfmt_channels(img->fmt) != 3 || m->planes == 1))
        return pvx_fail(d, PVX_EINVAL, "a colour matrix needs three channels in each bin, which %s",
                        m->p.nch != 3                        ? "one channel is not"
                        : cap_pixfmt_channels(img->fmt) != 3 ? "a grey camera does not have"
                                                             : "Bayer pixels as rays do not have");
    for (int k = 0; k < 3; k++)
        if (!(c->gain[k] > 0 && c->gain[k] <= 1e6f))
            return pvx_fail(d, PVX_EINVAL, "a gain of %g", (double)c->gain[k]);
    return PVX_OK;
}

pvx_err cap_maps_new(const struct cap_photometry *c, const struct cap_image *img,
                     const struct cap_convert_params *p, struct cap_maps **out, struct pvx_diag *d)
{
    static atomic_uint_fast64_t made;
    struct cap_maps *m = *out = pvx_calloc(1, sizeof *m);
    PVX_NEED(m);
    m->number = 1 + atomic_fetch_add(&made, 1);
    m->width = img->width;
    m->height = img->height;
    m->p = *p;
    m->p.maps = NULL;
    m->cell = cap_pixfmt_bayer(img->fmt);
    m->samples = cap_pixfmt_channels(img->fmt) == 1 || m->cell != NULL ? 1 : 3;
    bool rays = m->cell != NULL && p->mosaic == CAP_MOSAIC_RAYS && p->binning == 1;
    m->planes = p->nch == 3 && !rays ? 3 : 1;
    m->has_matrix = c->matrix != NULL;
    for (int k = 0; k < 9 && m->has_matrix; k++)
        m->matrix[k] = (float)c->matrix[k];
    pvx_err e = maps_check(m, c, img, d);
    PVX_THEN(e, tables(m, c, d));
    PVX_THEN(e, maps_mask(m, c));
    PVX_THEN(e, bin_maps(m, c, img));
    if (e != PVX_OK)
        cap_maps_free(out);
    return e;
}

void cap_maps_free(struct cap_maps **mp)
{
    struct cap_maps *m = *mp;
    if (m == NULL)
        return;
    for (size_t i = 0; i < sizeof m->table / sizeof *m->table; i++)
        free(m->table[i]);
    free(m->word);
    free(m->mask);
    free(m->patch);
    PVX_FREE(*mp);
}

bool cap_maps_fit(const struct cap_maps *m, const struct cap_image *img)
{
    const uint8_t *cell = cap_pixfmt_bayer(img->fmt);
    int samples = cap_pixfmt_channels(img->fmt) == 1 || cell != NULL ? 1 : 3;
    return m->width == img->width && m->height == img->height && m->cell == cell &&
           m->samples == samples;
}

float cap_maps_saturated(const struct cap_maps *m)
{
    return m->saturated;
}

size_t cap_maps_masked(const struct cap_maps *m)
{
    return m->n_masked;
}
