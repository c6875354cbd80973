#include "daemon/cli/reconstruct/plan.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/reconstruct/active.h"
#include "daemon/cli/reconstruct/learn.h"
#include "daemon/pipeline/volume_file.h"
#include "daemon/pipeline/wire.h"
#include "daemon/volumes/bricks.h"
#include "recon/frame/bars.h"

#define LOOK_SECONDS 15.0
#define BUILD_SECONDS \
    15.0 /* longest building of the matrix: the grid is halved until it takes no more */
#define SOLVE_SECONDS 20.0
#define SETS          8 /* that are solved */
#define HALVINGS      5

/* Measurements on one grid. */
struct measure {
    struct rec_rig rig;
    struct rec_sysmat_params p;
    rec_sysmat *outline, *S;
    double outline_s, look_s, build_s; /* look: each set */
    struct rec_active_estimate e;
    struct reconstruct_seen seen;
    size_t solved;
    double read_s, photo_s, hull_s, restrict_s, solve_s, bars_s, write_s; /* each set */
    uint32_t modes;                                                       /* of the error bars */
};

struct plan {
    const struct reconstruct_options *o;
    struct frames_in *in;
    const struct rec_frame_params *params;
    pvx_pool *pool;
    struct measure full, part; /* the grid that is planned for; the one that is solved on */
    int halved;
};

/* Make the outline, mark it and estimate its matrix. */
static pvx_err plan_look(struct plan *p, struct measure *m, const struct reconstruct_look *how,
                         struct pvx_diag *d)
{
    struct cli_progress bricks = {.label = "bricks", .quiet = p->o->quiet},
                        estimate = {.label = "estimate", .quiet = p->o->quiet};
    int64_t t0 = pvx_now_mono();
    PVX_TRY(rec_sysmat_outline(&m->rig, &m->p, p->pool,
                               (struct rec_progress){cli_progress, &bricks}, &m->outline, d));
    m->outline_s = cli_seconds_since(t0);
    PVX_TRY(frames_in_begin(p->in, m->p.binning, p->o->reading.mosaic, d));
    PVX_TRY(reconstruct_mark(how, m->outline, &m->seen, d));
    m->look_s = m->seen.seconds / (double)m->seen.sets;
    if (m->seen.bricks_most == 0)
        return pvx_fail(d, PVX_ENOENT, "--plan: no flame in %zu frame sets evenly spread",
                        m->seen.sets);
    return rec_sysmat_estimate_active(&m->rig, m->outline, RECONSTRUCT_SHARE, p->pool,
                                      (struct rec_progress){cli_progress, &estimate}, &m->e, d);
}

/* Halve the planned grid until its matrix takes at most BUILD_SECONDS.  Bins grow as much, as far as they may. */
static pvx_err choose_part(struct plan *p, struct pvx_diag *d)
{
    struct measure *m = &p->part;
    PVX_TRY(rec_rig_copy(&p->full.rig, &m->rig));
    for (double s = p->full.e.seconds; s > BUILD_SECONDS && p->halved < HALVINGS; s /= 8)
        p->halved++;
    for (int a = 0; a < 3; a++)
        m->rig.grid.n[a] = (m->rig.grid.n[a] >> p->halved) < 1 ? 1 : m->rig.grid.n[a] >> p->halved;
    struct rec_sysmat_params larger = {p->full.p.binning << p->halved, p->full.p.rays_per_bin};
    struct pvx_diag ignored;
    while (larger.binning > p->full.p.binning &&
           rec_sysmat_resolve(&m->rig, &larger, &m->p, &ignored) != PVX_OK)
        larger.binning /= 2;
    return rec_sysmat_resolve(&m->rig, &larger, &m->p, d);
}

