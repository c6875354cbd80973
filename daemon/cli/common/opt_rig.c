#include "daemon/cli/common/opt_rig.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/yaml.h"
#include "daemon/cli/common/arg.h"
#include "daemon/pipeline/photometry.h"

enum { OPT_RIG = 0x700, OPT_CAMERAS, OPT_GRID, OPT_BASIS, OPT_BINNING, OPT_RAYS, OPT_THREADS };

static const struct argp_option options[] = {
    {NULL, 0, NULL, 0, "Rig and system matrix:", 1},
    {"rig", OPT_RIG, "FILE", 0, "rig.yaml: volume, camera poses and lenses", 1},
    {"cameras", OPT_CAMERAS, "A,B,...", 0, "use these cameras only", 1},
    {"grid", OPT_GRID, "N|NX,NY,NZ|auto", 0,
     "voxels along x, y, z, instead of the rig's (auto: the finest that the pictures hold: no "
     "voxel under 0.7 pixels, at most 20 unknowns to a measured value, at most 256 voxels)",
     1},
    {"basis", OPT_BASIS, "box|trilinear", 0,
     "basis function, instead of the rig's (one that says nothing: trilinear; box is faster)", 1},
    {"binning", OPT_BINNING, "N|auto", 0,
     "raw pixels per bin side; must divide the image sizes (auto: a bin is at most 1.1 voxels)", 1},
    {"rays", OPT_RAYS, "N|auto", 0,
     "N x N rays per bin (auto: 2, the mean over its area; 1 is faster and less accurate)", 1},
    {"threads", OPT_THREADS, "N", 0, "threads to work with (0: one per CPU that it may use)", 1},
    {0},
};

bool opt_rig_parse_grid(const char *s, int32_t n[3])
{
    char copy[64];
    if (strlen(s) >= sizeof copy)
        return false;
    snprintf(copy, sizeof copy, "%s", s);
    int got = 0;
    char *rest = copy, *item;
    while ((item = strsep(&rest, ",")) != NULL) {
        int64_t v;
        if (got == 3 || pvx_parse_int(item, 1, REC_GRID_MAX, &v) != PVX_OK)
            return false;
        n[got++] = (int32_t)v;
    }
    if (got == 1)
        n[1] = n[2] = n[0];
    return got == 1 || got == 3;
}

static bool parse_auto(const char *s, int64_t max, int32_t *out)
{
    int64_t v = 0;
    if (strcmp(s, "auto") != 0 && pvx_parse_int(s, 1, max, &v) != PVX_OK)
        return false;
    *out = (int32_t)v;
    return true;
}

static error_t opt_rig_parse(int key, char *arg, struct argp_state *state)
{
    struct opt_rig *o = state->input;
    int64_t v = 0;
    switch (key) {
    case OPT_RIG: o->path = arg; return 0;
    case OPT_CAMERAS: o->cameras = arg; return 0;
    case OPT_GRID:
        o->grid_auto = strcmp(arg, "auto") == 0;
        if (o->grid_auto)
            memset(o->grid, 0, sizeof o->grid);
        else if (!opt_rig_parse_grid(arg, o->grid))
            argp_error(state, "--grid %s: should be auto, N or NX,NY,NZ with 1 to %d voxels each",
                       arg, REC_GRID_MAX);
        o->grid_one = strchr(arg, ',') == NULL;
        return 0;
    case OPT_BASIS:
        if (strcmp(arg, "box") == 0)
            o->basis = REC_BOX;
        else if (strcmp(arg, "trilinear") == 0)
            o->basis = REC_TRILINEAR;
        else
            argp_error(state, "--basis %s: should be box or trilinear", arg);
        return 0;
    case OPT_BINNING:
        if (!parse_auto(arg, 64, &o->matrix.binning))
            argp_error(state, "--binning %s: should be auto or 1 to 64", arg);
        return 0;
    case OPT_RAYS:
        if (!parse_auto(arg, 16, &o->matrix.rays_per_bin))
            argp_error(state, "--rays %s: should be auto or 1 to 16", arg);
        return 0;
    case OPT_THREADS:
        cli_arg_int(state, "threads", arg, 0, 256, &v);
        o->threads = (unsigned)v;
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

const struct argp opt_rig_argp = {.options = options, .parser = opt_rig_parse};

pvx_err opt_rig_finest(const struct opt_rig *o, struct rec_rig *rig, struct pvx_diag *d)
{
    int32_t binning = o->matrix.binning > 0 ? o->matrix.binning : 1;
    if (rec_rig_finest(rig, binning, rig->grid.n) != PVX_OK)
        return pvx_fail(d, PVX_EINVAL,
                        "--grid auto: no camera has the middle of the volume in front of it");
    return PVX_OK;
}

pvx_err opt_rig_load(const struct opt_rig *o, struct rec_rig *out, struct pvx_diag *d)
{
    memset(out, 0, sizeof *out);
    if (o->path == NULL)
        return pvx_fail(d, PVX_EINVAL, "which rig?  Give --rig FILE (a rig.yaml)");
    PVX_TRY(rec_rig_load(o->path, out, d));
    for (int a = 0; a < 3; a++)
        if (o->grid[a] != 0)
            out->grid.n[a] = o->grid[a];
    if (o->basis >= 0)
        out->grid.basis = o->basis;
    pvx_err e = o->cameras != NULL ? rec_rig_select(out, o->cameras, d) : PVX_OK;
    if (e == PVX_OK && o->grid_auto)
        e = opt_rig_finest(o, out, d);
    if (e != PVX_OK)
        rec_rig_fini(out);
    return e;
}

/* Meshes that lie beside the file `to` or below are named from there, so that a folder can be moved as a whole; others
 * are named from the root. */
static void name_meshes(struct rec_rig *rig, const char *to)
{
    char name[PATH_MAX], folder[PATH_MAX];
    const char *slash = strrchr(to, '/');
    snprintf(name, sizeof name, "%.*s", slash == NULL ? 1 : (int)(slash - to) + 1,
             slash == NULL ? "." : to);
    if (realpath(name, folder) == NULL) /* writing it will say why */
        return;
    size_t n = strcmp(folder, "/") == 0 ? 0 : strlen(folder);
    for (size_t i = 0; i < rig->bodies.n; i++) {
        char *file = rig->bodies.body[i].file;
        if (rig->bodies.body[i].kind == REC_BODY_MESH && strncmp(file, folder, n) == 0 &&
            file[n] == '/')
            memmove(file, file + n + 1, strlen(file + n + 1) + 1);
    }
}

pvx_err opt_rig_save(const struct rec_rig *rig, const char *from, const char *to,
                     struct pvx_diag *d)
{
    struct rec_rig there = {.n_cameras = 0};
    char *text = NULL;
    size_t len;
    pvx_err e = rec_rig_copy(rig, &there);
    if (e == PVX_OK && from != NULL)
        e = dmn_photometry_move(&there, from, to, d);
    name_meshes(&there, to);
    if (e == PVX_OK)
        e = rec_rig_format(&there, &text, &len);
    rec_rig_fini(&there);
    if (e == PVX_OK)
        e = pvx_file_write(to, text, len, d);
    free(text);
    return e == PVX_OK ? e : pvx_fail(d, e, "%s: %s", to, pvx_strerror(e));
}
