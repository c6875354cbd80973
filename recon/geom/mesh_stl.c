/* STL: binary (80 bytes, a count, 50 bytes for each triangle) or text.  Marshall Burns, Automated Fabrication, 1993,
 * 6.5. */
#include <string.h>

#include "recon/geom/mesh_file.h"

#define HEAD 84
#define EACH 50

static pvx_err mesh_stl_corner(struct rec_mesh_file *f, double v[3])
{
    if (!rec_word_is(rec_mesh_word_below(f), "vertex"))
        return rec_mesh_bad(f, "a facet has not three vertices");
    for (int a = 0; a < 3; a++)
        if (!rec_word_number(rec_mesh_word_below(f), true, &v[a]))
            return rec_mesh_bad(f, "a vertex has not three numbers");
    return PVX_OK;
}

/* The word `facet` has been read.  The normal is ignored: some programs write something else than numbers there. */
static pvx_err facet(struct rec_mesh_file *f)
{
    double v[3][3];
    struct rec_word w = rec_mesh_word_below(f);
    for (int i = 0; i < 4 && !rec_word_is(w, "outer"); i++)
        w = rec_mesh_word_below(f);
    if (!rec_word_is(w, "outer") || !rec_word_is(rec_mesh_word_below(f), "loop"))
        return rec_mesh_bad(f, "a facet has no 'outer loop'");
    for (int k = 0; k < 3; k++)
        PVX_TRY(mesh_stl_corner(f, v[k]));
    if (!rec_word_is(rec_mesh_word_below(f), "endloop") ||
        !rec_word_is(rec_mesh_word_below(f), "endfacet"))
        return rec_mesh_bad(f, "a facet does not end after three vertices");
    return rec_mesh_put(f, v[0], v[1], v[2]);
}

static pvx_err mesh_stl_text(struct rec_mesh_file *f)
{
    bool solid = false;
    struct rec_word w;
    while ((w = rec_mesh_word_below(f)).at != NULL)
        if (rec_word_is(w, solid ? "endsolid" : "solid")) {
            solid = !solid;
            rec_mesh_skip_line(f); /* its name */
        } else if (solid && rec_word_is(w, "facet")) {
            PVX_TRY(facet(f));
        } else {
            return rec_mesh_bad(f, solid ? "neither 'facet' nor 'endsolid'" : "no 'solid'");
        }
    return solid ? rec_mesh_bad(f, "no 'endsolid': it was cut off") : PVX_OK;
}

static pvx_err binary(struct rec_mesh_file *f, uint32_t n)
{
    const uint8_t *t;
    f->at += HEAD;
    for (uint32_t i = 0; i < n && (t = rec_mesh_bytes(f, EACH)) != NULL; i++) {
        double v[9];
        for (size_t k = 0; k < 9; k++)
            v[k] = (double)rec_mesh_f32(t + 4 * (3 + k), false);
        PVX_TRY(rec_mesh_put(f, v, v + 3, v + 6));
    }
    return PVX_OK;
}

/* Some programs begin a binary file with "solid" too.  A zero byte in the head tells them apart: text has none.  In
 * binary the count of triangles has one, because the count in a file of the allowed size is less than 2^24. */
pvx_err rec_mesh_stl(struct rec_mesh_file *f)
{
    size_t len = (size_t)(f->end - f->start);
    const uint8_t *head = rec_mesh_bytes(f, HEAD);
    uint64_t n = head != NULL ? rec_mesh_u32(head + HEAD - 4, 4, false) : 0;
    f->at = f->start;
    bool says_solid = rec_word_is(rec_mesh_word_below(f), "solid");
    f->at = f->start;
    if (says_solid && memchr(f->start, '\0', len < HEAD ? len : HEAD) == NULL)
        return mesh_stl_text(f);
    if (head == NULL)
        return pvx_fail(f->d, PVX_EFORMAT,
                        "it does not begin with 'solid', and has less than the %d bytes of a "
                        "binary STL: it was cut off; export the mesh again",
                        HEAD);
    if (len < HEAD + EACH * n)
        return pvx_fail(f->d, PVX_EFORMAT,
                        "it says %llu triangles, more than its %zu bytes can hold: it was cut off, "
                        "or is no STL; export the mesh again",
                        (unsigned long long)n, len);
    return binary(f, (uint32_t)n);
}
