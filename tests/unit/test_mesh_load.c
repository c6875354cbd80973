/* One body in every kind of mesh file is the same body; what is cut off or contradicts itself is refused. */
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

static const char *const type_names[8][2] = {
    {"char", "int8"}, {"uchar", "uint8"}, {"short", "int16"},   {"ushort", "uint16"},
    {"int", "int32"}, {"uint", "uint32"}, {"float", "float32"}, {"double", "float64"}};
enum type { I8, U8, I16, U16, I32, U32, F32, F64 };
static const char *const formats[] = {"ascii", "binary_little_endian", "binary_big_endian"};
enum format { TEXT, LITTLE, BIG };

struct how {
    enum format format;
    enum type coordinate, count, index;
    int also;      /* which of a type's names */
    bool polygons; /* else their triangles */
    bool more; /* comments, elements and properties that nobody wants, before, between and behind */
    const char *newline;
    int less; /* from each coordinate: below 0 where the type has a sign */
};

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

static void put(FILE *f, const struct how *h, enum type t, double v)
{
    static const size_t bytes[] = {1, 1, 2, 2, 4, 4, 4, 8};
    unsigned char b[8];
    int64_t whole = (int64_t)v;
    float single = (float)v;
    if (h->format == TEXT) {
        fprintf(f, " %.9g", v);
        return;
    }
    memcpy(b, t == F64 ? (void *)&v : t == F32 ? (void *)&single : (void *)&whole, bytes[t]);
    for (size_t i = 0; i < bytes[t]; i++)
        fputc(b[h->format == BIG ? bytes[t] - 1 - i : i], f);
}

static void end(FILE *f, const struct how *h)
{
    if (h->format == TEXT)
        fputs(h->newline, f);
}

static void put_face(FILE *f, const struct how *h, const int *corner, int n)
{
    if (h->more) {
        put(f, h, U8, 2); /* a list before the wanted one */
        put(f, h, F64, 0.1);
        put(f, h, F64, -1e30);
    }
    put(f, h, h->count, n);
    for (int k = 0; k < n; k++)
        put(f, h, h->index, corner[k]);
    if (h->more)
        put(f, h, I16, -7);
    end(f, h);
}

static void put_more(FILE *f, const struct how *h)
{
    for (int i = 0; i < 2 && h->more; i++) {
        put(f, h, I8, -1);
        put(f, h, U16, i);
        for (int k = 0; k < i; k++)
            put(f, h, F32, 3.5);
        end(f, h);
    }
}

static void write_ply(const char *path, const struct how *h)
{
    FILE *f = fopen(path, "wb");
    const char *nl = h->newline, *coordinate = type_names[h->coordinate][h->also];
    static const char *const more = "element material 2%sproperty char a%sproperty list ushort "
                                    "float b%s";
    fprintf(f, "ply%sformat %s 1.0%s", nl, formats[h->format], nl);
    if (h->more) {
        fprintf(f, "comment element vertex 3%sobj_info%s", nl, nl);
        fprintf(f, more, nl, nl, nl); // NOLINT(clang-diagnostic-format-nonliteral)
    }
    fprintf(f, "element vertex %d%s", N_VERTICES, nl);
    if (h->more) /* another order too */
        fprintf(f, "property uchar red%sproperty %s z%sproperty %s y%sproperty double nx%s", nl,
                coordinate, nl, coordinate, nl, nl);
    fprintf(f, "property %s x%s", coordinate, nl);
    if (!h->more)
        fprintf(f, "property %s y%sproperty %s z%s", coordinate, nl, coordinate, nl);
    fprintf(f, "element face %d%s", h->polygons ? N_FACES : N_TRIANGLES, nl);
    if (h->more)
        fprintf(f, "property list uchar double texcoord%s", nl);
    fprintf(f, "property list %s %s %s%s", type_names[h->count][h->also],
            type_names[h->index][h->also], h->also ? "vertex_index" : "vertex_indices", nl);
    if (h->more)
        fprintf(f,
                "property short flags%selement edge 2%sproperty char a%sproperty list ushort "
                "float b%selement nothing 9%s",
                nl, nl, nl, nl, nl);
    fprintf(f, "end_header%s", nl);
    put_more(f, h);
    for (int i = 0; i < N_VERTICES; i++) {
        for (int k = 0; k < 3; k++) {
            if (h->more && k == 0)
                put(f, h, U8, 255);
            if (h->more && k == 2)
                put(f, h, F64, NAN);
            put(f, h, h->coordinate, vertex[i][h->more ? 2 - k : k] - h->less);
        }
        end(f, h);
    }
    for (int i = 0; i < (h->polygons ? N_FACES : N_TRIANGLES); i++) {
        int t[3];
        fan(i, t);
        put_face(f, h, h->polygons ? face[i] + 1 : t, h->polygons ? face[i][0] : 3);
    }
    put_more(f, h);
    fclose(f);
}

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

