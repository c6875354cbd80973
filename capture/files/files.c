/* files.c - files: pictures, stacks and films (reel.h) as cameras.
 *
 * The time of a frame follows from its number alone (file name, or page), or is the film's, so frames of one number or
 * instant form a set even when others are missing.  Live: frames are handed over in real time, and a frame that cannot
 * be loaded in time is left out.  Lossless: as fast as the consumer takes them, and every frame.
 * All files: cameras share one time line: its begin and, with `loop`, the length of one turn.  Both are the same for
 * all cameras, also when some sequences are shorter or start later.  Otherwise turn k of one camera would meet turn k
 * of another with the wrong frames.  The time line counts periods of `fps`.  A film's frame is a remainder away. */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "capture/source/backends.h"
#include "capture/files/reel.h"
#include "capture/files/said.h"
#include "capture/files/sequence.h"
#include "capture/source/player.h"

#define LEAD_NS (100 * PVX_NS_PER_MS)          /* from the first start to the first frame */
#define RATES   0.01                           /* a film's rate may differ so much from fps */
#define TIMES   10                             /* numbers that go up by more are hardly counts */
#define FAR_NS  (INT64_MAX / 2 - PVX_NS_PER_S) /* the farthest time used */

/* The time line; lives while any files: source is open. */
static struct {
    pthread_mutex_t lock;
    unsigned users;
    int64_t first, last; /* numbers of one turn, all cameras */
    int64_t begin;       /* number of the first file of stacks; -1: not known */
    char stack[400];     /* which is: */
    int64_t base;        /* the number that is place 0: times before a trigger are below 0 */
    bool known, fixed;   /* a camera has registered; fixed because a camera is in turn 2 */
    bool based;
    bool running;
    int64_t origin; /* the place that is due at: */
    int64_t start_mono_ns, start_real_ns;
} line = {.lock = PTHREAD_MUTEX_INITIALIZER};

struct files {
    struct cap_source base;
    struct cap_player player;
    char *name, *camera_name;
    struct cap_reel reel;
    double step; /* ns, of a film */
    int32_t width, height;
    enum cap_pixfmt fmt;
    int64_t period_ns;
    bool loop;
    bool joined; /* has joined the common time line */
    bool said_unreadable, said_unfit;
};

/* ---- the common time line --------------------------------------------------------------------- */

/* Whether the camera's frames can be of one recording with those of the others: as pairs.c judges it. */
static pvx_err line_check(const struct cap_reel *r, int64_t first, int64_t last, struct pvx_diag *d)
{
    bool film = cap_reel_timed(r);
    if (line.known && (first > line.last || last < line.first))
        return pvx_fail(d, PVX_EINVAL,
                        "%s: its frames have the numbers %lld to %lld%s, those of the other "
                        "cameras %lld to %lld: none is of one instant; %s",
                        r->path[0], (long long)first, (long long)last,
                        film ? " (periods since the zero of its times)" : "", (long long)line.first,
                        (long long)line.last,
                        film ? "their clocks must have one zero" : "rename the files");
    if (r->kind != CAP_REEL_PAGES || r->files < 2 || r->begin < 0)
        return PVX_OK;
    if (line.begin >= 0 && line.begin != r->begin)
        return pvx_fail(d, PVX_EINVAL,
                        "%s is the first file, and %s that of another camera: their numbers "
                        "should be the same; is a file missing before one of them?",
                        r->path[0], line.stack);
    line.begin = r->begin;
    snprintf(line.stack, sizeof line.stack, "%s", r->path[0]);
    return PVX_OK;
}

static pvx_err line_join(const struct cap_reel *r, int64_t first, int64_t last, struct pvx_diag *d)
{
    pthread_mutex_lock(&line.lock);
    if (line.users == 0) {
        line.known = line.fixed = line.running = line.based = false;
        line.begin = -1;
    }
    pvx_err e = line_check(r, first, last, d);
    line.users += e == PVX_OK;
    if (e == PVX_OK && !line.fixed) {
        line.first = line.known && line.first < first ? line.first : first;
        line.last = line.known && line.last > last ? line.last : last;
        line.known = true;
    }
    pthread_mutex_unlock(&line.lock);
    return e;
}