/* Measure the time of writing a volume into the folder that is planned for. */
static pvx_err write_folder(const struct plan *p, struct measure *m, const rec_frame *f,
                            const float *dense, struct pvx_diag *d)
{
    char path[4300], json[4300];
    int64_t t0 = pvx_now_mono();
    snprintf(path, sizeof path, "%s/plan-%ld.npy", p->o->out, (long)getpid());
    snprintf(json, sizeof json, "%s/plan-%ld.json", p->o->out, (long)getpid());
    struct dmn_volume_meta meta = {
        .grid = m->rig.grid, .nch = p->params->nch, .report = rec_frame_get_report(f)};
    pvx_err e = pvx_mkdirs(p->o->out, d);
    PVX_THEN(e, dmn_volume_save(path, &meta, dense, NULL, d));
    m->write_s = cli_seconds_since(t0);
    unlink(path);
    unlink(json);
    return e;
}

/* Measure the time of writing a volume into a file beside the planned one.  The second volume is timed, because the
 * first includes making the file. */
static pvx_err write_recording(const struct plan *p, struct measure *m, const float *dense,
                               struct pvx_diag *d)
{
    struct vol_head head = {.rig = NULL};
    struct vol_volume v = {.sample = PVP_F32};
    struct vol_store store = {0};
    vol_writer *w;
    char path[4300];
    snprintf(path, sizeof path, "%s.plan-%ld", p->o->out, (long)getpid());
    dmn_wire_start(&m->rig, p->params->nch, 0, "pyrovox", &head.start);
    v.v.grid = head.start.grid;
    PVX_TRY(vol_writer_open(VOL_HDF5, path, &head, NULL, &w, d));
    pvx_err e = PVX_OK;
    for (; v.v.set < 2 && e == PVX_OK; v.v.set++) {
        int64_t t0 = pvx_now_mono();
        e = vol_from_dense(&store, &v.v.grid, dense);
        v.n_bricks = store.n;
        v.ids = store.ids;
        v.brick = store.brick;
        PVX_THEN(e, vol_writer_put(w, &v, d));
        m->write_s = cli_seconds_since(t0);
    }
    pvx_err closing = vol_writer_close(&w, d);
    vol_store_free(&store);
    unlink(path);
    return e == PVX_OK ? closing : e;
}

static pvx_err write_once(struct plan *p, struct measure *m, const rec_frame *f, struct pvx_diag *d)
{
    struct rec_sparse v;
    if (p->o->out == NULL)
        return PVX_OK;
    rec_frame_volume(f, &v);
    float *dense = pvx_calloc(rec_grid_count(&m->rig.grid) * (size_t)p->params->nch, sizeof *dense);
    if (dense == NULL)
        return pvx_fail(d, PVX_ENOMEM, "--plan: out of memory for a volume");
    rec_sparse_to_dense(&v, dense);
    pvx_err e = p->o->recording ? write_recording(p, m, dense, d) : write_folder(p, m, f, dense, d);
    free(dense);
    return e;
}

/* The time of a set's error bars, if it is to have some. */
static pvx_err plan_bars(struct measure *m, rec_frame *f, rec_bars *b, uint64_t seed)
{
    struct rec_bars_view view;
    if (b == NULL)
        return PVX_OK;
    int64_t t0 = pvx_now_mono();
    PVX_TRY(rec_frame_bars(f, b, seed, &view));
    m->bars_s += cli_seconds_since(t0);
    m->modes = view.n_modes > m->modes ? view.n_modes : m->modes;
    return PVX_OK;
}

