/* reconstruct.c - `pyrovox reconstruct`: recorded frames in, one volume per frame set out.  It runs the daemon's
 * pipeline, lossless, between frames_in.h and the files that are written here. */
#include <cjson/cJSON.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/cpu.h"
#include "base/file.h"
#include "base/mem.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/frames_in.h"
#include "daemon/cli/common/silhouettes.h"
#include "daemon/cli/pictures/hull_picture.h"
#include "daemon/cli/reconstruct/ranks.h"
#include "daemon/cli/reconstruct/absorb.h"
#include "daemon/cli/reconstruct/active.h"
#include "daemon/cli/reconstruct/device.h"
#include "daemon/cli/reconstruct/fit.h"
#include "daemon/cli/reconstruct/hints.h"
#include "daemon/cli/reconstruct/join.h"
#include "daemon/cli/reconstruct/learn.h"
#include "daemon/cli/reconstruct/options.h"
#include "daemon/cli/reconstruct/part.h"
#include "daemon/cli/reconstruct/plan.h"
#include "daemon/cli/reconstruct/slurm.h"
#include "daemon/pipeline/volume_file.h"
#include "daemon/volumes/folder.h"
#include "recon/frame/inside.h"
#include "recon/check/plausible.h"

struct job {
    const struct reconstruct_options *o;
    struct rec_rig rig;
    struct rec_grid whole; /* the rig's own, before it was fitted */
    rec_sysmat *S;
    dmn_photometry *light; /* NULL = none */
    struct frames_in in;
    struct rec_frame_params params;
    pvx_pool *pool;
    rec_average *average; /* of the cameras' corrections; NULL: each set by itself */
    struct dmn_compute compute;
    dmn_pipeline *pipeline;
    struct ranks ranks;
    struct reconstruct_part part; /* where out is one file */

    /* the sink's: */
    hull_picture *picture;   /* NULL = none wanted */
    float *dense, *dense_sd; /* dense_sd: with error bars */
    bool kept;               /* rig.yaml lies beside the volumes */
    cJSON *list;             /* of frames, in the report */
    struct cli_progress bar;
    size_t sets;                    /* received so far */
    int64_t first_ns, last_ns;      /* when the first and the last came */
    struct reconstruct_hints hints; /* of the volumes written */
    rec_plausible *plausible;       /* NULL: without silhouettes */
    size_t lit;                     /* sets with light in two cameras */
    bool said_lit;       /* the warning that nearly all of a picture is lit was printed */
    enum rec_cause said; /* what is wrong with rig and pictures, as it was said */
    struct dmn_votes votes;
    bool failed;   /* a set failed, but the others went on */
    pvx_err error; /* the error that ended the work */
    struct pvx_diag why;
};

/* ---- one set to files ---- */

static bool reconstruct_has(const struct dmn_slot *s, size_t c)
{
    return s->mask >> c & 1;
}

static void report_frame(const struct job *j, const struct dmn_slot *s)
{
    cJSON *o = cJSON_CreateObject();
    char number[24]; /* as text: it may be a time, for which a double is too short */
    snprintf(number, sizeof number, "%llu", (unsigned long long)s->set);
    cJSON_AddRawToObject(o, "frame", number);
    dmn_report_to_json(o, rec_frame_get_report(s->frame));
    dmn_verdict_json(o, &rec_frame_get_report(s->frame)->vote, &j->rig);
    if (s->why != DMN_N_DROP)
        cJSON_ReplaceItemInObject(o, "status", cJSON_CreateString("failed"));
    cJSON_AddStringToObject(o, "start", rec_frame_get_report(s->frame)->warm ? "warm" : "cold");
    /* unpacking and binning belong to photometry here: total is from raw pixels to volume */
    cJSON *ms = cJSON_GetObjectItem(o, "ms");
    static const char *const with_binning[] = {"photometry", "total"};
    for (int i = 0; i < 2; i++) {
        cJSON *item = cJSON_GetObjectItem(ms, with_binning[i]);
        if (item != NULL)
            cJSON_SetNumberValue(item, item->valuedouble + (double)s->bin_ns * 1e-6);
    }
    if (s->problem.text[0] != '\0')
        cJSON_AddStringToObject(o, "problem", s->problem.text);
    cJSON *missing = cJSON_AddArrayToObject(o, "cameras_missing");
    for (size_t c = 0; c < j->rig.n_cameras; c++)
        if (!reconstruct_has(s, c))
            cJSON_AddItemToArray(missing, cJSON_CreateString(j->rig.cameras[c].name));
    cJSON_AddItemToArray(j->list, o);
}

