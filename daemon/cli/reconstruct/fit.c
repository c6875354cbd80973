#include "daemon/cli/reconstruct/fit.h"
#include "daemon/cli/common/opt_rig.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/silhouettes.h"

struct fit {
    struct silhouettes see;
    bool said; /* the warning that all is lit was printed */
    uint32_t sets, left_out[REC_MAX_CAMERAS];
    uint8_t why[REC_MAX_CAMERAS]; /* reason of the last time */
};

/* Add set i's silhouettes to the fit.  Returns whether any camera saw flame. */
static bool fit_look(struct fit *f, size_t i, rec_fit *fit)
{
    struct silhouettes *see = &f->see;
    size_t light = 0, there = 0;
    silhouettes_load(see, i);
    for (size_t c = 0; c < see->S->n_cameras && c < REC_MAX_CAMERAS; c++) {
        const struct rec_sysmat_block *b = &see->S->block[c];
        if (see->verdict->out >> c & 1) {
            f->left_out[c]++;
            f->why[c] = see->verdict->why[c];
        }
        if (!see->believed[c])
            continue;
        there++;
        light += silhouettes_check_lit(see->in->rig->cameras[c].name, see->lit[c], see->weight[c],
                                       (size_t)b->bw * (size_t)b->bh, &f->said);
    }
    f->sets++;
    if (there > 0)
        rec_fit_add(fit, see->lit, see->believed);
    return light > 0;
}

/* List the sets to use.  A set that lacks a camera has too large a hull, so it is used only if no set is complete. */
static size_t candidates(const struct frames_in *in, size_t *set)
{
    size_t n = 0;
    for (size_t i = 0; i < in->n; i++)
        if (frames_in_complete(in, i))
            set[n++] = i;
    for (size_t i = 0; n == 0 && i < in->n; i++)
        set[i] = i;
    return n > 0 ? n : in->n;
}

/* Look at up to `most` sets (0 = all), spread over the recording with first and last.  *with_light: the number of
 * sets in which some camera saw flame. */
static pvx_err look_at_sets(struct fit *f, rec_fit *fit, uint32_t most, bool quiet,
                            size_t *with_light)
{
    size_t *set = pvx_calloc(f->see.in->n, sizeof *set);
    PVX_NEED(set);
    struct cli_progress bar = {.label = "fit volume", .quiet = quiet};
    size_t all = candidates(f->see.in, set), n = most > 0 && most < all ? most : all;
    pvx_err err = PVX_OK;
    for (size_t k = 0; k < n && err == PVX_OK; k++) {
        *with_light += fit_look(f, set[n > 1 ? k * (all - 1) / (n - 1) : all / 2], fit);
        if (!cli_progress(&bar, (double)(k + 1) / (double)n))
            err = PVX_ECANCELED;
    }
    free(set);
    return err;
}

static void say_left_out(const struct fit *f)
{
    for (size_t c = 0; c < f->see.S->n_cameras; c++)
        if (f->left_out[c] > 0)
            fprintf(stderr,
                    "note: the box is without camera %s in %u of %u frame sets, it contradicts the "
                    "others: %s; %s\n",
                    f->see.in->rig->cameras[c].name, f->left_out[c], f->sets,
                    rec_wrong_name((enum rec_wrong)f->why[c]),
                    rec_wrong_remedy((enum rec_wrong)f->why[c]));
}

static pvx_err no_flame(const struct frames_in *in, uint32_t sets, size_t with_light,
                        struct pvx_diag *d)
{
    if (with_light == 0)
        return pvx_fail(
            d, PVX_ENOENT,
            "--fit-volume: no flame in any of the %u frame sets from %06lld to %06lld; is "
            "--threshold too high, or --black or --background brighter than the flame?",
            sets, (long long)in->number[0], (long long)in->number[in->n - 1]);
    return pvx_fail(d, PVX_ENOENT,
                    "--fit-volume: %zu of %u frame sets have light, but the silhouettes of all "
                    "cameras meet nowhere in the rig's box; is the calibration right (a larger "
                    "--margin allows for an error), is the box where the flame is?",
                    with_light, sets);
}

static double fit_share_of(const double min[3], const double max[3], const struct rec_grid *whole)
{
    double share = 1;
    for (int a = 0; a < 3; a++)
        share *= (max[a] - min[a]) / (whole->max[a] - whole->min[a]);
    return share;
}

/* If the box would be much smaller without the parts that few cameras see, print the least --min-views for that. */
static void advise_views(const rec_fit *fit, double margin, const struct rec_grid *whole,
                         uint32_t asked, size_t cameras, const struct rec_fit_box *box)
{
    double now = fit_share_of(box->min, box->max, whole), least = now;
    struct rec_fit_box b;
    for (uint32_t m = asked + 1; m <= cameras; m++)
        if (rec_fit_get(fit, m, margin, &b) == PVX_OK && b.lit == box->lit)
            least = fmin(least, fit_share_of(b.min, b.max, whole));
    for (uint32_t m = asked + 1; m <= cameras && least < 0.7 * now; m++)
        if (rec_fit_get(fit, m, margin, &b) == PVX_OK &&
            fit_share_of(b.min, b.max, whole) <= 1.1 * least) {
            fprintf(stderr,
                    "note: the box is larger because few cameras see some parts of it; with "
                    "--min-views %u (of %zu) it is %.0f %% of the rig's box\n",
                    m, cameras, 100 * fit_share_of(b.min, b.max, whole));
            return;
        }
}

