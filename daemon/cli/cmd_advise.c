/* cmd_advise.c - `pyrovox advise`: which terms and settings a scene needs, by what a recording shows. */
#include <argp.h>
#include <math.h>
#include <stdio.h>

#include "daemon/cli/advise.h"

static const char doc[] = "Look at a recording and say what its scene needs: which terms of the "
                          "model, which basis and grid, and "
                          "whether light and cameras suffice.\v"
                          "Settings are compared by cameras that had no part in a volume: it is "
                          "made of the others, and shown as "
                          "they should see it. No truth is needed. A line a question: verdict, "
                          "evidence, what it buys; then a "
                          "pyrovoxd.yaml to paste.\n\n"
                          "  pyrovox advise --rig rig.yaml --frames take.h5\n"
                          "Not looked at: bodies in the flame, and whether the rig is right, which "
                          "`pyrovox calibrate check` "
                          "says.";

static void line(const char *term, const char *verdict)
{
    printf("%-12s %-10s ", term, verdict);
}

static void light(const struct flame_sets *s, const struct advice *a)
{
    bool dim = a->brightest < 0.2 && a->saturated < ADVISE_SATURATED && !s->floats;
    line("exposure", dim ? "raise" : a->saturated > 0.05 ? "lower" : "fine");
    printf("the brightest pixel is at %.0f %% of full scale, noise at %.2f %%\n",
           100 * a->brightest, 100 * a->sigma);
    line("saturated", a->saturated > ADVISE_SATURATED ? "at-least" : "left-out");
    printf("%.1f %% of the flame's pixels are at full scale\n", 100 * a->saturated);
    double level = a->level[a->darkest];
    line("black", level > ADVISE_LEVEL ? "subtract" : "fine");
    printf("where it is darkest %s has %.2f %% of full scale%s\n", s->rig.cameras[a->darkest].name,
           100 * level,
           level > ADVISE_LEVEL
               ? "; `pyrovox calibrate dark` or `background` measure it pixel by pixel"
               : "");
    if (a->lit > 0.9)
        printf("%-23s nearly all pixels count as flame (%.0f %%): what follows is of little worth "
               "before that "
               "is mended\n",
               "", 100 * a->lit);
}

/* Alike, and volumes that are smooth serve whoever renders them. */
static enum rec_basis basis(const struct advice *a)
{
    return ADVISE_SAME * a->basis[REC_BOX] < a->basis[REC_TRILINEAR] ? REC_BOX : REC_TRILINEAR;
}

static void model(const struct advice *a)
{
    const struct rec_absorption *b = &a->absorption;
    line("absorption", b->c > 0 ? "on" : "off");
    printf("c %.3g (depth %.1f at the brightest pixel) betters %u of %u left-out pictures, their "
           "error by %.1f "
           "%%; no time\n",
           b->best, b->depth, b->better, b->views, 100 * (1 - sqrt(fmax(1 - b->gain, 0))));
    line("basis", rec_basis_name(basis(a)));
    printf("left-out pictures are missed by %.1f %% (box), %.1f %% (trilinear)\n",
           100 * a->basis[REC_BOX], 100 * a->basis[REC_TRILINEAR]);
}

static void gains(const struct flame_sets *s, const struct advice *a)
{
    const struct advise_gain *g = &a->gain;
    if (!g->known) {
        line("gain", "unknown");
        printf("too few sets or cameras with a flame to tell\n");
        return;
    }
    line("gain", g->on ? "on" : "off");
    printf("%s is furthest off the others, %.3f of what it should have; left-out pictures are "
           "missed by %.1f %% as they "
           "are, by %.1f %% with gains; no time\n",
           s->rig.cameras[g->worst].name, 1 / g->gain[g->worst], 100 * g->error[0],
           100 * g->error[1]);
    if (!g->on)
        return;
    printf("%-23s ", "");
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        if (fabs(log(g->gain[c])) > log(1 + ADVISE_GAIN))
            printf("%s: %.3f, ", s->rig.cameras[c].name, g->gain[c]);
    printf("which `pyrovox calibrate gain --rig %s --flame --frames %s --out with-gains.yaml` "
           "measures by colour\n",
           s->a->rig, s->a->frames);
}

static void size(const struct flame_sets *s, const struct advice *a)
{
    char n[16];
    snprintf(n, sizeof n, "%d", a->grid[a->best_grid].voxels);
    line("grid", n);
    for (size_t i = 0; i < a->n_grids; i++)
        printf("%s%d: %.1f %% %.0f ms", i > 0 ? ", " : "", a->grid[i].voxels,
               100 * a->grid[i].error, a->grid[i].ms);
    printf(" (grey)%s\n",
           a->best_grid + 1 == a->n_grids ? "; finer may be better yet: --grid auto" : "");
    if (s->rig.n_cameras < 7)
        return;
    bool more = a->half > 1.25 * a->all;
    line("cameras", more ? "more help" : "enough");
    printf("left-out pictures are missed by %.1f %% by every second of the others, by %.1f %% by "
           "all\n",
           100 * a->half, 100 * a->all);
}

void advise_print(const struct flame_sets *s, const struct advice *a)
{
    light(s, a);
    model(a);
    gains(s, a);
    size(s, a);
    printf("\nrig: %s\nbasis: %s\n", s->a->rig, rec_basis_name(basis(a)));
    if (a->best_grid + 1 == a->n_grids && a->finest > a->grid[a->best_grid].voxels)
        printf("grid: [%d]  # the finest that the pictures hold\n", a->finest);
    else
        printf("grid: [%d]\n", a->grid[a->best_grid].voxels);
    double level = INFINITY; /* what all of them have; one number takes no more off */
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        level = fmin(level, a->level[c]);
    if (a->level[a->darkest] > level + ADVISE_LEVEL)
        printf("# black levels differ by camera: `pyrovox calibrate dark` gives each its own\n");
    if (level > ADVISE_LEVEL || s->a->black > 0)
        printf("photometry: { black: %.4g }\n", s->a->black + (level > ADVISE_LEVEL ? level : 0));
    printf("model: { absorption: %.3g, saturated: %s }\n", a->absorption.c,
           a->saturated > ADVISE_SATURATED ? "at-least" : "left-out");
}

static error_t parse(int key, char *arg, struct argp_state *st)
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

static int run(int argc, char **argv)
{
    static const struct argp_child children[] = {{&flame_sets_argp, 0, NULL, 1}, {0}};
    static const struct argp argp = {.parser = parse, .children = children, .doc = doc};
    struct flame_sets_args args = FLAME_SETS_INIT;
    struct flame_sets s;
    struct advice a;
    struct pvx_diag d = {""};
    args.sets = 20;
    argp_parse(&argp, argc, argv, 0, NULL, &args);
    cli_catch_stop();
    pvx_err e = flame_sets_load(&s, &args, &d);
    if (e == PVX_OK && s.rig.n_cameras < 4)
        e = pvx_fail(
            &d, PVX_EINVAL,
            "advise: %zu cameras: one is left out and three make a volume, so it takes four",
            s.rig.n_cameras);
    if (e == PVX_OK)
        e = advise_measure(&s, &a, &d);
    if (e == PVX_OK)
        advise_print(&s, &a);
    flame_sets_fini(&s);
    if (e == PVX_ECANCELED) {
        fprintf(stderr, "pyrovox: stopped\n");
        return 130;
    }
    return e == PVX_OK ? 0 : cli_error(&d, e);
}

const struct cli_command cmd_advise = {
    "advise", "what a recording's scene needs: terms, grid, light, cameras", run};
