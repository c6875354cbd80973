/* spectral.c - `pyrovox calibrate spectral`: what the channels see of the spectrum, from a source of known temperature. */
#include "daemon/cli/calibrate/spectral.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/mem.h"
#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/common/arg.h"

enum {
    OPT_RESPONSE = 0xA00,
    OPT_FILTER,
    OPT_QUANTUM,
    OPT_KELVIN,
    OPT_KELVIN_SD,
    OPT_EMISSIVITY,
    OPT_EMISSIVITY_SD,
    OPT_CURVE_SD,
    OPT_REGION,
    OPT_POINT,
    OPT_VOLUME,
    OPT_EM,
    OPT_ALPHA
};
#define MAX_CSV (1u << 20)

static const struct argp_option options[] = {
    {"response", OPT_RESPONSE, "CSV", 0,
     "response of the three channels: wavelength in nm, red, green, blue (a datasheet's will do)",
     0},
    {"quantum", OPT_QUANTUM, NULL, 0, "the response is a quantum efficiency, which counts photons",
     0},
    {"filter", OPT_FILTER, "CSV", 0,
     "transmission of a filter that the response is without: wavelength in nm, 0 to 1", 0},
    {"kelvin", OPT_KELVIN, "T", 0, "temperature of the source in the --frames before it", 0},
    {"kelvin-sd", OPT_KELVIN_SD, "K", 0, "standard deviation of the temperatures (10)", 0},
    {"emissivity", OPT_EMISSIVITY, "CSV|E", 0,
     "of the source: wavelength in nm, 0 to 1; or one number (1, a black body)", 0},
    {"emissivity-sd", OPT_EMISSIVITY_SD, "E", 0, "its standard deviation, relative (0.02)", 0},
    {"curve-sd", OPT_CURVE_SD, "E", 0,
     "standard deviation of each channel by its response curve, relative (0.02)", 0},
    {"region", OPT_REGION, "X,Y,W,H", 0,
     "where the source is in the pictures, pixels (the middle half)", 0},
    {"thermocouple", OPT_POINT, "X,Y,Z,T", 0,
     "in place of --frames: temperature at a place of a sooty flame, m and K; gives temperatures, "
     "and no amount of soot",
     0},
    {"volume", OPT_VOLUME, "FILE.h5", 0, "the recording of that flame", 0},
    {"em", OPT_EM, "E", 0, "E(m) of soot for --thermocouple (0.26)", 0},
    {"alpha", OPT_ALPHA, "A", 0, "exponent of the wavelength for --thermocouple (1)", 0},
    {0}};

static const char doc[] =
    "Measure what the cameras' channels make of a spectrum, and write it into rig.yaml, so that "
    "`pyrovox temperature` knows kelvin and soot.\vExamples:\n"
    "  pyrovox calibrate spectral --rig rig4.yaml --response camera.csv \\\n"
    "          --frames lamp.h5 --kelvin 2350 --emissivity 0.43 --out spectral.yaml\n"
    "  pyrovox calibrate spectral --rig rig4.yaml --response camera.csv --quantum \\\n"
    "          --thermocouple 0,0,0.5,1650 --volume recording.h5 --out couple.yaml\n"
    "\n"
    "The source (a tungsten ribbon, a black body, a glowing filament) is sharp, covers the region, "
    "and no channel is saturated. Repeat --frames and --kelvin for several temperatures: if the "
    "constants differ between them, the curves are wrong.\n"
    "All cameras have one response in `spectral:`, since a channel's emission is solved from all "
    "of "
    "them. Cameras that see the source in another colour are named, and refused above 10 %.\n"
    "Do this last, after gain and colour, with the lens's aperture as for flames. Exposure may "
    "differ where it is known. Without this step `pyrovox temperature` knows ratios only.";

/* ---- options ------------------------------------------------------------------------------------ */

/* "a,b,c,d" */
static void four(struct argp_state *st, const char *name, const char *arg, double v[4])
{
    int n = 0, end = 0;
    if (sscanf(arg, "%lf,%lf,%lf,%lf%n", &v[0], &v[1], &v[2], &v[3], &end) == 4 && arg[end] == '\0')
        for (n = 0; n < 4 && isfinite(v[n]) && fabs(v[n]) < 1e6; n++)
            ;
    if (n < 4)
        argp_error(st, "--%s %s: should be four numbers, as 1,2,3,4", name, arg);
}

