#include "daemon/cli/calibrate_look.h"

#include <dirent.h>
#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/mem.h"
#include "capture/files/imgio.h"
#include "capture/files/sequence.h"
#include "capture/pixel/pixfmt.h"
#include "daemon/cli/cli.h"

/* ---- what is there ---- */

static pvx_err add_camera(struct calibrate_look *l, const char *dir, const char *name,
                          struct pvx_diag *d)
{
    char path[4096];
    struct stat st;
    struct cap_sequence s;
    if (snprintf(path, sizeof path, "%s/%s", dir, name) >= (int)sizeof path)
        return pvx_fail(d, PVX_ERANGE, "%.80s...: name too long", dir);
    if (stat(path, &st) != 0 || !S_ISDIR(st.st_mode))
        return PVX_OK;
    pvx_err e = cap_sequence_find(path, &s, d);
    if (e == PVX_ENOENT && d != NULL) /* a folder of something else */
        d->text[0] = '\0';
    if (e != PVX_OK)
        return e == PVX_ENOENT ? PVX_OK : e;
    struct calibrate_picture *more = NULL;
    if (!rec_rig_name_ok(name))
        e = pvx_fail(
            d, PVX_EINVAL,
            "%s: a folder with pictures in it has a name that no camera can have: letters, "
            "digits and . _ - only, at most %d",
            dir, REC_NAME_MAX - 1);
    else if (l->n_cameras == REC_MAX_CAMERAS)
        e = pvx_fail(d, PVX_ERANGE, "%s: more than %d cameras", dir, REC_MAX_CAMERAS);
    else if (s.item[s.n - 1].number >= REC_NO_FRAME)
        e = pvx_fail(d, PVX_ERANGE, "%s: its number is too large", s.item[s.n - 1].path);
    else if ((more = realloc(l->picture, (l->n + s.n) * sizeof *more)) == NULL)
        e = PVX_ENOMEM;
    if (e == PVX_OK) {
        l->picture = more;
        for (size_t i = 0; i < s.n; i++) {
            l->picture[l->n++] = (struct calibrate_picture){.camera = (uint32_t)l->n_cameras,
                                                            .frame = (uint32_t)s.item[i].number,
                                                            .path = s.item[i].path,
                                                            .at = CALIBRATE_NO_VIEW};
            s.item[i].path = NULL;
        }
        l->count[l->n_cameras].pictures = s.n;
        snprintf(l->camera[l->n_cameras++].name, REC_NAME_MAX, "%s", name);
    }
    cap_sequence_free(&s);
    return e;
}

