/* fuzz_mesh.c - any bytes behind the first as a mesh file.
 * Refused in one line, or a closed body of finite size at which rays end or do not. */
#include <math.h>
#include <string.h>
#include <unistd.h>

#include "recon/geom/body.h"
#include "tests/fuzz/fuzz.h"

static void use(struct rec_mesh *m)
{
    struct rec_body b = {.kind = REC_BODY_MESH, .scale = 1, .mesh = m};
    const struct rec_bodies one = {1, &b};
    double min[3], max[3];
    rec_mesh_box(m, min, max);
    for (int a = 0; a < 3; a++)
        MUST(isfinite(min[a]) && isfinite(max[a]) && min[a] <= max[a]);
    for (int a = 0; a < 3; a++) {
        double o[3], d[3] = {0};
        for (int k = 0; k < 3; k++)
            o[k] = 0.5 * (min[k] + max[k]);
        (void)rec_body_inside(&b, o);
        o[a] = min[a] - 1;
        d[a] = 1;
        double t = rec_body_hit(&one, o, d);
        MUST(t >= 0); /* not NaN either; INFINITY where it meets nothing */
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static char name[64]; /* written over again and again */
    struct pvx_diag d = {""};
    struct rec_mesh *m;
    if (size == 0)
        return 0;
    if (name[0] == '\0')
        snprintf(name, sizeof name, "/dev/shm/pvx_fuzz_mesh_%d.stl", (int)getpid());
    FILE *f = fopen(name, "wb");
    MUST(f != NULL);
    MUST(fwrite(data + 1, 1, size - 1, f) == size - 1);
    MUST(fclose(f) == 0);
    pvx_err e = rec_mesh_load(name, 1, 1, &m, &d);
    MUST(unlink(name) == 0);
    if (e == PVX_OK) {
        fuzz_taken++;
        use(m);
        rec_mesh_free(&m);
    } else {
        MUST(m == NULL && strchr(d.text, '\n') == NULL);
        MUST(e == PVX_ENOMEM || d.text[0] != '\0');
    }
    return 0;
}