static void describe_volume(cJSON *root, const struct job *j)
{
    const struct rec_grid *g = &j->rig.grid;
    cJSON *v = cJSON_AddObjectToObject(root, "volume");
    cJSON_AddItemToObject(v, "min", cJSON_CreateDoubleArray(g->min, 3));
    cJSON_AddItemToObject(v, "max", cJSON_CreateDoubleArray(g->max, 3));
    cJSON_AddItemToObject(v, "voxels", cJSON_CreateIntArray(g->n, 3));
    cJSON_AddStringToObject(v, "basis", rec_basis_name(g->basis));
    cJSON_AddBoolToObject(v, "fitted", j->o->fit);
}

/* What all sets were corrected by; none: each by itself. */
static void describe_cameras(cJSON *root, const struct job *j)
{
    struct rec_selfcal_report r;
    if (j->average == NULL)
        return;
    rec_average_tell(j->average, &r);
    dmn_selfcal_to_json(root, &r);
}

static void check_lit(struct job *j, const struct dmn_slot *s)
{
    for (size_t c = 0; c < j->rig.n_cameras && !j->said_lit && !j->o->no_hull && !j->o->fit; c++)
        if (reconstruct_has(s, c) && (rec_frame_get_report(s->frame)->vote.out >> c & 1) == 0)
            (void)silhouettes_check_lit(j->rig.cameras[c].name, rec_frame_lit(s->frame, c),
                                        rec_frame_weight(s->frame) + j->S->row0[c],
                                        j->S->row0[c + 1] - j->S->row0[c], &j->said_lit);
}

static void reconstruct_say_missing(const struct job *j, const struct dmn_slot *s)
{
    char names[600] = "";
    for (size_t c = 0; c < j->rig.n_cameras && strlen(names) < 500; c++)
        if (!reconstruct_has(s, c))
            snprintf(names + strlen(names), sizeof names - strlen(names), " %s",
                     j->rig.cameras[c].name);
    if (names[0] != '\0')
        fprintf(stderr, "pyrovox: frame %06llu: solved from %u of %zu cameras, without%s\n",
                (unsigned long long)s->set, s->n_present, j->rig.n_cameras, names);
}

static void reconstruct_say(void *ctx, bool bad, const struct pvx_about *about,
                            const char *sentence)
{
    const uint64_t *frame = ctx;
    (void)bad;
    (void)about;
    fprintf(stderr, "pyrovox: frame %06llu: %s\n", (unsigned long long)*frame, sentence);
}

/* Whether pictures and rig belong together, after sets 1 and 8 with light.  After the first it may end the work. */
static pvx_err reconstruct_belong(struct job *j, const struct dmn_slot *s, struct pvx_diag *d)
{
    const struct rec_frame_report *r = rec_frame_get_report(s->frame);
    const int cs = j->params.nch == 3 ? 4 : 1;
    struct rec_plausible_set set = {.number = j->sets,
                                    .nch = j->params.nch,
                                    .cs = cs,
                                    .residual = r->solve.rel_residual,
                                    .noise = rec_frame_noise(r, j->params.nch)};
    struct rec_plausible_verdict v;
    char line[REC_PLAUSIBLE_LINE];
    size_t light = 0;
    if (j->plausible == NULL)
        return PVX_OK;
    for (size_t c = 0; c < j->rig.n_cameras; c++) {
        size_t row0 = j->S->row0[c];
        if (!reconstruct_has(s, c))
            continue;
        set.b[c] = rec_frame_rhs(s->frame) + row0 * (size_t)cs;
        set.lit[c] = rec_frame_lit(s->frame, c);
        if ((r->vote.out >> c & 1) == 0) /* else all weights are 0 */
            set.weight[c] = rec_frame_weight(s->frame) + row0;
        light += memchr(set.lit[c], 1, j->S->row0[c + 1] - row0) != NULL;
    }
    rec_plausible_add(j->plausible, &set);
    j->lit += light > 1;
    if (light < 2 || (j->lit != 1 && j->lit != 8))
        return PVX_OK;
    PVX_TRY(rec_plausible_judge(j->plausible, REC_PLAUSIBLE_HYPOTHESES, j->o->rig.path,
                                j->o->frames, &v));
    if (v.meaningless && j->lit == 1 && !j->o->anyway && !j->o->fit)
        return pvx_fail(d, PVX_EINVAL, "frame %06llu: %.400s; next: %.400s; or --anyway",
                        (unsigned long long)s->set, v.text, v.next);
    if (v.cause != REC_CAUSE_NONE && v.cause != j->said) {
        rec_plausible_line(&v, line);
        fprintf(stderr, "pyrovox: frame %06llu: %s\n", (unsigned long long)s->set, line);
        j->said = v.cause;
    }
    return PVX_OK;
}

