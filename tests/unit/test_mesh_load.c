/* One body in every kind of STL file is the same body; what is cut off or contradicts itself is refused. */
#include "recon/geom/body.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

/* A prism over a hexagon, corners in eighths of a metre: every type of number can hold them. */
enum { N_VERTICES = 12, N_FACES = 8, N_TRIANGLES = 20 };
static const int vertex[N_VERTICES][3] = {{4, 2, 0}, {3, 4, 0}, {1, 4, 0}, {0, 2, 0},
                                          {1, 0, 0}, {3, 0, 0}, {4, 2, 3}, {3, 4, 3},
                                          {1, 4, 3}, {0, 2, 3}, {1, 0, 3}, {3, 0, 3}};
static const int face[N_FACES][7] = {
    {6, 5, 4, 3, 2, 1, 0}, {6, 6, 7, 8, 9, 10, 11}, {4, 0, 1, 7, 6},   {4, 1, 2, 8, 7},
    {4, 2, 3, 9, 8},       {4, 3, 4, 10, 9},        {4, 4, 5, 11, 10}, {4, 6, 11, 5, 0}};

/* Triangle t of the fans: 0 1 2, 0 2 3. */
static void fan(int t, int out[3])
{
    int f = 0;
    for (; t >= face[f][0] - 2; f++)
        t -= face[f][0] - 2;
    out[0] = face[f][1];
    out[1] = face[f][t + 2];
    out[2] = face[f][t + 3];
}

/* ---- written ------------------------------------------------------------------------------------- */

static void write_stl(const char *path, const char *head, size_t behind)
{
    FILE *f = fopen(path, "wb");
    char bytes[80] = {0};
    uint32_t n = N_TRIANGLES;
    snprintf(bytes, sizeof bytes, "%s", head);
    fwrite(bytes, 1, sizeof bytes, f);
    fwrite(&n, 4, 1, f);
    for (int i = 0; i < N_TRIANGLES; i++) {
        float v[12] = {NAN, 0, 1};
        int t[3];
        fan(i, t);
        for (int k = 0; k < 9; k++)
            v[3 + k] = (float)vertex[t[k / 3]][k % 3];
        fwrite(v, 4, 12, f);
        fwrite("\xff\x7f", 1, 2, f); /* a colour */
    }
    for (; behind > 0; behind--)
        fputc('x', f);
    fclose(f);
}

/* As two solids where the words are in capitals. */
static void write_stl_text(const char *path, bool capitals, const char *nl)
{
    FILE *f = fopen(path, "wb");
    fprintf(f, capitals ? "SOLID%s" : "solid a facet of it%s", nl);
    for (int i = 0; i < N_TRIANGLES; i++) {
        int t[3];
        fan(i, t);
        if (capitals && i == 7)
            fprintf(f, "ENDSOLID%s%sSOLID b%s", nl, nl, nl);
        fprintf(f,
                capitals ? "FACET NORMAL -nan(ind) 0 1e999%sOUTER LOOP%s"
                         : "facet normal 0 0 0%s outer loop%s",
                nl, nl);
        for (int k = 0; k < 3; k++)
            fprintf(f, "%s %d %d.0 +%de0%s", capitals ? "\tVERTEX" : "vertex", vertex[t[k]][0],
                    vertex[t[k]][1], vertex[t[k]][2], nl);
        fprintf(f, capitals ? "ENDLOOP%sENDFACET%s" : "endloop%sendfacet%s", nl, nl);
    }
    fprintf(f, capitals ? "ENDSOLID%s" : "endsolid a%s", nl);
    fclose(f);
}

/* ---- read ---------------------------------------------------------------------------------------- */

static uint64_t prism(void) /* without a file */
{
    double corner[N_TRIANGLES][3][3];
    struct rec_mesh *m;
    struct pvx_diag d = {""};
    for (int i = 0; i < N_TRIANGLES; i++) {
        int t[3];
        fan(i, t);
        for (int k = 0; k < 9; k++)
            corner[i][k / 3][k % 3] = 0.125 * vertex[t[k / 3]][k % 3];
    }
    T_EQ_I(rec_mesh_new(&corner[0][0][0], N_TRIANGLES, &m, &d), PVX_OK);
    uint64_t hash = rec_mesh_hash(m);
    rec_mesh_free(&m);
    return hash;
}

static bool is_prism(const char *path)
{
    struct rec_mesh *m;
    struct pvx_diag d = {""};
    pvx_err e = rec_mesh_load(path, 0.125, 1, &m, &d);
    T_EQ_S(d.text, "");
    bool same = e == PVX_OK && rec_mesh_hash(m) == prism();
    rec_mesh_free(&m);
    return same;
}

