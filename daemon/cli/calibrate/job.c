#include "daemon/cli/calibrate/job.h"

#include <stdio.h>
#include <string.h>

#include "base/yaml.h"
#include "daemon/cli/calibrate/choose.h"
#include "daemon/cli/calibrate/modes.h"
#include "daemon/cli/calibrate/report.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/opt_rig.h"
#include "recon/board/spec.h"
#include "recon/calib/next.h"

static pvx_err job_find_camera(const struct calibrate_look *l, const char *name, size_t len,
                               uint32_t *out, struct pvx_diag *d)
{
    *out = (uint32_t)calibrate_camera(l, name, len);
    return *out < l->n_cameras
               ? PVX_OK
               : pvx_fail(d, PVX_ENOENT, "no pictures of a camera called '%.*s'", (int)len, name);
}

static pvx_err read_measured(struct calibrate_job *j, struct pvx_diag *d)
{
    for (size_t i = 0; i < j->a->n_measured; i++) {
        struct rec_calib_measured *m = &j->measured[i];
        const char *s = j->a->measured[i], *b = strchr(s, ','),
                   *n = b != NULL ? strchr(b + 1, ',') : NULL;
        if (n == NULL || pvx_parse_double(n + 1, 1e-6, 1e6, &m->metres) != PVX_OK)
            return pvx_fail(d, PVX_EINVAL, "--measured %s: should be CAMERA,CAMERA,METRES", s);
        PVX_TRY(job_find_camera(&j->look, s, (size_t)(b - s), &m->a, d));
        PVX_TRY(job_find_camera(&j->look, b + 1, (size_t)(n - b - 1), &m->b, d));
    }
    return PVX_OK;
}

pvx_err calibrate_start(struct calibrate_job *j, const struct calibrate_args *a, struct pvx_diag *d)
{
    *j = (struct calibrate_job){.a = a};
    PVX_TRY(cli_may_write(a->out, a->force, d));
    for (size_t i = 0; i < a->n_reports; i++)
        PVX_TRY(calibrate_report_possible(a->report[i], true, d));
    return rec_board_parse(a->board, &j->board, d);
}

pvx_err calibrate_prepare(struct calibrate_job *j, struct pvx_diag *d)
{
    const struct calibrate_args *a = j->a;
    struct rec_calib_options *o = &j->in.options;
    const char *old = a->keep != NULL ? a->keep : a->lenses;
    if (old != NULL) {
        PVX_TRY(rec_rig_load(old, &j->old, d));
        o->old = &j->old;
    }
    o->world = a->floor >= 0     ? REC_WORLD_FLOOR
               : a->has_up       ? REC_WORLD_UP
               : a->keep != NULL ? REC_WORLD_OLD
                                 : REC_WORLD_BEST;
    o->floor_frame = a->floor >= 0 ? (uint32_t)a->floor : 0;
    memcpy(o->up, a->up, sizeof o->up);
    if (a->up_camera != NULL)
        PVX_TRY(job_find_camera(&j->look, a->up_camera, strlen(a->up_camera), &o->up_camera, d));
    PVX_TRY(read_measured(j, d));
    o->measured = j->measured;
    o->n_measured = a->n_measured;
    for (size_t c = 0; a->lenses != NULL && c < j->look.n_cameras; c++)
        j->look.camera[c].hold = REC_HOLD_LENS;
    j->in.board = j->board;
    j->in.grid.basis = REC_BASIS_DEFAULT;
    memcpy(j->in.grid.min, a->volume, sizeof j->in.grid.min);
    memcpy(j->in.grid.max, a->volume + 3, sizeof j->in.grid.max);
    memcpy(j->in.grid.n, a->voxels, sizeof j->in.grid.n);
    if (a->add.n + a->recover.n > 0) {
        j->in.grid = j->old.grid;
        PVX_TRY(calibrate_hold(&j->look, &j->old, &a->add, &a->recover, d));
    }
    return PVX_OK;
}

/* Fail if a camera never saw the board.  The reason given is the most frequent one in which something was recognised
 * (mirrored, another board, other markers).  Without one it is the most frequent of all. */
static pvx_err all_saw(const struct calibrate_look *l, struct pvx_diag *d)
{
    for (size_t c = 0; c < l->n_cameras; c++) {
        const struct calibrate_count *n = &l->count[c];
        size_t most = REC_SIGHT_NO_MARKER;
        for (size_t s = most; s < REC_N_SIGHTS; s++)
            if (n->sight[s] >
                (most < REC_SIGHT_MIRRORED && s >= REC_SIGHT_MIRRORED ? 0 : n->sight[most]))
                most = s;
        if (n->sight[REC_SIGHT_FOUND] == 0 && (l->camera[c].hold & REC_HOLD_POSE) == 0)
            return pvx_fail(
                d, PVX_EINVAL, "%s: the board is in none of %zu pictures; %zu of them: %s: %s",
                l->camera[c].name, n->pictures, n->sight[most],
                rec_sight_name((enum rec_sight)most), l->picture[n->example[most]].text);
    }
    return PVX_OK;
}

