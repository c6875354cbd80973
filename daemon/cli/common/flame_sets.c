#include "daemon/cli/common/flame_sets.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "daemon/cli/common/arg.h"

enum {
    OPT_RIG = 0x900,
    OPT_CAMERAS,
    OPT_FRAMES,
    OPT_FIRST,
    OPT_LAST,
    OPT_SETS,
    OPT_BACKGROUND,
    OPT_BLACK,
    OPT_BINNING,
    OPT_FORMAT,
    OPT_TRANSFER,
    OPT_THREADS,
    OPT_QUIET
};

static const struct argp_option options[] = {
    {"rig", OPT_RIG, "FILE", 0, "rig.yaml: volume, camera poses and lenses", 0},
    {"cameras", OPT_CAMERAS, "A,B,...", 0, "these cameras only", 0},
    {"frames", OPT_FRAMES, "DIR|TAKE.h5", 0,
     "a flame: DIR/<camera>/<6 digits>.(npy|png|tif|jpg), or a take of raw frames", 0},
    {"first", OPT_FIRST, "N", 0, "first frame number", 0},
    {"last", OPT_LAST, "N", 0, "last frame number", 0},
    {"sets", OPT_SETS, "N", 0,
     "look at N frame sets (default 60), of a longer recording runs of 10 spread over it", 0},
    {"background", OPT_BACKGROUND, "DIR", 0,
     "subtract DIR/<camera>.(npy|png|tif), an image of the scene without flame", 0},
    {"black", OPT_BLACK, "X", 0, "black level, share of full scale (default 0)", 0},
    {"binning", OPT_BINNING, "N", 0,
     "raw pixels per bin side (default: so that a picture is at least 160 bins wide)", 0},
    {"pixel-format", OPT_FORMAT, "NAME", 0, "what grey images are, as of `pyrovox reconstruct`", 0},
    {"transfer", OPT_TRANSFER, "auto|linear|srgb|bt709", 0,
     "how samples stand for light (auto: JPEG files srgb, all others linear)", 0},
    {"threads", OPT_THREADS, "N", 0, "threads to work with (0: one per CPU)", 0},
    {"quiet", OPT_QUIET, NULL, 0, "no progress", 0},
    {0}};

