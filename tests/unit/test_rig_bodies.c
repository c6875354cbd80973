/* Bodies in rig.yaml: read, written and read again, and what is refused. */
#include "recon/geom/rig.h"
#include "tests/lib/body_mesh.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

#define HEAD                                                                                 \
    "version: 1\n"                                                                           \
    "volume: { min: [-0.5,-0.5,0], max: [0.5,0.5,1], voxels: [8,9,10], basis: trilinear }\n" \
    "cameras:\n"                                                                             \
    "  - name: left\n    size: [640, 480]\n    K: [500, 500, 319.5, 239.5]\n"                \
    "    R: [1,0,0, 0,1,0, 0,0,1]\n    t: [0, 0, 3]\n"
#define ROD "  - { name: rod, cylinder: { from: [-0.5,0,0.4], to: [0.5,0,0.4], radius: 0.05 } }\n"
#define LOG "  - { name: log, box: { min: [-0.3,-0.1,0], max: [0.3,0.1,0.2] } }\n"

static pvx_err parse(const char *text, struct rec_rig *r, struct pvx_diag *d)
{
    d->text[0] = '\0';
    return rec_rig_parse(text, strlen(text), "rig.yaml", r, d);
}

static void refuse(const char *bodies, const char *part)
{
    char text[4096];
    struct rec_rig r;
    struct pvx_diag d;
    snprintf(text, sizeof text, "%sbodies:\n%s", HEAD, bodies);
    T_OK(parse(text, &r, &d) != PVX_OK);
    T_CONTAINS(d.text, part);
    T_CONTAINS(d.text, "rig.yaml:");
    T_OK(r.cameras == NULL && r.bodies.body == NULL);
}

T_CASE(read_and_written)
{
    struct rec_rig r, copy, again, none;
    struct pvx_diag d;
    char *text;
    size_t len;
    T_EQ_I(parse(HEAD "bodies:\n" ROD LOG, &r, &d), PVX_OK);
    T_EQ_I(parse(HEAD, &none, &d), PVX_OK);
    T_EQ_I(r.bodies.n, 2);
    T_EQ_S(r.bodies.body[0].name, "rod");
    T_EQ_I(r.bodies.body[0].kind, REC_BODY_CYLINDER);
    T_NEAR(r.bodies.body[0].radius, 0.05, 0);
    T_NEAR(r.bodies.body[1].b[2], 0.2, 0);
    T_EQ_I(rec_rig_copy(&r, &copy), PVX_OK);
    T_EQ_I(rec_rig_format(&copy, &text, &len), PVX_OK);
    T_EQ_I(parse(text, &again, &d), PVX_OK);
    T_EQ_I(again.bodies.n, 2);
    T_OK(rec_rig_hash(&again) == rec_rig_hash(&r));
    T_OK(rec_rig_hash(&none) != rec_rig_hash(&r));
    again.bodies.body[0].radius *= 1.5;
    T_OK(rec_rig_hash(&again) != rec_rig_hash(&r));
    free(text);
    rec_rig_fini(&r);
    rec_rig_fini(&copy);
    rec_rig_fini(&again);
    rec_rig_fini(&none);
}

T_CASE(refusals_say_what_is_wrong)
{
    refuse("  - { name: rod }\n", "one of the keys box, cylinder and mesh");
    refuse("  - { box: { min: [0,0,0], max: [1,1,1] } }\n", "name");
    refuse(ROD ROD, "'rod' is used twice");
    refuse("  - { name: a, box: { min: [0,0,0], max: [1,-1,1] } }\n", "empty along y");
    refuse("  - { name: a, cylinder: { from: [0,0,0], to: [0,0,0], radius: 1 } }\n", "no length");
    refuse("  - { name: a, cylinder: { from: [0,0,0], to: [0,0,1], radius: -1 } }\n", "radius");
    refuse("  - { name: a, box: { min: [-9,-9,-9], max: [9,9,9] } }\n",
           "camera left stands inside the body 'a'");
    refuse("  - { name: a, box: { min: [0,0,0], max: [1,1,1] }, scale: 2 }\n", "belongs to a mesh");
    refuse("  - { name: a, mesh: /nowhere/a.stl }\n", "no such file");
    refuse("  - { name: a, mesh: a.obj }\n", "should end with .stl");
    refuse("  - { name: a, ball: { at: [0,0,0] } }\n", "ball");
}

/* ---- files --------------------------------------------------------------------------------------- */

static const double *t_box(double k, double t[12 * 9])
{
    box_mesh((double[]){-0.25 * k, -0.125 * k, 0.25 * k}, (double[]){0.25 * k, 0.125 * k, 0.5 * k},
             t);
    return t;
}

