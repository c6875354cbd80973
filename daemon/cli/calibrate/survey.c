/* survey.c - choose the instants of videos and takes that are worth looking at (reel.h). */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/pixel/pixfmt.h"
#include "daemon/cli/calibrate/reel.h"
#include "daemon/cli/common/cli.h"

#define THUMB 160 /* bins along the longer side of the compared pictures */
#define LACK  4.0

/* ---- motion ---- */

struct survey {
    struct calibrate_look *l;
    struct calibrate_motion motion[REC_MAX_CAMERAS];
    pthread_mutex_t lock; /* guards all fields below */
    size_t done;
    pvx_err e;
    struct pvx_diag d;
    struct cli_progress bar;
};

struct thumb {
    float *now, *before;
    size_t n; /* bins; 0: none yet */
    bool compares;
};

/* Shrink the picture to few bins.  Pixels that do not fill a bin are cut off.  False: the picture cannot be read. */
static bool survey_shrink(struct thumb *t, const struct cap_image *img)
{
    int32_t longer = img->width > img->height ? img->width : img->height;
    int32_t b = (longer + THUMB - 1) / THUMB;
    struct cap_image whole = *img;
    b = b > CAP_BINNING_MAX ? CAP_BINNING_MAX : b;
    whole.width = img->width / b * b;
    whole.height = img->height / b * b;
    size_t n = (size_t)(whole.width / b) * (size_t)(whole.height / b);
    float *swap = t->now;
    t->now = t->before;
    t->before = swap;
    if (n != t->n) { /* the first, or pictures of two sizes, which are refused later */
        free(t->now);
        free(t->before);
        *t = (struct thumb){
            .now = pvx_calloc(n, sizeof(float)), .before = pvx_calloc(n, sizeof(float)), .n = n};
    }
    return n > 0 && t->now != NULL && t->before != NULL &&
           cap_bin(&whole, b, 1, 0, whole.height / b, t->now) == PVX_OK;
}

static float differs(const struct thumb *t)
{
    double sum = 0;
    size_t n = 0;
    for (size_t i = 0; i < t->n; i++)
        if (isfinite(t->now[i]) && isfinite(t->before[i])) {
            sum += fabs((double)t->now[i] - (double)t->before[i]);
            n++;
        }
    return n > 0 ? (float)(sum / (double)n) : NAN;
}

static pvx_err survey_note(struct calibrate_motion *m, size_t *room, float v)
{
    if (m->n == *room) {
        size_t more = *room == 0 ? 1024 : 2 * *room;
        float *of = realloc(m->of, more * sizeof *of);
        PVX_NEED(of);
        m->of = of;
        *room = more;
    }
    m->of[m->n++] = v;
    return PVX_OK;
}

/* The number of instant k. */
static uint32_t survey_number_of(const struct calibrate_look *l, size_t k)
{
    return l->take != NULL ? (uint32_t)cap_take_set(l->take, k, NULL)->number
                           : (uint32_t)l->pairs.number[k];
}

static bool survey_in_range(const struct calibrate_look *l, size_t k)
{
    return survey_number_of(l, k) >= l->from && survey_number_of(l, k) <= l->to;
}

static pvx_err go_through(struct survey *s, size_t c, struct calibrate_reel *r, struct thumb *t,
                          struct pvx_diag *d)
{
    const struct calibrate_look *l = s->l;
    size_t room = 0, n = l->take != NULL ? (size_t)cap_take_info(l->take)->sets : l->pairs.n;
    for (size_t k = 0; k < n && !cli_stop; k++) {
        struct cap_image img;
        struct pvx_diag why = {""};
        pvx_err e = calibrate_reel_read(r, survey_number_of(l, k), &img, &why);
        if (e != PVX_OK && e != PVX_ENOENT && l->take == NULL)
            return pvx_fail(d, e, "%s", pvx_diag_text(&why, e));
        bool good = e == PVX_OK && survey_shrink(t, &img);
        PVX_TRY(survey_note(&s->motion[c], &room,
                            e == PVX_ENOENT       ? CALIBRATE_LACKS
                            : good && t->compares ? differs(t)
                                                  : NAN));
        t->compares = good || (e == PVX_ENOENT && t->compares && t->n > 0);
    }
    return cli_stop ? PVX_ECANCELED : PVX_OK;
}

