#include "recon/geom/rig_bodies.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define MAX_COORD 1e6 /* m, as in rig.c */

struct reader {
    const pvx_yaml *y;
    const char *name; /* of the file */
    const struct rec_rig *rig;
    struct pvx_diag *d;
};

static pvx_err rig_bodies_three(const struct reader *r, int map, const char *path, const char *key,
                                double out[3])
{
    char full[96];
    int node = pvx_yaml_get(r->y, map, key);
    if (node == 0)
        return pvx_yaml_fail(r->y, map, path, PVX_EFORMAT, r->d, "the key '%s' is missing", key);
    snprintf(full, sizeof full, "%s.%s", path, key);
    PVX_TRY(pvx_yaml_doubles(r->y, node, full, 3, 3, out, r->d));
    for (int a = 0; a < 3; a++)
        if (!(fabs(out[a]) <= MAX_COORD))
            return pvx_yaml_fail(r->y, node, full, PVX_EINVAL, r->d, "%g is outside %g..%g", out[a],
                                 -MAX_COORD, MAX_COORD);
    return PVX_OK;
}

static pvx_err read_box(const struct reader *r, int m, const char *path, struct rec_body *b)
{
    b->kind = REC_BODY_BOX;
    PVX_TRY(pvx_yaml_known(r->y, m, path, "min max", r->d));
    PVX_TRY(rig_bodies_three(r, m, path, "min", b->a));
    PVX_TRY(rig_bodies_three(r, m, path, "max", b->b));
    for (int a = 0; a < 3; a++)
        if (!(b->b[a] > b->a[a]))
            return pvx_yaml_fail(r->y, m, path, PVX_EINVAL, r->d,
                                 "the box is empty along %c: max %g is not above min %g", "xyz"[a],
                                 b -> b[a], b -> a[a]);
    return PVX_OK;
}

static pvx_err read_cylinder(const struct reader *r, int m, const char *path, struct rec_body *b)
{
    double l2 = 0;
    int node;
    b->kind = REC_BODY_CYLINDER;
    PVX_TRY(pvx_yaml_known(r->y, m, path, "from to radius", r->d));
    PVX_TRY(rig_bodies_three(r, m, path, "from", b->a));
    PVX_TRY(rig_bodies_three(r, m, path, "to", b->b));
    if ((node = pvx_yaml_get(r->y, m, "radius")) == 0)
        return pvx_yaml_fail(r->y, m, path, PVX_EFORMAT, r->d, "the key 'radius' is missing");
    char full[96];
    snprintf(full, sizeof full, "%s.radius", path);
    PVX_TRY(pvx_yaml_double(r->y, node, full, 1e-9, MAX_COORD, &b->radius, r->d));
    for (int a = 0; a < 3; a++)
        l2 += (b->b[a] - b->a[a]) * (b->b[a] - b->a[a]);
    if (!(l2 >= 1e-18))
        return pvx_yaml_fail(r->y, m, path, PVX_EINVAL, r->d,
                             "the cylinder has no length: from and to are the same point");
    return PVX_OK;
}

/* The absolute path of the file: a rig that is written elsewhere still finds it. */
static pvx_err find_file(const struct reader *r, const char *file, char out[REC_BODY_FILE])
{
    char path[PATH_MAX], full[PATH_MAX];
    const char *slash = file[0] == '/' ? NULL : strrchr(r->name, '/');
    int folder = slash == NULL ? 0 : (int)(slash - r->name) + 1;
    int n = snprintf(path, sizeof path, "%.*s%s", folder, r->name, file);
    if (n < 0 || (size_t)n >= sizeof path)
        return PVX_ERANGE;
    const char *best = realpath(path, full) != NULL ? full : path;
    n = snprintf(out, REC_BODY_FILE, "%s", best);
    return n < REC_BODY_FILE ? PVX_OK : PVX_ERANGE;
}

static pvx_err read_mesh(const struct reader *r, int body, int node, const char *path,
                         struct rec_body *b)
{
    struct pvx_diag why = {""};
    const struct rec_grid *g = &r->rig->grid;
    double side = 0;
    int scale = pvx_yaml_get(r->y, body, "scale");
    b->kind = REC_BODY_MESH;
    b->scale = 1;
    if (scale != 0)
        PVX_TRY(pvx_yaml_double(r->y, scale, "scale", 1e-9, 1e9, &b->scale, r->d));
    for (int a = 0; a < 3; a++)
        side = fmax(side, g->max[a] - g->min[a]);
    if (pvx_yaml_kind(r->y, node) != PVX_YAML_SCALAR)
        return pvx_yaml_fail(r->y, node, path, PVX_EFORMAT, r->d,
                             "should be the name of an STL file");
    const char *file = pvx_yaml_text(r->y, node);
    if (file[strcspn(file, "\"\\")] != '\0' || find_file(r, file, b->file) != PVX_OK)
        return pvx_yaml_fail(r->y, node, path, PVX_EINVAL, r->d,
                             "the path is longer than %d characters or has a quote in it; "
                             "rename the file",
                             REC_BODY_FILE - 1);
    pvx_err e = rec_mesh_load(b->file, b->scale, side, &b->mesh, &why);
    if (e != PVX_OK)
        return pvx_yaml_fail(r->y, node, path, e, r->d, "%.300s: %.600s", file,
                             pvx_diag_text(&why, e));
    return PVX_OK;
}