static void write_stl(const char *path, const double *t, size_t n, bool binary)
{
    FILE *f = fopen(path, "wb");
    uint32_t count = (uint32_t)n;
    char head[80] = "made for a test";
    if (binary) {
        fwrite(head, 1, 80, f);
        fwrite(&count, 4, 1, f);
    } else {
        fputs("solid a\n", f);
    }
    for (size_t i = 0; i < n; i++) {
        float v[12] = {0};
        for (int k = 0; k < 9; k++)
            v[3 + k] = (float)t[9 * i + (size_t)k];
        if (binary) {
            fwrite(v, 4, 12, f);
            fwrite("\0", 1, 2, f);
            continue;
        }
        fputs(" facet normal 0 0 0\n  outer loop\n", f);
        for (int k = 1; k < 4; k++)
            fprintf(f, "   vertex %.9g %.9g %.9g\n", v[3 * k], v[3 * k + 1], v[3 * k + 2]);
        fputs("  endloop\n endfacet\n", f);
    }
    if (!binary)
        fputs("endsolid a\n", f);
    fclose(f);
}

/* A rig beside the mesh `file`. */
static pvx_err load(const char *file, const char *more, struct rec_rig *r, struct pvx_diag *d)
{
    FILE *f = fopen(at("rig.yaml"), "w");
    fprintf(f, "%sbodies:\n  - { name: a, mesh: %s%s }\n", HEAD, file, more);
    fclose(f);
    d->text[0] = '\0';
    return rec_rig_load(at("rig.yaml"), r, d);
}

static void refuse_mesh(const char *file, const char *part)
{
    struct rec_rig r;
    struct pvx_diag d;
    T_OK(load(file, "", &r, &d) != PVX_OK);
    T_CONTAINS(d.text, part);
    T_CONTAINS(d.text, file);
}

/* What a mesh of a box hits is what the box hits. */
static void like_the_box(const struct rec_rig *r)
{
    struct rec_body box = {
        .kind = REC_BODY_BOX, .a = {-0.25, -0.125, 0.25}, .b = {0.25, 0.125, 0.5}};
    const struct rec_bodies one = {1, &box};
    int hits = 0;
    for (int i = 0; i < 500; i++) {
        double o[3] = {t_uniform(-2, 2), t_uniform(-2, 2), 3}, d[3], len = 0;
        for (int a = 0; a < 3; a++) {
            d[a] = t_uniform(-0.3, 0.3) - o[a];
            len += d[a] * d[a];
        }
        for (int a = 0; a < 3; a++)
            d[a] /= sqrt(len);
        double want = rec_body_hit(&one, o, d), got = rec_body_hit(&r->bodies, o, d);
        T_OK(isfinite(want) == isfinite(got));
        if (isfinite(want))
            T_NEAR(got, want, 1e-12);
        hits += isfinite(want);
    }
    T_OK(hits > 50);
}

T_CASE(meshes_of_every_kind)
{
    static const char *const files[] = {"a.stl", "b.stl", "mm.stl"};
    double t[12 * 9];
    struct rec_rig r, again;
    struct pvx_diag d;
    char *text;
    size_t len;
    write_stl(at("a.stl"), t_box(1, t), 12, false);
    write_stl(at("b.stl"), t_box(1, t), 12, true);
    write_stl(at("mm.stl"), t_box(1024, t), 12, true);
    for (int i = 0; i < 3; i++) {
        T_EQ_I(load(files[i], i == 2 ? ", scale: 0.0009765625" : "", &r, &d), PVX_OK);
        T_EQ_S(d.text, "");
        if (d.text[0] != '\0')
            continue;
        like_the_box(&r);
        T_EQ_I(rec_rig_format(&r, &text, &len), PVX_OK); /* from anywhere */
        T_EQ_I(rec_rig_parse(text, len, "/elsewhere/rig.yaml", &again, &d), PVX_OK);
        T_OK(rec_rig_hash(&again) == rec_rig_hash(&r));
        free(text);
        rec_rig_fini(&again);
        rec_rig_fini(&r);
    }
}

T_CASE(meshes_that_are_refused)
{
    double t[12 * 9];
    refuse_mesh("nothing.stl", "no such file");
    T_EQ_I(mkfifo(at("pipe.stl"), 0600), 0);
    refuse_mesh("pipe.stl", "is a named pipe");
    write_stl(at("mm.stl"), t_box(1000, t), 12, true);
    refuse_mesh("mm.stl", "scale: 0.001");
    write_stl(at("hole.stl"), t_box(1, t), 11, false);
    refuse_mesh("hole.stl", "not closed");
    t[13] = NAN;
    write_stl(at("nan.stl"), t, 12, true);
    refuse_mesh("nan.stl", "not a number");
    size_t n = REC_MESH_MAX / 12 * 12 + 12;
    double *many = malloc(n * 9 * sizeof *many);
    for (size_t i = 0; i < n; i += 12)
        box_mesh((double[]){0, 0, 0}, (double[]){1, 1, 1}, many + 9 * i);
    write_stl(at("many.stl"), many, n, true);
    free(many);
    refuse_mesh("many.stl", "simplify");
    if (truncate(at("hole.stl"), 400L << 20) == 0) /* a hole in the file system too */
        refuse_mesh("hole.stl", "simplify");
}

T_MAIN(scratch_new(), scratch_remove())
