#include "daemon/cli/calibrate/watch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/files/imgio.h"
#include "capture/pixel/jpeg.h"
#include "capture/pixel/pixfmt.h"

#define FULL 0.999f /* of full scale: clipped */

/* The watcher's state of one camera. */
struct live_eye {
    rec_board_detector *det;
    cap_jpeg *jpeg;
    struct cap_image grey; /* as it is saved: Mono8, or Mono16 */
    void *samples;
    float *level;
    int32_t width, height;
    bool there; /* in this set */
    pvx_err e;
    struct pvx_diag d;
    struct rec_board_sight sight;
    double bright, clipped;
    struct rec_board_corner *anchor; /* [n_corners] */
    struct rec_board_view view,
        still; /* this set's, corners the detector's; where it began to stand still */
};

struct look {
    struct live *l;
    const struct cap_set *set;
    uint32_t frame; /* to be saved as */
};

/* ---- one picture ---- */

static pvx_err watch_room(struct live_eye *k, const struct cap_image *img)
{
    if (k->width == img->width && k->height == img->height)
        return PVX_OK;
    size_t n = (size_t)img->width * (size_t)img->height;
    free(k->samples);
    free(k->level);
    cap_jpeg_free(&k->jpeg);
    k->width = img->width;
    k->height = img->height;
    k->samples = pvx_calloc(n, sizeof(uint16_t));
    k->level = pvx_calloc(n, sizeof *k->level);
    return k->samples == NULL || k->level == NULL ? PVX_ENOMEM : PVX_OK;
}

/* Convert to grey with the bits that a file keeps, so that `calibrate solve` finds the same corners in the file. */
static pvx_err to_grey(struct live_eye *k, const struct cap_image *raw)
{
    static const struct cap_convert_params grey = {.binning = 1, .nch = 1};
    struct cap_image img = *raw;
    size_t n = (size_t)raw->width * (size_t)raw->height;
    PVX_TRY(watch_room(k, raw));
    if (raw->fmt == CAP_JPEG) {
        if (k->jpeg == NULL)
            PVX_TRY(cap_jpeg_new(raw->width, raw->height, &k->jpeg));
        PVX_TRY(cap_jpeg_decode(k->jpeg, raw, &img, &k->d));
    }
    bool bytes = raw->fmt == CAP_GREY8;
    PVX_TRY(cap_bin(&img, 1, 1, 0, img.height, k->level));
    for (size_t i = 0; i < n; i++) {
        float v = k->level[i] * (bytes ? 255.0f : 65535.0f) + 0.5f, top = bytes ? 255 : 65535;
        v = v > 0 ? fminf(v, top) : 0; /* NaN becomes black */
        if (bytes)
            ((uint8_t *)k->samples)[i] = (uint8_t)v;
        else
            ((uint16_t *)k->samples)[i] = (uint16_t)v;
    }
    enum cap_pixfmt fmt = bytes ? CAP_GREY8 : CAP_GREY16;
    size_t row = cap_pixfmt_row(fmt, img.width);
    k->grey = (struct cap_image){.data = k->samples,
                                 .size = row * (size_t)img.height,
                                 .width = img.width,
                                 .height = img.height,
                                 .stride = (ptrdiff_t)row,
                                 .fmt = fmt};
    return cap_convert(&k->grey, &grey, 0, img.height, k->level);
}

static void watch_expose(struct live_eye *k)
{
    size_t n = (size_t)k->width * (size_t)k->height, bin[256] = {0}, above = 0;
    for (size_t i = 0; i < n; i++)
        bin[(int)(fminf(fmaxf(k->level[i], 0), 1) * 255)]++;
    int b = 255;
    for (; b > 0 && (above + bin[b]) * 100 < n; b--)
        above += bin[b];
    size_t full = 0;
    for (size_t i = 0; i < n; i++)
        full += k->level[i] >= FULL;
    k->bright = b / 255.0;
    k->clipped = (double)full / (double)n;
}