static void spectral_end(struct argp_state *st, const struct calibrate_spectral_args *a)
{
    bool point = isfinite(a->point_kelvin);
    if (a->light.rig == NULL || a->light.out == NULL || a->response == NULL)
        argp_error(st, "needs --rig, --response and --out");
    if (point == (a->light.n > 0) || point != (a->volume != NULL))
        argp_error(st, "needs --frames with --kelvin, or --thermocouple with --volume");
    for (size_t g = 0; g < a->light.n; g++)
        if (!isfinite(a->kelvin[g]))
            argp_error(st, "--frames %s: its source's temperature is missing (--kelvin T)",
                       a->light.frames[g]);
}

static error_t spectral_parse_more(int key, const char *arg, struct argp_state *st,
                                   struct calibrate_spectral_args *a)
{
    double v[4];
    switch (key) {
    case OPT_EMISSIVITY: a->emissivity = arg; return 0;
    case OPT_VOLUME: a->volume = arg; return 0;
    case OPT_REGION:
        four(st, "region", arg, v);
        for (int i = 0; i < 4; i++)
            if (v[i] < 0 || v[i] != floor(v[i]))
                argp_error(st, "--region %s: should be whole pixels", arg);
            else
                a->region[i] = (int32_t)v[i];
        if (v[2] < 1 || v[3] < 1)
            argp_error(st, "--region %s: is empty", arg);
        return 0;
    case OPT_POINT:
        four(st, "thermocouple", arg, v);
        memcpy(a->point, v, sizeof a->point);
        a->point_kelvin = v[3];
        return 0;
    case OPT_EM: a->soot.em = cli_arg_double(st, "em", arg, 0.01, 1); return 0;
    case OPT_ALPHA: a->soot.a = cli_arg_double(st, "alpha", arg, 0, 3); return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

static error_t spectral_parse(int key, char *arg, struct argp_state *st)
{
    struct calibrate_spectral_args *a = st->input;
    switch (key) {
    case ARGP_KEY_INIT: st->child_inputs[0] = &a->light; return 0;
    case ARGP_KEY_END: spectral_end(st, a); return 0;
    case OPT_RESPONSE: a->response = arg; return 0;
    case OPT_FILTER: a->filter = arg; return 0;
    case OPT_QUANTUM: a->quantum = true; return 0;
    case OPT_KELVIN:
        if (a->light.n == 0)
            argp_error(st, "--kelvin belongs after the --frames that it is of");
        a->kelvin[a->light.n - 1] =
            cli_arg_double(st, "kelvin", arg, REC_KNOWN_T_LO, REC_KNOWN_T_HI);
        return 0;
    case OPT_KELVIN_SD: a->doubt.kelvin_sd = cli_arg_double(st, "kelvin-sd", arg, 0, 500); return 0;
    case OPT_EMISSIVITY_SD:
        a->doubt.emissivity_sd = cli_arg_double(st, "emissivity-sd", arg, 0, 0.4);
        return 0;
    case OPT_CURVE_SD: a->doubt.curve_sd = cli_arg_double(st, "curve-sd", arg, 0, 0.4); return 0;
    default: return spectral_parse_more(key, arg, st, a);
    }
}

/* ---- the step ----------------------------------------------------------------------------------- */

static const struct calibrate_spectral_args *spectral_args; /* this program runs one step */

static pvx_err load_curve(const char *path, int columns, struct rec_curve *out, struct pvx_diag *d)
{
    char *text;
    size_t len;
    PVX_TRY(pvx_file_read(path, MAX_CSV, &text, &len, d));
    pvx_err e = rec_curve_parse(text, len, path, columns, out, d);
    free(text);
    return e;
}

struct emissivity {
    struct rec_curve curve; /* n 0: a number */
    double number;
};

static double emissivity_at(const void *ctx, double metres)
{
    const struct emissivity *m = ctx;
    return m->curve.n > 0 ? rec_curve_at(&m->curve, 0, metres * 1e9, 0) : m->number;
}

static pvx_err load_emissivity(const char *arg, const struct rec_spectral *s, struct emissivity *m,
                               struct pvx_diag *d)
{
    char *end;
    double hi = s->from + (s->n - 1) * s->step;
    m->number = 1;
    if (arg == NULL)
        return PVX_OK;
    m->number = strtod(arg, &end);
    if (end != arg && *end == '\0')
        return m->number > 0 && m->number <= 1
                   ? PVX_OK
                   : pvx_fail(d, PVX_EINVAL, "--emissivity %s: should be above 0 and at most 1",
                              arg);
    PVX_TRY(load_curve(arg, 1, &m->curve, d));
    if (!rec_curve_covers(&m->curve, s->from, hi))
        return pvx_fail(d, PVX_EINVAL,
                        "%s: the emissivity is known from %g to %g nm, and the response from %g to "
                        "%g nm",
                        arg, m->curve.nm[0], m->curve.nm[m->curve.n - 1], s->from, hi);
    return PVX_OK;
}

struct spectral_work {
    struct rec_curve response, filter;
    struct emissivity emissivity;
    struct rec_known known[CALIBRATE_GROUPS * REC_MAX_CAMERAS];
};

static pvx_err spectral_by_pictures(const struct calibrate_light *l, struct spectral_work *w,
                                    struct rec_spectral *s, struct pvx_diag *d)
{
    const struct calibrate_spectral_args *a = spectral_args;
    double exposure, scatter;
    size_t n;
    PVX_TRY(load_emissivity(a->emissivity, s, &w->emissivity, d));
    PVX_TRY(calibrate_spectral_pictures(l, a, w->known, &n, &exposure, d));
    const struct rec_known_source source = {w->known, n, emissivity_at, &w->emissivity};
    PVX_TRY(rec_known_source(&source, &a->doubt, s, &scatter, d));
    s->has_exposure = isfinite(exposure);
    if (s->has_exposure)
        s->exposure = exposure;
    printf("%zu pictures of a known source: constants %.4g %.4g %.4g, %.2f %% apart\n", n,
           s->constant[0], s->constant[1], s->constant[2], 100 * scatter);
    return PVX_OK;
}

static pvx_err spectral_by_point(struct rec_spectral *s, struct pvx_diag *d)
{
    const struct calibrate_spectral_args *a = spectral_args;
    struct rec_known k;
    PVX_TRY(calibrate_spectral_point(a, &k, d));
    PVX_TRY(rec_known_soot(&k, &a->soot, &a->doubt, s, d));
    printf("thermocouple: %.4g %.4g %.4g 1/m at %.0f K; the amount of soot stays unknown\n",
           k.value[0], k.value[1], k.value[2], k.kelvin);
    return PVX_OK;
}

static pvx_err spectral_work(struct calibrate_light *l, struct spectral_work *w,
                             struct rec_spectral *s, struct pvx_diag *d)
{
    const struct calibrate_spectral_args *a = spectral_args;
    struct pvx_diag why = {""};
    rec_soot *soot;
    PVX_TRY(load_curve(a->response, 3, &w->response, d));
    if (a->filter != NULL)
        PVX_TRY(load_curve(a->filter, 1, &w->filter, d));
    pvx_err e = rec_curve_response(&w->response, a->filter != NULL ? &w->filter : NULL, a->quantum,
                                   s, &why);
    if (e != PVX_OK)
        return pvx_fail(d, e, "%s: %s", a->response, why.text);
    PVX_TRY(a->light.n > 0 ? spectral_by_pictures(l, w, s, d) : spectral_by_point(s, d));
    e = rec_soot_new(s, &a->soot, &soot, &why);
    if (e != PVX_OK)
        return pvx_fail(d, e, "%s: %s", a->response, pvx_diag_text(&why, e));
    rec_soot_free(&soot);
    printf("known to %.1f %.1f %.1f %% (red, green, blue)\n", 100 * sqrt(s->covariance[0]),
           100 * sqrt(s->covariance[4]), 100 * sqrt(s->covariance[8]));
    return PVX_OK;
}

static pvx_err spectral_step(struct calibrate_light *l, struct pvx_diag *d)
{
    struct spectral_work *w = pvx_calloc(1, sizeof *w);
    struct rec_spectral *s = pvx_calloc(1, sizeof *s);
    pvx_err e = w != NULL && s != NULL ? spectral_work(l, w, s, d) : PVX_ENOMEM;
    free(w);
    if (e != PVX_OK) {
        free(s);
        return e;
    }
    free(l->rig.spectral);
    l->rig.spectral = s;
    return calibrate_light_save(l, d);
}

int calibrate_spectral(int argc, char **argv)
{
    const struct argp_child children[] = {{&calibrate_light_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {
        .options = options, .parser = spectral_parse, .doc = doc, .children = children};
    struct calibrate_spectral_args a = {.light = {.nothing = true},
                                        .point_kelvin = NAN,
                                        .doubt = {10, 0.02, 0.02},
                                        .soot = rec_soot_defaults};
    for (size_t g = 0; g < CALIBRATE_GROUPS; g++)
        a.kelvin[g] = NAN;
    if (argp_parse(&argp, argc, argv, 0, NULL, &a) != 0)
        return 2;
    spectral_args = &a;
    return calibrate_light_run(&a.light, DMN_LIGHT_RESPONSE | DMN_LIGHT_DARK | DMN_LIGHT_FLAT,
                               spectral_step);
}
