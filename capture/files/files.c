/* files.c - files: image sequences and videos as cameras.
 *
 * The time of a frame follows from its number alone (file name, or place in the video), so frames of one number form
 * a set even when others are missing.  Live: frames are handed over in real time, one period apart, and a frame that
 * cannot be loaded in time is left out.  Lossless: as fast as the consumer takes them, and every frame.
 * All files: cameras share one time line: its begin and, with `loop`, the length of one turn.  Both are the same for
 * all cameras, also when some sequences are shorter or start later.  Otherwise turn k of one camera would meet turn k
 * of another with the wrong frames. */
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "capture/source/backends.h"
#include "capture/files/imgio.h"
#include "capture/source/player.h"
#include "capture/files/sequence.h"

#define LEAD_NS (100 * PVX_NS_PER_MS)          /* from the first start to the first frame */
#define FAR_NS  (INT64_MAX / 2 - PVX_NS_PER_S) /* the farthest time used */

/* The time line; lives while any files: source is open. */
static struct {
    pthread_mutex_t lock;
    unsigned users;
    int64_t first, last; /* numbers of one turn, all cameras */
    bool known, fixed;   /* a camera has registered; fixed because a camera is in turn 2 */
    bool running;
    int64_t origin; /* the number that is due at: */
    int64_t start_mono_ns, start_real_ns;
} line = {.lock = PTHREAD_MUTEX_INITIALIZER};

struct files {
    struct cap_source base;
    struct cap_player player;
    char *name, *camera_name;
    struct cap_sequence seq; /* n = 0: a video */
    cap_video *video;
    int64_t video_frames; /* 0 = not known */
    struct cap_image
        pending; /* first frame of the video, read when it was opened; data NULL = none */
    int32_t width, height;
    enum cap_pixfmt fmt;
    int64_t period_ns;
    bool loop;
    bool joined; /* has joined the common time line */
    bool said_unreadable, said_unfit;
};

/* ---- the common time line --------------------------------------------------------------------- */

static void line_join(int64_t first, int64_t last)
{
    pthread_mutex_lock(&line.lock);
    if (line.users++ == 0)
        line.known = line.fixed = line.running = false;
    if (!line.fixed) {
        line.first = line.known && line.first < first ? line.first : first;
        line.last = line.known && line.last > last ? line.last : last;
        line.known = true;
    }
    pthread_mutex_unlock(&line.lock);
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
    if (!line.fixed && number > line.last)
        line.last = number; /* a video whose length is not known */
    if (number >= line.first && number <= line.last)
        place = turn * (line.last - line.first + 1) + number;
    pthread_mutex_unlock(&line.lock);
    return place;
}

