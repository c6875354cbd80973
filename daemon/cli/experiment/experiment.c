/* experiment.c - the paper's experiments (its section 6) on any recording. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/mem.h"
#include "daemon/cli/experiment/report.h"
#include "daemon/cli/report/pdf.h"

/* Choose at most frames_max of the complete frame sets, evenly spread. */
static pvx_err choose_sets(struct experiment *x, struct pvx_diag *d)
{
    size_t all = 0, most = x->o->frames_max;
    x->set = pvx_calloc(x->in.n, sizeof *x->set);
    if (x->set == NULL)
        return pvx_fail(d, PVX_ENOMEM, "out of memory for a list of frames");
    for (size_t i = 0; i < x->in.n; i++)
        if (frames_in_complete(&x->in, i))
            x->set[all++] = i;
    if (all == 0)
        return pvx_fail(d, PVX_ENOENT,
                        "%s: each of the %zu frame sets lacks a camera's picture; leave the camera "
                        "that is missing out with --cameras",
                        x->o->frames, x->in.n);
    x->sets = most < all ? most : all;
    for (size_t i = 0; i < x->sets; i++)
        x->set[i] = x->set[x->sets > 1 ? i * (all - 1) / (x->sets - 1) : all / 2];
    return PVX_OK;
}

static pvx_err choose_unused(struct experiment *x, struct pvx_diag *d)
{
    if (x->rig.n_cameras < 4)
        return pvx_fail(d, PVX_EINVAL,
                        "%zu cameras are too few: an experiment reconstructs from at least three "
                        "and compares with one more; give a rig (or --cameras) with four",
                        x->rig.n_cameras);
    int c = x->o->unused == NULL ? 0 : rec_rig_find(&x->rig, x->o->unused);
    if (c < 0) {
        char names[600] = "";
        for (size_t i = 0; i < x->rig.n_cameras && strlen(names) < 500; i++)
            snprintf(names + strlen(names), sizeof names - strlen(names), " %s",
                     x->rig.cameras[i].name);
        return pvx_fail(d, PVX_ENOENT, "--unused %s: there is no such camera, but%s", x->o->unused,
                        names);
    }
    x->unused = (size_t)c;
    return PVX_OK;
}

/* Choose one binning for all grids: that of the finest grid. */
static pvx_err experiment_choose_binning(struct experiment *x, struct pvx_diag *d)
{
    const struct experiment_options *o = x->o;
    struct rec_rig finest;
    int32_t most = o->grids[o->n_grids - 1] > o->grid ? o->grids[o->n_grids - 1] : o->grid;
    double longest = 0;
    PVX_TRY(rec_rig_copy(&x->rig, &finest));
    for (int a = 0; a < 3; a++)
        longest = finest.grid.max[a] - finest.grid.min[a] > longest
                      ? finest.grid.max[a] - finest.grid.min[a]
                      : longest;
    for (int a = 0; a < 3; a++) {
        double n = (finest.grid.max[a] - finest.grid.min[a]) / longest * most;
        finest.grid.n[a] = n < 1 ? 1 : (int32_t)(n + 0.5);
    }
    pvx_err e = rec_sysmat_resolve(&finest, &o->rig.matrix, &x->matrix, d);
    rec_rig_fini(&finest);
    return e == PVX_OK ? frames_in_begin(&x->in, x->matrix.binning, CAP_MOSAIC_DEMOSAIC, d) : e;
}

/* Describe the files of the recording, so that a changed file is noticed by size or time. */
static void describe_files(const struct experiment *x, FILE *f)
{
    long long bytes = 0, seconds = 0, newest = 0;
    struct stat st;
    if (x->in.take != NULL && stat(x->o->frames, &st) == 0) {
        bytes = st.st_size;
        newest = st.st_mtime;
    }
    for (size_t c = 0; x->in.reel != NULL && c < x->rig.n_cameras; c++)
        for (size_t i = 0; i < x->in.reel[c].files; i++)
            if (stat(x->in.reel[c].path[i], &st) == 0) {
                bytes += st.st_size;
                seconds = st.st_mtime;
                newest = seconds > newest ? seconds : newest;
            }
    fprintf(f, "recording: %zu sets, %06lld to %06lld, %lld bytes, %lld\n", x->in.n,
            (long long)x->in.number[0], (long long)x->in.number[x->in.n - 1], bytes, newest);
}

