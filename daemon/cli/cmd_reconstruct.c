/* cmd_reconstruct.c - recorded frames in, one volume per frame set out (DESIGN 4).
 *
 * A reader thread loads and bins frame set k+1 while set k is solved; two slots circulate, nothing is
 * dropped. */
#include <argp.h>
#include <cjson/cJSON.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"
#include "base/queue.h"
#include "base/yaml.h"
#include "capture/imgio.h"
#include "capture/pixfmt.h"
#include "cli/cli.h"
#include "cli/opt_rig.h"
#include "framedir.h"
#include "recon/frame.h"
#include "volume_file.h"

#define SLOTS 3

struct options {
    struct opt_rig rig;
    const char *frames, *out, *report, *cache, *background;
    struct rec_frame_params frame;
    uint32_t first, last;
    double deadline_ms;
    bool grey, warm, quiet, no_hull;
};

enum {
    OPT_FRAMES = 0x100,
    OPT_OUT,
    OPT_REPORT,
    OPT_SOLVER,
    OPT_ITER,
    OPT_STOP,
    OPT_LAMBDA,
    OPT_DEADLINE,
    OPT_FIRST,
    OPT_LAST,
    OPT_THRESHOLD,
    OPT_MARGIN,
    OPT_BLACK,
    OPT_MIN_VIEWS,
    OPT_STRICT,
    OPT_NO_HULL,
    OPT_BACKGROUND,
    OPT_GREY,
    OPT_WARM,
    OPT_CACHE,
    OPT_QUIET
};

static const struct argp_option option_table[] = {
    {"frames", OPT_FRAMES, "DIR", 0, "DIR/<camera>/<6 digits>.(npy|png|tif)", 0},
    {"out", OPT_OUT, "DIR", 0, "volumes go to DIR/<6 digits>.npy with a .json beside each", 0},
    {"save-report", OPT_REPORT, "FILE", 0, "solver report of every frame as JSON", 0},
    {"first", OPT_FIRST, "N", 0, "first frame number", 0},
    {"last", OPT_LAST, "N", 0, "last frame number", 0},
    {"grey", OPT_GREY, NULL, 0, "solve one channel (colour images: their mean)", 0},
    {"warm-start", OPT_WARM, NULL, 0, "start each frame from the volume before it", 0},
    {"matrix-cache", OPT_CACHE, "FILE", 0, "where the system matrix is kept (default: user cache)",
     0},
    {"quiet", OPT_QUIET, NULL, 0, "no progress", 0},
    {NULL, 0, NULL, 0, "Solver:", 2},
    {"solver", OPT_SOLVER, "NAME", 0, "pcg (default), cgls-paper or mlem", 2},
    {"iterations", OPT_ITER, "N", 0, "at most N; without --stop exactly the budget", 2},
    {"stop", OPT_STOP, "RULE", 0, "auto (default), lcurve, discrepancy or iterations", 2},
    {"lambda", OPT_LAMBDA, "X", 0, "weight of the smoothness term (default: from the noise)", 2},
    {"deadline-ms", OPT_DEADLINE, "T", 0, "return the best iterate after T ms of solving", 2},
    {NULL, 0, NULL, 0, "Silhouettes and hull:", 3},
    {"threshold", OPT_THRESHOLD, "X|auto", 0, "flame is >= X of full scale (auto: from the noise)",
     3},
    {"black", OPT_BLACK, "X", 0, "black level, share of full scale (default 0)", 3},
    {"margin", OPT_MARGIN, "N", 0, "grow silhouettes by N bins, for calibration error (default 0)",
     3},
    {"min-views", OPT_MIN_VIEWS, "N", 0, "cameras that must see a voxel (default 2)", 3},
    {"strict-hull", OPT_STRICT, NULL, 0, "drop voxels that are only partly inside", 3},
    {"no-hull", OPT_NO_HULL, NULL, 0, "for comparison: solve for every voxel that is seen", 3},
    {"background", OPT_BACKGROUND, "DIR", 0,
     "subtract DIR/<camera>.(npy|png|tif), an image of the scene without flame", 3},
    {0},
};

static void number(struct argp_state *st, const char *opt, const char *arg, double lo, double hi,
                   double *out)
{
    if (pvx_parse_double(arg, lo, hi, out) != PVX_OK)
        argp_error(st, "--%s %s: should be a number from %g to %g", opt, arg, lo, hi);
}

