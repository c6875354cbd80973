/* PLY: a header of text lines that describes the elements and their properties, then the elements as text or binary.
 * G. Turk, The PLY Polygon File Format, 1994.  The second type names come from later programs. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/geom/body.h"
#include "recon/geom/mesh_file.h"

#define ELEMENTS_MAX   32
#define PROPERTIES_MAX 512 /* of all elements */
#define VERTICES_MAX   (3 * REC_MESH_MAX)

enum type { I8, U8, I16, U16, I32, U32, F32, F64, N_TYPES };
static const struct {
    const char *name, *also;
    size_t bytes;
} types[N_TYPES] = {{"char", "int8", 1},     {"uchar", "uint8", 1},   {"short", "int16", 2},
                    {"ushort", "uint16", 2}, {"int", "int32", 4},     {"uint", "uint32", 4},
                    {"float", "float32", 4}, {"double", "float64", 8}};

struct property {
    enum type type, count; /* count: type of a list's length; N_TYPES: no list */
    enum { OTHER, X, Y, Z, CORNERS } is;
};

struct element {
    size_t n, first, properties;
    enum { SKIPPED, VERTEX, FACE } is;
};

struct ply {
    struct rec_mesh_file *f;
    enum { NO_FORMAT, TEXT, LITTLE, BIG } format;
    size_t elements, properties;
    struct element element[ELEMENTS_MAX];
    struct property property[PROPERTIES_MAX];
    double *vertex; /* [vertices][3], in the file's unit */
    size_t vertices;
};

struct fan { /* triangles from corners in file order: 0 1 2, 0 2 3 */
    size_t n, first_triangle;
    const double *first, *last;
};

/* ---- head --------------------------------------------------------------------------------------- */

static bool read_type(struct rec_word w, enum type *out)
{
    for (int t = 0; t < N_TYPES; t++)
        if (rec_word_is(w, types[t].name) || rec_word_is(w, types[t].also)) {
            *out = (enum type)t;
            return true;
        }
    return false;
}

static pvx_err read_format(struct ply *p)
{
    struct rec_word w = rec_mesh_word(p->f);
    p->format = rec_word_is(w, "ascii")                  ? TEXT
                : rec_word_is(w, "binary_little_endian") ? LITTLE
                : rec_word_is(w, "binary_big_endian")    ? BIG
                                                         : NO_FORMAT;
    if (p->format == NO_FORMAT || !rec_word_is(rec_mesh_word(p->f), "1.0"))
        return rec_mesh_bad(p->f, "neither ascii, binary_little_endian nor binary_big_endian 1.0");
    return PVX_OK;
}

static pvx_err read_element(struct ply *p)
{
    double n;
    struct rec_word name = rec_mesh_word(p->f);
    if (!rec_word_number(rec_mesh_word(p->f), false, &n) || !(n >= 0 && n < 1e15) || n != floor(n))
        return rec_mesh_bad(p->f, "it does not say how many of an element there are");
    if (p->elements == ELEMENTS_MAX)
        return rec_mesh_bad(p->f, "too many kinds of elements");
    struct element *e = &p->element[p->elements++];
    *e = (struct element){.n = (size_t)n, .first = p->properties};
    e->is = rec_word_is(name, "vertex") ? VERTEX : rec_word_is(name, "face") ? FACE : SKIPPED;
    for (const struct element *o = p->element; o < e; o++)
        if (e->is == VERTEX && o->is == VERTEX)
            return rec_mesh_bad(p->f, "vertices for the second time");
    return PVX_OK;
}

static pvx_err read_property(struct ply *p)
{
    struct rec_word w = rec_mesh_word(p->f);
    struct property new = {.count = N_TYPES};
    bool list = rec_word_is(w, "list");
    if (p->elements == 0 || p->properties == PROPERTIES_MAX)
        return rec_mesh_bad(p->f, "a property of no element, or too many of them");
    if (list && !read_type(rec_mesh_word(p->f), &new.count))
        return rec_mesh_bad(p->f, "a list whose count has an unknown type");
    if (!read_type(list ? rec_mesh_word(p->f) : w, &new.type))
        return rec_mesh_bad(p->f, "a property of an unknown type");
    w = rec_mesh_word(p->f);
    if (w.at == NULL)
        return rec_mesh_bad(p->f, "a property without a name");
    struct element *e = &p->element[p->elements - 1];
    if (e->is == VERTEX && !list)
        new.is = rec_word_is(w, "x")   ? X
                 : rec_word_is(w, "y") ? Y
                 : rec_word_is(w, "z") ? Z
                                       : OTHER;
    if (e->is == FACE && list &&
        (rec_word_is(w, "vertex_indices") || rec_word_is(w, "vertex_index")))
        new.is = CORNERS;
    for (size_t i = e->first; new.is != OTHER &&i < p->properties; i++)
        if (p->property[i].is == new.is)
            return rec_mesh_bad(p->f, "a property for the second time");
    p->property[p->properties++] = new;
    e->properties++;
    return PVX_OK;
}