static pvx_err job_solve(struct calibrate_job *j, struct pvx_diag *d)
{
    j->in.n_cameras = j->look.n_cameras;
    j->in.camera = j->look.camera;
    j->in.n_views = j->look.n_views;
    j->in.view = j->look.view;
    PVX_TRY(all_saw(&j->look, d));
    calibrate_mode_uncrop(&j->look, &j->old);
    return rec_calib_solve(&j->in, &j->rig, &j->report, d);
}

/* Unless the calibration is good already, print the pose that would help most. */
static void say_next(const struct calibrate_job *j)
{
    struct rec_calib_next n;
    if (!rec_calib_good(&j->report) && rec_calib_next(&j->in, &j->rig, &j->report, &n) == PVX_OK)
        printf("next: %s: %.2g -> %.2g voxels\n", n.text, n.now, n.then);
}

/* Turn the rig of these pictures into the wanted one: add the old rig's cameras, and crop to the flame's pictures. */
static pvx_err job_complete(struct calibrate_job *j, struct pvx_diag *d)
{
    if (j->a->add.n + j->a->recover.n > 0)
        PVX_TRY(calibrate_merge(&j->look, &j->old, &j->rig, d));
    calibrate_mode_crop(&j->look, &j->rig);
    return PVX_OK;
}

/* Warn that the bodies of rig `from` are lost: without --keep the new world differs, so their places are unknown. */
static void say_lost(const struct calibrate_job *j, const char *from)
{
    struct rec_rig was;
    if (j->a->keep != NULL || rec_rig_load(from, &was, NULL) != PVX_OK)
        return;
    if (was.bodies.n > 0)
        fprintf(stderr,
                "%s: the bodies of %s are left out, for the world is another; --keep %s stays in "
                "its world and keeps them\n",
                j->a->out, from, from);
    rec_rig_fini(&was);
}

static pvx_err job_write_rig(const struct calibrate_job *j, struct pvx_diag *d)
{
    const char *old = j->a->keep != NULL ? j->a->keep : j->a->lenses;
    say_lost(j, old != NULL ? old : j->a->out);
    return opt_rig_save(&j->rig, old, j->a->out, d);
}

pvx_err calibrate_conclude(struct calibrate_job *j, struct pvx_diag *d)
{
    const struct calibrate_args *a = j->a;
    struct calibrate_result r = {.board = &j->board,
                                 .grid = &j->in.grid,
                                 .look = &j->look,
                                 .report = &j->report,
                                 .accepted = a->accept};
    calibrate_print_pictures(&r);
    fflush(stdout);
    struct pvx_diag why;
    pvx_err e = job_solve(j, d);
    if (cli_stop)
        return PVX_ECANCELED;
    if (e == PVX_OK) {
        r.grid = &j->rig.grid;
        calibrate_print_cameras(&r);
    }
    calibrate_print_findings(&r);
    if (e == PVX_OK) {
        say_next(j);
        e = job_complete(j, d);
    }
    if (e != PVX_OK) {
        snprintf(why.text, sizeof why.text, "%s", pvx_diag_text(d, e));
        r.failure = why.text;
    } else {
        r.rig = &j->rig;
    }
    fflush(stdout);
    if (e == PVX_OK && rec_calib_says(&j->report, REC_CALIB_REFUSED, -1) && !a->accept)
        e = pvx_fail(
            d, PVX_EINVAL,
            "%s is not written, for what is refused above; --accept writes it all the same",
            a->out);
    for (size_t i = 0; i < a->n_reports; i++) {
        pvx_err written =
            calibrate_write_report(a->report[i], calibrate_json, calibrate_html, &r, d);
        PVX_THEN(e, written);
    }
    PVX_THEN(e, job_write_rig(j, d));
    if (e == PVX_OK)
        printf("%s: %zu cameras, %d x %d x %d voxels\n", a->out, j->rig.n_cameras, j->rig.grid.n[0],
               j->rig.grid.n[1], j->rig.grid.n[2]);
    return e;
}

void calibrate_job_fini(struct calibrate_job *j)
{
    calibrate_look_fini(&j->look);
    rec_calib_report_fini(&j->report);
    rec_rig_fini(&j->rig);
    rec_rig_fini(&j->old);
}
