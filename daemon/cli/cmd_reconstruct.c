/* cmd_reconstruct.c - recorded frames in, one volume per frame set out (DESIGN 4).
 *
 * A reader thread loads and bins frame set k+1 while set k is solved; two slots circulate, nothing is
 * dropped. */
#include <cjson/cJSON.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"
#include "base/queue.h"
#include "cli/cli.h"
#include "cli/frames_in.h"
#include "cli/hull_picture.h"
#include "cli/reconstruct_fit.h"
#include "cli/reconstruct_options.h"
#include "pipeline/volume_file.h"

#define SLOTS 3

/* One slot: a frame set on its way from the reader to the solver. */
struct slot {
    rec_frame *frame;
    size_t index; /* of the set in job.in */
    uint32_t present;
    bool failed;             /* a file could not be used: named in `problem` */
    struct pvx_diag problem; /* the first */
    bool have[REC_MAX_CAMERAS];
    int64_t bin_ns;
};

struct job {
    const struct reconstruct_options *o;
    struct rec_rig rig;
    struct rec_grid whole; /* the rig's own, before it was fitted */
    rec_sysmat *S;
    struct frames_in in;
    struct rec_frame_params params;
    pvx_pool *pool;
    hull_picture *picture; /* NULL = none wanted */
    struct slot slot[SLOTS];
    unsigned volumes; /* written */
    bool said_lit;    /* that nearly all of an image is */
    unsigned dark;    /* of them, without one iteration before the deadline */
    unsigned cut;     /* of them, flame at a side of the fitted box */
    pvx_queue *empty, *full;
};

/* Load and bin camera `c` of the slot's set.  A file that is not there is a missing camera; one that
 * cannot be used is a failure, but the other cameras still count. */
static void load_camera(struct job *j, struct slot *s, size_t c)
{
    struct pvx_diag why = {""};
    float *in = rec_frame_input(s->frame, c);
    enum frames_in_got got = frames_in_load(&j->in, s->index, c, in, &s->bin_ns, &why);
    if (got == FRAMES_BAD) {
        fprintf(stderr, "pyrovox: %s\n", why.text);
        pvx_fail(&s->problem, PVX_EINVAL, "%s", why.text);
        s->failed = true;
    }
    s->have[c] = got == FRAMES_LOADED;
    s->present += s->have[c];
    rec_frame_present(s->frame, c, s->have[c]);
    rec_frame_bayer(s->frame, c, cap_pixfmt_bayer(j->in.how.fmt),
                    j->in.how.mosaic == CAP_MOSAIC_RAYS && j->in.binning == 1);
}

static void *reader(void *arg)
{
    struct job *j = arg;
    for (size_t i = 0; i < j->in.n && !cli_stop; i++) {
        void *item;
        if (pvx_queue_take(j->empty, -1, &item) != PVX_OK)
            break;
        struct slot *s = item;
        rec_frame_reset(s->frame);
        s->index = i;
        s->present = 0;
        memset(s->have, 0, sizeof s->have);
        s->failed = false;
        s->problem.text[0] = '\0';
        s->bin_ns = 0;
        for (size_t c = 0; c < j->rig.n_cameras; c++)
            load_camera(j, s, c);
        if (pvx_queue_put_wait(j->full, s) != PVX_OK)
            break;
    }
    pvx_queue_close(j->full);
    return NULL;
}