static void watch_look_at(void *ctx, size_t task)
{
    struct look *w = ctx;
    struct live_eye *k = &w->l->eye[w->l->look_of[task]];
    const struct cap_frame *f = w->set->frame[task];
    k->there = f != NULL;
    k->view.n = 0;
    k->e = PVX_OK;
    if (f == NULL)
        return;
    k->e = to_grey(k, &f->img);
    if (k->e != PVX_OK)
        return;
    watch_expose(k);
    struct rec_board_picture p = {k->level, k->width, k->height,
                                  k->width * (ptrdiff_t)sizeof *k->level, true};
    k->e = rec_board_detect(k->det, &p, &k->sight);
    if (k->e == PVX_OK)
        k->view = k->sight.view;
}

/* ---- state of the board ---- */

static void watch_gather(const struct live *l, bool still, struct rec_board_view *out)
{
    for (size_t c = 0; c < l->job.look.n_cameras; c++)
        out[c] = still ? l->eye[c].still : l->eye[c].view;
}

/* Remember where the board is now: a later set is compared with this one. */
static void anchor(struct live *l)
{
    for (size_t c = 0; c < l->job.look.n_cameras; c++) {
        struct live_eye *k = &l->eye[c];
        if (k->view.n > 0)
            memcpy(k->anchor, k->view.corner, k->view.n * sizeof *k->anchor);
        k->still = k->view;
        k->still.corner = k->anchor;
    }
}

/* Whether this pose was taken before.  Under the lock. */
static bool watch_known(const struct live *l, const struct rec_board_view *now)
{
    const struct calibrate_look *k = &l->job.look;
    double nearest = INFINITY, width[REC_MAX_CAMERAS];
    for (size_t c = 0; c < k->n_cameras; c++)
        width[c] = l->eye[c].width > 0 ? l->eye[c].width : 1;
    for (size_t i = k->n, from; i > 0 && nearest >= CALIBRATE_NEW; i = from) {
        struct rec_board_view then[REC_MAX_CAMERAS] = {0};
        for (from = i; from > 0 && k->picture[from - 1].frame == k->picture[i - 1].frame; from--)
            then[k->picture[from - 1].camera] = k->picture[from - 1].view;
        nearest = fmin(nearest, calibrate_moved(now, then, k->n_cameras, width));
    }
    return nearest < CALIBRATE_NEW;
}

/* Under the lock.  t_s: when the set was exposed. */
static enum live_now watch_judge(struct live *l, double t_s, double *since_s, uint64_t *looks)
{
    struct rec_board_view now[REC_MAX_CAMERAS], then[REC_MAX_CAMERAS];
    size_t n = l->job.look.n_cameras, see = 0;
    watch_gather(l, false, now);
    watch_gather(l, true, then);
    for (size_t c = 0; c < n; c++)
        see += now[c].n > 0;
    double moved = calibrate_moved(now, then, n, NULL);
    if (!(moved <= CALIBRATE_STILL_PX)) {
        anchor(l);
        *since_s = t_s;
        *looks = 0;
    }
    ++*looks;
    if (see == 0)
        return LIVE_UNSEEN;
    if (!(moved <= CALIBRATE_STILL_PX))
        return LIVE_MOVING;
    if (watch_known(l, now))
        return LIVE_KNOWN;
    if (t_s - *since_s < CALIBRATE_STILL_S || *looks < CALIBRATE_LOOKS)
        return LIVE_STILL;
    for (uint32_t c = 0; c < n; c++)
        if (l->camera[c].running && !l->eye[c].there) {
            l->missing = c;
            return LIVE_MISSING;
        }
    return l->poses == 0 && see < 2 && n > 1 ? LIVE_ALONE : LIVE_TAKEN;
}

static void show(struct live *l)
{
    for (size_t c = 0; c < l->job.look.n_cameras; c++) {
        struct live_camera *to = &l->camera[c];
        const struct live_eye *k = &l->eye[c];
        to->seen = k->there;
        to->corners = k->view.n;
        if (!k->there)
            continue;
        to->outcome = k->sight.outcome;
        to->bright = k->bright;
        to->clipped = k->clipped;
        if (k->view.n > 0)
            to->blur = k->sight.blur;
    }
}

/* ---- kept ---- */