static pvx_err solve_sets(struct plan *p, struct measure *m, rec_frame *f, rec_bars *bars,
                          struct pvx_diag *d)
{
    size_t n = m->seen.sets;
    int64_t begin = pvx_now_mono();
    for (size_t k = 0; k < n && (k < 2 || cli_seconds_since(begin) < SOLVE_SECONDS); k++) {
        int64_t t0 = pvx_now_mono();
        rec_frame_reset(f);
        (void)frames_in_load_frame(p->in, reconstruct_spread(k, p->in->n), f);
        m->read_s += cli_seconds_since(t0);
        rec_frame_carve(f);
        PVX_TRY(rec_frame_solve(f, 0, NULL));
        const struct rec_frame_report *r = rec_frame_get_report(f);
        m->photo_s += (double)(r->photo_ns + r->vote_ns) * 1e-9;
        m->hull_s += (double)r->hull_ns * 1e-9;
        m->restrict_s += (double)r->restrict_ns * 1e-9;
        m->solve_s += (double)r->solve_ns * 1e-9;
        PVX_TRY(plan_bars(m, f, bars, k));
        m->solved++;
        if (cli_stop)
            return PVX_ECANCELED;
    }
    double *each[] = {&m->read_s, &m->photo_s, &m->hull_s, &m->restrict_s, &m->solve_s, &m->bars_s};
    for (size_t i = 0; i < sizeof each / sizeof *each; i++)
        *each[i] /= (double)m->solved;
    return write_once(p, m, f, d);
}

static pvx_err plan_solve(struct plan *p, struct measure *m, struct pvx_diag *d)
{
    rec_frame *f = NULL;
    rec_bars *bars = NULL;
    struct rec_frame_params here = *p->params;
    struct cli_progress bar = {.label = "system matrix", .quiet = p->o->quiet};
    here.card = NULL; /* the matrix is there for a few sets */
    int64_t t0 = pvx_now_mono();
    PVX_TRY(rec_sysmat_build_active(&m->rig, &m->outline, p->pool,
                                    (struct rec_progress){cli_progress, &bar}, &m->S, d));
    m->build_s = cli_seconds_since(t0);
    PVX_TRY(rec_frame_alone(m->S, &m->rig, &here, p->pool, &f, d));
    pvx_err e = p->o->bars > 0 ? rec_bars_new(m->S, p->params->nch, p->o->bars, &bars, d) : PVX_OK;
    PVX_THEN(e, solve_sets(p, m, f, bars, d));
    rec_bars_free(&bars);
    rec_frame_free(&f);
    return e;
}

/* ---- totals ---- */

/* A stage: seconds once, seconds of each set, bytes, and the origin of these numbers. */
struct stage {
    const char *name;
    double once, each, bytes;
    char from[192];
};
enum { BRICKS, SILHOUETTES, MATRIX, CAMERAS, READ, CARVE, RESTRICT, SOLVE, BARS, WRITE, STAGES };

/* What is written for each voxel: its emission, its deviation, in a recording also the modes. */
static double plan_planes(const struct plan *p)
{
    return p->o->bars == 0 ? 1 : p->o->recording ? 2 + (double)p->part.modes : 2;
}

