/* live.c - `pyrovox calibrate live`: pictures through the rig's own cameras, and the rig from them. */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/log.h"
#include "base/mem.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/calibrate/screen.h"
#include "daemon/cli/common/cli.h"

#define LOOK_NS  (50 * PVX_NS_PER_MS)
#define STATS_NS (500 * PVX_NS_PER_MS)

struct args {
    struct calibrate_args c;
    const char *config, *frames;
    int64_t poses;
    int argc;
    char **argv;
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"c|config", "FILE", AT(config), 0, 0,
     "the cameras of this pyrovoxd.yaml, set up and triggered as it says"},
    {"frames", "DIR", AT(frames), 0, 0,
     "keep the pictures here, and go on from those that are there (default: beside the rig, "
     "rig-frames for rig.yaml)"},
    {"poses", "N", AT(poses), 0, 1000000,
     "end by itself once there are so many (0, the default: never)"},
    {0}};

static const char doc[] =
    "Calibrate through the rig's own cameras and triggers.\vExamples:\n"
    "  pyrovox calibrate live --config pyrovoxd.yaml \\\n"
    "          --board charuco:8x11:0.03:0.022:two-sided \\\n"
    "          --volume -0.5,-0.5,0,0.5,0.5,1 --out rig.yaml\n"
    "\n"
    "Stop pyrovoxd first: a camera has one master. Then:\n"
    "  1. Lay the board flat where the middle of the volume's floor is. The first picture is taken "
    "of it there: x = y = 0 is its middle, its rows are x, z is up. (Not with --up or --keep.)\n"
    "  2. Carry it from pose to pose and hold it still. All cameras take a picture at one instant "
    "once the board stood still for half a second in a new pose.\n"
    "  3. Do what the screen says. It shows which cameras still lack joint poses, the expected "
    "volume error, and the pose that would lower it most. \"face cam3, low, tilt left\": the board "
    "looks at cam3, low in the volume, with its face turned to the left as cam3 sees it.\n"
    "  4. Press Ctrl-C. Every picture stays. All are solved once more with all checks, and the rig "
    "is written unless it should not be believed. The same command continues from there, and so "
    "does `pyrovox calibrate solve --frames DIR`.\n"
    "\n"
    "A camera that gave no picture is named, and the rig is made without it.\n"
    "\n"
    "In the configuration, `cameras` must name each camera as long as there is no rig: cameras: "
    "{cam0: \"aravis:192.168.1.21\", cam1: ...}. Pictures have the size that the cameras are set "
    "to, or that of the older rig. Without --volume, the older rig's is used.\n"
    "\n"
    "Without a terminal it prints a line for each event.\n"
    "Exit code 0 when the rig was written, also after Ctrl-C.\n"
    "\n"
    "Without cameras:\n"
    "  (echo cameras:; printf '  cam%d: \"aravis:127.0.0.%d\"\\n' 0 2 1 3 2 4 3 5) \\\n"
    "          > sim.yaml\n"
    "  printf 'fps: 10\\nshared_clock: true\\n' >> sim.yaml\n"
    "  pyrovox simcams --private-net --cameras 4 --radius 1.6 --height 0.9 \\\n"
    "          --board charuco:5x6:0.14:0.105:two-sided -- pyrovox calibrate live \\\n"
    "          --config sim.yaml --board charuco:5x6:0.14:0.105:two-sided \\\n"
    "          --volume -0.5,-0.5,0,0.5,0.5,1 --out rig.yaml";