static void watch_save(void *ctx, size_t c)
{
    struct look *w = ctx;
    struct live_eye *k = &w->l->eye[c];
    char path[4096];
    if (!k->there)
        return;
    snprintf(path, sizeof path, "%.3900s/%s/%06u.png", w->l->frames, w->l->job.look.camera[c].name,
             w->frame);
    k->e = cap_image_write(path, k->samples, k->width, k->height, 1,
                           k->grey.fmt == CAP_GREY8 ? 8 : 16, &k->d);
}

/* Add the set's pictures as calibrate_look would after reading their files.  Under the lock. */
static pvx_err watch_add(struct live *l, uint32_t frame)
{
    struct calibrate_look *k = &l->job.look;
    struct calibrate_picture *more =
        realloc(k->picture, (k->n + k->n_cameras) * sizeof *k->picture);
    PVX_NEED(more);
    k->picture = more;
    for (uint32_t c = 0; c < k->n_cameras; c++) {
        const struct live_eye *y = &l->eye[c];
        struct calibrate_picture *p = &k->picture[k->n];
        if (!y->there)
            continue;
        *p = (struct calibrate_picture){.camera = c,
                                        .frame = frame,
                                        .width = y->width,
                                        .height = y->height,
                                        .at = CALIBRATE_NO_VIEW};
        if (asprintf(&p->path, "%s/%s/%06u.png", l->frames, k->camera[c].name, frame) < 0)
            return PVX_ENOMEM;
        k->n++;
        PVX_TRY(calibrate_keep(p, &y->sight));
    }
    return PVX_OK;
}

static void count_picture(struct live_camera *c, const struct calibrate_picture *p)
{
    c->boards++;
    for (size_t s = 0; s < p->view.n; s++) {
        int x = (int)(p->view.corner[s].x * 8 / p->width),
            y = (int)(p->view.corner[s].y * 6 / p->height);
        if (x >= 0 && x < 8 && y >= 0 && y < 6)
            c->places |= UINT64_C(1) << (8 * y + x);
    }
}

void live_count(struct live *l)
{
    const struct calibrate_look *k = &l->job.look;
    size_t n = k->n_cameras;
    memset(l->common, 0, n * n * sizeof *l->common);
    for (size_t c = 0; c < n; c++)
        l->camera[c].boards = l->camera[c].places = 0;
    l->poses = 0;
    for (size_t i = 0, to; i < k->n; i = to) {
        bool seen = false;
        for (to = i; to < k->n && k->picture[to].frame == k->picture[i].frame; to++) {
            const struct calibrate_picture *p = &k->picture[to];
            if (p->view.n == 0)
                continue;
            count_picture(&l->camera[p->camera], p);
            for (const struct calibrate_picture *q = &k->picture[i]; q < p; q++)
                if (q->view.n > 0) {
                    l->common[p->camera * n + q->camera]++;
                    l->common[q->camera * n + p->camera]++;
                }
            seen = true;
        }
        l->poses += seen;
    }
    l->next_frame = k->n > 0 ? k->picture[k->n - 1].frame + 1 : 0;
}

static pvx_err watch_take(struct live *l, struct look *w)
{
    size_t n = l->job.look.n_cameras;
    w->frame = l->next_frame; /* only this thread changes it */
    pvx_pool_run(l->pool, n, watch_save, w);
    for (size_t c = 0; c < n; c++)
        if (l->eye[c].e != PVX_OK)
            return pvx_fail(&l->d, l->eye[c].e, "%s", pvx_diag_text(&l->eye[c].d, l->eye[c].e));
    pthread_mutex_lock(&l->lock);
    pvx_err e = watch_add(l, w->frame);
    live_count(l);
    l->last = w->frame;
    l->taken_now++;
    pthread_cond_broadcast(&l->wake);
    pthread_mutex_unlock(&l->lock);
    return e;
}

/* ---- the thread ---- */

static pvx_err open_eyes(struct live *l, struct pvx_diag *d)
{
    size_t n = l->job.look.n_cameras;
    if ((l->eye = pvx_calloc(n, sizeof *l->eye)) == NULL)
        return PVX_ENOMEM;
    const uint32_t n_corners = rec_board_corners(&l->job.board);
    for (size_t c = 0; c < n; c++) {
        PVX_TRY(rec_board_detector_new(&l->job.board, &l->eye[c].det, d));
        l->eye[c].anchor = pvx_calloc(n_corners, sizeof *l->eye[c].anchor);
        if (l->eye[c].anchor == NULL)
            return PVX_ENOMEM;
    }
    return PVX_OK;
}