static error_t flame_sets_parse(int key, char *arg, struct argp_state *st)
{
    struct flame_sets_args *a = st->input;
    switch (key) {
    case OPT_RIG: a->rig = arg; return 0;
    case OPT_CAMERAS: a->cameras = arg; return 0;
    case OPT_FRAMES: a->frames = arg; return 0;
    case OPT_FIRST: cli_arg_int(st, "first", arg, 0, FRAMES_IN_LAST, &a->first); return 0;
    case OPT_LAST: cli_arg_int(st, "last", arg, 0, FRAMES_IN_LAST, &a->last); return 0;
    case OPT_SETS: cli_arg_int(st, "sets", arg, REC_CHECK_SETS, 10000, &a->sets); return 0;
    case OPT_BACKGROUND: a->background = arg; return 0;
    case OPT_BLACK: a->black = cli_arg_double(st, "black", arg, 0, 1); return 0;
    case OPT_BINNING: cli_arg_int(st, "binning", arg, 1, 64, &a->binning); return 0;
    case OPT_FORMAT: a->reading.fmt = cli_arg_pixfmt(st, arg); return 0;
    case OPT_TRANSFER: a->reading.transfer = cli_arg_transfer(st, arg); return 0;
    case OPT_THREADS: cli_arg_int(st, "threads", arg, 0, 256, &a->threads); return 0;
    case OPT_QUIET: a->quiet = true; return 0;
    case ARGP_KEY_END:
        if (a->rig == NULL)
            argp_error(st, "which rig? --rig rig.yaml");
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

const struct argp flame_sets_argp = {.options = options, .parser = flame_sets_parse};

/* ---- loaded ---- */

/* The k-th of n taken out of `there`, in runs. */
static size_t taken(const struct flame_sets *s, size_t k)
{
    if (s->there == s->n)
        return k;
    size_t runs = (s->n + FLAME_SETS_RUN - 1) / FLAME_SETS_RUN, run = k / FLAME_SETS_RUN;
    size_t last = s->there - (run + 1 < runs ? FLAME_SETS_RUN : s->n - run * FLAME_SETS_RUN);
    size_t start = runs > 1 ? run * last / (runs - 1) : 0, least = run * FLAME_SETS_RUN;
    return (start < least ? least : start) + k % FLAME_SETS_RUN;
}

static pvx_err flame_sets_room(struct frames_in *in, float **at, struct pvx_diag *d)
{
    for (size_t c = 0; c < in->rig->n_cameras; c++)
        if ((at[c] = frames_in_room(in, c)) == NULL)
            return pvx_fail(d, PVX_ENOMEM, "%s: no memory for so many pictures: --sets 20",
                            in->dir);
    return PVX_OK;
}

/* What of it is the flame's: from `top` on pixels are saturated and stay so. */
static void flame_sets_subtract(float *picture, float black, const float *background, size_t n,
                                float top)
{
    for (size_t i = 0; i < n; i++)
        if (!(picture[i] >= top))
            picture[i] -= black + (background != NULL ? background[i] : 0);
}

/* Bins of cameras with photometry may be brighter than full scale, which no check of a sample tells then. */
static void blank_saturated(const struct flame_sets *s, const struct dmn_images *images, size_t c,
                            float *picture)
{
    float top = dmn_images_floats(images, c) ? INFINITY : dmn_images_saturated(images, c);
    top = top > 0 ? 0.999F * top : REC_PHOTO_FULL;
    for (size_t i = 0; i < s->bins[c] * (s->nch == 3 ? 4 : 1); i++)
        if (picture[i] >= top)
            picture[i] = NAN;
}

static pvx_err load_all(struct flame_sets *s, struct frames_in *in, float *const *background,
                        struct pvx_diag *d)
{
    size_t cams = s->rig.n_cameras;
    struct cli_progress bar = {.label = "frames"};
    for (size_t k = 0; k < s->n; k++) {
        float **at = s->picture[k];
        size_t i = taken(s, k);
        PVX_TRY(flame_sets_room(in, at, d));
        s->number[k] = in->number[i];
        uint64_t mask = frames_in_load(in, i, at);
        for (size_t c = 0; c < cams; c++) {
            float black = dmn_photometry_of(s->light, c) != NULL ? 0 : (float)s->a->black;
            if ((mask >> c & 1) == 0) {
                PVX_FREE(at[c]);
                continue;
            }
            if (s->light != NULL)
                blank_saturated(s, in->images, c, at[c]);
            if (background[c] != NULL || black > 0)
                flame_sets_subtract(at[c], black, background[c], s->bins[c],
                                    s->light != NULL ? INFINITY : REC_PHOTO_FULL);
            s->floats = s->floats || dmn_images_floats(in->images, c);
        }
        if (cli_stop || (!s->a->quiet && !cli_progress(&bar, (double)(k + 1) / (double)s->n)))
            return PVX_ECANCELED;
    }
    return PVX_OK;
}

static pvx_err common_flame_sets_load(struct flame_sets *s, struct frames_in *in,
                                      struct pvx_diag *d)
{
    float *background[REC_MAX_CAMERAS] = {0};
    const struct flame_sets_args *a = s->a;
    PVX_TRY(frames_in_open(in, a->frames, (uint32_t)a->first, (uint32_t)a->last, !s->colour, d));
    s->there = in->n;
    s->nch = in->nch;
    s->floats = s->light != NULL;
    s->n = in->n < (size_t)a->sets ? in->n : (size_t)a->sets;
    s->number = pvx_calloc(s->n, sizeof *s->number);
    s->picture = pvx_calloc(s->n, sizeof *s->picture);
    if (s->number == NULL || s->picture == NULL)
        return PVX_ENOMEM;
    PVX_TRY(frames_in_begin(in, s->params.binning, CAP_MOSAIC_DEMOSAIC, d));
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        const struct rec_camera *q = &s->rig.cameras[c];
        s->bins[c] = (size_t)(q->width / in->binning) * (size_t)(q->height / in->binning);
        if (s->nch == 3 && (s->plane[c] = pvx_calloc(s->bins[c], sizeof(float))) == NULL)
            return PVX_ENOMEM;
    }
    pvx_err e =
        a->background != NULL ? frames_in_background(in, a->background, background, d) : PVX_OK;
    if (e == PVX_OK)
        e = load_all(s, in, background, d);
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        free(background[c]);
    return e;
}

static pvx_err right_binning(struct flame_sets *s, struct pvx_diag *d)
{
    s->params = (struct rec_unseen_params)REC_UNSEEN_DEFAULTS;
    s->params.binning = (int32_t)s->a->binning;
    s->params.binning = rec_unseen_binning(&s->rig, &s->params);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        const struct rec_camera *q = &s->rig.cameras[c];
        if (q->width % s->params.binning != 0 || q->height % s->params.binning != 0)
            return pvx_fail(d, PVX_EINVAL, "--binning %d does not divide the %d x %d pixels of %s",
                            s->params.binning, q->width, q->height, q->name);
    }
    return PVX_OK;
}