/* Whether a rig.yaml that is there is of another rig, or of none. */
static bool another_rig(const char *path, const struct rec_rig *rig)
{
    struct rec_rig there;
    if (rec_rig_load(path, &there, NULL) != PVX_OK)
        return true;
    bool other = rec_rig_hash(&there) != rec_rig_hash(rig);
    rec_rig_fini(&there);
    return other;
}

/* The rig that was used, as a recording keeps it.  A rig.yaml that is there is somebody's, perhaps --rig itself. */
static pvx_err keep_rig(const struct job *j, struct pvx_diag *d)
{
    char path[4300], *text;
    size_t len;
    snprintf(path, sizeof path, "%s/rig.yaml", j->o->out);
    if (access(path, F_OK) == 0) {
        if (another_rig(path, &j->rig))
            fprintf(stderr,
                    "pyrovox: %s: was there before, so it is left, and later commands take it for "
                    "the rig of these volumes\n",
                    path);
        return PVX_OK;
    }
    PVX_TRY(rec_rig_format(&j->rig, &text, &len));
    pvx_err e = pvx_file_write(path, text, len, d);
    free(text);
    return e;
}

static pvx_err reconstruct_save(struct job *j, const struct dmn_slot *s, struct pvx_diag *d)
{
    unsigned long long no = s->set;
    char path[4300];
    PVX_TRY(reconstruct_belong(j, s, d));
    reconstruct_say_missing(j, s);
    check_lit(j, s);
    j->failed |= reconstruct_say_cut(rec_frame_get_report(s->frame), s->set);
    uint64_t frame = s->set;
    dmn_votes_add(&j->votes, &rec_frame_get_report(s->frame)->vote, &j->rig,
                  &(struct dmn_votes_listener){reconstruct_say, &frame});
    if (j->picture != NULL) {
        bool have[REC_MAX_CAMERAS];
        for (size_t c = 0; c < j->rig.n_cameras; c++)
            have[c] =
                reconstruct_has(s, c) && (rec_frame_get_report(s->frame)->vote.out >> c & 1) == 0;
        snprintf(path, sizeof path, "%s/%06llu.png", j->o->save_hull, no);
        PVX_TRY(hull_picture_save(j->picture, s->frame, have, no, path, d));
    }
    const struct rec_frame_report *r = rec_frame_get_report(s->frame);
    struct rec_sparse v;
    rec_frame_volume(s->frame, &v);
    if (!j->o->recording) {
        rec_sparse_to_dense(&v, j->dense);
        struct rec_sparse sd = v;
        sd.value = s->bars.sd;
        if (sd.value != NULL)
            rec_sparse_to_dense(&sd, j->dense_sd);
        snprintf(path, sizeof path, "%s/%06llu.npy", j->o->out, no);
        struct dmn_volume_meta m = {.grid = j->S->grid,
                                    .nch = j->params.nch,
                                    .frame = (int64_t)s->set,
                                    .clock = "frame-number",
                                    .report = r,
                                    .bars = s->bars.sd != NULL,
                                    .doubt = s->bars.doubt};
        if (!j->kept)
            PVX_TRY(keep_rig(j, d));
        j->kept = true;
        PVX_TRY(dmn_volume_save(path, &m, j->dense, j->dense_sd, d));
    }
    reconstruct_hints_add(&j->hints, r, &v, j->o->fit ? &j->whole : NULL);
    return PVX_OK;
}