static void report_frame(const struct job *j, const struct slot *s, cJSON *list)
{
    cJSON *o = cJSON_CreateObject();
    cJSON_AddNumberToObject(o, "frame", frames_in_number(&j->in, s->index));
    dmn_report_to_json(o, rec_frame_get_report(s->frame));
    if (s->present == 0)
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
        if (!s->have[c])
            cJSON_AddItemToArray(missing, cJSON_CreateString(j->rig.cameras[c].name));
    cJSON_AddItemToArray(list, o);
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

/* Flame at a side of the fitted box that is not also a side of the rig's: the frames that the box was
 * fitted to had none there. */
static bool reaches_side(const struct job *j, const struct rec_sparse *v)
{
    const struct rec_grid *g = v->grid;
    bool cut[3][2];
    for (int a = 0; a < 3; a++) {
        cut[a][0] = g->min[a] > j->whole.min[a] + 1e-9;
        cut[a][1] = g->max[a] < j->whole.max[a] - 1e-9;
    }
    for (int32_t q = 0; q < v->n; q++) {
        int32_t ijk[3];
        float light = 0;
        for (int l = 0; l < v->nch; l++)
            light += v->value[(size_t)q * (size_t)v->cs + (size_t)l];
        rec_grid_ijk(g, v->index[q], ijk);
        for (int a = 0; light > 0 && a < 3; a++)
            if ((ijk[a] == 0 && cut[a][0]) || (ijk[a] == g->n[a] - 1 && cut[a][1]))
                return true;
    }
    return false;
}

static void check_lit(struct job *j, const struct slot *s)
{
    for (size_t c = 0; c < j->rig.n_cameras && !j->said_lit && !j->o->no_hull && !j->o->fit; c++) {
        const struct rec_camera *cam = &j->rig.cameras[c];
        size_t bins = (size_t)frames_in_bins(&j->in, cam->width) *
                      (size_t)frames_in_bins(&j->in, cam->height),
               lit = 0;
        const uint8_t *at = rec_frame_lit(s->frame, c);
        for (size_t i = 0; s->have[c] && i < bins; i++)
            lit += at[i] != 0;
        reconstruct_check_lit(cam->name, lit, bins, &j->said_lit);
    }
}

/* Carve, solve and save one frame set; *failed is set when something about it went wrong. */
static pvx_err do_frame(struct job *j, struct slot *s, struct rec_sparse *prev, float *dense,
                        cJSON *list, bool *failed, struct pvx_diag *d)
{
    uint32_t no = frames_in_number(&j->in, s->index);
    *failed |= s->failed;
    if (s->present == 0) {
        report_frame(j, s, list);
        return PVX_OK;
    }
    if (s->present < j->rig.n_cameras) {
        char names[600] = "";
        for (size_t c = 0; c < j->rig.n_cameras && strlen(names) < 500; c++)
            if (!s->have[c])
                snprintf(names + strlen(names), sizeof names - strlen(names), " %s",
                         j->rig.cameras[c].name);
        fprintf(stderr, "pyrovox: frame %06u: solved from %u of %zu cameras, without%s\n", no,
                s->present, j->rig.n_cameras, names);
    }
    rec_frame_carve(s->frame);
    check_lit(j, s);
    char path[4300];
    if (j->picture != NULL) {
        snprintf(path, sizeof path, "%s/%06u.png", j->o->save_hull, no);
        PVX_TRY(hull_picture_save(j->picture, s->frame, s->have, no, path, d));
    }
    bool warm = prev->grid != NULL && prev->n > 0;
    int64_t deadline = 0;
    if (j->o->deadline_ms > 0)
        deadline = pvx_now_mono() + (int64_t)(j->o->deadline_ms * 1e6);
    PVX_TRY(rec_frame_solve(s->frame, deadline, warm ? prev : NULL));
    const struct rec_frame_report *r = rec_frame_get_report(s->frame);
    struct rec_sparse v;
    rec_frame_volume(s->frame, &v);
    rec_sparse_to_dense(&v, dense);
    snprintf(path, sizeof path, "%s/%06u.npy", j->o->out, no);
    struct dmn_volume_meta m = {
        .grid = j->S->grid, .nch = v.nch, .frame = no, .clock = "frame-number", .report = r};
    PVX_TRY(dmn_volume_save(path, &m, dense, d));
    report_frame(j, s, list);
    j->volumes++;
    j->dark += r->solve.status == REC_DEADLINE && r->solve.iterations == 0 &&
               r->coarse_iterations == 0 && !r->warm;
    j->cut += j->o->fit && reaches_side(j, &v);
    if (j->o->warm)
        *prev = v;
    return PVX_OK;
}

static pvx_err save_report(const char *path, cJSON *root, struct pvx_diag *d)
{
    char *text = cJSON_Print(root);
    if (text == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: out of memory", path);
    pvx_err e = pvx_file_write(path, text, strlen(text), d);
    cJSON_free(text);
    return e;
}

/* The background of every camera into every slot. */
static pvx_err set_background(struct job *j, struct pvx_diag *d)
{
    for (size_t c = 0; c < j->rig.n_cameras; c++) {
        float *bins = rec_frame_input(j->slot[0].frame, c);
        PVX_TRY(frames_in_background(&j->in, j->o->background, c, bins, d));
        for (int i = 0; i < SLOTS; i++)
            PVX_TRY(rec_frame_set_background(j->slot[i].frame, c, bins));
    }
    return PVX_OK;
}

/* Everything is flame: the hull then drops only what no camera sees. */
static void without_hull(struct rec_frame_params *p)
{
    p->photo.threshold = 0;
    p->photo.margin = 16; /* noise may be below 0 here and there */
    p->hull.min_views = 1;
}

/* Rig, frames and the grid to work on. */
static pvx_err find_input(struct job *j, struct pvx_diag *d)
{
    const struct reconstruct_options *o = j->o;
    struct opt_rig as_in_file = o->rig;
    if (o->fit) /* --grid is then for the fitted box */
        memset(as_in_file.grid, 0, sizeof as_in_file.grid);
    if (o->no_hull)
        without_hull(&j->params);
    PVX_TRY(opt_rig_load(&as_in_file, &j->rig, d));
    if (j->params.hull.min_views > j->rig.n_cameras)
        return pvx_fail(
            d, PVX_EINVAL,
            "--min-views %u: that many cameras must see a voxel, but there are only %zu",
            j->params.hull.min_views, j->rig.n_cameras);
    j->whole = j->rig.grid;
    struct frames_in_reading how = o->reading;
    how.mosaic = CAP_MOSAIC_DEMOSAIC; /* until the volume is fitted */
    PVX_TRY(frames_in_scan(&j->in, &j->rig, o->frames, o->first, o->last, o->grey, &how, d));
    j->params.nch = j->in.nch;
    if (!j->in.full_scale) /* floats have no full scale to run into */
        j->params.photo.saturation = 1e30F;
    PVX_TRY(pvx_pool_new(o->rig.threads, "solve", &j->pool));
    return o->fit ? reconstruct_fit(o, &j->in, &j->params, j->pool, &j->rig, d) : PVX_OK;
}

static pvx_err prepare(struct job *j, struct pvx_diag *d)
{
    const struct reconstruct_options *o = j->o;
    PVX_TRY(find_input(j, d));
    if (o->out == NULL)
        return PVX_OK;
    PVX_TRY(pvx_mkdirs(o->out, d));
    if (o->save_hull != NULL)
        PVX_TRY(pvx_mkdirs(o->save_hull, d));
    struct cli_progress bar = {.label = "system matrix"};
    PVX_TRY(rec_sysmat_open(&j->rig, &o->rig.matrix, o->cache, j->pool,
                            o->quiet ? NULL : cli_progress, &bar, &j->S, NULL, d));
    j->in.binning = j->S->binning;
    j->in.how.mosaic = o->reading.mosaic;
    PVX_TRY(pvx_queue_new(SLOTS, &j->empty));
    PVX_TRY(pvx_queue_new(SLOTS, &j->full));
    for (int i = 0; i < SLOTS; i++) {
        PVX_TRY(rec_frame_new(j->S, &j->rig, &j->params, j->pool, &j->slot[i].frame, d));
        PVX_TRY(pvx_queue_put_wait(j->empty, &j->slot[i]));
    }
    if (o->save_hull != NULL)
        PVX_TRY(hull_picture_new(j->S, &j->rig, j->params.nch, j->params.hull.min_views, j->pool,
                                 &j->picture));
    return o->background != NULL ? set_background(j, d) : PVX_OK;
}

static void finish(struct job *j)
{
    for (int i = 0; i < SLOTS; i++)
        rec_frame_free(&j->slot[i].frame);
    pvx_queue_free(&j->empty);
    pvx_queue_free(&j->full);
    hull_picture_free(&j->picture);
    rec_sysmat_free(&j->S);
    pvx_pool_free(&j->pool);
    frames_in_fini(&j->in);
    rec_rig_fini(&j->rig);
}

/* The previous volume lives in its slot, so the slot goes back to the reader only when the next volume
 * has been made. */
static pvx_err solve_all(struct job *j, cJSON *list, bool *failed, struct pvx_diag *d)
{
    float *dense = pvx_calloc(rec_grid_count(&j->S->grid) * (size_t)j->params.nch, sizeof *dense);
    if (dense == NULL)
        return pvx_fail(d, PVX_ENOMEM, "out of memory for a dense volume");
    pthread_t th;
    if (pthread_create(&th, NULL, reader, j) != 0) {
        free(dense);
        return pvx_fail(d, PVX_EIO, "cannot start the reader thread");
    }
    struct cli_progress bar = {.label = "reconstruct"};
    struct rec_sparse prev = {0};
    struct slot *kept = NULL;
    pvx_err e = PVX_OK;
    void *item;
    while (e == PVX_OK && pvx_queue_take(j->full, -1, &item) == PVX_OK) {
        struct slot *s = item;
        e = do_frame(j, s, &prev, dense, list, failed, d);
        struct slot *done = s;
        if (s->present > 0) { /* a set without a volume does not displace the volume before it */
            done = kept;
            kept = s;
        }
        if (done != NULL && pvx_queue_put_wait(j->empty, done) != PVX_OK)
            break;
        if (!j->o->quiet)
            cli_progress(&bar, (double)(s->index + 1) / (double)j->in.n);
        if (cli_stop)
            break;
    }
    pvx_queue_close(j->empty);
    pvx_queue_close(j->full);
    pthread_join(th, NULL);
    free(dense);
    return e;
}

/* After an error or Ctrl-C too the report is written for what was done. */
static pvx_err reconstruct(struct job *j, bool *failed, struct pvx_diag *d)
{
    const struct reconstruct_options *o = j->o;
    cJSON *root = cJSON_CreateObject();
    describe_volume(root, j);
    cJSON *list = cJSON_AddArrayToObject(root, "frames");
    pvx_err e = solve_all(j, list, failed, d);
    struct pvx_diag dr = {""};
    pvx_err er = o->report == NULL ? PVX_OK : save_report(o->report, root, &dr);
    if (er != PVX_OK) {
        cli_error(&dr, er);
        *failed = true;
    }
    cJSON_Delete(root);
    if (e == PVX_OK && !o->quiet)
        fprintf(stderr, "%u volume%s in %s\n", j->volumes, j->volumes == 1 ? "" : "s", o->out);
    if (j->dark > 0)
        fprintf(stderr,
                "pyrovox: in %u of %u volumes not one iteration was done by the deadline: they are "
                "empty; allow more than --deadline %g, or make less of it (--grid, --binning)\n",
                j->dark, j->volumes, o->deadline_ms);
    if (j->cut > 0)
        fprintf(stderr,
                "pyrovox: in %u of %u volumes the flame reaches a side of the fitted box: look at "
                "more frames (--fit-frames all) or leave more room (--fit-volume=MARGIN)\n",
                j->cut, j->volumes);
    return e;
}

static int run(int argc, char **argv)
{
    struct reconstruct_options o;
    reconstruct_parse(argc, argv, &o);
    cli_catch_stop();
    struct job j = {.o = &o, .params = o.frame};
    struct pvx_diag d = {""};
    bool failed = false;
    pvx_err e = prepare(&j, &d);
    if (e == PVX_OK && o.out != NULL)
        e = reconstruct(&j, &failed, &d);
    finish(&j);
    if (e == PVX_ECANCELED || (e == PVX_OK && cli_stop)) {
        fprintf(stderr, "pyrovox: stopped\n");
        return 130;
    }
    if (e != PVX_OK)
        return cli_error(&d, e);
    return failed ? 1 : 0;
}

const struct cli_command cmd_reconstruct = {
    "reconstruct", "recorded frames in, one volume per frame set out", run};