pvx_err flame_sets_load(struct flame_sets *s, const struct flame_sets_args *a, struct pvx_diag *d)
{
    *s = (struct flame_sets){.a = a};
    if (a->frames == NULL)
        return pvx_fail(d, PVX_EINVAL, "which flame? --frames DIR or TAKE.h5");
    PVX_TRY(rec_rig_load(a->rig, &s->rig, d));
    if (a->cameras != NULL)
        PVX_TRY(rec_rig_select(&s->rig, a->cameras, d));
    PVX_TRY(dmn_photometry_load(a->rig, DMN_LIGHT_ALL, &s->rig, &s->own, d));
    s->light = s->own;
    return flame_sets_read(s, d);
}

pvx_err flame_sets_read(struct flame_sets *s, struct pvx_diag *d)
{
    PVX_TRY(right_binning(s, d));
    PVX_TRY(pvx_pool_new((unsigned)s->a->threads, "check", &s->pool));
    struct frames_in in = {
        .rig = &s->rig, .pool = s->pool, .how = s->a->reading, .light = s->light};
    pvx_err e = common_flame_sets_load(s, &in, d);
    frames_in_close(&in);
    return e;
}

void flame_sets_fini(struct flame_sets *s)
{
    for (size_t k = 0; k < s->n && s->picture != NULL; k++)
        for (size_t c = 0; c < s->rig.n_cameras; c++)
            free(s->picture[k][c]);
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        free(s->plane[c]);
    free(s->picture);
    free(s->number);
    pvx_pool_free(&s->pool);
    dmn_photometry_free(&s->own);
    rec_rig_fini(&s->rig);
}

static pvx_err flame_sets_get(void *ctx, size_t i, struct rec_check_set *out)
{
    struct flame_sets *s = ctx;
    for (size_t c = 0; c < s->rig.n_cameras && s->nch == 3; c++) {
        s->given[c] = s->picture[i][c] != NULL ? s->plane[c] : NULL;
        for (size_t k = 0; k < s->bins[c] && s->given[c] != NULL; k++)
            s->plane[c][k] = s->picture[i][c][4 * k + (size_t)s->channel];
    }
    const float *const *of = s->nch == 3 ? s->given : (const float *const *)s->picture[i];
    *out = (struct rec_check_set){s->number[i], of, s->floats};
    return PVX_OK;
}

static bool flame_sets_progress(void *ctx, double done)
{
    struct flame_sets *s = ctx;
    if (s->a->quiet)
        return !cli_stop;
    if (done < s->bar.last) /* once more from the first set on */
        s->bar = (struct cli_progress){.label = s->bar.label};
    return cli_progress(&s->bar, done);
}

struct rec_check_source flame_sets_source(struct flame_sets *s, const char *label)
{
    s->bar = (struct cli_progress){.label = label};
    return (struct rec_check_source){
        .n = s->n, .get = flame_sets_get, .progress = flame_sets_progress, .ctx = s};
}