static pvx_err head_line(struct ply *p, struct rec_word w)
{
    if (rec_word_is(w, "format"))
        return read_format(p);
    if (rec_word_is(w, "element"))
        return read_element(p);
    if (rec_word_is(w, "property"))
        return read_property(p);
    return rec_mesh_bad(p->f, "none of format, element, property, comment and end_header");
}

static pvx_err mesh_ply_read_head(struct ply *p)
{
    struct rec_mesh_file *f = p->f;
    bool ply = rec_word_is(rec_mesh_word(f), "ply"), ended = false;
    while (ply && !ended && rec_mesh_word(f).at == NULL && f->at < f->end) {
        f->at++; /* the newline */
        struct rec_word w = rec_mesh_word(f);
        ended = rec_word_is(w, "end_header");
        if (rec_word_is(w, "comment") || rec_word_is(w, "obj_info"))
            while (rec_mesh_word(f).at != NULL)
                ;
        else if (w.at != NULL && !ended)
            PVX_TRY(head_line(p, w));
    }
    if (f->at < f->end && ply && !ended)
        return rec_mesh_bad(f, "a word too many");
    if (!ended || rec_mesh_word(f).at != NULL || f->at == f->end)
        return pvx_fail(f->d, PVX_EFORMAT,
                        "it is no PLY, or its head has no end: it was cut off; export the mesh "
                        "again");
    f->at++;
    return p->format != NO_FORMAT ? PVX_OK : rec_mesh_bad(f, "its head has no format");
}

/* ---- elements ----------------------------------------------------------------------------------- */

static pvx_err mesh_ply_cut_off(const struct ply *p)
{
    return rec_mesh_bad(p->f, p->format == TEXT ? "a number is missing, or is none"
                                                : "it was cut off here");
}

static pvx_err read_value(struct ply *p, enum type t, double *out)
{
    *out = 0;
    if (p->format == TEXT)
        return rec_word_number(rec_mesh_word(p->f), t == F32, out) ? PVX_OK : mesh_ply_cut_off(p);
    bool big = p->format == BIG;
    const uint8_t *b = rec_mesh_bytes(p->f, types[t].bytes);
    if (b == NULL)
        return mesh_ply_cut_off(p);
    uint32_t v = t != F64 ? rec_mesh_u32(b, types[t].bytes, big) : 0;
    switch (t) {
    case I8: *out = (int8_t)v; break;
    case I16: *out = (int16_t)v; break;
    case I32: *out = (int32_t)v; break;
    case F32: *out = (double)rec_mesh_f32(b, big); break;
    case F64: {
        uint64_t bits = (uint64_t)rec_mesh_u32(b + (big ? 0 : 4), 4, big) << 32 |
                        rec_mesh_u32(b + (big ? 4 : 0), 4, big);
        memcpy(out, &bits, sizeof *out);
        break;
    }
    default: *out = v;
    }
    return PVX_OK;
}

/* Reads the length of a list.  A value takes at least one byte, so the rest of the file bounds it. */
static pvx_err read_count(struct ply *p, enum type t, size_t *out)
{
    double n;
    *out = 0;
    PVX_TRY(read_value(p, t, &n));
    if (!(n >= 0 && n <= (double)(p->f->end - p->f->at)) || n != floor(n))
        return rec_mesh_bad(p->f, "a list has more values than the file can hold: it was cut off");
    *out = (size_t)n;
    return PVX_OK;
}

static pvx_err add_corner(struct ply *p, struct fan *fan, double index)
{
    if (!(index >= 0 && index < (double)p->vertices) || index != floor(index))
        return rec_mesh_bad(p->f, "a face has a corner that is not among the vertices");
    const double *v = p->vertex + 3 * (size_t)index;
    if (fan->n++ == 0)
        fan->first = v;
    else if (fan->n > 2)
        PVX_TRY(rec_mesh_put(p->f, fan->first, fan->last, v));
    fan->last = v;
    return PVX_OK;
}

static void normal(const double *t, double n[3]) /* length: twice the area */
{
    for (int a = 0; a < 3; a++) {
        int b = (a + 1) % 3, c = (a + 2) % 3;
        n[a] = (t[3 + b] - t[b]) * (t[6 + c] - t[c]) - (t[3 + c] - t[c]) * (t[6 + b] - t[b]);
    }
}