/* The sink.  After an error it stops the source and writes nothing more. */
static bool reconstruct_put(void *ctx, const struct dmn_slot *s)
{
    struct job *j = ctx;
    if (j->error != PVX_OK)
        return false;
    j->last_ns = pvx_now_mono();
    j->first_ns = j->sets++ == 0 ? j->last_ns : j->first_ns;
    if (j->in.bar == NULL)
        cli_progress(&j->bar, (double)j->sets / (double)j->in.n);
    bool own = true;
    if (s->why != DMN_N_DROP && s->why != DMN_DROP_IMAGES)
        j->error = pvx_fail(&j->why, PVX_EINVAL, "frame %06llu: cannot be solved",
                            (unsigned long long)s->set);
    else if (j->o->recording)
        j->error = reconstruct_part_put(&j->part, s, &j->rig, j->params.nch, &own, &j->why);
    j->failed |= own && s->problem.text[0] != '\0';
    if (j->error == PVX_OK && own && s->why == DMN_N_DROP)
        j->error = reconstruct_save(j, s, &j->why);
    if (j->error == PVX_OK && own)
        report_frame(j, s);
    if (j->error != PVX_OK)
        atomic_store(&j->in.stop, true);
    return j->error == PVX_OK && s->why == DMN_N_DROP;
}

/* ---- all ---- */

