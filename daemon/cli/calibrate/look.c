#include "daemon/cli/calibrate/look.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/files/imgio.h"
#include "capture/pixel/pixfmt.h"
#include "daemon/cli/calibrate/choose.h"
#include "daemon/cli/calibrate/modes.h"
#include "daemon/cli/calibrate/reel.h"
#include "daemon/cli/common/cli.h"

struct looking {
    struct calibrate_look *l;
    const struct rec_board *board;
    pthread_mutex_t lock; /* guards all fields below */
    size_t next, done;
    pvx_err e;
    struct pvx_diag d;
    struct cli_progress bar;
    bool reels;
    size_t of_reel[REC_MAX_CAMERAS]; /* the next of each */
};

static pvx_err detect(rec_board_detector *det, const struct cap_image *img,
                      struct calibrate_picture *p, struct rec_board_sight *s, struct pvx_diag *d)
{
    int32_t w = img->width, h = img->height;
    float *grey = pvx_calloc((size_t)w * (size_t)h, sizeof *grey);
    PVX_NEED(grey);
    pvx_err e = cap_bin(img, 1, 1, 0, h, grey);
    if (e == PVX_OK) {
        const struct rec_board_picture in = {grey, w, h, w * (ptrdiff_t)sizeof *grey, true};
        p->width = w;
        p->height = h;
        e = rec_board_detect(det, &in, s);
    } else {
        e = pvx_fail(d, e, "%s: %s", p->path, pvx_strerror(e));
    }
    free(grey);
    return e;
}

pvx_err calibrate_keep(struct calibrate_picture *p, const struct rec_board_sight *s)
{
    p->outcome = s->outcome;
    p->legacy = s->legacy;
    p->grid = s->grid;
    p->square = s->square;
    p->blur = s->blur;
    memcpy(p->text, s->text, sizeof p->text);
    if (s->outcome != REC_SIGHT_FOUND)
        return PVX_OK;
    p->view = s->view;
    p->view.camera = p->camera;
    p->view.frame = p->frame;
    p->view.corner = pvx_calloc(s->view.n, sizeof *p->view.corner);
    if (p->view.corner == NULL) {
        p->view.n = 0;
        return PVX_ENOMEM;
    }
    memcpy(p->view.corner, s->view.corner, s->view.n * sizeof *p->view.corner);
    return PVX_OK;
}

/* Look at a picture of a file or of the camera's reel.  A picture that cannot be read is marked, and is no error. */
static pvx_err calibrate_look_at(rec_board_detector *det, struct calibrate_reel *reel,
                                 struct calibrate_picture *p)
{
    struct rec_board_sight s;
    struct pvx_diag d = {""};
    struct cap_loaded in = {0};
    pvx_err e = reel != NULL ? calibrate_reel_read(reel, p->frame, &in.img, &d)
                             : cap_image_load(p->path, &in, &d);
    PVX_THEN(e, detect(det, &in.img, p, &s, &d));
    if (e == PVX_OK) {
        e = calibrate_keep(p, &s);
    } else if (e != PVX_ENOMEM) {
        p->unreadable = true;
        snprintf(p->text, sizeof p->text, "%.*s", (int)sizeof p->text - 1, pvx_diag_text(&d, e));
        e = PVX_OK;
    }
    cap_loaded_free(&in);
    return e;
}

/* The next picture that was not looked at yet, of all or of reel `task`.  Under the lock. */
static struct calibrate_picture *take_next(struct looking *w, size_t task)
{
    size_t *next = w->reels ? &w->of_reel[task] : &w->next;
    if (*next == w->l->n || (w->reels && w->l->picture[*next].camera != task))
        return NULL;
    return &w->l->picture[(*next)++];
}

/* One thread with its own detector.  It takes pictures that no other thread took, or all pictures of one reel. */
static void work(void *ctx, size_t task)
{
    struct looking *w = ctx;
    struct pvx_diag d = {""};
    struct calibrate_reel reel = {0};
    struct calibrate_picture *p;
    rec_board_detector *det = NULL;
    pvx_err e = rec_board_detector_new(w->board, &det, &d);
    if (e == PVX_OK && w->reels)
        e = calibrate_reel_open(&reel, w->l, task, &d);
    pthread_mutex_lock(&w->lock);
    for (;;) {
        if (e != PVX_OK && w->e == PVX_OK) {
            w->e = e;
            w->d = d;
        }
        if (w->e == PVX_OK && cli_stop)
            w->e = PVX_ECANCELED;
        if (w->e != PVX_OK || (p = take_next(w, task)) == NULL)
            break;
        pthread_mutex_unlock(&w->lock);
        e = calibrate_look_at(det, w->reels ? &reel : NULL, p);
        pthread_mutex_lock(&w->lock);
        w->done++;
        cli_progress(&w->bar, (double)w->done / (double)w->l->n);
    }
    pthread_mutex_unlock(&w->lock);
    calibrate_reel_close(&reel);
    rec_board_detector_free(&det);
}