static pvx_err read_shape(const struct reader *r, int m, const char *path, struct rec_body *b)
{
    static const char *const keys[] = {"box", "cylinder", "mesh"};
    char full[80];
    int node[3], shapes = 0, k = 0;
    for (int i = 0; i < 3; i++)
        if ((node[i] = pvx_yaml_get(r->y, m, keys[i])) != 0) {
            shapes++;
            k = i;
        }
    if (shapes != 1)
        return pvx_yaml_fail(r->y, m, path, PVX_EFORMAT, r->d,
                             "should have one of the keys box, cylinder and mesh");
    snprintf(full, sizeof full, "%s.%s", path, keys[k]);
    if (k != 2 && pvx_yaml_get(r->y, m, "scale") != 0)
        return pvx_yaml_fail(r->y, m, path, PVX_EFORMAT, r->d,
                             "the key 'scale' belongs to a mesh; a %s is in metres", keys[k]);
    if (k == 2)
        return read_mesh(r, m, node[2], full, b);
    return k == 0 ? read_box(r, node[0], full, b) : read_cylinder(r, node[1], full, b);
}

/* A camera inside a body sees nothing of the flame. */
static pvx_err outside(const struct reader *r, int m, const char *path, const struct rec_body *b)
{
    for (size_t c = 0; c < r->rig->n_cameras; c++) {
        double x[3];
        rec_camera_centre(&r->rig->cameras[c], x);
        if (rec_body_inside(b, x))
            return pvx_yaml_fail(
                r->y, m, path, PVX_EINVAL, r->d,
                "camera %s stands inside the body '%s'; correct the body, it is in "
                "metres in the rig's world",
                r->rig->cameras[c].name, b->name);
    }
    return PVX_OK;
}

static pvx_err read_body(const struct reader *r, int m, const char *path,
                         const struct rec_bodies *before, struct rec_body *b)
{
    PVX_TRY(pvx_yaml_known(r->y, m, path, "name box cylinder mesh scale", r->d));
    int node = pvx_yaml_get(r->y, m, "name");
    const char *name = pvx_yaml_text(r->y, node);
    if (!rec_rig_name_ok(name))
        return pvx_yaml_fail(r->y, node != 0 ? node : m, path, PVX_EINVAL, r->d,
                             "name: should be 1 to %d of A-Z a-z 0-9 . _ -", REC_BODY_NAME - 1);
    for (size_t i = 0; i < before->n; i++)
        if (strcmp(before->body[i].name, name) == 0)
            return pvx_yaml_fail(r->y, node, path, PVX_EINVAL, r->d, "'%s' is used twice", name);
    snprintf(b->name, sizeof b->name, "%s", name);
    PVX_TRY(read_shape(r, m, path, b));
    return outside(r, m, path, b);
}

pvx_err rec_bodies_read(const pvx_yaml *y, int seq, const char *name, const struct rec_rig *rig,
                        struct rec_bodies *out, struct pvx_diag *d)
{
    const struct reader r = {y, name, rig, d};
    size_t n = pvx_yaml_length(y, seq);
    *out = (struct rec_bodies){0};
    if (pvx_yaml_kind(y, seq) != PVX_YAML_SEQ || n > REC_BODIES_MAX)
        return pvx_yaml_fail(y, seq, "bodies", PVX_EFORMAT, d,
                             "should be a list of at most %d bodies (- name: ...)", REC_BODIES_MAX);
    if (n == 0)
        return PVX_OK;
    out->body = pvx_calloc(n, sizeof *out->body);
    if (out->body == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < n; i++) {
        char path[32];
        snprintf(path, sizeof path, "bodies[%zu]", i);
        pvx_err e = read_body(&r, pvx_yaml_item(y, seq, i), path, out, &out->body[i]);
        if (e != PVX_OK) {
            rec_mesh_free(&out->body[i].mesh);
            return e;
        }
        out->n++;
    }
    return PVX_OK;
}

static void put_three(FILE *f, const char *key, const double v[3])
{
    fprintf(f, "%s: [%.17g, %.17g, %.17g]", key, v[0], v[1], v[2]);
}

void rec_bodies_write(FILE *f, const struct rec_bodies *b)
{
    if (b->n > 0)
        fputs("bodies:\n", f);
    for (size_t i = 0; i < b->n; i++) {
        const struct rec_body *o = &b->body[i];
        fprintf(f, "  - name: \"%s\"\n", o->name);
        if (o->kind == REC_BODY_MESH) {
            fprintf(f, "    mesh: \"%s\"\n    scale: %.17g\n", o->file, o->scale);
            continue;
        }
        bool box = o->kind == REC_BODY_BOX;
        put_three(f, box ? "    box: { min" : "    cylinder: { from", o->a);
        put_three(f, box ? ", max" : ", to", o->b);
        if (!box)
            fprintf(f, ", radius: %.17g", o->radius);
        fputs(" }\n", f);
    }
}

size_t rec_body_numbers(const struct rec_body *b, double out[8])
{
    out[0] = b->kind;
    if (b->kind == REC_BODY_MESH) {
        uint64_t h = rec_mesh_hash(b->mesh);
        out[1] = (double)(uint32_t)h;
        out[2] = (double)(uint32_t)(h >> 32);
        return 3;
    }
    memcpy(out + 1, b->a, sizeof b->a);
    memcpy(out + 4, b->b, sizeof b->b);
    out[7] = b->radius;
    return 8;
}
