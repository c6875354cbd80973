/* print.c - what advise says: a line for each term, then a configuration to paste. */
#include <math.h>
#include <string.h>

#include "daemon/cli/advise/advise.h"
#include "recon/carve/clipped.h"

static void advise_line(FILE *f, const char *term, const char *verdict)
{
    fprintf(f, "%-12s %-10s ", term, verdict);
}

static void advise_say_light(FILE *f, const struct flame_sets *s, const struct advice *a)
{
    int bits = cap_depth_bits(&s->depth, 1);
    const enum cap_pixfmt fmt = s->nch == 3 ? CAP_RGB16 : CAP_GREY16;
    char room[120];
    const char *exposure = advise_exposure(s, a);
    advise_line(f, "exposure", exposure);
    if (a->saturated > 0)
        fprintf(
            f,
            "%.1f %% of the flame's pixels are at full scale, the brightest of the others is at "
            "%.0f %%, noise at %.2f %%\n",
            100 * a->saturated, 100 * a->brightest, 100 * a->sigma);
    else
        fprintf(f, "the brightest pixel is at %.0f %% of full scale, noise at %.2f %%\n",
                100 * a->brightest, 100 * a->sigma);
    unsigned top = s->depth.top;
    if (bits > 0)
        fprintf(f, "%-23s these are %d bits in 16, saturated at %u; %s; measure again with it\n",
                "", bits, top, cap_depth_remedy(fmt, bits, "--pixel-format ", room));
    else if (exposure[0] == 'r' && top > 0 && top < 1u << 12)
        fprintf(f,
                "%-23s no sample is above %u: if the cameras have %d bits, measure again with "
                "--pixel-format Mono%d (colour: RGB%d) first\n",
                "", top, top < 1u << 10 ? 10 : 12, top < 1u << 10 ? 10 : 12,
                top < 1u << 10 ? 10 : 12);
    advise_line(f, "saturated", a->saturated > ADVISE_SATURATED ? "at-least" : "left-out");
    fprintf(f, "%.1f %% of the flame's pixels are at full scale\n", 100 * a->saturated);
    double level = a->level[a->darkest];
    advise_line(f, "black", level > ADVISE_LEVEL ? "subtract" : "fine");
    fprintf(f, "where it is darkest %s has %.2f %% of full scale%s\n",
            s->rig.cameras[a->darkest].name, 100 * level,
            level > ADVISE_LEVEL
                ? "; `pyrovox calibrate dark` or `background` measure it pixel by pixel"
                : "");
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        char text[REC_PHOTO_CUT_TEXT];
        if (rec_photo_say_cut(a->cut[c], a->pedestal[c], text))
            fprintf(f, "%-23s %s: %s\n", "", s->rig.cameras[c].name, text);
    }
    if (a->lit > 0.9)
        fprintf(
            f,
            "%-23s nearly all pixels count as flame (%.0f %%): correct this first, the rest has "
            "little value before\n",
            "", 100 * a->lit);
}

/* Print where each camera is dark. */
static void bodies(FILE *f, const struct flame_sets *s, const struct advice *a)
{
    size_t n = 0;
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        const struct advise_body *b = &a->body[c];
        if (!(b->share > 0))
            continue;
        if (n++ == 0)
            advise_line(f, "bodies", "found");
        else
            fprintf(f, "%-23s ", "");
        fprintf(
            f,
            "%s stays dark in pixels %d..%d, %d..%d (right, down) where %.0f %% of its light is "
            "expected; without them the error of the other pictures is %.1f %%, with them %.1f "
            "%%\n",
            s->rig.cameras[c].name, b->from[0], b->to[0], b->from[1], b->to[1], 100 * b->share,
            100 * b->error[1], 100 * b->error[0]);
    }
    if (n == 0) {
        advise_line(f, "bodies", "none");
        fprintf(f, "no camera stays dark where the others see flame\n");
        return;
    }
    fprintf(
        f, "%-23s %s; no time. The rest is measured without these pixels\n", "",
        n == 1 ? "a body before that lens: draw it dark into its `photometry: { mask: FILE }` in "
                 "rig.yaml"
               : "several cameras see it, so it stands near the flame: use `bodies` of rig.yaml if "
                 "its shape is known, or else a mask for each camera");
}

/* What the other lines do not say already. */
static bool advise_doubts(const struct advice *a)
{
    const enum rec_cause c = a->belong.cause;
    return c == REC_CAUSE_BOX || c == REC_CAUSE_RIG || c == REC_CAUSE_TURNED ||
           c == REC_CAUSE_SWAPPED || c == REC_CAUSE_LATE || c == REC_CAUSE_REPEATS;
}