static void line_leave(void)
{
    pthread_mutex_lock(&line.lock);
    line.users--;
    pthread_mutex_unlock(&line.lock);
}

/* Number over all turns of frame `number` in turn `turn`; -1: not part of a turn. */
static int64_t line_place(int64_t turn, int64_t number)
{
    int64_t place = -1;
    pthread_mutex_lock(&line.lock);
    if (turn > 0)
        line.fixed = true;
    if (!line.based) {
        line.base = line.first < 0 ? line.first : 0;
        line.based = true;
    }
    if (number >= line.first && number >= line.base && number <= line.last)
        place = turn * (line.last - line.first + 1) + number - line.base;
    pthread_mutex_unlock(&line.lock);
    return place;
}

static void line_start(void)
{
    pthread_mutex_lock(&line.lock);
    if (!line.running) {
        line.running = true;
        line.origin = line.first - line.base;
        line.start_mono_ns = pvx_now_mono() + LEAD_NS;
        line.start_real_ns = pvx_now_real() + LEAD_NS;
    }
    pthread_mutex_unlock(&line.lock);
}

/* The length of `numbers` periods, limited to FAR_NS: a number may be a date, and so very large. */
static int64_t lasts(int64_t numbers, int64_t period)
{
    int64_t most = FAR_NS / period;
    return numbers > most ? FAR_NS : numbers < -most ? -FAR_NS : numbers * period;
}

static void line_due(int64_t place, int64_t period, int64_t *mono, int64_t *real)
{
    pthread_mutex_lock(&line.lock);
    int64_t after = lasts(place - line.origin, period);
    *mono = line.start_mono_ns + after;
    *real = line.start_real_ns + after;
    pthread_mutex_unlock(&line.lock);
}

/* A replay gives the same times on every run.  They count from 1 s after the epoch, which is the time of number 0, or
 * of the first number if numbers are too large for that. */
static int64_t line_time(int64_t place, int64_t period)
{
    pthread_mutex_lock(&line.lock);
    int64_t from = line.last > FAR_NS / period ? line.first - line.base : 0;
    pthread_mutex_unlock(&line.lock);
    return PVX_NS_PER_S + lasts(place - from, period);
}

/* ---- reading ---------------------------------------------------------------------------------- */

/* Number of frame i on the time line.  *more: by how much a film's frame is later. */
static int64_t files_number(const struct files *s, size_t i, int64_t *more)
{
    int64_t at = s->reel.frame[i].at;
    *more = 0;
    if (!cap_reel_timed(&s->reel))
        return at;
    int64_t number = llround((double)at / (double)s->period_ns);
    *more = at - number * s->period_ns;
    return number;
}

/* How many frames are missing before frame i. */
static uint64_t files_gap(const struct files *s, size_t i)
{
    int64_t d = s->reel.frame[i].at - s->reel.frame[i - 1].at;
    if (cap_reel_timed(&s->reel))
        d = s->step > 0 ? llround((double)d / s->step) : 1;
    return d > 1 ? (uint64_t)d - 1 : 0;
}

/* The first readable image gives the size and format that the configuration leaves open. */
static pvx_err files_look_at_first(struct files *s, struct pvx_diag *d)
{
    if (s->width > 0 && s->height > 0 && s->fmt != CAP_FMT_NONE)
        return PVX_OK;
    struct cap_loaded l = {0};
    pvx_err e = PVX_OK;
    for (size_t i = 0; i < s->reel.n; i++) {
        struct pvx_diag each = {""};
        e = cap_reel_load(&s->reel, i, &l, &each);
        if (e == PVX_OK)
            break;
        if (i + 1 == s->reel.n)
            return pvx_fail(d, e, "%s", pvx_diag_text(&each, e));
    }
    if (s->width <= 0)
        s->width = l.img.width;
    if (s->height <= 0)
        s->height = l.img.height;
    if (s->fmt == CAP_FMT_NONE)
        s->fmt = l.img.fmt;
    cap_loaded_free(&l);
    return e;
}

