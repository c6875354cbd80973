/* cmd_render.c - `pyrovox render`: a view of a volume, from a camera of the rig or a turntable. */
#include <argp.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "base/yaml.h"
#include "capture/imgio.h"
#include "cli/cli.h"
#include "daemon/strip.h"
#include "daemon/volume_file.h"
#include "recon/render.h"

struct args {
    const char *rig, *camera, *volume, *out;
    bool orbit;
    int size_given;
    struct dmn_strip_params view; /* sub, exposure and gamma serve the rig's cameras too */
    unsigned threads;
};

enum {
    OPT_RIG = 0x100,
    OPT_CAMERA,
    OPT_ORBIT,
    OPT_STRIP,
    OPT_SIZE,
    OPT_SUB,
    OPT_GAMMA,
    OPT_EXPOSURE,
    OPT_ELEVATION,
    OPT_THREADS
};

static const struct argp_option options[] = {
    {"rig", OPT_RIG, "FILE", 0, "rig.yaml that has the camera (and the box of a bare .npy)", 0},
    {"camera", OPT_CAMERA, "NAME", 0, "view of this camera, distortion included", 0},
    {"orbit", OPT_ORBIT, "DEG", 0, "turntable view at this angle instead", 0},
    {"strip", OPT_STRIP, "A0,A1,N", 0, "N turntable views from A0 to A1 degrees side by side", 0},
    {"size", OPT_SIZE, "WxH", 0, "pixels of one turntable view (default 240x320)", 0},
    {"elevation", OPT_ELEVATION, "DEG", 0, "turntable camera above the horizon (default 5)", 0},
    {"sub", OPT_SUB, "N", 0, "N x N rays per pixel (default 2)", 0},
    {"exposure", OPT_EXPOSURE, "F|auto", 0,
     "factor on the values (default 1; turntable to .png: auto)", 0},
    {"gamma", OPT_GAMMA, "G", 0, ".png only: display gamma (default 1; turntable: 2.2)", 0},
    {"threads", OPT_THREADS, "N", 0, "threads to work with (0: one per CPU)", 0},
    {0},
};

static double number(struct argp_state *state, const char *what, const char *s, double lo,
                     double hi)
{
    double v = lo;
    if (pvx_parse_double(s, lo, hi, &v) != PVX_OK)
        argp_error(state, "%s %s: should be a number from %g to %g", what, s, lo, hi);
    return v;
}

/* Up to `max` numbers separated by `sep`; how many, 0 when one is not a number. */
static int split(const char *s, char sep, double *v, int max)
{
    char copy[96];
    if (strlen(s) >= sizeof copy)
        return 0;
    memcpy(copy, s, strlen(s) + 1);
    const char stop[2] = {sep, '\0'};
    char *rest = copy, *item;
    int n = 0;
    while ((item = strsep(&rest, stop)) != NULL)
        if (n == max || pvx_parse_double(item, -1e6, 1e6, &v[n++]) != PVX_OK)
            return 0;
    return n;
}