static uint64_t prism(int less) /* without a file */
{
    double corner[N_TRIANGLES][3][3];
    struct rec_mesh *m;
    struct pvx_diag d = {""};
    for (int i = 0; i < N_TRIANGLES; i++) {
        int t[3];
        fan(i, t);
        for (int k = 0; k < 9; k++)
            corner[i][k / 3][k % 3] = 0.125 * (vertex[t[k / 3]][k % 3] - less);
    }
    T_EQ_I(rec_mesh_new(&corner[0][0][0], N_TRIANGLES, &m, &d), PVX_OK);
    uint64_t hash = rec_mesh_hash(m);
    rec_mesh_free(&m);
    return hash;
}

static bool is_prism(const char *path, int less)
{
    struct rec_mesh *m;
    struct pvx_diag d = {""};
    pvx_err e = rec_mesh_load(path, 0.125, 1, &m, &d);
    T_EQ_S(d.text, "");
    bool same = e == PVX_OK && rec_mesh_hash(m) == prism(less);
    rec_mesh_free(&m);
    return same;
}

static const struct how plain = {TEXT, F32, U8, I32, 0, false, false, "\n", 0};

T_CASE(every_type_of_ply)
{
    for (enum format f = TEXT; f <= BIG; f++)
        for (int i = 0; i < 8 * 2; i++) {
            enum type t = (enum type)(i / 2);
            int less = t == U8 || t == U16 || t == U32 ? 0 : 2;
            struct how h = {f, t, U8, I32, i % 2, i % 2 == 1, false, "\n", less};
            write_ply(at("a.ply"), &h);
            T_OK(is_prism(at("a.ply"), less));
            h = (struct how){f, F32, t, t, i % 2, i % 2 == 0, true, i % 2 ? "\r\n" : "\n", 0};
            write_ply(at("a.ply"), &h);
            T_OK(is_prism(at("a.ply"), 0));
        }
}

T_CASE(every_kind_of_stl)
{
    write_stl(at("a.stl"), "made for a test", 0);
    T_OK(is_prism(at("a.stl"), 0));
    write_stl(at("a.stl"), "solid in name only", 0);
    T_OK(is_prism(at("a.stl"), 0));
    write_stl(at("a.STL"), "solid in name only", 3);
    T_OK(is_prism(at("a.STL"), 0));
    for (int i = 0; i < 4; i++) {
        write_stl_text(at("a.stl"), i % 2, i / 2 ? "\r\n" : "\n");
        T_OK(is_prism(at("a.stl"), 0));
    }
}

/* ---- refused ------------------------------------------------------------------------------------- */