/* A fan covers its polygon exactly if all its triangles face the same side. */
static pvx_err check_fan(const struct ply *p, const struct fan *fan)
{
    const struct rec_mesh_file *f = p->f;
    double sum[3] = {0}, n[3];
    if (fan->n <= 3 || f->n > REC_MESH_MAX)
        return PVX_OK;
    for (size_t i = fan->first_triangle; i < f->n; i++) {
        normal(f->corner + 9 * i, n);
        for (int a = 0; a < 3; a++)
            sum[a] += n[a];
    }
    double slack = -1e-3 * (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    for (size_t i = fan->first_triangle; i < f->n; i++) {
        normal(f->corner + 9 * i, n);
        if (n[0] * sum[0] + n[1] * sum[1] + n[2] * sum[2] < slack)
            return pvx_fail(f->d, PVX_EFORMAT,
                            "a face of %zu corners is bent inwards; export the mesh as triangles",
                            fan->n);
    }
    return PVX_OK;
}

static pvx_err read_property_of(struct ply *p, const struct property *q, double xyz[3])
{
    struct fan fan = {.first_triangle = p->f->n};
    size_t n = 1;
    if (q->count != N_TYPES)
        PVX_TRY(read_count(p, q->count, &n));
    for (size_t i = 0; i < n; i++) {
        double v;
        PVX_TRY(read_value(p, q->type, &v));
        if (q->is == CORNERS)
            PVX_TRY(add_corner(p, &fan, v));
        else if (q->is != OTHER)
            xyz[q->is - X] = v;
    }
    return check_fan(p, &fan);
}

/* Checks before allocation that the file can hold the elements.  In binary a value takes at least a byte, in text two
 * with its separator. */
static pvx_err elements_fit(const struct ply *p, const struct element *e)
{
    size_t left = (size_t)(p->f->end - p->f->at), each = 0;
    for (size_t i = e->first; i < e->first + e->properties; i++) {
        const struct property *q = &p->property[i];
        each += p->format == TEXT ? 2 : types[q->count != N_TYPES ? q->count : q->type].bytes;
    }
    if (each == 0 || e->n > (left + 1) / each)
        return pvx_fail(p->f->d, PVX_EFORMAT,
                        "its head says more vertices and faces than its %zu bytes can hold: it was "
                        "cut off; export the mesh again",
                        (size_t)(p->f->end - p->f->start));
    if (e->is == VERTEX && e->n > VERTICES_MAX)
        return pvx_fail(p->f->d, PVX_EINVAL,
                        "%zu vertices are more than %d triangles have; simplify the mesh, a voxel "
                        "sees no more",
                        e->n, REC_MESH_MAX);
    return PVX_OK;
}

static pvx_err begin_vertices(struct ply *p, const struct element *e)
{
    unsigned has = 0;
    for (size_t i = e->first; i < e->first + e->properties; i++)
        has |= 1u << p->property[i].is;
    if ((has >> X & 7) != 7)
        return pvx_fail(p->f->d, PVX_EFORMAT,
                        "its vertices have not x, y and z; export the mesh again");
    p->vertex = pvx_calloc(e->n, 3 * sizeof *p->vertex);
    return p->vertex != NULL ? PVX_OK : PVX_ENOMEM;
}

static pvx_err read_elements(struct ply *p, const struct element *e)
{
    if (e->properties == 0)
        return PVX_OK;
    PVX_TRY(elements_fit(p, e));
    if (e->is == VERTEX)
        PVX_TRY(begin_vertices(p, e));
    for (size_t i = 0; i < e->n; i++) {
        double xyz[3] = {0};
        struct rec_mesh_file *f = p->f;
        if (p->format == TEXT)
            rec_mesh_skip_space(f);
        for (size_t k = e->first; k < e->first + e->properties; k++)
            PVX_TRY(read_property_of(p, &p->property[k], xyz));
        if (p->format == TEXT && rec_mesh_word(f).at != NULL)
            return rec_mesh_bad(f, "more numbers than its head says");
        if (e->is == VERTEX)
            memcpy(p->vertex + 3 * p->vertices++, xyz, sizeof xyz);
    }
    return PVX_OK;
}

pvx_err rec_mesh_ply(struct rec_mesh_file *f)
{
    struct ply p = {.f = f};
    pvx_err e = mesh_ply_read_head(&p);
    f->counted = p.format > TEXT;
    for (size_t i = 0; i < p.elements && e == PVX_OK; i++)
        e = read_elements(&p, &p.element[i]);
    PVX_FREE(p.vertex);
    return e;
}
