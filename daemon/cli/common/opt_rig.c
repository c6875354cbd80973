#include "daemon/cli/common/opt_rig.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/yaml.h"
#include "daemon/cli/common/arg.h"
#include "daemon/config/config.h"
#include "daemon/pipeline/photometry.h"

enum { OPT_GRID = 0x700 };

#define AT(field) CLI_AT(struct opt_rig, field)

static const struct cli_row rows[] = {
    {.help = "Rig and system matrix:"},
    {"rig", "FILE", AT(path), 0, 0, "rig.yaml: volume, camera poses and lenses"},
    {"cameras", "A,B,...", AT(cameras), 0, 0, "use these cameras only"},
    {"grid", "N|NX,NY,NZ|auto", CLI_KEY(OPT_GRID), 0, 0,
     "voxels along x, y, z, instead of the rig's. auto: the finest grid that the pictures support "
     "(no voxel under 0.7 pixels, at most 20 unknowns to a measured value, at most 256 voxels)"},
    {"basis", "box|trilinear", AT(basis), 0, 0,
     "basis function, instead of the rig's (default where the rig names none: trilinear; box is "
     "faster)"},
    {"binning", "N|auto", AT(matrix.binning), 1, 64,
     "raw pixels per bin side; must divide the image sizes (auto: a bin is at most 1.1 voxels)"},
    {"rays", "N|auto", AT(matrix.rays_per_bin), 1, 16,
     "N x N rays per bin (auto: 2, the mean over its area; 1 is faster and less accurate)"},
    {"threads", "N", AT(threads), 0, 256, "number of threads (0: one per CPU that it may use)"},
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

static error_t opt_rig_parse(int key, char *arg, struct argp_state *state)
{
    struct opt_rig *o = state->input;
    switch (key) {
    case OPT_GRID:
        o->grid_auto = strcmp(arg, "auto") == 0;
        if (o->grid_auto)
            memset(o->grid, 0, sizeof o->grid);
        else if (!opt_rig_parse_grid(arg, o->grid))
            argp_error(state, "--grid %s: should be auto, N or NX,NY,NZ with 1 to %d voxels each",
                       arg, REC_GRID_MAX);
        o->grid_one = strchr(arg, ',') == NULL;
        return 0;
    default: return cli_row(rows, key, arg, state, o);
    }
}

const struct argp *opt_rig_argp(void)
{
    static struct argp_option options[sizeof rows / sizeof *rows];
    static struct argp argp = {.parser = opt_rig_parse};
    argp.options = cli_rows(rows, options);
    return &argp;
}

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
    PVX_THEN(e, dmn_config_sees(out, o->path, d));
    if (e == PVX_OK && o->grid_auto)
        e = opt_rig_finest(o, out, d);
    if (e != PVX_OK)
        rec_rig_fini(out);
    return e;
}

/* Meshes in the folder of the file `to` or below get names relative to it, so that the folder can be moved as a
 * whole.  Other meshes keep absolute names. */
static void name_meshes(struct rec_rig *rig, const char *to)
{
    char name[PATH_MAX], folder[PATH_MAX];
    const char *slash = strrchr(to, '/');
    snprintf(name, sizeof name, "%.*s", slash == NULL ? 1 : (int)(slash - to) + 1,
             slash == NULL ? "." : to);
    if (realpath(name, folder) == NULL) /* writing the file will report the reason */
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
    PVX_THEN(e, rec_rig_format(&there, &text, &len));
    rec_rig_fini(&there);
    PVX_THEN(e, pvx_file_write(to, text, len, d));
    free(text);
    return e == PVX_OK ? e : pvx_fail(d, e, "%s: %s", to, pvx_strerror(e));
}