static bool image_fits(struct files *s, const struct cap_image *img, const char *path)
{
    bool size = img->width == s->width && img->height == s->height;
    if (size && cap_pixfmt_fits(img->fmt, s->fmt))
        return true;
    cap_player_count(&s->player, size ? CAP_BAD_FORMAT : CAP_BAD_SIZE, 1);
    if (!s->said_unfit)
        LOG_W(CAPTURE,
              "camera %s: %s is %dx%d %s, not %dx%d %s; it and others like it are left out",
              s->camera_name, path, img->width, img->height, cap_pixfmt_name(img->fmt), s->width,
              s->height, cap_pixfmt_name(s->fmt));
    s->said_unfit = true;
    return false;
}

static struct cap_frame *copy_to_buffer(struct files *s, const struct cap_image *img)
{
    struct cap_frame *f = cap_player_get(&s->player);
    if (f == NULL)
        return NULL;
    size_t row = cap_pixfmt_row(s->fmt, s->width);
    unsigned char *to = cap_bufpool_memory(f);
    const unsigned char *from = img->data;
    for (int32_t y = 0; y < s->height; y++)
        memcpy(to + (size_t)y * row, from + y * img->stride, row);
    f->img.size = row * (size_t)s->height;
    f->img.width = s->width;
    f->img.height = s->height;
    f->img.stride = (ptrdiff_t)row;
    f->img.fmt = s->fmt;
    f->img.yuv = img->yuv;
    return f;
}

static void files_unreadable(struct files *s, const char *text)
{
    cap_player_count(&s->player, CAP_INCOMPLETE, 1);
    if (!s->said_unreadable)
        LOG_W(CAPTURE, "camera %s: %s; it and others like it are left out", s->camera_name, text);
    s->said_unreadable = true;
}

/* Load frame i into a buffer.  NULL: it is left out and counted. */
static struct cap_frame *files_load(struct files *s, size_t i)
{
    char room[CAP_REEL_NAME];
    struct pvx_diag d = {""};
    struct cap_loaded l;
    pvx_err e = cap_reel_load(&s->reel, i, &l, &d);
    if (e != PVX_OK) {
        files_unreadable(s, pvx_diag_text(&d, e));
        return NULL;
    }
    struct cap_frame *f =
        image_fits(s, &l.img, cap_reel_name(&s->reel, i, room)) ? copy_to_buffer(s, &l.img) : NULL;
    cap_loaded_free(&l);
    return f;
}

/* ---- thread ----------------------------------------------------------------------------------- */

/* Hand over the frame at its time; false = stop. */
static bool files_deliver(struct files *s, struct cap_frame *f, int64_t place, int64_t more,
                          int64_t due, int64_t real)
{
    if (!s->player.lossless && !cap_player_wait_until(&s->player, due)) {
        cap_frame_release(f);
        return false;
    }
    f->id = (uint64_t)place;
    f->t_device_ns = s->player.lossless ? line_time(place, s->period_ns) + more : real;
    f->t_arrival_ns = pvx_now_real();
    f->t_arrival_mono_ns = pvx_now_mono();
    s->player.sink.push(s->player.sink.ctx, f);
    return true;
}

/* Play frame i in turn `turn`.  Adds to *good; false = stop. */
static bool files_one(struct files *s, int64_t turn, size_t i, uint64_t *good)
{
    int64_t more, place = line_place(turn, files_number(s, i, &more)), due = 0, real = 0;
    if (place < 0)
        return !cap_player_stopped(&s->player);
    if (!s->player.lossless) {
        line_start();
        line_due(place, s->period_ns, &due, &real);
        due += more;
        real += more;
        if (pvx_now_mono() > due + 2 * s->period_ns) { /* too slow, or opened later than others */
            cap_player_count(&s->player, CAP_ID_GAP, 1);
            *good += 1;
            return !cap_player_stopped(&s->player);
        }
    }
    struct cap_frame *f = files_load(s, i);
    if (f == NULL)
        return !cap_player_stopped(&s->player);
    *good += 1;
    return files_deliver(s, f, place, more, due, real);
}

/* Play one turn through the frames; false = stop. */
static bool files_turn(struct files *s, int64_t turn, uint64_t *good)
{
    for (size_t i = 0; i < s->reel.n; i++) {
        if (i > 0)
            cap_player_count(&s->player, CAP_ID_GAP, files_gap(s, i));
        if (!files_one(s, turn, i, good))
            return false;
    }
    return true;
}

