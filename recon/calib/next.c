#include "recon/calib/next.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/board/hold.h"
#include "recon/calib/information.h"
#include "recon/calib/model.h"

#define DEGREE (M_PI / 180)
#define TILT   (40 * DEGREE)
#define SEEN   (65 * DEGREE) /* largest angle from the board's axis */
#define SQUARE 8.0           /* px */
#define LEAST  12            /* corners */
#define PLACES 27
#define TILTS  5

/* A board held in some pose. */
struct pose {
    uint32_t camera; /* that the board faces */
    int place, tilt; /* tilt: 0 straight, 1 left, 2 right, 3 up, 4 down */
    double at[3], face[3];
    double gain;
};

static void next_middle_of(const struct rec_grid *g, double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = 0.5 * (g->min[i] + g->max[i]);
}

static double next_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void next_make(const struct rec_rig *rig, uint32_t camera, int place, int tilt,
                      struct pose *p)
{
    const struct rec_grid *g = &rig->grid;
    const struct rec_camera *k = &rig->cameras[camera];
    const int step[3] = {place % 3, place / 3 % 3, place / 9};
    double c[3], n;
    *p = (struct pose){.camera = camera, .place = place, .tilt = tilt};
    rec_camera_centre(k, c);
    for (int i = 0; i < 3; i++) {
        double f = (1 + 2 * step[i]) / 6.0;
        p->at[i] = (1 - f) * g->min[i] + f * g->max[i];
        p->face[i] = c[i] - p->at[i];
    }
    n = sqrt(next_dot(p->face, p->face));
    /* the camera's axes: right R[0..2], down R[3..5] */
    const double *side = tilt == 1 || tilt == 2 ? k->R : k->R + 3;
    double sign = tilt == 1 || tilt == 3 ? -1 : 1, s = tilt == 0 ? 0 : sign * sin(TILT);
    for (int i = 0; i < 3; i++)
        p->face[i] = p->face[i] / n * (tilt == 0 ? 1 : cos(TILT)) + s * side[i];
    n = sqrt(next_dot(p->face, p->face));
    for (int i = 0; i < 3; i++)
        p->face[i] /= n;
}

/* Cosine of the angle between the board's axis and the direction to the camera, negative behind the board; px:
 * shorter extent of a square. */
static double next_turned(const struct rec_board *b, const struct rec_camera *k, const double at[3],
                          const double face[3], double *px)
{
    double to[3], centre[3];
    rec_camera_centre(k, centre);
    for (int i = 0; i < 3; i++)
        to[i] = centre[i] - at[i];
    double far = sqrt(next_dot(to, to)), cosine = next_dot(to, face) / far;
    *px = k->fx * b->square / far * fabs(cosine);
    return cosine;
}

/* The view that camera c would have; false: none. */
static bool would_see(const struct rec_information *w, uint32_t c, const struct pose *p,
                      const double board[12], struct rec_board_view *v)
{
    const struct rec_board *b = &w->in->board;
    const struct rec_camera *k = &w->rig->cameras[c];
    double X[3], uv[2], b0[3], px, cosine = next_turned(b, k, p->at, p->face, &px);
    uint32_t all = rec_board_corners(b);
    v->face = cosine < 0 ? REC_BACK : REC_FRONT;
    v->camera = c;
    v->n = 0;
    if (fabs(cosine) < cos(SEEN) || (cosine < 0 && !b->two_sided) || px < w->least_square)
        return false;
    for (uint32_t id = 0; id < all; id++) {
        rec_board_point(b, v->face, id, b0);
        for (int i = 0; i < 3; i++)
            X[i] = board[3 * i] * b0[0] + board[3 * i + 1] * b0[1] + board[3 * i + 2] * b0[2] +
                   board[9 + i];
        if (rec_camera_project(k, X, uv) && uv[0] >= 2 && uv[1] >= 2 && uv[0] <= k->width - 3 &&
            uv[1] <= k->height - 3)
            v->corner[v->n++].id = id;
    }
    return v->n >= (b->kind == REC_CHESSBOARD ? all : all < LEAST ? all : LEAST);
}

/* The smallest squares of a good view: squares that were found once can be found again. */
static double least_square(const struct rec_information *w, const struct rec_calib_report *r)
{
    double least = SQUARE, px;
    for (size_t i = 0; i < w->in->n_views; i++) {
        const struct rec_board_view *v = &w->in->view[i];
        size_t f = 0;
        while (f < r->n_frames && r->frame[f] != v->frame)
            f++;
        if (r->view[i].fate != REC_VIEW_USED || f == r->n_frames || isnan(r->board[f][0]))
            continue;
        const double *b = r->board[f], face[3] = {-b[2], -b[5], -b[8]};
        if (fabs(next_turned(&w->in->board, &w->rig->cameras[v->camera], b + 9, face, &px)) >=
            cos(SEEN))
            least = fmin(least, px);
    }
    return least;
}