/* The first n bytes for every n: how many of them are the same body.  Nothing is left of the file. */
static size_t cuts(const char *path)
{
    struct stat st;
    size_t same = 0;
    T_OK(is_prism(path, 0));
    T_EQ_I(stat(path, &st), 0);
    for (off_t n = st.st_size - 1; n >= 0; n--) {
        struct rec_mesh *m;
        struct pvx_diag d = {""};
        T_EQ_I(truncate(path, n), 0);
        if (rec_mesh_load(path, 0.125, 1, &m, &d) == PVX_OK) {
            T_OK(rec_mesh_hash(m) == prism(0));
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
    struct how h = plain;
    write_stl(at("a.stl"), "made for a test", 0);
    T_EQ_I(cuts(at("a.stl")), 0);
    write_stl(at("a.stl"), "solid", 0);
    T_EQ_I(cuts(at("a.stl")), 0);
    write_stl_text(at("a.stl"), false, "\n");
    T_EQ_I(cuts(at("a.stl")), 3); /* without its name's letter, blank and newline */
    write_ply(at("a.ply"), &h);
    T_EQ_I(cuts(at("a.ply")), 1); /* without the newline */
    h.format = LITTLE;
    write_ply(at("a.ply"), &h);
    T_EQ_I(cuts(at("a.ply")), 0);
    h = (struct how){BIG, F64, U16, U32, 1, true, true, "\r\n", 0};
    write_ply(at("a.ply"), &h);
    T_EQ_I(cuts(at("a.ply")), 0);
}

#define TETRA(vertices, properties, numbers, faces)                                   \
    "ply\nformat ascii 1.0\nelement vertex " vertices "\n" properties "element face " \
    "4\nproperty list uchar int vertex_indices\nend_header\n" numbers faces
#define XYZ     "property float x\nproperty float y\nproperty float z\n"
#define NUMBERS "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
#define FACES   "3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"
#define FACET   "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"

static const struct {
    const char *name, *text, *says;
} bad[] = {
    {"a.ply", "", "its head has no end"},
    {"a.ply", "ply\nformat ascii 1.0\nelement vertex 1\n", "its head has no end"},
    {"a.ply", "ply\nend_header\n", "its head has no format"},
    {"a.ply", "ply\nformat ascii 2.0\nend_header\n", "line 2: neither ascii"},
    {"a.ply", "ply\nformat ascii 1.0 1\nend_header\n", "line 2: a word too many"},
    {"a.ply", "ply\nformat ascii 1.0\nend_header\n", "no triangle"},
    {"a.ply", "ply\nformat ascii 1.0\nfoo\nend_header\n", "line 3: none of format"},
    {"a.ply", TETRA("-4", XYZ, NUMBERS, FACES), "line 3: it does not say how many"},
    {"a.ply", TETRA("4.5", XYZ, NUMBERS, FACES), "line 3: it does not say how many"},
    {"a.ply", TETRA("1e14", XYZ, NUMBERS, FACES), "more vertices and faces than its"},
    {"a.ply", TETRA("4", "property float x\n", NUMBERS, FACES), "have not x, y and z"},
    {"a.ply", TETRA("4", XYZ "property float y\n", NUMBERS, FACES), "line 7: a property for the"},
    {"a.ply", TETRA("4", XYZ "property long q\n", NUMBERS, FACES), "line 7: a property of an unk"},
    {"a.ply", TETRA("4", XYZ "property list q int a\n", NUMBERS, FACES), "line 7: a list whose"},
    {"a.ply", TETRA("4", XYZ "element vertex 4\n" XYZ, NUMBERS NUMBERS, FACES), "second time"},
    {"a.ply", "ply\nformat ascii 1.0\nproperty int a\nend_header\n", "a property of no element"},
    {"a.ply", TETRA("4", XYZ, "0 0 0\n1 0\n0 1 0\n0 0 1\n", FACES), "line 11: a number is missing"},
    {"a.ply", TETRA("4", XYZ, "0 0 0\n1 0 0x\n0 1 0\n0 0 1\n", FACES), "line 11: a number"},
    {"a.ply", TETRA("4", XYZ, "0 0 0\n1 0 0 0\n0 1 0\n0 0 1\n", FACES), "line 11: more numbers"},
    {"a.ply", TETRA("4", XYZ, "0 0 0\n1 0 nan\n0 1 0\n0 0 1\n", FACES), "is not a number"},
    {"a.ply", TETRA("4", XYZ, "0 0 0\n1 0 1e39\n0 1 0\n0 0 1\n", FACES), "is not a number"},
    {"a.ply", TETRA("4", XYZ, NUMBERS, "3 0 2 4\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"), "not among the"},
    {"a.ply", TETRA("4", XYZ, NUMBERS, "3 0 2 -1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"), "not among the"},
    {"a.ply", TETRA("4", XYZ, NUMBERS, "3 0 2 .5\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"), "not among the"},
    {"a.ply", TETRA("4", XYZ, NUMBERS, "3 0 2 nan\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"), "not among the"},
    {"a.ply", TETRA("4", XYZ, NUMBERS, "1e9 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"),
     "a list has more"},
    {"a.ply", TETRA("4", XYZ, NUMBERS, "-3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"), "a list has more"},
    {"a.ply", TETRA("4", XYZ, NUMBERS, "3 0 1 2\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"), "not closed"},
    {"a.ply", TETRA("5", XYZ, NUMBERS "0.1 0.1 0\n", "4 2 4 1 0\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"),
     "a face of 4 corners is bent inwards"},
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

/* Room for a million triangles' vertices is the most that is made. */
T_CASE(too_many_vertices)
{
    struct rec_mesh *m;
    struct pvx_diag d = {""};
    FILE *f = fopen(at("a.ply"), "wb");
    fputs("ply\nformat binary_little_endian 1.0\nelement vertex 4000000\nproperty char x\nproperty "
          "char y\nproperty char z\nend_header\n",
          f);
    fclose(f);
    T_EQ_I(truncate(at("a.ply"), 13L << 20), 0);
    T_EQ_I(rec_mesh_load(at("a.ply"), 1, 1, &m, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "simplify");
}

T_MAIN(scratch_new(), scratch_remove())
