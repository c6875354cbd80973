#include "daemon/cli/reconstruct/active.h"

#include <stdio.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/mem.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/silhouettes.h"
#include "recon/carve/hull_bricks.h"

size_t reconstruct_spread(size_t k, size_t n)
{
    size_t step = n < 3 ? 1 : (size_t)(0.618 * (double)n);
    for (;; step++) { /* step and n without common divisor: all n come before one repeats */
        size_t a = n, b = step, c;
        while (b != 0) {
            c = a % b;
            a = b;
            b = c;
        }
        if (a == 1)
            return k * step % n;
    }
}

/* Add the rows of bins that brick i reaches to `slab` and to the slabs beside it: surfaces are not even, so the brick
 * may belong to a neighbour. */
static void active_reach(const rec_sysmat *outline, size_t i, size_t slab,
                         struct reconstruct_seen *out)
{
    size_t first = slab > 0 ? slab - 1 : 0,
           end = slab + 2 < REC_SLABS_MAX ? slab + 2 : REC_SLABS_MAX;
    for (size_t c = 0; c < outline->n_cameras; c++) {
        struct rec_rect r = outline->active->rect[c][i];
        if (rec_rect_unknown(r))
            r = (struct rec_rect){0, 0, 0, (uint16_t)(outline->block[c].bh - 1)};
        for (size_t s = first; s < end && rec_rect_seen(r); s++) {
            if (r.y0 < out->rows[s][c].lo)
                out->rows[s][c].lo = r.y0;
            if (r.y1 > out->rows[s][c].hi)
                out->rows[s][c].hi = r.y1;
        }
    }
}

static void add_set(const rec_sysmat *outline, const uint8_t *brick, size_t bricks,
                    struct reconstruct_seen *out)
{
    struct rec_active *a = outline->active;
    out->sets++;
    out->bricks_mean += ((double)bricks - out->bricks_mean) / (double)out->sets;
    out->bricks_most = bricks > out->bricks_most ? bricks : out->bricks_most;
    for (size_t i = 0, n = 0; i < a->bricks; i++) {
        if (!brick[i])
            continue;
        a->brick[i] = 1;
        active_reach(outline, i, n++ * REC_SLABS_MAX / bricks, out);
    }
}

static void add_slabs(const rec_sysmat *outline, struct reconstruct_seen *out)
{
    for (size_t s = 0; s < REC_SLABS_MAX; s++)
        for (size_t c = 0; c < outline->n_cameras; c++)
            if (out->rows[s][c].lo <= out->rows[s][c].hi)
                out->slabs +=
                    (double)(out->rows[s][c].hi - out->rows[s][c].lo + 3) * outline->block[c].bw;
}

static pvx_err mark_sets(const struct reconstruct_look *l, struct silhouettes *see, rec_hull *hull,
                         const rec_sysmat *outline, uint8_t *brick, struct reconstruct_seen *out)
{
    struct cli_progress bar = {.label = "silhouettes", .quiet = l->quiet};
    size_t all = l->in->n, n = l->sets > 0 && l->sets < all ? l->sets : all;
    int64_t t0 = pvx_now_mono();
    for (size_t k = 0; k < n; k++) {
        if (l->seconds > 0 && k >= 2 && out->seconds > l->seconds)
            break;
        /* all of them in order: a film is slow the other way */
        silhouettes_load(see, n < all || l->seconds > 0 ? reconstruct_spread(k, all) : k);
        size_t bricks =
            rec_hull_bricks(hull, &l->params->hull, see->lit, see->believed, l->pool, brick);
        add_set(outline, brick, bricks, out);
        out->seconds = cli_seconds_since(t0);
        if (!cli_progress(&bar, (double)(k + 1) / (double)n))
            return PVX_ECANCELED;
    }
    return PVX_OK;
}

pvx_err reconstruct_mark(const struct reconstruct_look *l, rec_sysmat *outline,
                         struct reconstruct_seen *out, struct pvx_diag *d)
{
    struct silhouettes see;
    rec_hull *hull = NULL;
    uint8_t *brick = pvx_calloc(outline->active->bricks, 1);
    *out = (struct reconstruct_seen){0};
    for (size_t s = 0; s < REC_SLABS_MAX; s++)
        for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
            out->rows[s][c].lo = INT32_MAX;
    pvx_err e = silhouettes_new(&see, l->in, l->params, l->background, l->pool, d);
    if (e == PVX_OK && (brick == NULL || rec_hull_new(outline, &hull) != PVX_OK))
        e = pvx_fail(d, PVX_ENOMEM, "out of memory for silhouettes");
    PVX_THEN(e, mark_sets(l, &see, hull, outline, brick, out));
    if (e == PVX_OK)
        add_slabs(outline, out);
    free(brick);
    rec_hull_free(&hull);
    silhouettes_free(&see);
    return e;
}