static error_t live_parse_opt(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &a->c; return 0;
    case ARGP_KEY_ARG: argp_error(st, "'%s': this step takes options only", arg); return 0;
    case ARGP_KEY_END:
        if (a->config == NULL)
            argp_error(st, "which cameras? --config pyrovoxd.yaml");
        return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

/* ---- before ---- */

/* "rig.yaml" -> "rig-frames". */
static pvx_err name_frames(const char *out, char *dir, size_t size)
{
    const char *slash = strrchr(out, '/'), *dot = strrchr(out, '.');
    int n = (int)(dot != NULL && (slash == NULL || dot > slash + 1) && dot > out
                      ? dot - out
                      : (ptrdiff_t)strlen(out));
    return snprintf(dir, size, "%.*s-frames", n, out) < (int)size ? PVX_OK : PVX_ERANGE;
}

/* The cameras of the configuration, sorted by name as calibrate_find sorts those of a folder. */
static void name_cameras(struct live *l)
{
    struct calibrate_look *k = &l->job.look;
    const struct rec_rig *rig = &l->cams.rig;
    for (size_t i = 0; i < rig->n_cameras; i++) {
        const char *name = rig->cameras[i].name;
        size_t at = k->n_cameras++;
        for (; at > 0 && strcmp(k->camera[at - 1].name, name) > 0; at--)
            k->camera[at] = k->camera[at - 1];
        k->camera[at] = (struct rec_calib_camera){0};
        snprintf(k->camera[at].name, sizeof k->camera[at].name, "%s", name);
    }
    for (size_t i = 0; i < rig->n_cameras; i++)
        l->look_of[i] =
            (uint32_t)calibrate_camera(k, rig->cameras[i].name, strlen(rig->cameras[i].name));
}

static pvx_err make_folders(const struct live *l, struct pvx_diag *d)
{
    const struct calibrate_look *k = &l->job.look;
    for (size_t c = 0; c < k->n_cameras; c++) {
        char path[4096];
        if (snprintf(path, sizeof path, "%s/%s", l->frames, k->camera[c].name) >= (int)sizeof path)
            return pvx_fail(d, PVX_ERANGE, "%.80s...: name too long", l->frames);
        PVX_TRY(pvx_mkdirs(path, d));
    }
    return PVX_OK;
}

static int live_by_number(const void *a, const void *b)
{
    uint32_t p = ((const struct calibrate_picture *)a)->frame,
             q = ((const struct calibrate_picture *)b)->frame;
    return (p > q) - (p < q);
}

/* Take over the pictures of an earlier run, and find the board in them again. */
static pvx_err live_take_over(struct live *l, struct pvx_diag *d)
{
    struct calibrate_look old, *k = &l->job.look;
    pvx_err e = calibrate_find(&old, l->frames, CAP_NUMBERS_COUNT, d);
    if (e == PVX_ENOENT && old.source == CALIBRATE_FOLDERS) {
        d->text[0] = '\0';
        return PVX_OK;
    }
    if (e == PVX_OK && old.source != CALIBRATE_FOLDERS)
        e = pvx_fail(d, PVX_EINVAL,
                     "%s: there is a take or a video, and pictures cannot be added to it; take "
                     "another --frames",
                     l->frames);
    uint32_t to[REC_MAX_CAMERAS];
    for (size_t i = 0; e == PVX_OK && i < old.n_cameras; i++) {
        to[i] = (uint32_t)calibrate_camera(k, old.camera[i].name, strlen(old.camera[i].name));
        if (to[i] == k->n_cameras)
            e = pvx_fail(d, PVX_EINVAL,
                         "%s/%s: pictures of a camera that the configuration does not have; take "
                         "another --frames, or move them away",
                         l->frames, old.camera[i].name);
    }
    PVX_THEN(e, calibrate_look(&old, &l->job.board, l->pool, l->a->quiet, d));
    if (e == PVX_OK && (k->picture = pvx_calloc(old.n, sizeof *k->picture)) == NULL)
        e = PVX_ENOMEM;
    for (size_t i = 0; e == PVX_OK && i < old.n; i++) {
        k->picture[k->n] = old.picture[i];
        k->picture[k->n].camera = k->picture[k->n].view.camera = to[old.picture[i].camera];
        k->n++;
        old.picture[i].path = NULL;
        old.picture[i].view.corner = NULL;
    }
    if (e == PVX_OK)
        qsort(k->picture, k->n, sizeof *k->picture, live_by_number);
    calibrate_look_fini(&old);
    return e;
}

static pvx_err live_prepare(struct live *l, struct calibrate_args *a, const char *config,
                            struct pvx_diag *d)
{
    PVX_TRY(calibrate_start(&l->job, a, d));
    PVX_TRY(calibrate_cameras_init(&l->cams, config, d));
    const struct rec_grid *g = &l->cams.rig.grid;
    bool one = a->add.n + a->recover.n > 0; /* volume and voxels of --keep */
    if (!a->has_volume && !one && g->n[0] == 0)
        return pvx_fail(d, PVX_EINVAL,
                        "where will the flame burn? --volume x0,y0,z0,x1,y1,z1, metres, z up");
    if (!a->has_volume && !one) {
        memcpy(a->volume, g->min, sizeof g->min);
        memcpy(a->volume + 3, g->max, sizeof g->max);
        a->has_volume = true;
    }
    PVX_TRY(pvx_pool_new((unsigned)a->threads, "board", &l->pool));
    name_cameras(l);
    PVX_TRY(live_take_over(l, d));
    size_t n = l->job.look.n_cameras;
    if ((l->common = pvx_calloc(n * n, sizeof *l->common)) == NULL)
        return PVX_ENOMEM;
    live_count(l);
    if (a->floor < 0 && !a->has_up && a->keep == NULL) /* by default the first picture */
        a->floor = l->job.look.n > 0 ? l->job.look.picture[0].frame : 0;
    PVX_TRY(calibrate_prepare(&l->job, d));
    return make_folders(l, d);
}

/* ---- meanwhile ---- */

static void note_stats(struct live *l, struct cap_stats *s)
{
    cap_capture_stats(l->capture, s);
    pthread_mutex_lock(&l->lock);
    for (size_t i = 0; i < l->cams.rig.n_cameras; i++) {
        struct live_camera *c = &l->camera[l->look_of[i]];
        c->running = s->camera[i].state == CAP_RUNNING;
        c->fps = s->camera[i].fps;
        snprintf(c->error, sizeof c->error, "%s", s->camera[i].error);
    }
    l->dropped = s->sets_dropped;
    pthread_mutex_unlock(&l->lock);
}

static bool live_enough(struct live *l, int64_t poses)
{
    pthread_mutex_lock(&l->lock);
    bool done = l->e != PVX_OK || (poses > 0 && l->poses >= (size_t)poses);
    pthread_mutex_unlock(&l->lock);
    return done;
}

static pvx_err live_run(struct live *l, int64_t poses, struct pvx_diag *d)
{
    struct live_screen screen;
    struct cap_stats *stats = pvx_calloc(1, sizeof *stats);
    PVX_NEED(stats);
    pvx_err e = cap_capture_new(&l->cams.sources.capture, &l->capture, d);
    PVX_THEN(e, live_start(l, d));
    PVX_THEN(e, cap_capture_start(l->capture, d));
    int64_t next_ns = 0;
    live_screen_open(&screen);
    while (e == PVX_OK && !cli_stop && !live_enough(l, poses)) {
        struct cap_set *s = NULL;
        e = cap_capture_next(l->capture, LOOK_NS, &s);
        if (e == PVX_OK)
            live_offer(l, s);
        e = e == PVX_ETIMEDOUT ? PVX_OK : e;
        if (pvx_now_mono() >= next_ns) {
            note_stats(l, stats);
            next_ns = pvx_now_mono() + STATS_NS;
        }
        live_screen_draw(&screen, l);
    }
    if (l->capture != NULL)
        cap_capture_stop(l->capture);
    live_stop(l);
    if (e == PVX_OK || e == PVX_ECLOSED)
        live_screen_draw(&screen, l); /* the last lines */
    live_screen_close(&screen);
    free(stats);
    if (l->e != PVX_OK)
        return pvx_fail(d, l->e, "%s", pvx_diag_text(&l->d, l->e));
    return e == PVX_ECLOSED ? PVX_OK : e;
}

/* ---- after ---- */

static void live_print_word(const char *w)
{
    bool plain = w[0] != '\0';
    for (const char *p = w; *p != '\0'; p++)
        plain = plain && (isalnum((unsigned char)*p) || strchr("._-/:,=+%@", *p) != NULL);
    if (plain) {
        printf(" %s", w);
        return;
    }
    printf(" '");
    for (const char *p = w; *p != '\0'; p++)
        if (*p == '\'')
            printf("'\\''");
        else
            putchar(*p);
    putchar('\'');
}

/* Print the command again, with --force if it now has to replace a rig. */
static void say_how_to_go_on(const struct args *a)
{
    printf("more pictures:");
    for (int i = 0; i < a->argc; i++)
        if (i == 0)
            printf(" %s", a->argv[i]);
        else
            live_print_word(a->argv[i]);
    printf("%s\n", !a->c.force && access(a->c.out, F_OK) == 0 ? " --force" : "");
}

static int in_order(const void *a, const void *b)
{
    const struct calibrate_picture *p = a, *q = b;
    return p->camera != q->camera ? (p->camera > q->camera) - (p->camera < q->camera)
                                  : (p->frame > q->frame) - (p->frame < q->frame);
}

/* Whether the command line names this camera, or the world is placed by it. */
static bool live_needs(const struct calibrate_job *j, uint32_t camera)
{
    const struct rec_calib_options *o = &j->in.options;
    const struct calibrate_names *lists[] = {&j->a->add, &j->a->recover};
    bool needed = o->world == REC_WORLD_UP && o->up_camera == camera;
    for (size_t i = 0; i < o->n_measured; i++)
        needed |= o->measured[i].a == camera || o->measured[i].b == camera;
    for (size_t k = 0; k < 2; k++)
        for (size_t i = 0; i < lists[k]->n; i++)
            needed |= strcmp(lists[k]->name[i], j->look.camera[camera].name) == 0;
    return needed;
}

/* Remove the cameras without a picture from the job and renumber the others.  PVX_EINVAL: one of them is needed. */
static pvx_err live_leave_out(struct calibrate_job *j, struct pvx_diag *d)
{
    struct calibrate_look *k = &j->look;
    uint32_t to[REC_MAX_CAMERAS], n = 0;
    for (uint32_t c = 0; c < k->n_cameras; c++) {
        const char *name = k->camera[c].name;
        bool any = k->count[c].pictures > 0;
        if (!any && live_needs(j, c))
            return pvx_fail(d, PVX_EINVAL, "%s: no picture was taken with it: is it connected?",
                            name);
        if (!any)
            fprintf(stderr,
                    "pyrovox: %s gave no picture: the rig is made without it (is it connected?)\n",
                    name);
        to[c] = n;
        k->camera[n] = k->camera[c];
        k->count[n] = k->count[c];
        n += any;
    }
    k->n_cameras = n;
    for (size_t i = 0; i < k->n; i++)
        k->picture[i].camera = k->picture[i].view.camera = to[k->picture[i].camera];
    for (size_t i = 0; i < j->in.options.n_measured; i++) {
        j->measured[i].a = to[j->measured[i].a];
        j->measured[i].b = to[j->measured[i].b];
    }
    j->in.options.up_camera = to[j->in.options.up_camera];
    return PVX_OK;
}

/* Sort and count the pictures as calibrate_find would. */
static pvx_err put_in_order(struct calibrate_job *j, struct pvx_diag *d)
{
    struct calibrate_look *k = &j->look;
    qsort(k->picture, k->n, sizeof *k->picture, in_order);
    for (size_t i = 0; i < k->n; i++)
        k->count[k->picture[i].camera].pictures++;
    PVX_TRY(live_leave_out(j, d));
    return calibrate_look_count(k, d);
}

static pvx_err live_conclude(struct live *l, struct pvx_diag *d)
{
    if (l->poses == 0)
        return pvx_fail(d, PVX_ENOENT, "no picture of the board was taken; nothing to solve");
    printf(
        "%zu poses in %s, %zu of them new; %llu frame sets looked at, %llu passed over for newer "
        "ones\n",
        l->poses, l->frames, l->taken_now, (unsigned long long)l->looks,
        (unsigned long long)(l->skipped + l->dropped));
    cli_stop = 0; /* another Ctrl-C stops the solve, too */
    PVX_TRY(put_in_order(&l->job, d));
    return calibrate_conclude(&l->job, d);
}

static int calibrate_live_run(struct args *a)
{
    char dir[4000];
    struct pvx_diag d = {""};
    struct live *l = pvx_calloc(1, sizeof *l);
    if (l == NULL)
        return cli_error(NULL, PVX_ENOMEM);
    pthread_mutex_init(&l->lock, NULL);
    pthread_cond_init(&l->wake, NULL);
    l->a = &a->c;
    l->frames = a->frames != NULL ? a->frames : dir;
    pvx_err e = name_frames(a->c.out, dir, sizeof dir);
    PVX_THEN(e, live_prepare(l, &a->c, a->config, &d));
    bool ready = e == PVX_OK;
    PVX_THEN(e, live_run(l, a->poses, &d));
    PVX_THEN(e, live_conclude(l, &d));
    int code = e == PVX_OK ? 0 : e == PVX_ECANCELED ? 130 : cli_error(&d, e);
    if (code == 130)
        fprintf(stderr, "\npyrovox: stopped; no rig was written\n");
    if (ready && (l->poses > 0 || l->taken_now > 0))
        say_how_to_go_on(a);
    calibrate_job_fini(&l->job);
    cap_capture_free(&l->capture);
    calibrate_cameras_fini(&l->cams);
    pvx_pool_free(&l->pool);
    free(l->common);
    pthread_cond_destroy(&l->wake);
    pthread_mutex_destroy(&l->lock);
    free(l);
    return code;
}

int calibrate_live(int argc, char **argv)
{
    struct args a = {.c = CALIBRATE_ARGS_INIT, .argc = argc, .argv = argv};
    a.c.volume_later = true;
    const struct argp_child children[] = {{calibrate_options(), 0, NULL, 0}, {0}};
    const struct argp argp = {.parser = live_parse_opt, .doc = doc, .children = children};
    cli_parse(rows, &argp, 0, argc, argv, &a);
    pvx_log_set_level(PVX_LOG_ERROR); /* the screen shows the warnings */
    cli_catch_stop();
    return calibrate_live_run(&a);
}
