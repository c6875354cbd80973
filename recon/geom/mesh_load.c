/* Reads mesh files.  STL: binary (80 bytes, a count, 50 bytes for each triangle) or text.  Marshall Burns, Automated
 * Fabrication, 1993, 6.5. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "base/file.h"
#include "base/mem.h"
#include "recon/geom/body.h"

/* Enough for a million triangles as text.  A file of ten million is refused before it is read. */
#define FILE_MAX (300L << 20)
#define WORD_MAX 63 /* characters of a number; a double needs 24 */
#define HEAD     84
#define EACH     50

/* A file, read once from start to end, and the triangles found in it. */
struct stl {
    const char *start, *at, *end;
    double scale;
    double *corner; /* [n][3][3] in metres, of the first REC_MESH_MAX */
    size_t n, room;
    struct pvx_diag *d;
};

struct word { /* NULL: no more */
    const char *at;
    size_t len;
};

static bool blank(char c)
{
    return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f' || c == '\n';
}

static struct word stl_word(struct stl *f)
{
    while (f->at < f->end && blank(*f->at))
        f->at++;
    struct word w = {f->at, 0};
    while (f->at < f->end && !blank(*f->at))
        f->at++;
    w.len = (size_t)(f->at - w.at);
    return w.len > 0 ? w : (struct word){NULL, 0};
}

static bool word_is(struct word w, const char *text)
{
    return w.at != NULL && w.len == strlen(text) && strncasecmp(w.at, text, w.len) == 0;
}

/* True if the whole word is a number, also nan and inf, rounded to float as in a binary file.  Numbers are in the C
 * locale: the program never calls setlocale(). */
static bool word_number(struct word w, double *out)
{
    char text[WORD_MAX + 1], *end;
    if (w.at == NULL || w.len > WORD_MAX)
        return false;
    memcpy(text, w.at, w.len);
    text[w.len] = '\0';
    *out = (double)strtof(text, &end);
    return end == text + w.len;
}

/* Add a triangle.  Beyond REC_MESH_MAX triangles are only counted. */
static pvx_err stl_put(struct stl *f, const double v[9])
{
    if (f->n >= REC_MESH_MAX) {
        f->n++;
        return PVX_OK;
    }
    if (f->n == f->room) {
        size_t room = f->room > 0 ? 2 * f->room : 1024;
        double *more = realloc(f->corner, room * 9 * sizeof *more);
        PVX_NEED(more);
        f->corner = more;
        f->room = room;
    }
    double *to = f->corner + 9 * f->n++;
    for (int i = 0; i < 9; i++)
        to[i] = f->scale * v[i];
    return PVX_OK;
}

static pvx_err stl_bad(const struct stl *f, const char *what)
{
    size_t line = 1;
    for (const char *p = f->start; p < f->at; p++)
        line += *p == '\n';
    return pvx_fail(f->d, PVX_EFORMAT, "line %zu: %s; export the mesh again", line, what);
}

static pvx_err stl_corner(struct stl *f, double v[3])
{
    if (!word_is(stl_word(f), "vertex"))
        return stl_bad(f, "a facet has not three vertices");
    for (int a = 0; a < 3; a++)
        if (!word_number(stl_word(f), &v[a]))
            return stl_bad(f, "a vertex has not three numbers");
    return PVX_OK;
}

/* The word `facet` has been read.  The normal is ignored: some programs write something else than numbers there. */
static pvx_err facet(struct stl *f)
{
    double v[9];
    struct word w = stl_word(f);
    for (int i = 0; i < 4 && !word_is(w, "outer"); i++)
        w = stl_word(f);
    if (!word_is(w, "outer") || !word_is(stl_word(f), "loop"))
        return stl_bad(f, "a facet has no 'outer loop'");
    for (size_t k = 0; k < 3; k++)
        PVX_TRY(stl_corner(f, v + 3 * k));
    if (!word_is(stl_word(f), "endloop") || !word_is(stl_word(f), "endfacet"))
        return stl_bad(f, "a facet does not end after three vertices");
    return stl_put(f, v);
}