static double active_share_of(const struct rec_rig *rig, const struct rec_active_estimate *e)
{
    return 100 * (double)e->columns / (double)rec_grid_count(&rig->grid);
}

/* Mark, estimate and print the active part, or refuse it. */
static pvx_err active_prepare(const struct reconstruct_options *o,
                              const struct reconstruct_look *all, const struct rec_rig *rig,
                              double room, rec_sysmat *outline, struct pvx_diag *d)
{
    struct reconstruct_seen seen;
    struct rec_active_estimate e;
    struct reconstruct_need need;
    struct cli_progress bar = {.label = "estimate", .quiet = o->quiet};
    PVX_TRY(frames_in_begin(all->in, outline->binning, o->reading.mosaic, d));
    PVX_TRY(reconstruct_mark(all, outline, &seen, d));
    if (seen.bricks_most == 0)
        return pvx_fail(d, PVX_ENOENT,
                        "no flame in any of the %zu frame sets that all cameras agree on: is "
                        "--threshold too high, or --black or --background brighter than the flame?",
                        seen.sets);
    PVX_TRY(rec_sysmat_estimate_active(rig, outline, RECONSTRUCT_SHARE, all->pool,
                                       (struct rec_progress){cli_progress, &bar}, &e, d));
    reconstruct_need(o, rig, all->params, &e, &seen, &need);
    fprintf(stderr,
            "pyrovox: active part: %.1f %% of the %dx%dx%d voxels, of %.3g entries in all about "
            "%.3g; memory: at most %.2f GB\n",
            active_share_of(rig, &e), rig->grid.n[0], rig->grid.n[1], rig->grid.n[2], e.entries,
            e.kept, need.most * 1e-9 + 0.005);
    if (room > 0 && need.most > room)
        return pvx_fail(
            d, PVX_ENOMEM,
            "up to %.1f GB are needed, %.1f GB are free: fewer voxels (--grid), a "
            "tighter box (--fit-volume), larger bins (--binning) or fewer frame sets at "
            "a time (--first, --last) need less; --memory GB replaces this limit",
            need.most * 1e-9, room * 1e-9);
    return PVX_OK;
}

pvx_err reconstruct_matrix(const struct reconstruct_options *o, struct frames_in *in,
                           const struct rec_frame_params *p, pvx_pool *pool,
                           const struct rec_rig *rig, rec_sysmat **out, struct pvx_diag *d)
{
    struct cli_progress bar = {.label = "system matrix", .quiet = o->quiet};
    struct cli_progress bricks = {.label = "bricks", .quiet = o->quiet};
    const struct rec_progress progress = {cli_progress, &bar};
    struct rec_sysmat_params r;
    rec_sysmat *outline;
    *out = NULL;
    PVX_TRY(rec_sysmat_resolve(rig, &o->rig.matrix, &r, d));
    double whole = rec_sysmat_whole(rig, &r);
    double room = o->memory >= 0 ? o->memory : reconstruct_room();
    if (whole <= room)
        return rec_sysmat_open(rig, &o->rig.matrix, o->cache, pool, progress, out, d);
    fprintf(
        stderr,
        "pyrovox: the whole system matrix would take about %.1f GB, %.1f GB are to be used: only "
        "its part where these %zu frame sets have flame is built, and not cached (--memory GB)\n",
        whole * 1e-9, room * 1e-9, in->n);
    const struct reconstruct_look all = {
        .in = in, .params = p, .background = o->background, .pool = pool, .quiet = o->quiet};
    PVX_TRY(rec_sysmat_outline(rig, &r, pool, (struct rec_progress){cli_progress, &bricks},
                               &outline, d));
    /* processes of a node share the whole matrix, but each has its own active part */
    pvx_err e = active_prepare(o, &all, rig, room / o->node_n, outline, d);
    PVX_THEN(e, rec_sysmat_build_active(rig, &outline, pool, progress, out, d));
    rec_sysmat_free(&outline);
    return e;
}

bool reconstruct_say_cut(const struct rec_frame_report *r, unsigned long long set)
{
    if (r->hull.cut == 0)
        return false;
    fprintf(
        stderr,
        "pyrovox: frame %06llu: its hull may continue in %lld bricks of 4x4x4 voxels outside the "
        "active part, where nothing was solved: the vote trusted other cameras than in the first "
        "look at the silhouettes; use --trust-all, or --memory with more GB for the whole matrix\n",
        set, (long long)r->hull.cut);
    return true;
}
