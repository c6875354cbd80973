/* Any bytes as a rig.yaml: refused with a message, or a rig that is sound and reads back the same.
 * Beside it lies a mesh, m.stl. */
#include <math.h>
#include <string.h>
#include <unistd.h>

#include "recon/geom/rig.h"
#include "recon/matrix/sysmat.h"
#include "tests/fuzz/fuzz.h"

static void use(const struct rec_rig *r)
{
    for (size_t i = 0; i < r->n_cameras; i++) {
        const struct rec_camera *c = &r->cameras[i];
        double o[3], d[3], uv[2], X[3];
        for (int q = 0; q < 4; q++)
            if (rec_camera_ray(c, q & 1 ? c->width : -0.5, q & 2 ? c->height : -0.5, o, d)) {
                MUST(isfinite(d[0]) && isfinite(d[1]) && isfinite(d[2]));
                for (int a = 0; a < 3; a++)
                    X[a] = o[a] + d[a];
                if (rec_camera_project(c, X, uv))
                    MUST(isfinite(uv[0]) && isfinite(uv[1]));
            }
    }
    struct rec_sysmat_params p;
    MUST(rec_sysmat_resolve(r, &rec_sysmat_defaults, &p, NULL) == PVX_OK);
}

static char folder[] = "/dev/shm/fuzz_rig-XXXXXX", rig[64], mesh[64];

static void remove_all(void)
{
    unlink(mesh);
    rmdir(folder);
}

static void make(void)
{
    static const int corner[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    static const int side[4][3] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
    MUST(mkdtemp(folder) != NULL && atexit(remove_all) == 0);
    snprintf(mesh, sizeof mesh, "%s/m.stl", folder);
    FILE *f = fopen(mesh, "w");
    MUST(f != NULL);
    fputs("solid m\n", f);
    for (int i = 0; i < 4; i++) {
        fputs("facet normal 0 0 0\nouter loop\n", f);
        for (int k = 0; k < 3; k++) {
            const int *v = corner[side[i][k]];
            fprintf(f, "vertex %d %d %d\n", v[0], v[1], v[2]);
        }
        fputs("endloop\nendfacet\n", f);
    }
    fputs("endsolid m\n", f);
    MUST(fclose(f) == 0);
    snprintf(rig, sizeof rig, "%s/rig.yaml", folder);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct rec_rig r, again;
    struct pvx_diag d = {""};
    if (rig[0] == '\0')
        make();
    pvx_err e = rec_rig_parse((const char *)data, size, rig, &r, &d);
    if (e != PVX_OK) {
        MUST(d.text[0] != '\0' && strchr(d.text, '\n') == NULL);
        MUST(r.cameras == NULL);
        return 0;
    }
    fuzz_taken++;
    use(&r);
    char *text;
    size_t len;
    MUST(rec_rig_format(&r, &text, &len) == PVX_OK);
    MUST(rec_rig_parse(text, len, "again", &again, &d) == PVX_OK);
    MUST(rec_rig_hash(&r) == rec_rig_hash(&again));
    free(text);
    rec_rig_fini(&again);
    rec_rig_fini(&r);
    return 0;
}