static pvx_err stl_text(struct stl *f)
{
    bool solid = false;
    struct word w;
    while ((w = stl_word(f)).at != NULL)
        if (word_is(w, solid ? "endsolid" : "solid")) {
            const char *newline = memchr(f->at, '\n', (size_t)(f->end - f->at));
            solid = !solid;
            f->at = newline != NULL ? newline + 1 : f->end; /* its name */
        } else if (solid && word_is(w, "facet")) {
            PVX_TRY(facet(f));
        } else {
            return stl_bad(f, solid ? "neither 'facet' nor 'endsolid'" : "no 'solid'");
        }
    return solid ? stl_bad(f, "no 'endsolid': it was cut off") : PVX_OK;
}

static uint32_t stl_u32(const char *at)
{
    const uint8_t *p = (const uint8_t *)at;
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

static pvx_err stl_binary(struct stl *f, uint32_t n)
{
    for (size_t i = 0; i < n; i++) {
        double v[9];
        for (size_t k = 0; k < 9; k++) {
            uint32_t bits = stl_u32(f->start + HEAD + EACH * i + 4 * (3 + k));
            float x;
            memcpy(&x, &bits, sizeof x);
            v[k] = (double)x;
        }
        PVX_TRY(stl_put(f, v));
    }
    return PVX_OK;
}

/* Some programs begin a binary file with "solid" too.  A zero byte in the head tells them apart: text has none.  In
 * binary the count of triangles has one, because the count in a file of the allowed size is less than 2^24. */
static pvx_err stl_read(struct stl *f)
{
    size_t len = (size_t)(f->end - f->start);
    bool says_solid = word_is(stl_word(f), "solid");
    f->at = f->start;
    if (says_solid && memchr(f->start, '\0', len < HEAD ? len : HEAD) == NULL)
        return stl_text(f);
    if (len < HEAD)
        return pvx_fail(f->d, PVX_EFORMAT,
                        "it does not begin with 'solid', and has less than the %d bytes of a "
                        "binary STL: it was cut off; export the mesh again",
                        HEAD);
    uint32_t n = stl_u32(f->start + HEAD - 4);
    if (len < HEAD + (uint64_t)EACH * n)
        return pvx_fail(f->d, PVX_EFORMAT,
                        "it says %u triangles, more than its %zu bytes can hold: it was cut off, "
                        "or is no STL; export the mesh again",
                        n, len);
    return stl_binary(f, n);
}

static pvx_err of_this_size(const struct rec_mesh *m, double side, struct pvx_diag *d)
{
    double min[3], max[3], longest = 0;
    rec_mesh_box(m, min, max);
    for (int a = 0; a < 3; a++)
        longest = fmax(longest, max[a] - min[a]);
    if (longest <= 100 * side)
        return PVX_OK;
    return pvx_fail(
        d, PVX_EINVAL,
        "it is %.4g m long, over a hundred times the volume's %.4g m; is it in millimetres? "
        "scale: 0.001",
        longest, side);
}

/* Only the format that every program for parts and scans writes. */
static pvx_err readable(const char *path, struct pvx_diag *d)
{
    struct stat st;
    const char *dot = strrchr(path, '.');
    if (dot == NULL || strcasecmp(dot, ".stl") != 0)
        return pvx_fail(d, PVX_EFORMAT, "should end with .stl; export the mesh as STL");
    if (stat(path, &st) != 0)
        return pvx_fail(d, PVX_ENOENT,
                        "there is no such file; a path is relative to the rig's folder");
    PVX_TRY(pvx_file_check(path, d));
    if (st.st_size > FILE_MAX)
        return pvx_fail(
            d, PVX_EINVAL,
            "%lld MiB are more than %d triangles take; simplify the mesh, a voxel sees no "
            "more",
            (long long)(st.st_size >> 20), REC_MESH_MAX);
    return PVX_OK;
}

pvx_err rec_mesh_load(const char *path, double scale, double side, struct rec_mesh **out,
                      struct pvx_diag *d)
{
    char *bytes;
    size_t len;
    *out = NULL;
    PVX_TRY(readable(path, d));
    PVX_TRY(pvx_file_read(path, FILE_MAX, &bytes, &len, d));
    struct stl f = {.start = bytes, .at = bytes, .end = bytes + len, .scale = scale, .d = d};
    pvx_err e = stl_read(&f);
    free(bytes);
    if (e == PVX_OK)
        e = rec_mesh_new(f.corner, f.n, out, d);
    free(f.corner);
    if (e == PVX_OK && (e = of_this_size(*out, side, d)) != PVX_OK)
        rec_mesh_free(out);
    return e;
}