static void survey_camera(void *ctx, size_t c)
{
    struct survey *s = ctx;
    struct calibrate_reel r = {0};
    struct thumb t = {0};
    struct pvx_diag d = {""};
    pvx_err e = calibrate_reel_open(&r, s->l, c, &d);
    PVX_THEN(e, go_through(s, c, &r, &t, &d));
    calibrate_reel_close(&r);
    free(t.now);
    free(t.before);
    pthread_mutex_lock(&s->lock);
    if (e != PVX_OK && s->e == PVX_OK) {
        s->e = e;
        s->d = d;
    }
    s->done++;
    cli_progress(&s->bar, (double)s->done / (double)s->l->n_cameras);
    pthread_mutex_unlock(&s->lock);
}

/* ---- choice ---- */

/* The larger difference from its two neighbours, over the average.  LACK: there is no picture. */
static double restless(const struct calibrate_motion *m, double mean, size_t k)
{
    if (k >= m->n || m->of[k] == CALIBRATE_LACKS)
        return LACK;
    float before = m->of[k], after = k + 1 < m->n && m->of[k + 1] >= 0 ? m->of[k + 1] : NAN;
    float most = fmaxf(before, after);
    return isfinite(most) && mean > 0 ? (double)most / mean : 1;
}

static double survey_mean_of(const struct calibrate_motion *m)
{
    double sum = 0, n = 0;
    for (size_t k = 0; k < m->n; k++)
        if (m->of[k] >= 0) {
            sum += (double)m->of[k];
            n++;
        }
    return n > 0 ? sum / n : 0;
}

size_t calibrate_choose(const struct calibrate_motion *m, size_t cameras, size_t every, size_t *at)
{
    double mean[REC_MAX_CAMERAS];
    size_t n = 0, chosen = 0;
    for (size_t c = 0; c < cameras; c++) {
        mean[c] = survey_mean_of(&m[c]);
        n = m[c].n > n ? m[c].n : n;
    }
    for (size_t from = 0; from < n; from += every) {
        double least = INFINITY;
        for (size_t k = from; k < n && k < from + every; k++) {
            double sum = 0;
            for (size_t c = 0; c < cameras; c++)
                sum += restless(&m[c], mean[c], k);
            if (sum < least) {
                least = sum;
                at[chosen] = k;
            }
        }
        chosen++;
    }
    return chosen;
}

/* Insert in order the instant that is looked at in any case. */
static size_t include(const struct calibrate_look *l, size_t n, size_t *at, size_t chosen)
{
    size_t k = 0, to = 0;
    while (k < n && survey_number_of(l, k) != l->always)
        k++;
    while (to < chosen && at[to] < k)
        to++;
    if (k == n || (to < chosen && at[to] == k))
        return chosen;
    memmove(at + to + 1, at + to, (chosen - to) * sizeof *at);
    at[to] = k;
    return chosen + 1;
}

static pvx_err survey_list_camera(struct survey *s, size_t c, const size_t *at, size_t chosen)
{
    struct calibrate_look *l = s->l;
    for (size_t i = 0; i < chosen; i++) {
        struct calibrate_picture *p = &l->picture[l->n];
        if (at[i] >= s->motion[c].n || s->motion[c].of[at[i]] == CALIBRATE_LACKS)
            continue;
        *p = (struct calibrate_picture){
            .camera = (uint32_t)c, .frame = survey_number_of(l, at[i]), .at = CALIBRATE_NO_VIEW};
        char room[CAP_REEL_NAME];
        int64_t row = l->take == NULL ? l->pairs.row[at[i] * l->n_cameras + c] : 0;
        int n = l->take != NULL
                    ? asprintf(&p->path, "%s: set %u of %s", l->path, p->frame, l->camera[c].name)
                    : asprintf(&p->path, "%s", cap_reel_name(&l->reel[c], (size_t)row, room));
        if (n < 0) {
            p->path = NULL;
            return PVX_ENOMEM;
        }
        l->n++;
        l->count[c].pictures++;
    }
    return PVX_OK;
}