T_CASE(every_kind_of_stl)
{
    write_stl(at("a.stl"), "made for a test", 0);
    T_OK(is_prism(at("a.stl")));
    write_stl(at("a.stl"), "solid in name only", 0);
    T_OK(is_prism(at("a.stl")));
    write_stl(at("a.STL"), "solid in name only", 3);
    T_OK(is_prism(at("a.STL")));
    for (int i = 0; i < 4; i++) {
        write_stl_text(at("a.stl"), i % 2, i / 2 ? "\r\n" : "\n");
        T_OK(is_prism(at("a.stl")));
    }
}

/* ---- refused ------------------------------------------------------------------------------------- */

/* The first n bytes for every n: how many of them are the same body.  Nothing is left of the file. */
static size_t cuts(const char *path)
{
    struct stat st;
    size_t same = 0;
    T_OK(is_prism(path));
    T_EQ_I(stat(path, &st), 0);
    for (off_t n = st.st_size - 1; n >= 0; n--) {
        struct rec_mesh *m;
        struct pvx_diag d = {""};
        T_EQ_I(truncate(path, n), 0);
        if (rec_mesh_load(path, 0.125, 1, &m, &d) == PVX_OK) {
            T_OK(rec_mesh_hash(m) == prism());
            same++;
        } else {
            T_OK(m == NULL && d.text[0] != '\0' && strchr(d.text, '\n') == NULL);
        }
        rec_mesh_free(&m);
    }
    return same;
}

T_CASE(cut_at_every_byte)
{
    write_stl(at("a.stl"), "made for a test", 0);
    T_EQ_I(cuts(at("a.stl")), 0);
    write_stl(at("a.stl"), "solid", 0);
    T_EQ_I(cuts(at("a.stl")), 0);
    write_stl_text(at("a.stl"), false, "\n");
    T_EQ_I(cuts(at("a.stl")), 3); /* without its name's letter, blank and newline */
}

#define FACET "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"

static const struct {
    const char *name, *text, *says;
} bad[] = {
    {"a.ply", "ply\n", "should end with .stl"},
    {"a.stl", "", "less than the 84 bytes"},
    {"a.stl", "solid a\nendsolid a\n", "no triangle"},
    {"a.stl", "solid a\n" FACET "endloop\nendfacet\nendsolid a\n", "not closed"},
    {"a.stl", "solid a\n" FACET "endloop\nendfacet\n", "no 'endsolid': it was cut off"},
    {"a.stl", "solid a\n" FACET "vertex 1 1 1\nendloop\nendfacet\nendsolid\n",
     "line 7: a facet do"},
    {"a.stl", "solid a\nfacet normal 0 0 1\nvertex 1 1 1\n", "line 3: a facet has no 'outer loop'"},
    {"a.stl", "solid a\nfacet\nouter loop\nvertex 1 1\nendloop\n",
     "line 5: a vertex has not three"},
    {"a.stl", "solid a\nfacet\nouter loop\nvertex 1 1 1\nendloop\n", "line 5: a facet has not th"},
    {"a.stl", "solid a\nwhat\n", "line 2: neither 'facet' nor"},
    {"a.stl", "solid a\nendsolid\n" FACET, "line 3: no 'solid'"},
};

T_CASE(bad_files_are_refused)
{
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct rec_mesh *m;
        struct pvx_diag d = {""};
        FILE *f = fopen(at("%s", bad[i].name), "wb");
        fputs(bad[i].text, f);
        fclose(f);
        T_OK(rec_mesh_load(at("%s", bad[i].name), 1, 1, &m, &d) != PVX_OK);
        T_CONTAINS(d.text, bad[i].says);
        T_OK(m == NULL);
    }
}

/* Not that a surface is open, which would send people looking for holes. */
T_CASE(a_short_stl_is_called_so)
{
    struct rec_mesh *m;
    struct pvx_diag d = {""};
    write_stl(at("a.stl"), "solid", 0);
    T_EQ_I(truncate(at("a.stl"), 84 + 50 * (N_TRIANGLES - 1)), 0);
    T_EQ_I(rec_mesh_load(at("a.stl"), 0.125, 1, &m, &d), PVX_EFORMAT);
    T_CONTAINS(d.text, "it says 20 triangles, more than its 1034 bytes");
}

T_MAIN(scratch_new(), scratch_remove())