/* One board has one order of markers.  A picture that shows too few markers to tell it may have been read as another one. */
static void look_one_layout(struct calibrate_look *l)
{
    size_t n[REC_GRID_KALIBR + 1] = {0};
    for (size_t i = 0; i < l->n; i++)
        n[l->picture[i].grid] += l->picture[i].view.n > 0;
    for (int g = 0; g <= REC_GRID_KALIBR; g++)
        l->grid = n[g] > n[l->grid] ? (uint8_t)g : l->grid;
    for (size_t i = 0; i < l->n; i++) {
        struct calibrate_picture *p = &l->picture[i];
        if (p->view.n == 0 || ((p->grid ^ l->grid) & ~REC_GRID_WIDE) == 0)
            continue;
        p->outcome = REC_SIGHT_OTHER_BOARD;
        snprintf(p->text, sizeof p->text,
                 "its markers are not in the order of the other pictures: show more of the board");
    }
}

pvx_err calibrate_look_count(struct calibrate_look *l, struct pvx_diag *d)
{
    if ((l->view = pvx_calloc(l->n, sizeof *l->view)) == NULL)
        return PVX_ENOMEM;
    PVX_TRY(calibrate_mode_sizes(l, d));
    look_one_layout(l);
    for (size_t i = 0; i < l->n; i++) {
        struct calibrate_picture *p = &l->picture[i];
        struct calibrate_count *n = &l->count[p->camera];
        if (p->unreadable) {
            n->unreadable++;
            continue;
        }
        if (n->sight[p->outcome]++ == 0)
            n->example[p->outcome] = i;
        if (p->outcome == REC_SIGHT_FOUND) {
            p->at = l->n_views;
            l->view[l->n_views++] = p->view;
        }
    }
    for (size_t c = 0; c < l->n_cameras; c++) {
        size_t i = 0;
        while (i < l->n && l->picture[i].camera != c)
            i++;
        if (l->camera[c].width == 0)
            return pvx_fail(d, PVX_EINVAL, "%s: none of its %zu pictures can be read: %s",
                            l->camera[c].name, l->count[c].pictures,
                            i < l->n ? l->picture[i].text : "no set has one");
    }
    return PVX_OK;
}

pvx_err calibrate_look(struct calibrate_look *l, const struct rec_board *b, pvx_pool *pool,
                       bool quiet, struct pvx_diag *d)
{
    bool reels = l->source != CALIBRATE_FOLDERS;
    if (reels)
        PVX_TRY(calibrate_survey(l, pool, quiet, d));
    PVX_TRY(calibrate_only(l, d));
    struct looking w = {.l = l,
                        .board = b,
                        .lock = PTHREAD_MUTEX_INITIALIZER,
                        .bar = {.label = "boards", .quiet = quiet},
                        .reels = reels};
    for (size_t i = l->n; i-- > 0;)
        w.of_reel[l->picture[i].camera] = i;
    pvx_pool_run(pool, reels ? l->n_cameras : pvx_pool_threads(pool), work, &w);
    pthread_mutex_destroy(&w.lock);
    if (w.e != PVX_OK)
        return pvx_fail(d, w.e, "%s", pvx_diag_text(&w.d, w.e));
    return calibrate_look_count(l, d);
}

void calibrate_look_fini(struct calibrate_look *l)
{
    for (size_t i = 0; i < l->n; i++) {
        free(l->picture[i].path);
        free(l->picture[i].view.corner);
    }
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        cap_reel_close(&l->reel[c]);
    cap_pairs_free(&l->pairs);
    PVX_FREE(l->path);
    cap_take_free(&l->take);
    PVX_FREE(l->picture);
    PVX_FREE(l->view);
    l->n = l->n_views = 0;
}