static void survey_say(struct calibrate_look *l, size_t least, size_t most, size_t every)
{
    char lengths[60], more[sizeof l->said];
    snprintf(more, sizeof more, "%s", l->said);
    if (least == most)
        snprintf(lengths, sizeof lengths, "%zu", most);
    else
        snprintf(lengths, sizeof lengths, "%zu to %zu", least, most);
    int n =
        snprintf(l->said, sizeof l->said, "%s of %s %s%s: ", l->take != NULL ? "a take" : "videos",
                 lengths, l->take != NULL ? "sets" : "frames",
                 least != most && l->take == NULL ? ", taken to have started together" : "");
    if (every > 1)
        n += snprintf(l->said + n, sizeof l->said - (size_t)n,
                      "of every %zu the one in which the least moves", every);
    else
        n += snprintf(l->said + n, sizeof l->said - (size_t)n, "all were looked at");
    snprintf(l->said + n, sizeof l->said - (size_t)n, "%.100s", more);
}

static pvx_err survey_choose(struct survey *s)
{
    struct calibrate_look *l = s->l;
    size_t most = 1, least = SIZE_MAX; /* a camera without an instant does not come here */
    for (size_t c = 0; c < l->n_cameras; c++) {
        size_t own = l->take != NULL ? s->motion[c].n : l->reel[c].n;
        most = own > most ? own : most;
        least = own < least ? own : least;
    }
    size_t wanted = 0, sets = l->take != NULL ? most : l->pairs.n;
    for (size_t k = 0; k < sets; k++)
        wanted += survey_in_range(l, k);
    wanted = wanted > 0 ? wanted : sets; /* none: refused by calibrate_only */
    size_t every = l->every > 0 ? l->every : (wanted - 1) / CALIBRATE_LOOKED_AT + 1;
    size_t *at = pvx_calloc(sets / every + 2, sizeof *at);
    PVX_NEED(at);
    size_t chosen = calibrate_choose(s->motion, l->n_cameras, every, at);
    if (l->always != REC_NO_FRAME)
        chosen = include(l, sets, at, chosen);
    size_t kept = 0;
    for (size_t i = 0; i < chosen; i++)
        if (survey_in_range(l, at[i]))
            at[kept++] = at[i];
    chosen = kept;
    l->picture = pvx_calloc(chosen * l->n_cameras + 1, sizeof *l->picture);
    pvx_err e = l->picture == NULL ? PVX_ENOMEM : PVX_OK;
    for (size_t c = 0; c < l->n_cameras && e == PVX_OK; c++)
        e = survey_list_camera(s, c, at, chosen);
    free(at);
    survey_say(l, least, most, every);
    return e;
}

pvx_err calibrate_survey(struct calibrate_look *l, pvx_pool *pool, bool quiet, struct pvx_diag *d)
{
    struct survey s = {
        .l = l, .lock = PTHREAD_MUTEX_INITIALIZER, .bar = {.label = "motion", .quiet = quiet}};
    pvx_pool_run(pool, l->n_cameras, survey_camera, &s);
    pthread_mutex_destroy(&s.lock);
    pvx_err e =
        s.e == PVX_OK ? survey_choose(&s) : pvx_fail(d, s.e, "%s", pvx_diag_text(&s.d, s.e));
    for (size_t c = 0; c < l->n_cameras; c++)
        free(s.motion[c].of);
    return e;
}