static double next_gain_of(struct rec_information *w, const struct pose *p,
                           struct rec_board_corner *corner)
{
    double R[9], board[12];
    uint32_t seen = 0;
    rec_board_hold(&w->in->board, p->at, p->face, 0, R, board + 9);
    memcpy(board, R, sizeof R);
    rec_information_begin(w, board);
    for (uint32_t c = 0; c < w->nc; c++) {
        struct rec_board_view v = {.corner = corner};
        if (would_see(w, c, p, board, &v)) {
            rec_information_view(w, &v);
            seen++;
        }
    }
    return seen > 0 ? rec_information_gain(w) : 0;
}

/* ---- words ---- */

static void next_say(const struct rec_rig *rig, const struct pose *p, char *out, size_t size)
{
    static const char *const tilts[TILTS] = {"straight", "tilt left", "tilt right", "tilt up",
                                             "tilt down"};
    const struct rec_camera *k = &rig->cameras[p->camera];
    double mid[3], off[3], half = 0;
    next_middle_of(&rig->grid, mid);
    for (int i = 0; i < 3; i++) {
        off[i] = p->at[i] - mid[i];
        half += i < 2 ? (rig->grid.max[i] - rig->grid.min[i]) / 4 : 0;
    }
    int level = p->place / 9;
    double right = k->R[0] * off[0] + k->R[1] * off[1], away = k->R[6] * off[0] + k->R[7] * off[1];
    snprintf(out, size, "face %s%s%s%s, %s", k->name,
             level == 0   ? ", low"
             : level == 2 ? ", high"
                          : "",
             right < -0.4 * half  ? ", on the left"
             : right > 0.4 * half ? ", on the right"
                                  : "",
             away < -0.4 * half  ? ", near it"
             : away > 0.4 * half ? ", far from it"
                                 : "",
             tilts[p->tilt]);
}

/* ---- the choice ---- */

/* p [PLACES] of one camera, straight: the middle place and the best two others are also tried tilted. */
static void tilt(struct rec_information *w, const struct pose *p, struct rec_board_corner *corner,
                 struct pose *best)
{
    int place[3] = {PLACES / 2, 0, 0};
    for (int k = 1; k < 3; k++) {
        place[k] = -1;
        for (int i = 0; i < PLACES; i++)
            if (i != place[0] && i != place[1] && (place[k] < 0 || p[i].gain > p[place[k]].gain))
                place[k] = i;
    }
    for (int k = 0; k < 3; k++)
        for (int t = 0; t < TILTS; t++) {
            struct pose q = p[place[k]];
            if (t > 0) {
                next_make(w->rig, q.camera, q.place, t, &q);
                q.gain = next_gain_of(w, &q, corner);
            }
            if (q.gain > best->gain)
                *best = q;
        }
}

static pvx_err next_choose(struct rec_information *w, struct pose *best)
{
    struct pose p[PLACES];
    struct rec_board_corner *corner = pvx_calloc(rec_board_corners(&w->in->board), sizeof *corner);
    if (corner == NULL)
        return PVX_ENOMEM;
    for (uint32_t c = 0; c < w->nc; c++) {
        for (int i = 0; i < PLACES; i++) {
            next_make(w->rig, c, i, 0, &p[i]);
            p[i].gain = next_gain_of(w, &p[i], corner);
        }
        tilt(w, p, corner, best);
    }
    free(corner);
    return best->gain > 0 ? PVX_OK : PVX_ENOENT;
}

pvx_err rec_calib_next(const struct rec_calib_input *in, const struct rec_rig *rig,
                       const struct rec_calib_report *r, struct rec_calib_next *out)
{
    struct rec_information w;
    struct pose best = {0};
    *out = (struct rec_calib_next){.now = r->voxels};
    pvx_err e = rec_information_init(&w, in, rig, r);
    if (e == PVX_OK) {
        w.least_square = least_square(&w, r);
        e = next_choose(&w, &best);
    }
    if (e == PVX_OK) {
        out->camera = best.camera;
        memcpy(out->at, best.at, sizeof best.at);
        memcpy(out->face, best.face, sizeof best.face);
        out->then = r->voxels * sqrt(fmax(0, 1 - best.gain / w.error));
        next_say(rig, &best, out->text, sizeof out->text);
    }
    rec_information_fini(&w);
    return e;
}