const char *advise_first(const struct flame_sets *s, const struct advice *a)
{
    return advise_doubts(a) ? "; first what is said of pictures and rig"
           : strcmp(advise_exposure(s, a), "lower") == 0
               ? "; first expose a quarter as long: clipped pictures look like this as well"
           : a->gain.on ? "; first correct the gains below: cameras of unlike gain look like this "
                          "as well"
                        : NULL;
}

/* A term that helps is recommended only where nothing else has to be put right first. */
static const char *advise_term(bool helps, const char *first)
{
    return helps && first == NULL ? "on" : "off";
}

static void advise_do_motion(FILE *f, const struct advice *a, int32_t voxels, const char *first)
{
    const struct advise_motion *m = &a->motion;
    if (!m->known) {
        advise_line(f, "rate", "unknown");
        fprintf(f, "no three sets of the recording follow each other\n");
        advise_line(f, "temporal", "off");
        fprintf(f, "no three sets of the recording follow each other\n");
        return;
    }
    advise_line(f, "rate", m->voxels > ADVISE_FAR ? "raise" : "fine");
    fprintf(
        f,
        "from set to set the flame moves by %.1f voxels of %d and its pictures change by %.0f %%, "
        "%.0f %% by noise alone; ",
        m->voxels, voxels, 100 * m->change, 100 * m->noise);
    if (m->voxels > 0.5)
        fprintf(f, "exposures over %.0f %% of the period smear it by half a voxel\n",
                50 / m->voxels);
    else
        fprintf(f, "no exposure smears it\n");
    advise_line(f, "temporal", advise_term(m->on, first));
    fprintf(
        f,
        "the volume before improves %zu of %zu left-out pictures, by %.1f standard errors: "
        "error %.2f %%, without it %.2f %%, noise alone %.2f %%; %.0f ms, without it %.0f ms at "
        "%d voxels%s\n",
        m->better, m->pictures, m->sure, 100 * m->error[1], 100 * m->error[0], 100 * m->floor,
        m->ms[1], m->ms[0], voxels, m->on && first != NULL ? first : "");
}

static void margin(FILE *f, const struct flame_sets *s, const struct advice *a)
{
    char n[16];
    snprintf(n, sizeof n, "%d", a->best_margin);
    advise_line(f, "margin", n);
    fprintf(f, "error of left-out pictures, silhouettes grown by bins of %d pixels:",
            s->params.binning);
    for (int m = 0; m < ADVISE_MARGINS; m++)
        fprintf(f, "%s %d: %.1f %%", m > 0 ? "," : "", m, 100 * a->margin[m]);
    fprintf(f, "; no time\n");
}

static void advise_do_response(FILE *f, const struct advice *a)
{
    const struct advise_response *r = &a->response;
    advise_line(f, "response", r->on ? "bent" : "linear");
    fprintf(f, "error of left-out pictures %.1f %% as they are", 100 * r->error[0]);
    if (r->power != 1)
        fprintf(f, ", %.1f %% to the power of %.2g", 100 * r->error[1], r->power);
    else
        fprintf(f, ", more with any other power");
    fprintf(f, "; no time\n");
    if (r->on)
        fprintf(
            f,
            "%-23s `pyrovox calibrate response` measures the curve%s. The rest is measured with "
            "this power\n",
            "", r->power > 2 ? "; if the files are sRGB, use --transfer srgb instead" : "");
}

static void millimetres(FILE *f, const struct rec_resolution *r, int noise)
{
    for (int k = 0; k < 3; k++) {
        double mm = 1000 * r->least[k][noise], finest = 1000 * r->size[0] * r->voxel[k];
        fprintf(f, k > 0 ? ", " : "");
        if (isinf(mm))
            fprintf(f, "none");
        else
            fprintf(f, "%.3g mm%s", mm, mm > finest ? "" : " or less");
    }
}