static void plan_add_up(const struct plan *p, const struct reconstruct_need *need, bool whole,
                        struct stage s[STAGES])
{
    const struct measure *f = &p->full, *m = &p->part;
    double by = f->seen.bricks_mean / m->seen.bricks_mean;
    double rest = fmax(m->build_s - m->e.seconds - m->outline_s, 0);
    double voxels = (double)rec_grid_count(&f->rig.grid) / (double)rec_grid_count(&m->rig.grid);
    char grid[64], scaled[128] = "measured";
    snprintf(grid, sizeof grid, "%dx%dx%d", m->rig.grid.n[0], m->rig.grid.n[1], m->rig.grid.n[2]);
    if (p->halved > 0)
        snprintf(scaled, sizeof scaled, "on %s, times %.3g, the bricks of its hulls", grid, by);
    memset(s, 0, STAGES * sizeof *s);
    s[BRICKS] = (struct stage){"bricks", whole ? 0 : f->outline_s, 0, need->look, "measured"};
    s[SILHOUETTES] = (struct stage){"silhouettes", 0, whole ? 0 : f->look_s, need->look, ""};
    snprintf(s[SILHOUETTES].from, sizeof s->from, "measured, %zu sets", f->seen.sets);
    s[MATRIX] =
        (struct stage){"system matrix", f->e.seconds + f->outline_s + rest * f->e.kept / m->e.kept,
                       0, whole ? rec_sysmat_whole(&f->rig, &f->p) : need->build, ""};
    snprintf(s[MATRIX].from, sizeof s->from,
             "%.0f %% of its rows traced; sorted as on %s, by entries", 100 * f->e.share, grid);
    s[READ] = (struct stage){"read", 0, p->halved > 0 ? f->look_s : m->read_s, need->base, ""};
    snprintf(s[READ].from, sizeof s->from, "%s",
             p->halved > 0 ? "as silhouettes took, with photometry" : "measured");
    s[CARVE] = (struct stage){"carve", 0, (p->halved > 0 ? 0 : m->photo_s) + m->hull_s * by, 0, ""};
    s[RESTRICT] = (struct stage){"restrict", 0, m->restrict_s * by, 0, ""};
    s[SOLVE] = (struct stage){"solve", 0, m->solve_s * by, need->matrix + need->sets, ""};
    s[BARS] = (struct stage){"error bars", 0, m->bars_s * by, 0, ""};
    for (int i = CARVE; i <= BARS; i++)
        snprintf(s[i].from, sizeof s->from, "%s, %zu sets", scaled, m->solved);
    size_t sets = reconstruct_learn_sets(p->params, f->rig.n_cameras, p->in->n);
    double each = s[READ].each + s[CARVE].each + s[RESTRICT].each + s[SOLVE].each;
    s[CAMERAS] =
        (struct stage){"cameras", RECONSTRUCT_LEARN_ROUNDS * (double)sets * each, 0, 0, ""};
    snprintf(s[CAMERAS].from, sizeof s->from, "at most: gains and aims from %zu sets, %d rounds",
             sets, RECONSTRUCT_LEARN_ROUNDS);
    s[WRITE] = (struct stage){"write", 0, m->write_s * voxels * plan_planes(p), need->volume, ""};
    snprintf(s[WRITE].from, sizeof s->from, "%s",
             p->o->out == NULL ? "not measured: --out says where to"
             : p->halved > 0   ? "measured on the smaller grid, by voxels"
                               : "measured");
}

static void say_nodes(const struct plan *p, double once, double each)
{
    char takes[32];
    double sets = (double)p->in->n, hours = p->o->plan_hours;
    if (hours <= 0)
        return;
    double left = hours * 3600 - once;
    if (left < each) {
        printf("in %g h: no number of machines like this one can do it, each needs %s for a single "
               "set\n",
               hours, cli_duration(once + each, takes));
        return;
    }
    double of_each = floor(left / each), nodes = ceil(sets / of_each);
    printf("in %g h: %.0f machine%s like this one, with %.0f frame sets each; each finds the "
           "bricks and builds its own matrix; assumed: reading is as fast as on one machine\n",
           hours, nodes, nodes == 1 ? "" : "s", ceil(sets / nodes));
}