static error_t parse(int key, char *arg, struct argp_state *state)
{
    struct args *a = state->input;
    double v[3];
    switch (key) {
    case OPT_RIG: a->rig = arg; return 0;
    case OPT_CAMERA: a->camera = arg; return 0;
    case OPT_ORBIT:
        a->orbit = true;
        a->view.deg0 = a->view.deg1 = number(state, "--orbit", arg, -3600, 3600);
        a->view.views = 1;
        return 0;
    case OPT_STRIP:
        if (split(arg, ',', v, 3) != 3 || v[2] < 1 || v[2] > 64 || v[2] != floor(v[2]))
            argp_error(state, "--strip %s: should be A0,A1,N: degrees, degrees, 1 to 64 views",
                       arg);
        a->orbit = true;
        a->view.deg0 = v[0];
        a->view.deg1 = v[1];
        a->view.views = (int)v[2];
        return 0;
    case OPT_SIZE:
        if (split(arg, 'x', v, 2) != 2 || v[0] < 1 || v[0] > 8192 || v[1] < 1 || v[1] > 8192)
            argp_error(state, "--size %s: should be WxH, up to 8192x8192", arg);
        a->view.width = (int32_t)v[0];
        a->view.height = (int32_t)v[1];
        a->size_given = 1;
        return 0;
    case OPT_ELEVATION:
        a->view.elevation_deg = number(state, "--elevation", arg, -85, 85);
        return 0;
    case OPT_SUB: a->view.sub = (int)number(state, "--sub", arg, 1, REC_RENDER_SUB_MAX); return 0;
    case OPT_EXPOSURE:
        a->view.exposure =
            strcmp(arg, "auto") == 0 ? 0 : number(state, "--exposure", arg, 1e-9, 1e9);
        return 0;
    case OPT_GAMMA: a->view.gamma = number(state, "--gamma", arg, 0.1, 10); return 0;
    case OPT_THREADS: a->threads = (unsigned)number(state, "--threads", arg, 0, 256); return 0;
    case ARGP_KEY_ARG:
        if (state->arg_num == 0)
            a->volume = arg;
        else if (state->arg_num == 1)
            a->out = arg;
        else
            return ARGP_ERR_UNKNOWN;
        return 0;
    case ARGP_KEY_END:
        if (a->out == NULL)
            argp_error(state, "which volume, and where to?  VOL.npy OUT.(png|npy)");
        if (a->orbit == (a->camera != NULL))
            argp_error(state, "one of --camera NAME, --orbit DEG and --strip A0,A1,N is needed");
        if (a->camera != NULL && a->rig == NULL)
            argp_error(state, "--camera needs --rig FILE, which has the camera");
        if (a->camera != NULL && a->size_given)
            argp_error(state, "--size is for --orbit and --strip; a camera has its own");
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp parser = {
    options,
    parse,
    "VOL.npy OUT.(png|npy)",
    "Render a view of a reconstructed volume by direct forward projection.\v"
    "Box and basis come from the .json beside the .npy, else from the rig.  A .npy image is "
    "float32 "
    "[h][w][channels], unclipped, in the units of the input images; a .png is clipped to 0..1.\n\n"
    "  pyrovox render --rig rig.yaml --camera cam7 out/000000.npy cam7.npy\n"
    "  pyrovox render --strip 0,120,5 out/000000.npy turn.png\n",
    NULL,
    NULL,
    NULL};

/* One camera of the rig. */
static pvx_err view_of_camera(const struct args *a, const struct rec_rig *rig,
                              const struct rec_grid *g, const float *dense, int nch, pvx_pool *pool,
                              struct pvx_diag *d)
{
    int k = rec_rig_find(rig, a->camera);
    if (k < 0) {
        char names[400] = "";
        for (size_t i = 0; i < rig->n_cameras && strlen(names) < 300; i++)
            snprintf(names + strlen(names), sizeof names - strlen(names), " %s",
                     rig->cameras[i].name);
        return pvx_fail(d, PVX_ENOENT, "%s: no camera '%s'; it has%s", a->rig, a->camera, names);
    }
    const struct rec_camera *c = &rig->cameras[k];
    size_t n = (size_t)c->width * (size_t)c->height * (size_t)nch;
    float *image = pvx_calloc(n, sizeof *image);
    if (image == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for the image", a->out);
    pvx_err e = rec_render(g, dense, nch, c, a->view.sub, pool, image);
    for (size_t i = 0; i < n && a->view.exposure > 0; i++)
        image[i] *= (float)a->view.exposure;
    if (e == PVX_OK)
        e = cap_image_save(a->out, image, c->width, c->height, nch, a->view.gamma, d);
    free(image);
    return e;
}

static int run(int argc, char **argv)
{
    struct args a = {.view = dmn_strip_defaults};
    a.view.gamma = a.view.exposure = -1; /* not given */
    argp_err_exit_status = 2;
    argp_parse(&parser, argc, argv, 0, NULL, &a);
    size_t n = strlen(a.out);
    bool png = n > 4 && strcmp(a.out + n - 4, ".png") == 0;
    if (a.view.gamma < 0)
        a.view.gamma = a.orbit ? 2.2 : 1;
    if (a.view.exposure < 0)
        a.view.exposure = a.orbit && png ? 0 : 1;
    struct pvx_diag d = {""};
    struct rec_rig rig = {.grid = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {1, 1, 1}, REC_BOX}};
    struct rec_grid g;
    pvx_pool *pool = NULL;
    float *dense = NULL;
    int nch;
    pvx_err e = PVX_OK;
    if (a.rig != NULL)
        e = rec_rig_load(a.rig, &rig, &d);
    g = rig.grid;
    if (e == PVX_OK)
        e = dmn_volume_load(a.volume, &g, &nch, &dense, &d);
    if (e == PVX_OK)
        e = pvx_pool_new(a.threads, "render", &pool);
    if (e == PVX_OK)
        e = a.orbit ? dmn_strip_save(&g, dense, nch, &a.view, pool, a.out, &d)
                    : view_of_camera(&a, &rig, &g, dense, nch, pool, &d);
    pvx_pool_free(&pool);
    free(dense);
    rec_rig_fini(&rig);
    return e == PVX_OK ? 0 : cli_error(&d, e);
}

const struct cli_command cmd_render = {"render", "view of a volume from a camera or a turntable",
                                       run};
