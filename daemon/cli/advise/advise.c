/* advise.c - `pyrovox advise`: finds from a recording which terms and settings a scene needs. */
#include <argp.h>
#include <stdio.h>

#include "daemon/cli/advise/advise.h"

static const char doc[] =
    "Measure what the scene of a recording needs, for example\n\n"
    "  pyrovox advise --rig rig.yaml --frames take.h5\n\n"
    "The answers: which terms of the model, which basis and grid, and whether light and cameras "
    "suffice.\v"
    "Settings are compared by cameras that had no part in a volume: the volume is made from the "
    "other cameras and shown as the camera should see it. No true volume is needed. The output has "
    "a "
    "line for each question (verdict, evidence, gain, time), and then a pyrovoxd.yaml to paste.\n\n"
    "The finest detail comes from the singular values of the rig's own system on that flame. "
    "Whether the rig itself is right is a question for `pyrovox calibrate check`.";

static error_t advise_parse(int key, char *arg, struct argp_state *st)
{
    struct flame_sets_args *a = st->input;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = a; return 0;
    case ARGP_KEY_ARG: argp_error(st, "unexpected argument '%s'", arg); return 0;
    case ARGP_KEY_END:
        if (a->rig == NULL || a->frames == NULL)
            argp_error(st, "needs --rig and --frames");
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

/* With what was put right already. */
static pvx_err advise_belong(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    rec_unseen *u;
    PVX_TRY(rec_unseen_new(&s->rig, &s->params, s->pool, &u, d));
    pvx_err e = flame_sets_belong(s, u, &a->belong);
    rec_unseen_free(&u);
    return e;
}

pvx_err advise_all(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    if (s->rig.n_cameras < 4)
        return pvx_fail(
            d, PVX_EINVAL,
            "advise: %zu cameras: one is left out and three make a volume, so it takes four",
            s->rig.n_cameras);
    PVX_TRY(advise_measure(s, a, d));
    PVX_TRY(advise_noise(s, a, d));
    PVX_TRY(advise_belong(s, a, d));
    return advise_levels(s, &a->levels, d);
}

static int advise_run(int argc, char **argv)
{
    const struct argp_child children[] = {{flame_sets_argp(), 0, NULL, 1}, {0}};
    const struct argp argp = {.parser = advise_parse, .children = children, .doc = doc};
    struct flame_sets_args args = FLAME_SETS_INIT;
    struct flame_sets s;
    struct advice a;
    struct pvx_diag d = {""};
    args.sets = 20;
    argp_parse(&argp, argc, argv, 0, NULL, &args);
    cli_catch_stop();
    pvx_err e = flame_sets_load(&s, &args, &d);
    PVX_THEN(e, advise_all(&s, &a, &d));
    if (e == PVX_OK)
        advise_print(stdout, &s, &a);
    flame_sets_fini(&s);
    return cli_end(&d, e, false);
}

const struct cli_command cmd_advise = {
    "advise", "what a recording's scene needs: terms, grid, light, cameras", advise_run};