/* Describe everything on which the measurements depend. */
static pvx_err experiment_describe(const struct experiment *x, char **out, struct pvx_diag *d)
{
    const struct experiment_options *o = x->o;
    const struct rec_photo_params *p = &x->params.photo;
    size_t len, rig_len;
    char *rig;
    PVX_TRY(rec_rig_format(&x->rig, &rig, &rig_len));
    FILE *f = open_memstream(out, &len);
    if (f == NULL) {
        free(rig);
        return pvx_fail(d, PVX_ENOMEM, "out of memory");
    }
    describe_files(x, f);
    fprintf(f, "unused: %s\ngrids:", x->rig.cameras[x->unused].name);
    for (int g = 0; g < o->n_grids; g++)
        fprintf(f, " %d", o->grids[g]);
    fprintf(f, "\ngrid: %d\nframes: %zu\nbinning: %d\nrays: %d\n", o->grid, x->sets,
            x->matrix.binning, x->matrix.rays_per_bin);
    fprintf(f, "channels: %d\nthreshold: %g\nblack: %g\nmargin: %d\nformat: %d\ntransfer: %d\n",
            x->in.nch, (double)p->threshold, (double)p->black, p->margin, (int)o->reading.fmt,
            (int)o->reading.transfer);
    fwrite(rig, 1, rig_len, f);
    free(rig);
    return fclose(f) == 0 ? PVX_OK : pvx_fail(d, PVX_ENOMEM, "out of memory");
}

static pvx_err experiment_prepare(struct experiment *x, struct pvx_diag *d)
{
    const struct experiment_options *o = x->o;
    char *arguments = NULL;
    PVX_TRY(opt_rig_load(&o->rig, &x->rig, d));
    PVX_TRY(choose_unused(x, d));
    PVX_TRY(pvx_pool_new(o->rig.threads, "solve", &x->pool));
    PVX_TRY(dmn_photometry_load(o->rig.path, DMN_LIGHT_ALL, &x->rig, &x->light, d));
    x->in = (struct frames_in){.rig = &x->rig,
                               .pool = x->pool,
                               .how = o->reading,
                               .light = x->light,
                               .black = (double)o->frame.photo.black};
    PVX_TRY(frames_in_open(&x->in, o->frames, o->first, o->last,
                           o->grey ? FRAMES_IN_GREY : FRAMES_IN_SAME, d));
    PVX_TRY(frames_in_check_light(&x->in, d));
    x->params.nch = x->in.nch;
    PVX_TRY(choose_sets(x, d));
    PVX_TRY(experiment_choose_binning(x, d));
    PVX_TRY(experiment_describe(x, &arguments, d));
    pvx_err e = experiment_state_open(&x->state, o->out, arguments, o->anew, d);
    free(arguments);
    return e;
}

static void experiment_finish(struct experiment *x)
{
    experiment_state_close(&x->state);
    frames_in_close(&x->in);
    dmn_photometry_free(&x->light);
    pvx_pool_free(&x->pool);
    rec_rig_fini(&x->rig);
    PVX_FREE(x->set);
}

static int stopped(const struct experiment *x)
{
    fprintf(stderr,
            "pyrovox: stopped; %zu of %zu measurements are kept in %s/state, the same command goes "
            "on\n",
            x->state.n, x->units, x->o->out);
    return 130;
}

static int experiment_run(int argc, char **argv)
{
    struct experiment_options o;
    experiment_parse(argc, argv, &o);
    cli_catch_stop();
    struct experiment x = {.o = &o, .params = o.frame};
    struct pvx_diag d = {""};
    int rc = 0;
    pvx_err e = experiment_prepare(&x, &d);
    size_t before = x.state.n;
    PVX_THEN(e, experiment_measure(&x, &d));
    PVX_THEN(e, experiment_csv(&x, &d));
    PVX_THEN(e, experiment_report(&x, &d));
    PVX_THEN(e, report_pdf(o.out));
    if (e == PVX_ECANCELED || (e == PVX_OK && cli_stop))
        rc = stopped(&x);
    else if (e != PVX_OK)
        rc = cli_error(&d, e);
    else if (!o.quiet)
        fprintf(stderr, "%zu measurements, %zu of them from an earlier run: %s/report.html\n",
                x.state.n, before, o.out);
    experiment_finish(&x);
    return rc;
}

const struct cli_command cmd_experiment = {
    "experiment", "the paper's experiments on a recording: unseen views, by grid and views",
    experiment_run};
