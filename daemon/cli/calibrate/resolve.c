/* resolve.c - the solver thread of `calibrate live`: it solves again whenever there are more pictures. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "daemon/cli/calibrate/watch.h"

/* The input of a solve: the views of the largest group of cameras that poses join. */
struct snapshot {
    struct rec_calib_camera camera[REC_MAX_CAMERAS];
    struct rec_board_view *view;
    struct rec_calib_input in;
    uint32_t of[REC_MAX_CAMERAS];
    size_t poses;
};

/* Under the lock.  Corners are borrowed: pictures are never changed. */
static pvx_err resolve_snapshot(const struct live *l, struct snapshot *s)
{
    const struct calibrate_look *k = &l->job.look;
    struct calibrate_graph g;
    uint32_t to[REC_MAX_CAMERAS];
    *s = (struct snapshot){.in = l->job.in, .poses = l->poses};
    if ((s->view = pvx_calloc(k->n + 1, sizeof *s->view)) == NULL)
        return PVX_ENOMEM;
    calibrate_graph(l->common, k->n_cameras, &g);
    for (uint32_t c = 0; c < k->n_cameras; c++) {
        to[c] = (uint32_t)s->in.n_cameras;
        if (g.group[c] == 0) {
            s->of[s->in.n_cameras] = c;
            s->camera[s->in.n_cameras++] = k->camera[c];
        }
    }
    s->in.n_views = 0;
    for (size_t i = 0; i < k->n; i++) {
        const struct calibrate_picture *p = &k->picture[i];
        struct rec_calib_camera *c = &s->camera[to[p->camera]];
        if (p->view.n == 0 || g.group[p->camera] != 0)
            continue;
        c->width = p->width;
        c->height = p->height;
        s->view[s->in.n_views] = p->view;
        s->view[s->in.n_views++].camera = to[p->camera];
    }
    struct rec_calib_options *o = &s->in.options;
    o->brief = true;
    o->n_measured = 0; /* only the final solve uses them: they may name cameras not joined yet */
    if (o->world == REC_WORLD_UP && g.group[o->up_camera] != 0)
        o->world = REC_WORLD_BEST;
    else if (o->world == REC_WORLD_UP)
        o->up_camera = to[o->up_camera];
    s->in.camera = s->camera;
    s->in.view = s->view;
    return PVX_OK;
}

static void resolve_forget(struct live_result *r)
{
    rec_rig_fini(&r->rig);
    rec_calib_report_fini(&r->report);
}

static void resolve_solve(struct snapshot *s, struct live_result *r)
{
    int64_t t0 = pvx_now_mono();
    *r = (struct live_result){.there = true, .n = s->in.n_cameras, .poses = s->poses};
    memcpy(r->of, s->of, sizeof r->of);
    r->e = rec_calib_solve(&s->in, &r->rig, &r->report, &r->d);
    r->seconds = (double)(pvx_now_mono() - t0) * 1e-9;
    if (r->e == PVX_OK && rec_calib_next(&s->in, &r->rig, &r->report, &r->next) != PVX_OK)
        r->next.text[0] = '\0';
}

void *live_solve(void *ctx)
{
    struct live *l = ctx;
    size_t solved = 0;
    pthread_mutex_lock(&l->lock);
    while (!l->stop && l->e == PVX_OK) {
        if (l->poses == solved || l->poses < 2) {
            pthread_cond_wait(&l->wake, &l->lock);
            continue;
        }
        struct snapshot s;
        struct live_result r;
        pvx_err e = resolve_snapshot(l, &s);
        solved = l->poses;
        pthread_mutex_unlock(&l->lock);
        if (e == PVX_OK && s.in.n_cameras > 1)
            resolve_solve(&s, &r);
        free(s.view);
        pthread_mutex_lock(&l->lock);
        if (e != PVX_OK)
            l->e = e;
        else if (s.in.n_cameras > 1) {
            struct live_result old = l->result;
            l->result = r;
            resolve_forget(&old);
        }
    }
    resolve_forget(&l->result);
    l->result.there = false;
    pthread_mutex_unlock(&l->lock);
    return NULL;
}