static pvx_err save_report(const char *path, cJSON *root, struct pvx_diag *d)
{
    char *text = cJSON_Print(root);
    if (text == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: out of memory", path);
    pvx_err e = pvx_file_write(path, text, strlen(text), d);
    cJSON_free(text);
    return e;
}

/* Rig, frames and the grid to work on. */
static pvx_err find_input(struct job *j, struct pvx_diag *d)
{
    const struct reconstruct_options *o = j->o;
    struct opt_rig as_in_file = o->rig;
    if (o->fit) { /* --grid is then for the fitted box */
        memset(as_in_file.grid, 0, sizeof as_in_file.grid);
        as_in_file.grid_auto = false;
    }
    if (o->out != NULL && !o->plan && o->slurm == 0)
        PVX_TRY(reconstruct_device_open(o, &j->compute, d));
    if (o->no_hull)
        silhouettes_without_hull(&j->params);
    if (o->out != NULL && !o->recording && !o->plan && vol_folder_has(o->out, ".npy"))
        return pvx_fail(d, PVX_EBUSY,
                        "%s: holds volumes already; name another folder, or remove it", o->out);
    PVX_TRY(opt_rig_load(&as_in_file, &j->rig, d));
    if (j->params.hull.min_views > j->rig.n_cameras)
        return pvx_fail(
            d, PVX_EINVAL,
            "--min-views %u: that many cameras must see a voxel, but there are only %zu",
            j->params.hull.min_views, j->rig.n_cameras);
    j->whole = j->rig.grid;
    PVX_TRY(pvx_pool_new(o->rig.threads, "solve", &j->pool));
    PVX_TRY(dmn_photometry_load(o->rig.path, DMN_LIGHT_ALL, &j->rig, &j->light, d));
    j->in = (struct frames_in){.rig = &j->rig,
                               .pool = j->pool,
                               .how = o->reading,
                               .light = j->light,
                               .black = (double)o->frame.photo.black};
    PVX_TRY(frames_in_open(&j->in, o->frames, o->first, o->last,
                           o->grey ? FRAMES_IN_GREY : FRAMES_IN_SAME, d));
    PVX_TRY(frames_in_check_light(&j->in, d));
    j->params.nch = j->in.nch;
    if (o->find_absorption)
        PVX_TRY(reconstruct_absorb(o, &j->params.absorption, d));
    PVX_TRY(o->fit ? reconstruct_fit(o, &j->in, &j->params, j->pool, &j->rig, d) : PVX_OK);
    return o->recording && !o->plan ? reconstruct_part_begin(&j->part, o, &j->rig, &j->in, d)
                                    : PVX_OK;
}

/* One process of a node builds the matrix.  The others map the file in its cache, so it is in memory once. */
static pvx_err open_matrix(struct job *j, struct pvx_diag *d)
{
    ranks_first(&j->ranks);
    pvx_err e = j->part.nothing
                    ? PVX_OK
                    : reconstruct_matrix(j->o, &j->in, &j->params, j->pool, &j->rig, &j->S, d);
    ranks_others(&j->ranks);
    return e;
}

/* All parts of a recording learn from the same sets.  A part whose matrix holds only its own flame cannot. */
static pvx_err learn_cameras(struct job *j, float *const *background, struct pvx_diag *d)
{
    struct reconstruct_learn l = {.in = &j->in,
                                  .params = &j->params,
                                  .background = background,
                                  .S = j->S,
                                  .rig = &j->rig,
                                  .pool = j->pool,
                                  .quiet = j->o->quiet};
    if (j->o->parts == 0)
        return reconstruct_learn(&l, &j->average, d);
    if (j->S->active != NULL)
        return PVX_OK;
    struct frames_in all = {.rig = &j->rig,
                            .pool = j->pool,
                            .how = j->o->reading,
                            .light = j->light,
                            .black = j->in.black};
    l.in = &all;
    pvx_err e = frames_in_open(&all, j->o->frames, j->o->first, j->o->last, j->in.kinds, d);
    PVX_THEN(e, frames_in_begin(&all, j->S->binning, j->o->reading.mosaic, d));
    PVX_THEN(e, reconstruct_learn(&l, &j->average, d));
    frames_in_close(&all);
    return e;
}

/* The pipeline between the frames and their volumes. */
static pvx_err reconstruct_connect_all(struct job *j, struct pvx_diag *d)
{
    const struct reconstruct_options *o = j->o;
    float *background[REC_MAX_CAMERAS] = {0};
    struct dmn_pipeline_params p = {.S = j->S,
                                    .rig = &j->rig,
                                    .pool = j->pool,
                                    .background = o->background != NULL ? background : NULL,
                                    .lossless = true,
                                    .warm = o->warm,
                                    .bars = o->bars,
                                    .deadline = {.limit_ns = (int64_t)(o->deadline_ms * 1e6)},
                                    .source = frames_in_source(&j->in),
                                    .sink = {.name = "save", .put = reconstruct_put, .ctx = j}};
    pvx_err e = PVX_OK;
    if (o->background != NULL)
        e = frames_in_background(&j->in, o->background, background, d);
    const struct dmn_compute_job job = {
        .S = j->S, .rig = &j->rig, .pool = j->pool, .background = p.background};
    PVX_THEN(e, reconstruct_device_choose(&j->compute, &job, &j->in, o->quiet, &j->params, d));
    p.frame = j->params;
    PVX_THEN(e, learn_cameras(j, p.background, d));
    p.average = j->average;
    PVX_THEN(e, dmn_pipeline_new(&p, &j->pipeline, d));
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        free(background[c]);
    return e;
}

static pvx_err reconstruct_prepare(struct job *j, struct pvx_diag *d)
{
    const struct reconstruct_options *o = j->o;
    PVX_TRY(ranks_all(&j->ranks, find_input(j, d)));
    if (o->plan)
        return reconstruct_plan(o, &j->in, &j->params, j->pool, &j->rig, d);
    if (o->out == NULL || o->slurm > 0)
        return PVX_OK;
    PVX_TRY(open_matrix(j, d));
    if (j->part.nothing)
        return PVX_OK;
    if (o->recording)
        PVX_TRY(reconstruct_part_open(&j->part, &j->rig, &j->in, d));
    else
        PVX_TRY(pvx_mkdirs(o->out, d));
    if (o->save_hull != NULL)
        PVX_TRY(pvx_mkdirs(o->save_hull, d));
    PVX_TRY(frames_in_begin(&j->in, j->S->binning, o->reading.mosaic, d));
    if (o->save_hull != NULL)
        PVX_TRY(hull_picture_new(j->S, &j->rig, j->params.nch, j->params.hull.min_views, j->pool,
                                 &j->picture));
    if (!o->recording)
        j->dense =
            pvx_calloc(rec_grid_count(&j->S->grid) * (size_t)j->params.nch, sizeof *j->dense);
    if (!o->recording && o->bars > 0)
        j->dense_sd =
            pvx_calloc(rec_grid_count(&j->S->grid) * (size_t)j->params.nch, sizeof *j->dense_sd);
    if (!o->recording && (j->dense == NULL || (o->bars > 0 && j->dense_sd == NULL)))
        return pvx_fail(d, PVX_ENOMEM, "out of memory for a dense volume");
    if (!o->no_hull)
        PVX_TRY(rec_plausible_new(&j->rig, j->S->binning, &j->plausible));
    if (j->plausible != NULL && j->params.at_least)
        rec_plausible_at_least(j->plausible);
    return reconstruct_connect_all(j, d);
}

static void reconstruct_finish(struct job *j)
{
    dmn_pipeline_free(&j->pipeline);
    rec_average_free(&j->average);
    rec_plausible_free(&j->plausible);
    free(j->dense);
    free(j->dense_sd);
    hull_picture_free(&j->picture);
    frames_in_close(&j->in);
    dmn_photometry_free(&j->light);
    dmn_compute_close(&j->compute);
    rec_sysmat_free(&j->S);
    pvx_pool_free(&j->pool);
    rec_rig_fini(&j->rig);
}

/* One line at the end: of all sets, and of the last ones if the recording was shorter than eight. */
static pvx_err reconstruct_verdict(const struct job *j)
{
    struct rec_plausible_verdict v;
    char line[REC_PLAUSIBLE_LINE];
    if (j->plausible == NULL || j->lit == 0)
        return PVX_OK;
    PVX_TRY(rec_plausible_judge(
        j->plausible, j->lit > 1 && j->lit < 8 ? REC_PLAUSIBLE_HYPOTHESES : REC_PLAUSIBLE_FACTS,
        j->o->rig.path, j->o->frames, &v));
    rec_plausible_line(&v, line);
    if (v.cause == REC_CAUSE_NONE ? j->said == REC_CAUSE_NONE && !j->o->quiet : v.cause != j->said)
        fprintf(stderr, "%s\n", line);
    return PVX_OK;
}

/* The share of the time from the first volume to the last in which the solver waited for frames. */
static void describe_waiting(cJSON *root, const struct job *j)
{
    if (j->last_ns > j->first_ns)
        cJSON_AddNumberToObject(root, "solver_waited",
                                (double)dmn_pipeline_waited_ns(j->pipeline) /
                                    (double)(j->last_ns - j->first_ns));
}

/* After an error or Ctrl-C the report is written, too, for the sets that were done. */
static pvx_err reconstruct(struct job *j, struct pvx_diag *d)
{
    const struct reconstruct_options *o = j->o;
    cJSON *root = cJSON_CreateObject();
    describe_volume(root, j);
    describe_cameras(root, j);
    j->list = cJSON_AddArrayToObject(root, "frames");
    j->bar = (struct cli_progress){.label = "reconstruct", .quiet = o->quiet};
    j->in.bar = j->in.means.n > 0 ? &j->bar : NULL;
    pvx_err e = dmn_pipeline_start(j->pipeline, d);
    dmn_pipeline_join(j->pipeline);
    describe_waiting(root, j);
    reconstruct_device_tell(j->pipeline, root);
    if (e == PVX_OK && (e = j->error) != PVX_OK)
        *d = j->why;
    struct pvx_diag dr = {""};
    pvx_err er = o->report == NULL ? PVX_OK : save_report(o->report, root, &dr);
    if (er != PVX_OK) {
        cli_error(&dr, er);
        j->failed = true;
    }
    cJSON_Delete(root);
    if (e == PVX_OK && !o->quiet)
        fprintf(stderr, "%u volume%s in %s\n", j->hints.volumes, j->hints.volumes == 1 ? "" : "s",
                o->out);
    reconstruct_hints_say(&j->hints, o, &j->rig);
    if (e == PVX_OK)
        e = reconstruct_verdict(j);
    return e;
}

/* Join the parts if all of them are done. */
static int reconstruct_do_join(const struct job *j, int code)
{
    const struct reconstruct_options *o = j->o;
    if (o->parts == 0 || o->slurm > 0)
        return code;
    code = ranks_worst(&j->ranks, code);
    if (j->ranks.rank > 0 || cli_stop ||
        (j->ranks.n == 1 && !reconstruct_join_is_due(o->out, o->part)))
        return code;
    if (code != 0 && !reconstruct_join_has_job(o->out)) /* nothing was begun */
        return code;
    int joined = reconstruct_join(o->out);
    return code != 0 ? code : joined;
}

static int reconstruct_conclude(struct job *j, pvx_err e, struct pvx_diag *d)
{
    if (e == PVX_OK && cli_stop)
        e = PVX_ECANCELED;
    if (j->o->recording)
        e = reconstruct_part_end(&j->part, e, d);
    if (e == PVX_ECANCELED && cli_stop)
        fprintf(stderr, "pyrovox: stopped\n");
    if (e == PVX_ECANCELED) /* without cli_stop another rank failed and prints why */
        return cli_stop ? 130 : 1;
    if (e != PVX_OK)
        return cli_error(d, e);
    return j->failed ? 1 : 0;
}

/* Threads for one of n ranks on a node.  mine: processors that this rank may run on. */
static unsigned reconstruct_share_of(unsigned mine, unsigned n)
{
    long all = sysconf(_SC_NPROCESSORS_ONLN);
    unsigned share = all < (long)n ? 1 : (unsigned)all / n;
    return mine < share ? mine : share;
}

/* Each process of mpirun takes the part of its rank. */
static pvx_err deal(struct job *j, struct reconstruct_options *o, struct pvx_diag *d)
{
    o->node_n = j->ranks.n = 1;
    if (o->parts > 0 || o->slurm > 0 || o->plan) /* the part is given */
        return PVX_OK;
    PVX_TRY(ranks_open(&j->ranks, d));
    if (j->ranks.n == 1 && o->resume)
        return pvx_fail(d, PVX_EINVAL,
                        "--resume continues parts: use --array I/N, --slurm N or mpirun -n N as "
                        "before; a single process that can be continued is --array 1/1");
    if (j->ranks.n == 1)
        return PVX_OK;
    if (!o->recording)
        return pvx_fail(d, PVX_EINVAL,
                        "%u processes were started together: they need --out FILE.h5", j->ranks.n);
    o->part = j->ranks.rank + 1;
    o->parts = j->ranks.n;
    o->node_n = j->ranks.node_n;
    if (o->rig.threads == 0) /* ranks that share a NUMA domain may each run on all of it */
        o->rig.threads = reconstruct_share_of(pvx_cpu_count(), o->node_n);
    o->quiet |= j->ranks.rank > 0;
    return PVX_OK;
}

static int reconstruct_run(int argc, char **argv)
{
    struct reconstruct_options o;
    reconstruct_parse(argc, argv, &o);
    if (o.join) {
        free(o.said);
        return reconstruct_join(o.out);
    }
    cli_catch_stop();
    struct job j = {.o = &o, .params = o.frame};
    struct pvx_diag d = {""};
    pvx_err e = deal(&j, &o, &d);
    if (o.slurm > 0)
        o.parts = o.slurm;
    PVX_THEN(e, reconstruct_prepare(&j, &d));
    if (e == PVX_OK && o.slurm > 0)
        e = reconstruct_slurm(&j.part.job, o.resume, argc, argv, o.sbatch, &d);
    else if (e == PVX_OK && o.out != NULL && !o.plan && !j.part.nothing)
        e = reconstruct(&j, &d);
    int code = reconstruct_do_join(&j, reconstruct_conclude(&j, e, &d));
    reconstruct_finish(&j);
    ranks_close(&j.ranks);
    free(o.said);
    return code;
}

const struct cli_command cmd_reconstruct = {
    "reconstruct", "recorded frames in, one volume per frame set out", reconstruct_run};
