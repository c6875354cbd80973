#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/opt_rig.h"
#include "recon/matrix/cache.h"

struct options {
    struct opt_rig rig;
    const char *out, *check;
    bool list;
};

static const struct cli_row rows[] = {
    {.help = "Files:"},
    {"out", "FILE", CLI_AT(struct options, out), 0, 0,
     "write the matrix to FILE instead of the cache; a FILE that already fits is used as it is"},
    {"check", "FILE", CLI_AT(struct options, check), 0, 0,
     "verify a matrix file: sizes, checksums, every index"},
    {"list", NULL, CLI_AT(struct options, list), 0, 0,
     "list the matrices in the cache, the one used last at the end"},
    {0},
};

static error_t matrix_parse(int key, char *arg, struct argp_state *state)
{
    struct options *o = state->input;
    switch (key) {
    case ARGP_KEY_INIT: state->child_inputs[0] = &o->rig; return 0;
    case ARGP_KEY_ARG:
        argp_error(state, "'%s' is not an option; a rig is given by --rig %s", arg, arg);
        return 0;
    default: return cli_row(rows, key, arg, state, o);
    }
}

static const char doc[] =
    "Build the system matrix of a rig, or verify one, for example\n\n"
    "  pyrovox matrix --rig rig.yaml\n\n"
    "The matrix contains how much every voxel adds to every pixel. It depends on the rig alone, so "
    "it is built once and cached. This command shows its size and the time to build it.\v"
    "The cache is $PYROVOX_CACHE, or else $XDG_CACHE_HOME/pyrovox, or else ~/.cache/pyrovox. All "
    "other commands find the matrix there. If it grows beyond $PYROVOX_CACHE_MAX GB (default 5), "
    "the matrices that were not used for longest are removed.\n\n"
    "Examples:\n"
    "  pyrovox matrix --rig rig.yaml --grid 128 --basis trilinear --binning 2\n"
    "  pyrovox matrix --rig rig.yaml --cameras cam0,cam3 --out two.pvxm\n"
    "  pyrovox matrix --check two.pvxm\n";

static double bytes_of_level(const rec_sysmat *m)
{
    double N = (double)rec_grid_count(&m->grid);
    double window = (double)(sizeof *m->win.at + rec_window_size(&m->win));
    return N * m->win.slots * window + (double)m->win.n_more * sizeof *m->win.more +
           (double)rec_brick_places(&m->grid) * (double)m->n_cameras * sizeof *m->block[0].fp;
}

/* Print the table of cameras.  names NULL: the file has no names.  Returns the number of footprints that are seen. */
static double matrix_print_cameras(const rec_sysmat *m, const struct rec_rig *names)
{
    size_t N = rec_grid_count(&m->grid);
    double all = 0;
    printf("%-18s %10s %12s %14s %10s\n", "camera", "bins", "rows", "entries", "seen");
    for (size_t c = 0; c < m->n_cameras; c++) {
        const struct rec_sysmat_block *b = &m->block[c];
        size_t seen = 0;
        for (size_t j = 0; j < rec_brick_places(&m->grid); j++)
            seen += rec_rect_seen(b->fp[j]);
        all += (double)seen;
        char index[24], size[32];
        snprintf(index, sizeof index, "%zu", c);
        snprintf(size, sizeof size, "%dx%d", b->bw, b->bh);
        printf("%-18s %10s %12lld %14llu %8.1f %%\n",
               names == NULL ? index : names->cameras[c].name, size, (long long)b->bw * b->bh,
               (unsigned long long)b->nnz, 100.0 * (double)seen / (double)N);
    }
    return all;
}

static void print_matrix(const rec_sysmat *m, const struct rec_rig *names)
{
    double bytes = 0, coarse = 0, seen = matrix_print_cameras(m, names);
    printf("\n%-18s %zu\n", "cameras", m->n_cameras);
    printf("%-18s %d x %d x %d = %zu, %s\n", "voxels", m->grid.n[0], m->grid.n[1], m->grid.n[2],
           rec_grid_count(&m->grid), rec_basis_name(m->grid.basis));
    printf("%-18s %zu (binning %d, %d x %d rays per bin)\n", "rows", m->row0[m->n_cameras],
           m->binning, m->rays_per_bin, m->rays_per_bin);
    printf("%-18s %llu\n", "entries", (unsigned long long)m->nnz);
    printf("%-18s %d x %d x %d", "levels", m->grid.n[0], m->grid.n[1], m->grid.n[2]);
    for (const rec_sysmat *l = m; l != NULL; l = l->coarse) {
        bytes += bytes_of_level(l);
        if (l == m)
            continue;
        printf(", %d x %d x %d", l->grid.n[0], l->grid.n[1], l->grid.n[2]);
        coarse += bytes_of_level(l);
    }
    printf("\n");
    if (m->nnz > 0)
        printf("%-18s %.2f (windows, footprints, coarser levels)\n", "bytes per entry",
               bytes / (double)m->nnz);
    printf("%-18s %d x %d bins; %.2f %% of what is seen needs more than one\n", "windows",
           m->win.wide, m->win.high, 100 * (double)m->win.n_more / (seen > 0 ? seen : 1));
    printf("%-18s %.1f MiB, %.1f MiB of it coarser levels\n", "size", bytes / (1 << 20),
           coarse / (1 << 20));
    printf("%-18s %016llx\n", "key", (unsigned long long)m->key);
}

static int matrix_check(const char *path, pvx_pool *pool)
{
    struct pvx_diag d = {""};
    rec_sysmat *m;
    int64_t t0 = pvx_now_mono();
    pvx_err e = rec_sysmat_load(path, 0, true, pool, &m, &d);
    if (e != PVX_OK)
        return cli_error(&d, e);
    double s = cli_seconds_since(t0);
    print_matrix(m, NULL);
    printf("%-18s %.0f ms\n%s: sound\n", "checked in", s * 1e3, path);
    rec_sysmat_free(&m);
    return 0;
}