/* Print the finest detail of a flame's own brightness, and whether noise or the rig limits it. */
static void advise_detail(FILE *f, const struct advice *a)
{
    const struct rec_resolution *r = &a->resolution;
    bool light = false;
    if (!(r->least[0][0] > 0)) {
        advise_line(f, "detail", "unknown");
        fprintf(f, "without noise or without flame there is no limit\n");
        return;
    }
    bool all = true;
    for (int k = 0; k < 3; k++) {
        all &= r->least[k][0] <= r->size[0] * r->voxel[k];
        light |= r->least[k][0] > 1.25 * r->least[k][1];
    }
    advise_line(f, "detail", all ? "fine" : light ? "by noise" : "by rig");
    fprintf(f, "detail of the flame's own brightness survives from ");
    millimetres(f, r, 0);
    fprintf(f, " on (along x, y, z)");
    if (all) {
        fprintf(f, ", the voxels of this check\n");
        return;
    }
    fprintf(f, "; with a quarter of the noise from ");
    millimetres(f, r, 1);
    fprintf(f, ": more %s\n", light ? "light helps" : "cameras help, more light does not");
}

/* Print the noise of each channel, if pictures have colours. */
static void advise_say_noise(FILE *f, const struct advice *a)
{
    if (!(a->noise[0] > 0))
        return;
    double most = fmax(a->noise[0], fmax(a->noise[1], a->noise[2]));
    double least = fmin(a->noise[0], fmin(a->noise[1], a->noise[2]));
    advise_line(f, "noise", most > 1.5 * least ? "by channel" : "alike");
    fprintf(
        f,
        "red %.2f %%, green %.2f %%, blue %.2f %% of full scale; each channel is weighted by its "
        "own; no time\n",
        100 * a->noise[0], 100 * a->noise[1], 100 * a->noise[2]);
}

/* If both are about equal: trilinear, because smooth volumes render better. */
static enum rec_basis basis(const struct advice *a)
{
    return ADVISE_SAME * a->basis[REC_BOX] < a->basis[REC_TRILINEAR] ? REC_BOX : REC_TRILINEAR;
}

static void model(FILE *f, const struct advice *a, const char *first)
{
    const struct rec_absorption *b = &a->absorption;
    advise_line(f, "absorption", advise_term(b->c > 0, first));
    fprintf(f,
            "c %.3g (depth %.1f at the brightest pixel) improves %u of %u left-out pictures: error "
            "%.1f %%, without it %.1f %%, noise alone %.1f %%; no time%s\n",
            b->best, b->depth, b->better, b->views, 100 * b->missed[1], 100 * b->missed[0],
            100 * b->noise, b->c > 0 && first != NULL ? first : "");
    advise_line(f, "basis", rec_basis_name(basis(a)));
    fprintf(f, "error of left-out pictures %.1f %% (box), %.1f %% (trilinear)\n",
            100 * a->basis[REC_BOX], 100 * a->basis[REC_TRILINEAR]);
}

static void advise_gains(FILE *f, const struct flame_sets *s, const struct advice *a)
{
    const struct advise_gain *g = &a->gain;
    if (!g->known) {
        advise_line(f, "gain", "unknown");
        fprintf(f, "too few sets or cameras with a flame\n");
        return;
    }
    advise_line(f, "gain", g->on ? "on" : "off");
    if (g->gain[g->worst] == 1) {
        fprintf(f, "all cameras are alike: no gains lower the error in other sets; no time\n");
        return;
    }
    fprintf(f,
            "%s is furthest off the others, %.3f of what it should have; error of left-out "
            "pictures %.1f %% as they are, %.1f %% with gains; no time\n",
            s->rig.cameras[g->worst].name, 1 / g->gain[g->worst], 100 * g->error[0],
            100 * g->error[1]);
    if (!g->on)
        return;
    fprintf(f, "%-23s ", "");
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        if (fabs(log(g->gain[c])) > log(1 + ADVISE_GAIN))
            fprintf(f, "%s: %.3f, ", s->rig.cameras[c].name, g->gain[c]);
    fprintf(f,
            "which `pyrovox calibrate gain --rig %s --flame --frames %s --out with-gains.yaml` "
            "measures by colour\n",
            s->a->rig, s->a->frames);
}

static void advise_size(FILE *f, const struct flame_sets *s, const struct advice *a)
{
    char n[16];
    snprintf(n, sizeof n, "%d", a->grid[a->best_grid].voxels);
    advise_line(f, "grid", n);
    for (size_t i = 0; i < a->n_grids; i++)
        fprintf(f, "%s%d: %.1f %% %.0f ms", i > 0 ? ", " : "", a->grid[i].voxels,
                100 * a->grid[i].error, a->grid[i].ms);
    fprintf(f, " (grey)%s\n",
            a->best_grid + 1 == a->n_grids ? "; a finer one may be better: --grid auto" : "");
    if (s->rig.n_cameras < 7)
        return;
    bool more = a->half > 1.25 * a->all;
    advise_line(f, "cameras", more ? "more help" : "enough");
    fprintf(
        f, "error of left-out pictures %.1f %% from every second of the others, %.1f %% from all\n",
        100 * a->half, 100 * a->all);
}

