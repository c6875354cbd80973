/* Reads mesh files as a whole; mesh_stl.c and mesh_ply.c decode them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "base/file.h"
#include "base/mem.h"
#include "recon/geom/body.h"
#include "recon/geom/mesh_file.h"

/* Enough for a million triangles as text.  A file of ten million is refused before it is read. */
#define FILE_MAX (300L << 20)

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

/* Only the formats that programs for scans and for parts write. */
static pvx_err readable(const char *path, struct pvx_diag *d)
{
    struct stat st;
    const char *dot = strrchr(path, '.');
    if (dot == NULL || (strcasecmp(dot, ".stl") != 0 && strcasecmp(dot, ".ply") != 0))
        return pvx_fail(d, PVX_EFORMAT,
                        "should end with .stl or .ply; export the mesh as one of these");
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
    struct rec_mesh_file f = {
        .start = bytes, .at = bytes, .end = bytes + len, .scale = scale, .d = d};
    bool ply = strcasecmp(strrchr(path, '.'), ".ply") == 0;
    pvx_err e = ply ? rec_mesh_ply(&f) : rec_mesh_stl(&f);
    free(bytes);
    if (e == PVX_OK)
        e = rec_mesh_new(f.corner, f.n, out, d);
    free(f.corner);
    if (e == PVX_OK && (e = of_this_size(*out, side, d)) != PVX_OK)
        rec_mesh_free(out);
    return e;
}