static int matrix_list(pvx_pool *pool)
{
    struct rec_cached *file;
    size_t n;
    double all = 0;
    pvx_err e = rec_cache_list(&file, &n);
    if (e != PVX_OK)
        return cli_error(NULL, e);
    for (size_t i = 0; i < n; i++) {
        char when[32] = "";
        struct pvx_diag d = {""};
        struct tm tm;
        rec_sysmat *m;
        time_t used = (time_t)(file[i].used_ns / PVX_NS_PER_S);
        strftime(when, sizeof when, "%Y-%m-%d %H:%M", localtime_r(&used, &tm));
        printf("%s  %9.1f MB  %s", when, (double)file[i].bytes * 1e-6, file[i].path);
        if ((e = rec_sysmat_load(file[i].path, 0, false, pool, &m, &d)) == PVX_OK) {
            printf("  %zu cameras, %d x %d x %d voxels, %s, binning %d\n", m->n_cameras,
                   m->grid.n[0], m->grid.n[1], m->grid.n[2], rec_basis_name(m->grid.basis),
                   m->binning);
            rec_sysmat_free(&m);
        } else {
            printf("  %s\n", pvx_strerror(e));
        }
        all += (double)file[i].bytes;
    }
    printf("%zu matrices, %.2f GB; at most %g GB are kept (PYROVOX_CACHE_MAX)\n", n, all * 1e-9,
           rec_cache_max() * 1e-9);
    free(file);
    return 0;
}

/* Check beforehand that the folder of --out is writable. */
static pvx_err check_writable(const char *out, struct pvx_diag *d)
{
    char dir[4096];
    const char *slash = strrchr(out, '/');
    int n = slash == NULL ? 1 : slash == out ? 1 : (int)(slash - out);
    snprintf(dir, sizeof dir, "%.*s", n, slash == NULL ? "." : out);
    if (access(dir, W_OK | X_OK) != 0)
        return pvx_fail(d, PVX_EPERM, "%s: the folder %s does not exist or is not writable", out,
                        dir);
    return PVX_OK;
}

/* Progress that records the time at which building ended and saving began. */
struct watch {
    struct cli_progress bar;
    int64_t built;
};

static bool matrix_watch(void *ctx, double done)
{
    struct watch *w = ctx;
    if (done >= 1)
        w->built = pvx_now_mono();
    return cli_progress(&w->bar, done);
}

static int matrix_build(const struct options *o, const struct rec_rig *rig, pvx_pool *pool)
{
    struct pvx_diag d = {""};
    struct watch w = {.bar = {.label = "system matrix"}};
    rec_sysmat *m;
    pvx_err e = o->out == NULL ? PVX_OK : check_writable(o->out, &d);
    if (e != PVX_OK)
        return cli_error(&d, e);
    cli_catch_stop();
    int64_t t0 = pvx_now_mono();
    e = rec_sysmat_open(rig, &o->rig.matrix, o->out, pool, (struct rec_progress){matrix_watch, &w},
                        &m, &d);
    if (e != PVX_OK)
        return cli_end(&d, e, true);
    double s = cli_seconds_since(t0), saving = cli_seconds_since(w.built);
    print_matrix(m, rig);
    if (m->cached) {
        printf("%-18s %.0f ms (found and verified, not built)\n", "cached, opened in", s * 1e3);
    } else {
        unsigned threads = pvx_pool_threads(pool);
        printf("%-18s %.2f s with %u thread%s, %.1f M entries/s\n", "built in", s - saving, threads,
               threads == 1 ? "" : "s", (double)m->nnz / (s - saving) * 1e-6);
        printf("%-18s %.2f s\n", "saved in", saving);
    }
    uint64_t key = m->key;
    bool done = o->out == NULL || m->cached;
    rec_sysmat_free(&m);
    if (done)
        return 0;
    t0 = pvx_now_mono();
    e = rec_sysmat_load(o->out, key, true, pool, &m, &d); /* the log says why it was not saved */
    if (e != PVX_OK)
        return cli_error(&d, e);
    printf("%-18s %.0f ms\n", "opened in", cli_seconds_since(t0) * 1e3);
    rec_sysmat_free(&m);
    return 0;
}

static int run_with(const struct options *o, pvx_pool *pool)
{
    struct pvx_diag d = {""};
    struct rec_rig rig;
    if (o->check != NULL)
        return matrix_check(o->check, pool);
    if (o->list)
        return matrix_list(pool);
    pvx_err e = opt_rig_load(&o->rig, &rig, &d);
    if (e != PVX_OK)
        return cli_error(&d, e);
    int rc = matrix_build(o, &rig, pool);
    rec_rig_fini(&rig);
    return rc;
}

static int matrix_run(int argc, char **argv)
{
    struct options o = {.rig = OPT_RIG_INIT};
    const struct argp_child children[] = {{opt_rig_argp(), 0, NULL, 0}, {0}};
    const struct argp argp = {.parser = matrix_parse, .doc = doc, .children = children};
    pvx_pool *pool;
    cli_parse(rows, &argp, 0, argc, argv, &o);
    pvx_err e = pvx_pool_new(o.rig.threads, "matrix", &pool);
    if (e != PVX_OK)
        return cli_error(NULL, e);
    int rc = run_with(&o, pool);
    pvx_pool_free(&pool);
    return rc;
}

const struct cli_command cmd_matrix = {
    "matrix", "build, cache or verify the system matrix of a rig", matrix_run};