static int parse_stop(const char *arg, enum rec_stop *out)
{
    static const char *const names[] = {"auto", "lcurve", "discrepancy", "iterations"};
    static const enum rec_stop values[] = {REC_STOP_AUTO, REC_STOP_LCURVE, REC_STOP_DISCREPANCY,
                                           REC_STOP_ITERATIONS};
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++)
        if (strcmp(arg, names[i]) == 0) {
            *out = values[i];
            return 1;
        }
    return 0;
}

static error_t parse(int key, char *arg, struct argp_state *st)
{
    struct options *o = st->input;
    double v = 0;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &o->rig; return 0;
    case OPT_FRAMES: o->frames = arg; return 0;
    case OPT_OUT: o->out = arg; return 0;
    case OPT_REPORT: o->report = arg; return 0;
    case OPT_CACHE: o->cache = arg; return 0;
    case OPT_FIRST:
        number(st, "first", arg, 0, 999999, &v);
        o->first = (uint32_t)v;
        return 0;
    case OPT_LAST:
        number(st, "last", arg, 0, 999999, &v);
        o->last = (uint32_t)v;
        return 0;
    case OPT_GREY: o->grey = true; return 0;
    case OPT_WARM: o->warm = true; return 0;
    case OPT_QUIET: o->quiet = true; return 0;
    case OPT_SOLVER: {
        const char *const *names = rec_solver_names();
        for (; *names != NULL; names++)
            if (strcmp(*names, arg) == 0)
                o->frame.solve.solver = *names;
        if (o->frame.solve.solver == NULL || strcmp(o->frame.solve.solver, arg) != 0)
            argp_error(st, "--solver %s: not one of pcg, cgls-paper, mlem", arg);
        return 0;
    }
    case OPT_ITER:
        number(st, "iterations", arg, 1, 1e6, &v);
        o->frame.solve.iterations = (uint32_t)v;
        if (o->frame.solve.stop == REC_STOP_AUTO)
            o->frame.solve.stop = REC_STOP_ITERATIONS;
        return 0;
    case OPT_STOP:
        if (!parse_stop(arg, &o->frame.solve.stop))
            argp_error(st, "--stop %s: should be auto, lcurve, discrepancy or iterations", arg);
        return 0;
    case OPT_LAMBDA:
        number(st, "lambda", arg, 0, 1e6, &v);
        o->frame.solve.lambda = (float)v;
        return 0;
    case OPT_DEADLINE: number(st, "deadline-ms", arg, 0.01, 1e9, &o->deadline_ms); return 0;
    case OPT_THRESHOLD:
        v = -1;
        if (strcmp(arg, "auto") != 0)
            number(st, "threshold", arg, 0, 1e6, &v);
        o->frame.photo.threshold = (float)v;
        return 0;
    case OPT_BLACK:
        number(st, "black", arg, 0, 1, &v);
        o->frame.photo.black = (float)v;
        return 0;
    case OPT_MARGIN:
        number(st, "margin", arg, 0, 64, &v);
        o->frame.photo.margin = (int32_t)v;
        return 0;
    case OPT_MIN_VIEWS:
        number(st, "min-views", arg, 1, REC_MAX_CAMERAS, &v);
        o->frame.hull.min_views = (uint32_t)v;
        return 0;
    case OPT_STRICT: o->frame.hull.keep_partial = 0; return 0;
    case OPT_NO_HULL: o->no_hull = true; return 0;
    case OPT_BACKGROUND: o->background = arg; return 0;
    case ARGP_KEY_ARG: argp_error(st, "unexpected argument '%s'", arg); return 0;
    case ARGP_KEY_END:
        if (o->frames == NULL || o->out == NULL || o->rig.path == NULL)
            argp_error(st, "needs --rig, --frames and --out");
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

/* One slot: a frame set on its way from the reader to the solver. */
struct slot {
    rec_frame *frame;
    size_t index; /* into the framedir */
    uint32_t present;
    bool failed;             /* a file could not be used: named in `problem` */
    struct pvx_diag problem; /* the first */
    bool have[REC_MAX_CAMERAS];
    int64_t bin_ns;
};

struct job {
    const struct options *o;
    struct rec_rig rig;
    rec_sysmat *S;
    struct dmn_framedir dir;
    struct rec_frame_params params;
    pvx_pool *pool;
    struct slot slot[SLOTS];
    unsigned volumes; /* written */
    pvx_queue *empty, *full;
};

static bool wanted(const struct options *o, uint32_t number)
{
    return number >= o->first && number <= o->last;
}

/* Load an image of camera c and bin it into out; *bin_ns = time for the binning alone. */
static pvx_err load_binned(const struct job *j, const char *path, size_t c, float *out,
                           int64_t *bin_ns, struct pvx_diag *d)
{
    const struct rec_camera *cam = &j->rig.cameras[c];
    struct cap_loaded l;
    PVX_TRY(cap_image_load(path, &l, d));
    pvx_err e;
    int64_t t0 = pvx_now_mono();
    if (l.img.width != cam->width || l.img.height != cam->height)
        e = pvx_fail(d, PVX_EINVAL, "%s: is %dx%d, but the rig says camera %s takes %dx%d", path,
                     l.img.width, l.img.height, cam->name, cam->width, cam->height);
    else if ((e = cap_bin(&l.img, j->S->binning, j->params.nch, 0, j->S->block[c].bh, out)) !=
             PVX_OK)
        pvx_fail(d, e, "%s: %s", path, pvx_strerror(e));
    *bin_ns = pvx_now_mono() - t0;
    cap_loaded_free(&l);
    return e;
}

/* Load and bin frame `i` of camera `c` into the slot.  A file that is not there is a missing camera;
 * one that cannot be used is a failure, but the other cameras still count. */
static void load_camera(struct job *j, struct slot *s, size_t c)
{
    char path[4300];
    if (!dmn_framedir_path(&j->dir, &j->rig, s->index, c, path, sizeof path))
        return;
    int64_t t0 = 0;
    struct pvx_diag why = {""};
    pvx_err e = load_binned(j, path, c, rec_frame_input(s->frame, c), &t0, &why);
    s->bin_ns += t0;
    if (e != PVX_OK) {
        fprintf(stderr, "pyrovox: %s\n", pvx_diag_text(&why, e));
        pvx_fail(&s->problem, e, "%s", pvx_diag_text(&why, e));
        s->failed = true;
        return;
    }
    s->have[c] = true;
    rec_frame_present(s->frame, c, true);
    s->present++;
}

static void *reader(void *arg)
{
    struct job *j = arg;
    for (size_t i = 0; i < j->dir.n_frames && !cli_stop; i++) {
        if (!wanted(j->o, j->dir.number[i]))
            continue;
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
    cJSON_AddNumberToObject(o, "frame", j->dir.number[s->index]);
    dmn_report_to_json(o, rec_frame_get_report(s->frame));
    if (s->present == 0)
        cJSON_ReplaceItemInObject(o, "status", cJSON_CreateString("failed"));
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

/* Carve, solve and save one frame set; *failed is set when something about it went wrong. */
static pvx_err do_frame(struct job *j, struct slot *s, struct rec_sparse *prev, float *dense,
                        cJSON *list, bool *failed, struct pvx_diag *d)
{
    uint32_t no = j->dir.number[s->index];
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
    int64_t deadline = 0;
    if (j->o->deadline_ms > 0)
        deadline = pvx_now_mono() + (int64_t)(j->o->deadline_ms * 1e6);
    PVX_TRY(rec_frame_solve(s->frame, deadline, prev->grid != NULL ? prev : NULL));
    const struct rec_frame_report *r = rec_frame_get_report(s->frame);
    struct rec_sparse v;
    rec_frame_volume(s->frame, &v);
    rec_sparse_to_dense(&v, dense);
    char path[4300];
    snprintf(path, sizeof path, "%s/%06u.npy", j->o->out, no);
    struct dmn_volume_meta m = {
        .grid = j->S->grid, .nch = v.nch, .frame = no, .clock = "frame-number", .report = r};
    PVX_TRY(dmn_volume_save(path, &m, dense, d));
    report_frame(j, s, list);
    j->volumes++;
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

/* Channels and the meaning of "saturated" come from the first image that can be read. */
static pvx_err look_at_first(struct job *j, struct pvx_diag *d)
{
    for (size_t i = 0; i < j->dir.n_frames; i++)
        for (size_t c = 0; c < j->rig.n_cameras; c++) {
            char path[4300];
            struct cap_loaded l;
            struct pvx_diag why = {""};
            if (!wanted(j->o, j->dir.number[i]) ||
                !dmn_framedir_path(&j->dir, &j->rig, i, c, path, sizeof path))
                continue;
            pvx_err e = cap_image_load(path, &l, &why);
            if (e != PVX_OK) {
                pvx_fail(d, e, "%s", why.text);
                continue;
            }
            j->params.nch = j->o->grey ? 1 : cap_pixfmt_channels(l.img.fmt);
            if (l.img.fmt == CAP_GREY_F32 || l.img.fmt == CAP_RGB_F32)
                j->params.photo.saturation = 1e30F; /* floats have no full scale to run into */
            cap_loaded_free(&l);
            if (d != NULL)
                d->text[0] = '\0';
            return PVX_OK;
        }
    return pvx_fail(d, PVX_ENOENT, "%s: no frames from %06u to %06u", j->o->frames, j->o->first,
                    j->o->last);
}

/* The background of every camera into every slot. */
static pvx_err set_background(struct job *j, struct pvx_diag *d)
{
    static const char *const ext[] = {"npy", "tif", "tiff", "png"};
    for (size_t c = 0; c < j->rig.n_cameras; c++) {
        char path[4300] = "";
        for (size_t i = 0; i < sizeof ext / sizeof ext[0]; i++) {
            snprintf(path, sizeof path, "%s/%s.%s", j->o->background, j->rig.cameras[c].name,
                     ext[i]);
            if (access(path, F_OK) == 0)
                break;
        }
        int64_t ns;
        float *bins = rec_frame_input(j->slot[0].frame, c);
        PVX_TRY(load_binned(j, path, c, bins, &ns, d));
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

static pvx_err prepare(struct job *j, struct pvx_diag *d)
{
    if (j->o->no_hull)
        without_hull(&j->params);
    PVX_TRY(opt_rig_load(&j->o->rig, &j->rig, d));
    PVX_TRY(dmn_framedir_scan(j->o->frames, &j->rig, &j->dir, d));
    PVX_TRY(look_at_first(j, d));
    PVX_TRY(pvx_mkdirs(j->o->out, d));
    PVX_TRY(pvx_pool_new(j->o->rig.threads, "solve", &j->pool));
    struct cli_progress bar = {.label = "system matrix"};
    PVX_TRY(rec_sysmat_open(&j->rig, &j->o->rig.matrix, j->o->cache, j->pool,
                            j->o->quiet ? NULL : cli_progress, &bar, &j->S, NULL, d));
    PVX_TRY(pvx_queue_new(SLOTS, &j->empty));
    PVX_TRY(pvx_queue_new(SLOTS, &j->full));
    for (int i = 0; i < SLOTS; i++) {
        PVX_TRY(rec_frame_new(j->S, &j->rig, &j->params, j->pool, &j->slot[i].frame, d));
        PVX_TRY(pvx_queue_put_wait(j->empty, &j->slot[i]));
    }
    return j->o->background != NULL ? set_background(j, d) : PVX_OK;
}

static void finish(struct job *j)
{
    for (int i = 0; i < SLOTS; i++)
        rec_frame_free(&j->slot[i].frame);
    pvx_queue_free(&j->empty);
    pvx_queue_free(&j->full);
    rec_sysmat_free(&j->S);
    pvx_pool_free(&j->pool);
    dmn_framedir_fini(&j->dir);
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
            cli_progress(&bar, (double)(s->index + 1) / (double)j->dir.n_frames);
        if (cli_stop)
            break;
    }
    pvx_queue_close(j->empty);
    pvx_queue_close(j->full);
    pthread_join(th, NULL);
    free(dense);
    return e;
}

static int run(int argc, char **argv)
{
    static const struct argp_child children[] = {{&opt_rig_argp, 0, "", 1}, {0}};
    static const struct argp argp = {
        .options = option_table,
        .parser = parse,
        .children = children,
        .doc =
            "Reconstruct one emission volume per recorded frame set.\v"
            "Images are linear: 8/16-bit with full scale 1.0, .npy float32 as it is. A frame that "
            "some camera lacks is solved from the others; a file that cannot be used is named, "
            "the rest goes on, and the exit code is 1.\n\n"
            "Example: pyrovox reconstruct --rig rig.yaml --frames take1 --out volumes --grid 64 "
            "--save-report report.json"};
    struct options o = {.rig = OPT_RIG_INIT, .last = 999999};
    o.frame = rec_frame_defaults;
    argp_err_exit_status = 2;
    argp_parse(&argp, argc, argv, 0, NULL, &o);
    cli_catch_stop();
    struct job j = {.o = &o, .params = o.frame};
    struct pvx_diag d = {""};
    bool failed = false;
    cJSON *root = cJSON_CreateObject();
    cJSON *list = cJSON_AddArrayToObject(root, "frames");
    pvx_err e = prepare(&j, &d);
    if (e == PVX_OK) {
        e = solve_all(&j, list, &failed, &d);
        /* the report is written for what was done, also after an error or Ctrl-C */
        struct pvx_diag dr = {""};
        pvx_err er = o.report == NULL ? PVX_OK : save_report(o.report, root, &dr);
        if (er != PVX_OK) {
            cli_error(&dr, er);
            failed = true;
        }
    }
    if (e == PVX_OK && !o.quiet)
        fprintf(stderr, "%u volumes in %s\n", j.volumes, o.out);
    cJSON_Delete(root);
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
