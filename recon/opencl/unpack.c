#include <string.h>

#include "recon/opencl/photo_impl.h"

/* ---- tables and maps ---- */

/* A camera's tables and maps in words, from `at` on: the table, the words of the planes, the mask. */
struct unpack_place {
    size_t table, word, mask, end;
    size_t plane, bits; /* words of a plane; bytes of the mask */
};
static struct unpack_place unpack_place(const struct rec_cl_raw *r, size_t at)
{
    const struct rec_cl_maps *m = &r->maps;
    const size_t pixels = (size_t)r->width * (size_t)r->height, side = (size_t)r->binning;
    struct unpack_place o = {
        .table = at, .plane = pixels / (side * side), .bits = (pixels + 7) / 8};
    o.word = o.table + (m->table != NULL ? (size_t)1 << r->depth : 0);
    o.mask = o.word + (m->word != NULL ? m->planes * o.plane : 0);
    o.end = o.mask + (m->mask != NULL ? (pixels + 31) / 32 : 0);
    return o;
}

static void unpack_send_maps(rec_cl_photo *p, rec_cl_queue *q, size_t c, const struct rec_cl_raw *r)
{
    const struct rec_cl_maps *m = &r->maps;
    const struct unpack_place at = unpack_place(r, p->maps0[c]);
    const size_t word = sizeof *m->word;
    if (p->has[c].number == m->number && p->has[c].table == m->table)
        return;
    if (m->table != NULL)
        rec_cl_upload(q, &p->maps, at.table * word, m->table, word << r->depth);
    for (size_t k = 0; k < m->planes && m->word != NULL; k++)
        rec_cl_upload(q, &p->maps, (at.word + k * at.plane) * word, m->word + k * m->plane,
                      at.plane * word);
    if (m->mask != NULL)
        rec_cl_upload(q, &p->maps, at.mask * word, m->mask, at.bits);
    p->has[c] = *m;
}

static void unpack_put_maps(const struct rec_cl_raw *r, size_t at, struct rec_cl_raw_picture *o)
{
    const struct rec_cl_maps *m = &r->maps;
    const struct unpack_place place = unpack_place(r, at);
    o->table = m->table != NULL ? (uint32_t)place.table : REC_CL_NO_MAP;
    o->word = m->word != NULL ? (uint32_t)place.word : REC_CL_NO_MAP;
    o->mask = m->mask != NULL ? (uint32_t)place.mask : REC_CL_NO_MAP;
    o->planes = m->word != NULL ? (int)m->planes : 0;
    o->unit = m->unit;
    o->coloured = m->matrix != NULL;
    if (m->matrix != NULL)
        memcpy(o->matrix, m->matrix, sizeof o->matrix);
}

/* ---- pictures ---- */

static struct rec_cl_raw_picture unpack_picture(const struct rec_cl_raw *r, size_t at, size_t maps)
{
    struct rec_cl_raw_picture o = {.at = (uint32_t)at,
                                   .stride = (uint32_t)r->stride,
                                   .layout = (int)r->layout,
                                   .depth = r->depth,
                                   .width = r->width,
                                   .height = r->height,
                                   .binning = r->binning,
                                   .samples = r->samples,
                                   .grey = r->grey,
                                   .swapped = r->swapped,
                                   .rays = r->rays,
                                   .bayer = r->cell != NULL,
                                   .clip = r->clip,
                                   .full = r->full,
                                   .most = r->most,
                                   .y = r->yuv.y};
    for (int k = 0; k < 4 && r->cell != NULL; k++)
        o.cell[k] = r->cell[k];
    memcpy(o.cb, r->yuv.cb, sizeof o.cb);
    memcpy(o.cr, r->yuv.cr, sizeof o.cr);
    memcpy(o.at0, r->yuv.at, sizeof o.at0);
    unpack_put_maps(r, maps, &o);
    return o;
}

/* Whether there is room for all. */
static bool unpack_fits(const rec_cl_photo *p, const struct rec_cl_raw *raw)
{
    size_t all = 0;
    for (size_t c = 0; c < p->cameras; c++) {
        if (raw[c].layout == REC_CL_LAYOUT_NONE)
            continue;
        all += raw[c].bytes;
        if (unpack_place(&raw[c], p->maps0[c]).end > p->maps0[c + 1])
            return false;
    }
    return all <= p->bytes.bytes && all <= UINT32_MAX;
}

bool rec_cl_photo_unpack(rec_cl_photo *p, rec_cl_queue *q, const struct rec_cl_raw *raw,
                         const struct rec_cl_pictures *to)
{
    const struct rec_cl_buffer *maps = p->maps.bytes > 0 ? &p->maps : &p->at; /* not read then */
    size_t at = 0;
    if (!unpack_fits(p, raw))
        return false;
    for (size_t c = 0; c < p->cameras; c++) {
        p->raws[c] = (struct rec_cl_raw_picture){0};
        if (raw[c].layout == REC_CL_LAYOUT_NONE)
            continue;
        unpack_send_maps(p, q, c, &raw[c]);
        p->raws[c] = unpack_picture(&raw[c], at, p->maps0[c]);
        rec_cl_upload(q, &p->bytes, at, raw[c].data, raw[c].bytes);
        at += raw[c].bytes;
    }
    if (at == 0)
        return true;
    rec_cl_upload(q, &p->raw_picture, 0, p->raws, p->cameras * sizeof *p->raws);
    REC_CL_RUN(q, REC_CL_K_UNPACK, (int)p->cs, p->bands, REC_CL_FLAT, REC_CL_BUFFER(&p->shot),
               REC_CL_BUFFER(&p->raw_picture), REC_CL_BUFFER(&p->at), REC_CL_BUFFER(&p->bytes),
               REC_CL_BUFFER(maps), REC_CL_BUFFER(&to->b));
    return true;
}