static void advise_say_levels(FILE *f, const struct advise_levels *l)
{
    if (!(l->most > 0)) {
        advise_line(f, "triggers", "unknown");
        fprintf(f, "no set has light\n");
        return;
    }
    advise_line(f, "triggers", l->dark > 0 ? "ignition" : "burns");
    if (l->dark > 0)
        fprintf(f, "%zu of %zu sets are dark, with up to %.3g m2 of light; ", l->dark, l->sets,
                l->dim);
    else
        fprintf(f, "no set is dark, so no level for an ignition is known; ");
    fprintf(f, "the flame has %.3g to %.3g m2 and is up to z = %.3g m", l->least, l->most,
            l->height);
    if (l->pairs > 0)
        fprintf(f, "; its light changes by up to %.2g %% from set to set", l->change);
    fprintf(f, "\n");
}

/* As comments: they need record.ring. */
static void print_levels(FILE *f, const struct advise_levels *l, const struct rec_grid *g)
{
    if (!(l->most > 0))
        return;
    fprintf(f, "# triggers:  # with record: { ring: { seconds: 5, memory: 8GB } }\n");
    fprintf(f, "#   - { name: %s, when: light, above: %.3g, release: %.3g }\n",
            l->dark > 0 ? "ignition" : "flare", l->above, l->release);
    fprintf(f, "#   - { name: high, when: height, above: %.3g }\n",
            l->height + 0.05 * (g->max[2] - g->min[2]));
    if (l->pairs > 0)
        fprintf(f, "#   - { name: jump, when: change, above: %.3g }\n", fmax(3 * l->change, 1));
}

void advise_print(FILE *f, const struct flame_sets *s, const struct advice *a)
{
    const char *first = advise_first(s, a);
    const struct rec_plausible_verdict *v = &a->belong;
    if (advise_doubts(a)) {
        advise_line(f, "rig", "doubtful");
        fprintf(f, "%s; next: %s\n", v->text, v->next);
    }
    advise_say_light(f, s, a);
    advise_say_noise(f, a);
    bodies(f, s, a);
    model(f, a, first);
    advise_gains(f, s, a);
    advise_do_response(f, a);
    advise_do_motion(f, a, s->params.voxels, first);
    margin(f, s, a);
    advise_size(f, s, a);
    advise_detail(f, a);
    advise_say_levels(f, &a->levels);
    fprintf(f, "\nrig: %s\nbasis: %s\n", s->a->rig, rec_basis_name(basis(a)));
    if (a->best_grid + 1 == a->n_grids && a->finest > a->grid[a->best_grid].voxels)
        fprintf(f, "grid: [%d]  # the finest that the pictures hold\n", a->finest);
    else
        fprintf(f, "grid: [%d]\n", a->grid[a->best_grid].voxels);
    if (s->grey != 0)
        fprintf(f, "channels: 1  # some cameras are grey, others have colour\n");
    double level = INFINITY; /* lowest of all cameras: one number must not subtract more */
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        level = fmin(level, a->level[c]);
    if (a->level[a->darkest] > ADVISE_LEVEL && a->level[a->darkest] > level + ADVISE_LEVEL)
        fprintf(f,
                "# black levels differ by camera: `pyrovox calibrate dark` gives each its own\n");
    level = s->a->black + (level > ADVISE_LEVEL ? level : 0);
    if (a->margin_bins > 0)
        fprintf(f, "photometry: { black: %.4g, margin: %d }\n", level, a->margin_bins);
    else if (level > 0)
        fprintf(f, "photometry: { black: %.4g }\n", level);
    fprintf(f, "model: { absorption: %.3g, saturated: %s, temporal: %s }\n",
            first == NULL ? a->absorption.c : 0.0,
            a->saturated > ADVISE_SATURATED ? "at-least" : "left-out",
            advise_term(a->motion.on, first));
    if (a->response.on)
        fprintf(f, "# the cameras' response goes into %s\n", s->a->rig);
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        if (a->body[c].share > 0) {
            fprintf(f, "# bodies and masks stand in %s\n", s->a->rig);
            break;
        }
    print_levels(f, &a->levels, &s->rig.grid);
}