static void *files_run(void *arg)
{
    struct files *s = arg;
    for (int64_t turn = 0;; turn++) {
        uint64_t good = 0;
        if (!files_turn(s, turn, &good))
            return NULL;
        if (!s->loop || good == 0) /* a turn without frames is not repeated */
            break;
    }
    cap_player_event(&s->player, CAP_EV_END);
    return NULL;
}

/* ---- operations ------------------------------------------------------------------------------- */

static void files_close(cap_source **sp)
{
    struct files *s = (struct files *)*sp;
    if (s == NULL)
        return;
    *sp = NULL;
    if (s->joined)
        line_leave();
    cap_reel_close(&s->reel);
    cap_player_fini(&s->player);
    free(s->name);
    free(s->camera_name);
    free(s);
}

static pvx_err files_set_up(struct files *s, const struct cap_source_config *c, struct pvx_diag *d)
{
    if (s->name == NULL || s->camera_name == NULL)
        return PVX_ENOMEM;
    PVX_TRY(cap_reel_open(s->name, &s->reel, d));
    if (s->reel.raw.filter && s->fmt == CAP_FMT_NONE)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: its pictures have a colour filter, but it does not say which: set "
                        "the camera's pixel format, as BayerRG12 (or Mono12 if they are grey)",
                        s->reel.path[0]);
    PVX_TRY(files_look_at_first(s, d));
    double step = cap_reel_step(&s->reel), fps = c->fps;
    if (cap_reel_timed(&s->reel) && step > 0) {
        s->step = step;
        fps = fps > 0 ? fps : 1e9 / step;
        if (fabs(fps * step * 1e-9 - 1) > RATES)
            LOG_W(CAPTURE,
                  "camera %s: %s has %.4g frames a second, but fps is %.4g; it is played at its "
                  "own rate, so fps should be that",
                  s->camera_name, s->name, 1e9 / step, fps);
    } else if (step > TIMES) {
        LOG_W(CAPTURE,
              "camera %s: the numbers of its pictures go up by %.6g, which lasts as many frame "
              "periods; if they are times, rename the files to count frames",
              s->camera_name, step);
    }
    for (char *rest = s->reel.said, *said; (said = cap_said_next(&rest)) != NULL;)
        LOG_W(CAPTURE, "camera %s: %s", s->camera_name, said);
    if (!(fps > 1e-3 && fps < (s->reel.kind == CAP_REEL_RAW ? 1e9 : 1e5)))
        fps = 30;
    s->period_ns = (int64_t)(1e9 / fps + 0.5);
    size_t bytes = cap_pixfmt_image(s->fmt, s->width, s->height);
    return cap_player_make_pool(&s->player, c, bytes);
}

static pvx_err files_open(const struct cap_source_config *c, cap_source **out, struct pvx_diag *d)
{
    *out = NULL;
    struct files *s = pvx_calloc(1, sizeof *s);
    if (s == NULL)
        return PVX_ENOMEM;
    s->base.ops = &cap_source_files;
    s->name = strdup(c->uri);
    s->camera_name = strdup(c->name != NULL ? c->name : c->uri);
    s->width = c->width;
    s->height = c->height;
    s->fmt = c->fmt;
    s->loop = c->loop;
    cap_player_init(&s->player, c, CLOCK_MONOTONIC);
    pvx_err e = files_set_up(s, c, d);
    cap_source *base = &s->base;
    if (e == PVX_OK) {
        int64_t more, first = files_number(s, 0, &more);
        e = line_join(&s->reel, first, files_number(s, s->reel.n - 1, &more), d);
        s->joined = e == PVX_OK;
    }
    if (e != PVX_OK)
        files_close(&base);
    *out = base;
    return e;
}

static pvx_err files_start(cap_source *base, const struct cap_sink *sink, struct pvx_diag *d)
{
    struct files *s = (struct files *)base;
    return cap_player_start(&s->player, "files", sink, files_run, s, d);
}

static void files_stop(cap_source *base)
{
    cap_player_stop(&((struct files *)base)->player);
}

const struct cap_source_ops cap_source_files = {
    .scheme = "files",
    .help =
        "recorded frames: DIR/cam0/%06d.png, a folder, a glob, a TIFF stack, or a film (" CAP_VIDEOS
        ")",
    .recorded = true,
    .open = files_open,
    .start = files_start,
    .stop = files_stop,
    .close = files_close,
};