static void line_start(int64_t number)
{
    pthread_mutex_lock(&line.lock);
    if (!line.running) {
        line.running = true;
        line.origin = number;
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
    int64_t from = line.last > FAR_NS / period ? line.first : 0;
    pthread_mutex_unlock(&line.lock);
    return PVX_NS_PER_S + lasts(place - from, period);
}

/* ---- reading ---------------------------------------------------------------------------------- */

static bool is_video(const char *name)
{
    return strpbrk(name, "%*?[") == NULL && cap_is_video(name);
}

static pvx_err open_video(struct files *s, double *fps, struct pvx_diag *d)
{
    cap_video_close(&s->video);
    struct cap_video_info info;
    PVX_TRY(cap_video_open(s->name, &s->video, &info, d));
    *fps = info.fps;
    return cap_video_next(s->video, &s->pending, NULL, d);
}

/* Measure the length of a looped video by reading it to its end.  Containers only estimate the length, and turns of
 * different length would shift the cameras against each other. */
static pvx_err measure_video(struct files *s, struct pvx_diag *d)
{
    pvx_err e;
    double fps;
    for (s->video_frames = 1; (e = cap_video_next(s->video, NULL, NULL, d)) == PVX_OK;)
        s->video_frames++;
    s->pending.data = NULL;
    return e == PVX_ECLOSED ? open_video(s, &fps, d) : e;
}

/* The first readable image gives the size and format that the configuration leaves open. */
static pvx_err files_look_at_first(struct files *s, struct pvx_diag *d)
{
    if (s->width > 0 && s->height > 0 && s->fmt != CAP_FMT_NONE)
        return PVX_OK;
    struct cap_loaded l = {.img = s->pending};
    pvx_err e = PVX_OK;
    for (size_t i = 0; i < s->seq.n; i++) {
        struct pvx_diag each = {""};
        e = cap_image_load(s->seq.item[i].path, &l, &each);
        if (e == PVX_OK)
            break;
        if (i + 1 == s->seq.n)
            return pvx_fail(d, e, "%s", pvx_diag_text(&each, e));
    }
    if (s->width <= 0)
        s->width = l.img.width;
    if (s->height <= 0)
        s->height = l.img.height;
    if (s->fmt == CAP_FMT_NONE)
        s->fmt = l.img.fmt;
    if (s->seq.n > 0)
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

/* Load image i of the sequence into a buffer.  NULL: it is left out and counted. */
static struct cap_frame *load_image(struct files *s, size_t i)
{
    const char *path = s->seq.item[i].path;
    struct pvx_diag d = {""};
    struct cap_loaded l;
    pvx_err e = cap_image_load(path, &l, &d);
    if (e != PVX_OK) {
        files_unreadable(s, pvx_diag_text(&d, e));
        return NULL;
    }
    struct cap_frame *f = image_fits(s, &l.img, path) ? copy_to_buffer(s, &l.img) : NULL;
    cap_loaded_free(&l);
    return f;
}

/* ---- thread ----------------------------------------------------------------------------------- */

/* Hand over the frame at its time; false = stop. */
static bool files_deliver(struct files *s, struct cap_frame *f, int64_t place, int64_t due,
                          int64_t real)
{
    if (!s->player.lossless && !cap_player_wait_until(&s->player, due)) {
        cap_frame_release(f);
        return false;
    }
    f->id = (uint64_t)place;
    f->t_device_ns = s->player.lossless ? line_time(place, s->period_ns) : real;
    f->t_arrival_ns = pvx_now_real();
    f->t_arrival_mono_ns = pvx_now_mono();
    s->player.sink.push(s->player.sink.ctx, f);
    return true;
}

/* Play one frame of turn `turn`: *img of a video, or image i of the sequence.  Adds to *good; false = stop. */
static bool files_one(struct files *s, int64_t turn, int64_t number, const struct cap_image *img,
                      size_t i, uint64_t *good)
{
    int64_t place = line_place(turn, number), due = 0, real = 0;
    if (place < 0)
        return !cap_player_stopped(&s->player);
    if (!s->player.lossless) {
        line_start(place);
        line_due(place, s->period_ns, &due, &real);
        if (pvx_now_mono() > due + 2 * s->period_ns) { /* too slow, or opened later than others */
            cap_player_count(&s->player, CAP_ID_GAP, 1);
            *good += 1;
            return !cap_player_stopped(&s->player);
        }
    }
    struct cap_frame *f = img == NULL                   ? load_image(s, i)
                          : image_fits(s, img, s->name) ? copy_to_buffer(s, img)
                                                        : NULL;
    if (f == NULL)
        return !cap_player_stopped(&s->player);
    *good += 1;
    return files_deliver(s, f, place, due, real);
}

/* Play one turn through the images; false = stop. */
static bool turn_images(struct files *s, int64_t turn, uint64_t *good)
{
    for (size_t i = 0; i < s->seq.n; i++) {
        int64_t number = s->seq.item[i].number;
        if (i > 0)
            cap_player_count(&s->player, CAP_ID_GAP,
                             (uint64_t)(number - s->seq.item[i - 1].number - 1));
        if (!files_one(s, turn, number, NULL, i, good))
            return false;
    }
    return true;
}

static bool turn_video(struct files *s, int64_t turn, uint64_t *good)
{
    struct pvx_diag d = {""};
    pvx_err e = PVX_OK;
    double fps;
    if (s->pending.data == NULL)
        e = open_video(s, &fps, &d);
    for (int64_t number = 0; e == PVX_OK; number++) {
        struct cap_image img = s->pending;
        s->pending.data = NULL;
        if (!files_one(s, turn, number, &img, 0, good))
            return false;
        e = cap_video_next(s->video, &s->pending, NULL, &d);
    }
    s->pending.data = NULL;
    if (e != PVX_ECLOSED)
        files_unreadable(s, pvx_diag_text(&d, e));
    return true;
}

static void *files_run(void *arg)
{
    struct files *s = arg;
    for (int64_t turn = 0;; turn++) {
        uint64_t good = 0;
        if (!(s->seq.n > 0 ? turn_images : turn_video)(s, turn, &good))
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
    cap_sequence_free(&s->seq);
    cap_video_close(&s->video);
    cap_player_fini(&s->player);
    free(s->name);
    free(s->camera_name);
    free(s);
}

static pvx_err files_set_up(struct files *s, const struct cap_source_config *c, struct pvx_diag *d)
{
    double fps = 0;
    if (s->name == NULL || s->camera_name == NULL)
        return PVX_ENOMEM;
    if (is_video(s->name)) {
        PVX_TRY(open_video(s, &fps, d));
        if (c->loop)
            PVX_TRY(measure_video(s, d));
    } else {
        PVX_TRY(cap_sequence_find(s->name, &s->seq, d));
    }
    PVX_TRY(files_look_at_first(s, d));
    if (c->fps > 0)
        fps = c->fps;
    if (!(fps > 1e-3 && fps < 1e5))
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
        size_t n = s->seq.n;
        int64_t video_last = s->video_frames > 0 ? s->video_frames - 1 : 0;
        line_join(n > 0 ? s->seq.item[0].number : 0,
                  n > 0 ? s->seq.item[n - 1].number : video_last);
        s->joined = true;
    } else {
        files_close(&base);
    }
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
    .help = "recorded frames: DIR/cam0/%06d.png, a folder, a glob, or a video (.mp4 .avi .mkv)",
    .recorded = true,
    .open = files_open,
    .start = files_start,
    .stop = files_stop,
    .close = files_close,
};
