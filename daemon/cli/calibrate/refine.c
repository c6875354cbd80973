/* refine.c - `pyrovox calibrate refine`: the poses of a rig corrected by a flame. */
#include <stdio.h>
#include <string.h>

#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/flame_sets.h"
#include "daemon/cli/common/opt_rig.h"
#include "recon/check/refine.h"

struct args {
    struct flame_sets_args sets;
    const char *out;
    bool force;
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"o|out", "FILE", AT(out), 0, 0, "write the corrected rig here"},
    {"force", NULL, AT(force), 0, 0, "write over an older FILE"},
    {0}};

static const char doc[] =
    "Correct the poses of a rig by a flame: each camera is fitted to the volume that the others "
    "make of it, in up to 5 rounds.\vExamples:\n"
    "  pyrovox calibrate refine --rig rig.yaml --frames take.h5 --black 0.02 \\\n"
    "          --out refined.yaml\n"
    "\n"
    "Two thirds of the frame sets fit, and the last third judges. The rig is written only if views "
    "that were left out of its volumes get better there. Otherwise the figures are printed, and "
    "the exit code is 1.\n"
    "Place, direction and size of the world stay as they were as well as possible, because no "
    "flame shows them. Focal lengths are corrected if the flame shows them. If all cameras stand "
    "in a line, directions and distances are held.\n"
    "A covered, mirrored or late camera is not a matter of poses: `pyrovox calibrate check` names "
    "it.";

static error_t refine_parse_opt(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &a->sets; return 0;
    case ARGP_KEY_ARG: argp_error(st, "'%s': this step takes options only", arg); return 0;
    case ARGP_KEY_END:
        if (a->sets.frames == NULL)
            argp_error(st, "which flame? --frames DIR or TAKE.h5");
        if (a->out == NULL)
            argp_error(st, "where to? --out refined.yaml");
        return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

static void refine_say_held(const struct rec_rig *rig, const struct rec_refine_report *o)
{
    size_t focal = 0, nothing = 0;
    for (size_t c = 0; c < rig->n_cameras; c++) {
        focal += (o->held[c] & REC_POSE_FOCAL) != 0;
        nothing += o->held[c] == REC_POSE_ALL;
    }
    if (o->in_line)
        printf("the cameras stand in a line: the direction from which each looks, its distance and "
               "its focal length cannot be seen and are held\n");
    else if (focal > 0)
        printf("focal lengths of %zu of %zu cameras cannot be seen and are held\n", focal,
               rig->n_cameras);
    if (nothing > 0)
        printf("%zu of %zu cameras see nothing of the flame and are held\n", nothing,
               rig->n_cameras);
}

static void refine_say(const struct rec_rig *rig, const struct rec_refine_report *o)
{
    printf("%zu frame sets fit, %zu judge\n\n%-6s %12s %20s\n", o->fitted, o->held_out, "round",
           "moved, px", "unseen views, error");
    for (uint32_t i = 0; i <= o->rounds; i++)
        printf("%-6u %12.3f %20.4f%s\n", i, o->moved[i], o->error[i], i == o->best ? "  best" : "");
    printf("\n%-12s %10s\n", "camera", "moved, px");
    for (size_t c = 0; c < rig->n_cameras; c++)
        printf("%-12s %10.3f\n", rig->cameras[c].name, o->px[c]);
    refine_say_held(rig, o);
}

/* Save the rig of the command line with refined poses and focal lengths.  Its photometry stays as it was. */
static pvx_err refine_write_rig(const struct flame_sets *s, const char *path, struct pvx_diag *d)
{
    struct rec_rig rig;
    PVX_TRY(rec_rig_load(s->a->rig, &rig, d));
    pvx_err e = s->a->cameras != NULL ? rec_rig_select(&rig, s->a->cameras, d) : PVX_OK;
    for (size_t c = 0; e == PVX_OK && c < rig.n_cameras; c++) {
        const struct rec_camera *to = &s->rig.cameras[c];
        struct rec_camera *k = &rig.cameras[c];
        k->fx = to->fx;
        k->fy = to->fy;
        memcpy(k->R, to->R, sizeof k->R);
        memcpy(k->t, to->t, sizeof k->t);
    }
    PVX_THEN(e, opt_rig_save(&rig, s->a->rig, path, d));
    rec_rig_fini(&rig);
    return e;
}

static pvx_err refine_rig(struct flame_sets *s, const struct args *a, bool *accepted,
                          struct pvx_diag *d)
{
    struct rec_refine_report o;
    PVX_TRY(cli_may_write(a->out, a->force, d));
    PVX_TRY(flame_sets_load(s, &a->sets, d));
    struct rec_check_source from = flame_sets_source(s, "refine");
    PVX_TRY(rec_refine(&s->rig, &s->params, s->pool, &from, &o, d));
    refine_say(&s->rig, &o);
    *accepted = o.accepted;
    if (o.accepted) {
        PVX_TRY(refine_write_rig(s, a->out, d));
        printf("%s: unseen views of held-out frames: error %.4f -> %.4f\n", a->out, o.error[0],
               o.error[o.best]);
    }
    fflush(stdout);
    if (!o.accepted)
        fprintf(stderr,
                "pyrovox: not refined: held-out frames do not get better (error %.4f -> %.4f in "
                "unseen views); no rig was written\n",
                o.error[0], o.error[o.rounds]);
    return PVX_OK;
}

int calibrate_refine(int argc, char **argv)
{
    struct args a = {.sets = FLAME_SETS_INIT};
    const struct argp_child children[] = {{flame_sets_argp(), 0, NULL, 0}, {0}};
    const struct argp argp = {.parser = refine_parse_opt, .doc = doc, .children = children};
    cli_parse(rows, &argp, 0, argc, argv, &a);
    struct pvx_diag d = {""};
    struct flame_sets s = {0};
    bool accepted = false;
    cli_catch_stop();
    pvx_err e = refine_rig(&s, &a, &accepted, &d);
    flame_sets_fini(&s);
    return e == PVX_OK ? !accepted : cli_end(&d, e, true);
}
