#include "daemon/cli/common/flame_sets.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/mem.h"
#include "daemon/cli/common/arg.h"
#include "daemon/config/config.h"

#define AT(field) CLI_AT(struct flame_sets_args, field)

static const struct cli_row rows[] = {
    {"rig", "FILE", AT(rig), 0, 0, "rig.yaml: volume, camera poses and lenses"},
    {"cameras", "A,B,...", AT(cameras), 0, 0, "use these cameras only"},
    {"frames", "DIR|TAKE.h5", AT(frames), 0, 0,
     "a recording of a flame: a folder with a folder of pictures or a film for each camera, or a "
     "take of raw frames"},
    {"sets", "N", AT(sets), REC_CHECK_SETS, 10000,
     "use N frame sets (default 60); of a longer recording runs of 10, spread over it"},
    {"background", "DIR", AT(background), 0, 0,
     "subtract DIR/<camera>.(npy|png|tif|jpg), an image of the scene without flame"},
    {"black", "X", AT(black), 0, 1e6,
     "black level, share of full scale (default 0), of floats in their own unit"},
    {"binning", "N", AT(binning), 1, 64,
     "raw pixels per bin side (default: such that a picture is at least 160 bins wide)"},
    {"threads", "N", AT(threads), 0, 256, "number of threads (0: one per CPU)"},
    FRAMES_IN_ROWS(struct flame_sets_args),
    {0}};

static error_t flame_sets_parse(int key, char *arg, struct argp_state *st)
{
    struct flame_sets_args *a = st->input;
    if (key == ARGP_KEY_END && a->rig == NULL)
        argp_error(st, "which rig? --rig rig.yaml");
    return cli_row(rows, key, arg, st, a);
}

const struct argp *flame_sets_argp(void)
{
    static struct argp_option options[sizeof rows / sizeof *rows];
    static struct argp argp = {.parser = flame_sets_parse};
    argp.options = cli_rows(rows, options);
    return &argp;
}

/* ---- loaded ---- */

/* Place in the recording of the k-th of the n sets that are taken in runs. */
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

/* Subtract black level and background.  Pixels from `top` on are saturated and stay as they are. */
static void flame_sets_subtract(float *picture, float black, const float *background, size_t n,
                                float top)
{
    for (size_t i = 0; i < n; i++)
        if (!(picture[i] >= top))
            picture[i] -= black + (background != NULL ? background[i] : 0);
}

/* Set saturated bins to NaN.  With photometry a bin may exceed full scale, so later checks could not find them. */
static void blank_saturated(const struct flame_sets *s, const struct dmn_images *images, size_t c,
                            float *picture)
{
    float top = dmn_images_floats(images, c) ? INFINITY : dmn_images_saturated(images, c);
    top = top > 0 ? 0.999F * top : REC_PHOTO_FULL;
    for (size_t i = 0; i < s->bins[c] * (s->nch == 3 ? 4 : 1); i++)
        if (picture[i] >= top)
            picture[i] = NAN;
}

/* Where pictures are saturated below full scale (fewer bits in 16), set those bins to full scale. */
static void flame_sets_fill(const struct flame_sets *s, const struct dmn_images *images, size_t c,
                            float *picture)
{
    float top = dmn_images_saturated(images, c);
    for (size_t i = 0; i < s->bins[c] * (s->nch == 3 ? 4 : 1) && top > 0; i++)
        if (picture[i] >= 0.999F * top)
            picture[i] = 1;
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
        s->number[k] = (uint64_t)in->number[i];
        uint64_t mask = frames_in_load(in, i, at);
        for (size_t c = 0; c < cams; c++) {
            float black = dmn_photometry_of(s->light, c) != NULL ? 0 : (float)s->a->black;
            if ((mask >> c & 1) == 0) {
                PVX_FREE(at[c]);
                continue;
            }
            if (s->light != NULL)
                blank_saturated(s, in->images, c, at[c]);
            else
                flame_sets_fill(s, in->images, c, at[c]);
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
    PVX_TRY(frames_in_open(in, a->frames, a->first, a->last, s->kinds, d));
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        cap_depth_join(&s->depth, &in->depth[c]);
    s->grey = in->grey;
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
    PVX_THEN(e, load_all(s, in, background, d));
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
    PVX_TRY(dmn_config_sees(&s->rig, a->rig, d));
    PVX_TRY(dmn_photometry_load(a->rig, DMN_LIGHT_ALL, &s->rig, &s->own, d));
    s->light = s->own;
    return flame_sets_read(s, d);
}

pvx_err flame_sets_read(struct flame_sets *s, struct pvx_diag *d)
{
    PVX_TRY(right_binning(s, d));
    PVX_TRY(pvx_pool_new((unsigned)s->a->threads, "check", &s->pool));
    struct frames_in in = {.rig = &s->rig,
                           .pool = s->pool,
                           .how = s->a->reading,
                           .light = s->light,
                           .black = s->a->black};
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
    if (done < s->bar.last) /* the sets are read again from the first */
        s->bar = (struct cli_progress){.label = s->bar.label};
    return cli_progress(&s->bar, done);
}

struct rec_check_source flame_sets_source(struct flame_sets *s, const char *label)
{
    s->bar = (struct cli_progress){.label = label};
    return (struct rec_check_source){
        .n = s->n, .get = flame_sets_get, .progress = flame_sets_progress, .ctx = s};
}

#define BELONG_SETS 8

pvx_err flame_sets_belong(struct flame_sets *s, rec_unseen *u, struct rec_plausible_verdict *out)
{
    rec_plausible *p;
    PVX_TRY(rec_plausible_new(&s->rig, s->params.binning, &p));
    pvx_err e = PVX_OK;
    for (size_t i = 0; i < s->n && i < BELONG_SETS && e == PVX_OK; i++) {
        struct rec_check_set set;
        e = flame_sets_get(s, i, &set);
        if (e != PVX_OK)
            break;
        rec_unseen_load(u, set.picture, set.floats);
        rec_plausible_add_unseen(p, u, set.number);
    }
    PVX_THEN(e, rec_plausible_judge(p, REC_PLAUSIBLE_HYPOTHESES, s->a->rig, s->a->frames, out));
    rec_plausible_free(&p);
    return e;
}
