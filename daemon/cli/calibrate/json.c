/* json.c - a calibration's report as JSON. */
#include "daemon/cli/calibrate/report.h"
#include "recon/board/spec.h"

static const char *const what[] = {"verdict", "held",    "unseen",  "apart",    "weak pair",
                                   "sync",    "moved",   "lens",    "pictures", "world",
                                   "scale",   "old rig", "held out"};
_Static_assert(sizeof what / sizeof *what == REC_CALIB_HELD_OUT + 1, "a name for every finding");

static void calibrate_numbers(struct dmn_json *j, const char *key, const double *v, size_t n)
{
    dmn_json_open(j, key, '[');
    for (size_t i = 0; i < n; i++)
        dmn_json_num(j, NULL, v[i]);
    dmn_json_close(j, ']');
}

static void calibrate_put_camera(struct dmn_json *j, const struct calibrate_result *r, size_t c)
{
    const struct rec_calib_camera *k = &r->look->camera[c];
    const struct calibrate_count *n = &r->look->count[c];
    dmn_json_open(j, NULL, '{');
    dmn_json_str(j, "name", k->name);
    calibrate_numbers(j, "size", (const double[]){k->width, k->height}, 2);
    dmn_json_int(j, "pictures", (long long)n->pictures);
    dmn_json_open(j, "sights", '{');
    dmn_json_int(j, "unreadable", (long long)n->unreadable);
    for (int s = 0; s < REC_N_SIGHTS; s++)
        dmn_json_int(j, rec_sight_name((enum rec_sight)s), (long long)n->sight[s]);
    dmn_json_close(j, '}');
    if (r->report->camera != NULL) {
        const struct rec_calib_of_camera *o = &r->report->camera[c];
        dmn_json_int(j, "used", (long long)o->used);
        dmn_json_num(j, "single_px", o->single);
        dmn_json_num(j, "joint_px", o->joint);
        dmn_json_num(j, "structure_px", o->structure);
        dmn_json_num(j, "coverage", o->coverage);
        dmn_json_open(j, "held", '[');
        for (int i = 0; i < REC_LENS; i++)
            if (o->held >> i & 1)
                dmn_json_str(j, NULL, calibrate_lens[i]);
        dmn_json_close(j, ']');
        dmn_json_open(j, "sigma", '{');
        for (int i = 0; i < REC_LENS; i++)
            dmn_json_num(j, calibrate_lens[i], o->sigma[i]);
        dmn_json_close(j, '}');
        dmn_json_open(j, "expected", '{');
        dmn_json_num(j, "px", o->expected.px);
        dmn_json_num(j, "px_95", o->expected.px_95);
        dmn_json_num(j, "voxels", o->expected.voxels);
        dmn_json_num(j, "voxels_95", o->expected.voxels_95);
        dmn_json_str(j, "verdict", rec_calib_verdict(&o->expected));
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, '}');
}

static void put_picture(struct dmn_json *j, const struct calibrate_result *r,
                        const struct calibrate_picture *p)
{
    dmn_json_open(j, NULL, '{');
    dmn_json_str(j, "camera", r->look->camera[p->camera].name);
    dmn_json_int(j, "frame", p->frame);
    dmn_json_str(j, "file", p->path);
    dmn_json_str(j, "sight", p->unreadable ? "unreadable" : rec_sight_name(p->outcome));
    if (p->text[0] != '\0')
        dmn_json_str(j, "why", p->text);
    if (p->at != CALIBRATE_NO_VIEW) {
        const struct rec_calib_view *v = r->report->view != NULL ? &r->report->view[p->at] : NULL;
        dmn_json_str(j, "face", p->view.face == REC_BACK ? "back" : "front");
        dmn_json_num(j, "square_px", p->square);
        dmn_json_num(j, "blur_px", p->blur);
        if (v != NULL) {
            dmn_json_str(j, "fate", calibrate_fate[v->fate]);
            if (v->fate == REC_VIEW_STILL)
                dmn_json_int(j, "like", v->like);
            dmn_json_int(j, "wrong", (long long)v->wrong);
            dmn_json_num(j, "single_px", v->single);
            dmn_json_num(j, "joint_px", v->joint);
        }
        dmn_json_open(j, "corners", '['); /* id, x, y, and seen - expected where it is known */
        for (size_t i = 0; i < p->view.n; i++) {
            const struct rec_board_corner *c = &p->view.corner[i];
            bool known = v != NULL && v->residual != NULL;
            calibrate_numbers(j, NULL,
                              (const double[]){c->id, c->x, c->y,
                                               known ? (double)v->residual[2 * i] : 0,
                                               known ? (double)v->residual[2 * i + 1] : 0},
                              known ? 5 : 3);
        }
        dmn_json_close(j, ']');
    }
    dmn_json_close(j, '}');
}