static void close_eyes(struct live *l)
{
    for (size_t c = 0; l->eye != NULL && c < l->job.look.n_cameras; c++) {
        struct live_eye *k = &l->eye[c];
        rec_board_detector_free(&k->det);
        cap_jpeg_free(&k->jpeg);
        free(k->samples);
        free(k->level);
        free(k->anchor);
    }
    PVX_FREE(l->eye);
}

static pvx_err watch_look(struct live *l, struct cap_set *s, double *since_s, uint64_t *looks)
{
    struct look w = {.l = l, .set = s};
    size_t n = l->job.look.n_cameras;
    pvx_pool_run(l->pool, n, watch_look_at, &w);
    for (size_t c = 0; c < n; c++)
        if (l->eye[c].e != PVX_OK) {
            if (l->eye[c].e == PVX_ENOMEM)
                return PVX_ENOMEM;
            l->eye[c].there = false; /* a broken JPEG: as if it had not come */
            l->eye[c].e = PVX_OK;
            l->eye[c].d.text[0] = '\0';
        }
    pthread_mutex_lock(&l->lock);
    enum live_now now = watch_judge(l, (double)s->t_exposure_ns * 1e-9, since_s, looks);
    show(l);
    l->looks++;
    if (now != LIVE_TAKEN)
        l->now = now;
    pthread_mutex_unlock(&l->lock);
    if (now != LIVE_TAKEN)
        return PVX_OK;
    PVX_TRY(watch_take(l, &w));
    pthread_mutex_lock(&l->lock);
    l->now = LIVE_TAKEN;
    pthread_mutex_unlock(&l->lock);
    return PVX_OK;
}

static void *calibrate_watch(void *ctx)
{
    struct live *l = ctx;
    double since_s = 0;
    uint64_t looks = 0;
    pthread_mutex_lock(&l->lock);
    while (!l->stop && l->e == PVX_OK) {
        if (l->inbox == NULL) {
            pthread_cond_wait(&l->wake, &l->lock);
            continue;
        }
        struct cap_set *s = l->inbox;
        l->inbox = NULL;
        pthread_mutex_unlock(&l->lock);
        pvx_err e = watch_look(l, s, &since_s, &looks);
        cap_set_release(s);
        pthread_mutex_lock(&l->lock);
        if (e != PVX_OK)
            l->e = e;
    }
    pthread_mutex_unlock(&l->lock);
    return NULL;
}

void live_offer(struct live *l, struct cap_set *s)
{
    pthread_mutex_lock(&l->lock);
    struct cap_set *old = l->inbox;
    l->inbox = s;
    l->skipped += old != NULL;
    pthread_cond_broadcast(&l->wake);
    pthread_mutex_unlock(&l->lock);
    cap_set_release(old);
}

pvx_err live_start(struct live *l, struct pvx_diag *d)
{
    PVX_TRY(open_eyes(l, d));
    if (pthread_create(&l->watcher, NULL, calibrate_watch, l) != 0)
        return pvx_fail(d, PVX_EIO, "cannot start a thread");
    if (pthread_create(&l->solver, NULL, live_solve, l) != 0) {
        pthread_mutex_lock(&l->lock);
        l->stop = true;
        pthread_cond_broadcast(&l->wake);
        pthread_mutex_unlock(&l->lock);
        pthread_join(l->watcher, NULL);
        return pvx_fail(d, PVX_EIO, "cannot start a thread");
    }
    l->started = true;
    return PVX_OK;
}

void live_stop(struct live *l)
{
    pthread_mutex_lock(&l->lock);
    l->stop = true;
    pthread_cond_broadcast(&l->wake);
    pthread_mutex_unlock(&l->lock);
    if (l->started) {
        pthread_join(l->watcher, NULL);
        pthread_join(l->solver, NULL);
    }
    cap_set_release(l->inbox);
    l->inbox = NULL;
    close_eyes(l);
}