pvx_err calibrate_find(struct calibrate_look *l, const char *dir, struct pvx_diag *d)
{
    struct dirent **entry;
    *l = (struct calibrate_look){0};
    int n = scandir(dir, &entry, NULL, alphasort);
    if (n < 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", dir, strerror(errno));
    pvx_err e = PVX_OK;
    for (int i = 0; i < n; i++) {
        if (e == PVX_OK && entry[i]->d_name[0] != '.')
            e = add_camera(l, dir, entry[i]->d_name, d);
        free(entry[i]);
    }
    free(entry);
    if (e == PVX_OK && l->n == 0)
        e = pvx_fail(d, PVX_ENOENT,
                     "%s: no pictures; looked for %s/<camera>/<number>.(npy|png|tif|jpg)", dir,
                     dir);
    return e;
}

/* ---- looked at ---- */

struct looking {
    struct calibrate_look *l;
    const struct rec_board *board;
    pthread_mutex_t lock; /* guards what follows */
    size_t next, done;
    pvx_err e;
    struct pvx_diag d;
    struct cli_progress bar;
    bool quiet;
};

static pvx_err read_grey(const char *path, struct rec_board_picture *out, float **mem,
                         struct pvx_diag *d)
{
    static const struct cap_convert_params grey = {.binning = 1, .nch = 1};
    struct cap_loaded in;
    PVX_TRY(cap_image_load(path, &in, d));
    int32_t w = in.img.width, h = in.img.height;
    *mem = pvx_calloc((size_t)w * (size_t)h, sizeof **mem);
    pvx_err e = *mem == NULL ? PVX_ENOMEM : cap_convert(&in.img, &grey, 0, h, *mem);
    cap_loaded_free(&in);
    if (e != PVX_OK) {
        PVX_FREE(*mem);
        return pvx_fail(d, e, "%s: %s", path, pvx_strerror(e));
    }
    *out = (struct rec_board_picture){*mem, w, h, w * (ptrdiff_t)sizeof **mem, true};
    return PVX_OK;
}

static pvx_err look_at(rec_board_detector *det, struct calibrate_picture *p)
{
    struct rec_board_picture grey;
    struct rec_board_sight s;
    struct pvx_diag d = {""};
    float *mem = NULL;
    pvx_err e = read_grey(p->path, &grey, &mem, &d);
    if (e != PVX_OK) {
        p->unreadable = e != PVX_ENOMEM;
        snprintf(p->text, sizeof p->text, "%.*s", (int)sizeof p->text - 1, pvx_diag_text(&d, e));
        return p->unreadable ? PVX_OK : e;
    }
    p->width = grey.width;
    p->height = grey.height;
    e = rec_board_detect(det, &grey, &s);
    free(mem);
    if (e != PVX_OK)
        return e;
    p->outcome = s.outcome;
    p->legacy = s.legacy;
    p->square = s.square;
    p->blur = s.blur;
    memcpy(p->text, s.text, sizeof p->text);
    if (s.outcome != REC_SIGHT_FOUND)
        return PVX_OK;
    p->view = s.view;
    p->view.camera = p->camera;
    p->view.frame = p->frame;
    p->view.corner = pvx_calloc(s.view.n, sizeof *p->view.corner);
    if (p->view.corner == NULL) {
        p->view.n = 0;
        return PVX_ENOMEM;
    }
    memcpy(p->view.corner, s.view.corner, s.view.n * sizeof *p->view.corner);
    return PVX_OK;
}

/* One of the threads: a detector of its own, and picture after picture that no other has. */
static void work(void *ctx, size_t task)
{
    struct looking *w = ctx;
    struct pvx_diag d = {""};
    rec_board_detector *det = NULL;
    (void)task;
    pvx_err e = rec_board_detector_new(w->board, &det, &d);
    pthread_mutex_lock(&w->lock);
    for (;;) {
        if (e != PVX_OK && w->e == PVX_OK) {
            w->e = e;
            w->d = d;
        }
        if (w->e == PVX_OK && cli_stop)
            w->e = PVX_ECANCELED;
        if (w->e != PVX_OK || w->next == w->l->n)
            break;
        size_t i = w->next++;
        pthread_mutex_unlock(&w->lock);
        e = look_at(det, &w->l->picture[i]);
        pthread_mutex_lock(&w->lock);
        w->done++;
        if (!w->quiet)
            cli_progress(&w->bar, (double)w->done / (double)w->l->n);
    }
    pthread_mutex_unlock(&w->lock);
    rec_board_detector_free(&det);
}

static pvx_err count(struct calibrate_look *l, struct pvx_diag *d)
{
    for (size_t i = 0; i < l->n; i++) {
        struct calibrate_picture *p = &l->picture[i];
        struct rec_calib_camera *c = &l->camera[p->camera];
        struct calibrate_count *n = &l->count[p->camera];
        if (p->unreadable) {
            n->unreadable++;
            continue;
        }
        if (c->width == 0) {
            c->width = p->width;
            c->height = p->height;
        }
        if (c->width != p->width || c->height != p->height)
            return pvx_fail(
                d, PVX_EINVAL,
                "%s: %d x %d pixels, but pictures of %s before it have %d x %d: one lens "
                "is one size, so keep binning and region as they are",
                p->path, p->width, p->height, c->name, c->width, c->height);
        if (n->sight[p->outcome]++ == 0)
            n->example[p->outcome] = i;
        if (p->outcome == REC_SIGHT_FOUND) {
            p->at = l->n_views;
            l->view[l->n_views++] = p->view;
        }
    }
    for (size_t c = 0; c < l->n_cameras; c++)
        if (l->camera[c].width == 0)
            return pvx_fail(d, PVX_EINVAL, "%s: none of its %zu pictures can be read",
                            l->camera[c].name, l->count[c].pictures);
    return PVX_OK;
}

pvx_err calibrate_look(struct calibrate_look *l, const struct rec_board *b, pvx_pool *pool,
                       bool quiet, struct pvx_diag *d)
{
    struct looking w = {.l = l,
                        .board = b,
                        .lock = PTHREAD_MUTEX_INITIALIZER,
                        .bar = {.label = "boards"},
                        .quiet = quiet};
    if ((l->view = pvx_calloc(l->n, sizeof *l->view)) == NULL)
        return PVX_ENOMEM;
    pvx_pool_run(pool, pvx_pool_threads(pool), work, &w);
    pthread_mutex_destroy(&w.lock);
    if (w.e != PVX_OK)
        return pvx_fail(d, w.e, "%s", pvx_diag_text(&w.d, w.e));
    return count(l, d);
}

void calibrate_look_fini(struct calibrate_look *l)
{
    for (size_t i = 0; i < l->n; i++) {
        free(l->picture[i].path);
        free(l->picture[i].view.corner);
    }
    PVX_FREE(l->picture);
    PVX_FREE(l->view);
    l->n = l->n_views = 0;
}