static void put_graph(struct dmn_json *j, const struct calibrate_result *r)
{
    const struct rec_calib_report *o = r->report;
    dmn_json_open(j, "pairs", '[');
    for (size_t i = 0; o->pair != NULL && i < o->n_pairs; i++) {
        const struct rec_calib_pair *p = &o->pair[i];
        dmn_json_open(j, NULL, '{');
        dmn_json_str(j, "a", r->look->camera[p->a].name);
        dmn_json_str(j, "b", r->look->camera[p->b].name);
        dmn_json_int(j, "common", p->common);
        dmn_json_num(j, "weight", p->weight);
        dmn_json_bool(j, "in_tree", p->in_tree);
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
    dmn_json_open(j, "boards", '['); /* to the world; those that are known */
    for (size_t i = 0; o->board != NULL && i < o->n_frames; i++) {
        if (o->board[i][0] != o->board[i][0])
            continue;
        dmn_json_open(j, NULL, '{');
        dmn_json_int(j, "frame", o->frame[i]);
        calibrate_numbers(j, "R", o->board[i], 9);
        calibrate_numbers(j, "t", o->board[i] + 9, 3);
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
}

static void put_whole(struct dmn_json *j, const struct calibrate_result *r)
{
    const struct rec_calib_report *o = r->report;
    dmn_json_num(j, "single_px", o->single);
    dmn_json_num(j, "joint_px", o->joint);
    dmn_json_num(j, "chi2", o->chi2);
    dmn_json_int(j, "iterations", o->iterations);
    dmn_json_num(j, "expected_px", o->px);
    dmn_json_num(j, "expected_voxels", o->voxels);
    dmn_json_num(j, "voxels_95", o->voxels_95);
    calibrate_numbers(j, "warp", o->warp, 3);
    dmn_json_num(j, "thickness", o->thickness);
    dmn_json_open(j, "volume", '{');
    calibrate_numbers(j, "min", r->grid->min, 3);
    calibrate_numbers(j, "max", r->grid->max, 3);
    calibrate_numbers(j, "voxels", (const double[]){r->grid->n[0], r->grid->n[1], r->grid->n[2]},
                      3);
    dmn_json_int(j, "side", REC_CALIB_SIDE);
    calibrate_numbers(j, "expected_px", o->at, REC_CALIB_SIDE * REC_CALIB_SIDE * REC_CALIB_SIDE);
    dmn_json_close(j, '}');
    dmn_json_open(j, "folds", '[');
    for (int i = 0; i < REC_CALIB_FOLDS; i++) {
        dmn_json_open(j, NULL, '{');
        dmn_json_num(j, "trained", o->fold[i].trained);
        dmn_json_num(j, "held_out", o->fold[i].held_out);
        dmn_json_num(j, "volume_px", o->fold[i].volume);
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
}

void calibrate_json(struct dmn_json *j, const void *ctx)
{
    const struct calibrate_result *r = ctx;
    char board[REC_BOARD_TEXT];
    rec_board_text(r->board, board);
    dmn_json_open(j, NULL, '{');
    dmn_json_int(j, "version", 1);
    dmn_json_str(j, "board", board);
    if (r->look->said[0] != '\0')
        dmn_json_str(j, "looked_at", r->look->said);
    dmn_json_bool(j, "accepted", r->accepted);
    if (r->failure != NULL)
        dmn_json_str(j, "failure", r->failure);
    dmn_json_open(j, "findings", '[');
    for (size_t i = 0; i < r->report->n_findings; i++) {
        const struct rec_calib_finding *f = &r->report->finding[i];
        dmn_json_open(j, NULL, '{');
        dmn_json_str(j, "severity", calibrate_severity(f->severity));
        dmn_json_str(j, "what", what[f->what]);
        if (f->camera >= 0)
            dmn_json_str(j, "camera", r->look->camera[f->camera].name);
        if (f->frame != REC_NO_FRAME)
            dmn_json_int(j, "frame", f->frame);
        dmn_json_str(j, "text", f->text);
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
    put_whole(j, r);
    dmn_json_open(j, "cameras", '[');
    for (size_t c = 0; c < r->look->n_cameras; c++)
        calibrate_put_camera(j, r, c);
    dmn_json_close(j, ']');
    put_graph(j, r);
    dmn_json_open(j, "pictures", '[');
    for (size_t i = 0; i < r->look->n; i++)
        put_picture(j, r, &r->look->picture[i]);
    dmn_json_close(j, ']');
    dmn_json_close(j, '}');
}