static void fit_describe(const struct rec_grid *whole, const struct rec_grid *g,
                         const struct rec_fit_box *box, size_t of, double seconds)
{
    double share = fit_share_of(g->min, g->max, whole);
    fprintf(stderr,
            "volume fitted: x %.3g .. %.3g, y %.3g .. %.3g, z %.3g .. %.3g m, %dx%dx%d voxels, "
            "%.0f %% of the rig's box (from %u of %zu frame sets, %.1f s)\n",
            g->min[0], g->max[0], g->min[1], g->max[1], g->min[2], g->max[2], g->n[0], g->n[1],
            g->n[2], 100 * share, box->sets, of, seconds);
    static const char *const side[] = {"min x", "max x", "min y", "max y", "min z", "max z"};
    char list[64] = "";
    for (int i = 0; i < 6; i++)
        if (box->touches >> i & 1)
            snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s",
                     list[0] != '\0' ? ", " : "", side[i]);
    if (list[0] != '\0')
        fprintf(stderr,
                "note: the flame reaches the side of the rig's box at %s; if it continues outside, "
                "enlarge `volume` in the rig\n",
                list);
}

/* Set the rig's grid to the box found, with voxels as --grid says, and print notes about it. */
static pvx_err use_box(const struct reconstruct_options *o, const rec_fit *fit,
                       const struct rec_fit_box *box, size_t of, double seconds,
                       struct rec_rig *rig, struct pvx_diag *d)
{
    struct rec_grid whole = rig->grid;
    int32_t n[3];
    memcpy(n, o->rig.grid, sizeof n);
    if (o->rig.grid_one)
        n[1] = n[2] = 0;
    if (o->rig.grid_auto) {
        memcpy(rig->grid.min, box->min, sizeof box->min);
        memcpy(rig->grid.max, box->max, sizeof box->max);
        PVX_TRY(opt_rig_finest(&o->rig, rig, d));
        memcpy(n, rig->grid.n, sizeof n);
    }
    if (rec_fit_grid(&whole, box, n, &rig->grid) != PVX_OK)
        return pvx_fail(d, PVX_ERANGE,
                        "--fit-volume: over %d voxels along an axis; --grid N makes them larger",
                        REC_GRID_MAX);
    if (o->quiet)
        return PVX_OK;
    fit_describe(&whole, &rig->grid, box, of, seconds);
    advise_views(fit, o->fit_margin, &whole, o->frame.hull.min_views, rig->n_cameras, box);
    return PVX_OK;
}

/* Save the rig as it is in its file, with all cameras, but with the fitted volume. */
static pvx_err save_rig(const char *from, const char *path, const struct rec_grid *g,
                        struct pvx_diag *d)
{
    struct rec_rig rig;
    PVX_TRY(rec_rig_load(from, &rig, d));
    rig.grid = *g;
    pvx_err e = opt_rig_save(&rig, from, path, d);
    rec_rig_fini(&rig);
    return e;
}

/* Bins of the silhouettes are those of a reconstruction on the rig's own grid. */
static pvx_err fit_choose_binning(const struct reconstruct_options *o, struct frames_in *in,
                                  struct pvx_diag *d)
{
    struct rec_sysmat_params got;
    PVX_TRY(rec_sysmat_resolve(in->rig, &o->rig.matrix, &got, d));
    return frames_in_begin(in, got.binning, CAP_MOSAIC_DEMOSAIC, d);
}

pvx_err reconstruct_fit(const struct reconstruct_options *o, struct frames_in *in,
                        const struct rec_frame_params *p, pvx_pool *pool, struct rec_rig *rig,
                        struct pvx_diag *d)
{
    int64_t t0 = pvx_now_mono();
    PVX_TRY(fit_choose_binning(o, in, d));
    struct fit f = {.said = false};
    struct rec_fit_params fp = REC_FIT_DEFAULTS;
    struct rec_fit_box box;
    rec_fit *fit = NULL;
    size_t with_light = 0;
    fp.binning = in->binning;
    fp.min_views = p->hull.min_views;
    pvx_err e = rec_fit_new(rig, &fp, pool, &fit, d);
    PVX_THEN(e, silhouettes_new(&f.see, in, p, o->background, pool, d));
    PVX_THEN(e, look_at_sets(&f, fit, o->fit_frames, o->quiet, &with_light));
    if (e == PVX_OK && (e = rec_fit_get(fit, 0, o->fit_margin, &box)) != PVX_OK)
        e = no_flame(in, box.sets, with_light, d);
    PVX_THEN(e, use_box(o, fit, &box, in->n, cli_seconds_since(t0), rig, d));
    if (e == PVX_OK && !o->quiet)
        say_left_out(&f);
    silhouettes_free(&f.see);
    rec_fit_free(&fit);
    if (e != PVX_OK)
        return e;
    return o->save_rig != NULL ? save_rig(o->rig.path, o->save_rig, &rig->grid, d) : PVX_OK;
}