static void plan_print(const struct plan *p, const struct reconstruct_need *need, bool whole)
{
    const struct measure *f = &p->full;
    const struct rec_grid *g = &f->rig.grid;
    struct stage s[STAGES];
    char takes[32];
    double once = 0, each = 0, sets = (double)p->in->n;
    double disk =
        sets * (double)rec_grid_count(g) * p->params->nch * sizeof(float) * plan_planes(p);
    plan_add_up(p, need, whole, s);
    printf("%zu frame sets of %zu cameras, %dx%dx%d voxels, bins of %dx%d pixels, %u threads\n",
           p->in->n, f->rig.n_cameras, g->n[0], g->n[1], g->n[2], f->p.binning, f->p.binning,
           pvx_pool_threads(p->pool));
    printf("matrix: %s; %.3g entries in all; %.1f %% of the voxels active in %zu of %zu sets\n\n",
           whole ? "whole, cached" : "active part, not cached", f->e.entries,
           100 * (double)f->e.columns / (double)rec_grid_count(g), f->seen.sets, p->in->n);
    printf("%-14s %10s %10s %10s  %s\n", "stage", "once, s", "a set, s",
           whole ? "GB" : "GB at most", "from");
    for (int i = 0; i < STAGES; i++) {
        if (i == BARS && p->o->bars == 0)
            continue;
        once += s[i].once;
        each += s[i].each;
        char gb[32] = "";
        if (s[i].bytes > 0)
            snprintf(gb, sizeof gb, "%.2f", s[i].bytes * 1e-9);
        printf("%-14s %10.3g %10.3g %10s  %s\n", s[i].name, s[i].once, s[i].each, gb, s[i].from);
    }
    printf("%-14s %10.3g %10.3g\n\n", "", once, each);
    printf(
        "here: %s, one stage after the other; with enough processors the pipeline does them at the "
        "same time\n",
        cli_duration(once + each * sets, takes));
    printf("memory: %s %.2f GB%s\n", whole ? "about" : "at most", need->most * 1e-9 + 0.005,
           f->seen.sets < p->in->n ? ", if the other sets have flame in the same place" : "");
    printf("disk: %s%.3g GB of volumes%s (float, %d channel%s)%s\n",
           p->o->recording ? "at most " : "", disk * 1e-9,
           p->o->bars > 0 ? " with their error bars" : "", p->params->nch,
           p->params->nch == 1 ? "" : "s", p->o->recording ? ", less where there is no flame" : "");
    say_nodes(p, once, each);
}

static pvx_err plan_run(struct plan *p, struct pvx_diag *d)
{
    const struct reconstruct_look many = {.in = p->in,
                                          .params = p->params,
                                          .background = p->o->background,
                                          .pool = p->pool,
                                          .seconds = LOOK_SECONDS,
                                          .quiet = p->o->quiet};
    struct reconstruct_look few = many;
    few.sets = SETS;
    few.quiet = true;
    struct reconstruct_need need;
    PVX_TRY(plan_look(p, &p->full, &many, d));
    PVX_TRY(choose_part(p, d));
    PVX_TRY(plan_look(p, &p->part, &few, d));
    PVX_TRY(plan_solve(p, &p->part, d));
    reconstruct_need(p->o, &p->full.rig, p->params, &p->full.e, &p->full.seen, &need);
    double room = p->o->memory >= 0 ? p->o->memory : reconstruct_room();
    double all = rec_sysmat_whole(&p->full.rig, &p->full.p);
    bool whole = all <= room;
    if (whole)
        need.most = need.base + fmax(need.look, all + need.sets + need.volume);
    plan_print(p, &need, whole);
    if (!whole && room > 0 && need.most > room)
        printf("this is more than the %.1f GB that may be used here\n", room * 1e-9);
    return PVX_OK;
}

static void plan_done(struct measure *m)
{
    rec_sysmat_free(&m->outline);
    rec_sysmat_free(&m->S);
}

pvx_err reconstruct_plan(const struct reconstruct_options *o, struct frames_in *in,
                         const struct rec_frame_params *params, pvx_pool *pool,
                         const struct rec_rig *rig, struct pvx_diag *d)
{
    struct plan *p = pvx_calloc(1, sizeof *p);
    PVX_NEED(p);
    *p = (struct plan){.o = o, .in = in, .params = params, .pool = pool};
    pvx_err e = rec_rig_copy(rig, &p->full.rig);
    if (e == PVX_OK) {
        e = rec_sysmat_resolve(rig, &o->rig.matrix, &p->full.p, d);
        PVX_THEN(e, plan_run(p, d));
        plan_done(&p->full);
        plan_done(&p->part);
        rec_rig_fini(&p->full.rig);
        rec_rig_fini(&p->part.rig);
    }
    free(p);
    return e;
}
