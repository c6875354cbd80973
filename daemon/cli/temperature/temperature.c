/* temperature.c - `pyrovox temperature`: kelvin and soot of a recording of volumes. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/temperature/shaded.h"
#include "daemon/cli/temperature/vdb.h"
#include "recon/geom/rig.h"

struct temperature_args {
    const char *in, *rig, *out, *vdb;
    double noise, exposure_ms, em, alpha, reject;
    int64_t from, to;
    uint32_t threads;
    bool quiet, shade;
};

#define AT(field) CLI_AT(struct temperature_args, field)
static const struct cli_row rows[] = {
    {"rig", "FILE", AT(rig), 0, 0, "rig.yaml with `spectral:` (pyrovox calibrate spectral)"},
    {"out", "FILE.h5", AT(out), 0, 0, "temperatures in HDF5, a new file"},
    {"vdb", "DIR", AT(vdb), 0, 0,
     "OpenVDB files too, a new folder: `density` is soot in ppm, `temperature` is in kelvin, as "
     "Blender shows a black body"},
    {"noise", "F", AT(noise), 1e-6, 1,
     "for sets without error bars: standard deviation of the emission, as a share of each volume's "
     "largest. Sets with bars keep theirs"},
    {"exposure", "MS", AT(exposure_ms), 1e-6, 1e9,
     "exposure time of the flame's pictures, where it is not that of the calibration"},
    {"em", "E", AT(em), 0.01, 1, "E(m) of soot (0.26)"},
    {"alpha", "A", AT(alpha), 0, 3, "exponent of the wavelength in soot's absorption (1)"},
    {"reject", "X", AT(reject), 0.1, 1e6,
     "chi^2 above which light is not soot's (10.83: once in 1000 by noise)"},
    {"self-absorption", NULL, AT(shade), 0, 0,
     "take out what the soot takes from its own light, for a recording that was reconstructed "
     "without --absorption"},
    {"from", "SET", AT(from), 0, 9e18, "only this set and later ones"},
    {"to", "SET", AT(to), 0, 9e18, "only this set and earlier ones"},
    {"threads", "N", AT(threads), 0, 256, "threads to work with (0: one per CPU)"},
    {"q|quiet", NULL, AT(quiet), 0, 0, "no progress"},
    {0}};

static error_t temperature_parse(int key, char *arg, struct argp_state *st)
{
    struct temperature_args *a = st->input;
    switch (key) {
    case ARGP_KEY_ARG: cli_arg_one(st, "a recording of volumes", arg, &a->in); return 0;
    case ARGP_KEY_END:
        if (a->in == NULL || a->rig == NULL || a->out == NULL)
            argp_error(st, "needs a recording of volumes, --rig and --out");
        if (!vol_hdf5_name(a->out))
            argp_error(st, "--out %s: should end in .h5", a->out);
        if (a->from > a->to)
            argp_error(st, "--from %lld is after --to %lld", (long long)a->from, (long long)a->to);
        return 0;
    default: return cli_row(rows, key, arg, st, a);
    }
}

static const struct argp argp = {
    .parser = temperature_parse,
    .args_doc = "FLAME.h5",
    .doc =
        "Temperature and soot volume fraction of each voxel, from the three channels of a "
        "recording of volumes.\vExamples:\n"
        "  pyrovox temperature flame.h5 --rig spectral.yaml --noise 0.01 \\\n"
        "          --out kelvin.h5\n"
        "\n"
        "The file has /temperature in kelvin and /soot in ppm, each with one standard deviation "
        "(_sd), /chi2 and /state: 0 too little light, 1 soot, 2 not soot, 3 outside 800 to 3200 "
        "K. Voxels that are not 1 have no temperature (NaN).\n"
        "A rig without `spectral:` gives ratios of the channels alone. The bars hold noise and "
        "the calibration's doubt, and not that of E(m), nor gradients within a voxel.\n"
        "\n"
        "The mean of a region has its own bar (`pyrovox value`) if the recording keeps how the "
        "errors of voxels go together, as `pyrovox reconstruct --error-bars --out FILE.h5` makes "
        "it. If the light of the whole recording fits no soot in these response curves, the last "
        "lines say so.\n"
        "\n"
        "Exit: 0 done, 1 failed, 2 wrong usage, 130 stopped by Ctrl-C. Only after 0 there are "
        "OUT and the files of --vdb."};

/* ---- what belongs together ---------------------------------------------------------------------- */

/* Whether the recording is of this rig's cameras, at the gains that the constants belong to. */
static pvx_err same_cameras(const struct temperature_args *a, const struct vol_head *h,
                            const struct rec_rig *rig, struct pvx_diag *d)
{
    struct rec_rig was;
    pvx_err e = PVX_OK;
    if (h->rig == NULL || h->rig[0] == '\0' ||
        rec_rig_parse(h->rig, strlen(h->rig), "its rig", &was, NULL) != PVX_OK)
        return PVX_OK; /* not known, or its files are gone */
    for (size_t c = 0; c < was.n_cameras && e == PVX_OK; c++) {
        int k = rec_rig_find(rig, was.cameras[c].name);
        if (k < 0) {
            e = pvx_fail(d, PVX_EINVAL,
                         "%s is of a camera %s, which %s does not have: it is the "
                         "rig of another recording",
                         a->in, was.cameras[c].name, a->rig);
            break;
        }
        for (int q = 0; q < 3 && e == PVX_OK; q++)
            if (fabsf(rig->cameras[k].gain[q] - was.cameras[c].gain[q]) >
                1e-4F * was.cameras[c].gain[q])
                e = pvx_fail(d, PVX_EINVAL,
                             "camera %s had a gain of %g in %s, and has %g in %s: reconstruct with "
                             "the rig that was calibrated",
                             was.cameras[c].name, (double)was.cameras[c].gain[q], a->in,
                             (double)rig->cameras[k].gain[q], a->rig);
    }
    rec_rig_fini(&was);
    return e;
}

/* The constants at the flame's exposure. */
static pvx_err scale_exposure(const struct temperature_args *a, struct rec_spectral *s,
                              struct pvx_diag *d)
{
    if (isnan(a->exposure_ms)) {
        if (s->has_exposure && s->absolute)
            fprintf(stderr,
                    "pyrovox: the flame is taken to be exposed for %.6g ms, as the calibration was "
                    "(--exposure)\n",
                    s->exposure * 1e3);
        return PVX_OK;
    }
    if (!s->has_exposure)
        return pvx_fail(d, PVX_EINVAL,
                        "--exposure: the calibration in %s says no exposure that it could be "
                        "compared with",
                        a->rig);
    for (int q = 0; q < 3; q++)
        s->constant[q] *= a->exposure_ms * 1e-3 / s->exposure;
    return PVX_OK;
}

static pvx_err make_soot(const struct temperature_args *a, struct rec_rig *rig, rec_soot **soot,
                         struct pvx_diag *d)
{
    struct rec_soot_params p = rec_soot_defaults;
    struct pvx_diag why = {""};
    *soot = NULL;
    if (rig->spectral == NULL) {
        fprintf(stderr,
                "pyrovox: %s has no `spectral:`: ratios of the channels only, no kelvin "
                "(pyrovox calibrate spectral)\n",
                a->rig);
        return PVX_OK;
    }
    p.em = a->em;
    p.a = a->alpha;
    p.reject = a->reject;
    PVX_TRY(scale_exposure(a, rig->spectral, d));
    pvx_err e = rec_soot_new(rig->spectral, &p, soot, &why);
    if (e == PVX_OK && !rig->spectral->absolute)
        fprintf(stderr,
                "pyrovox: the calibration in %s is by a thermocouple: the amount of soot stays "
                "unknown\n",
                a->rig);
    return e == PVX_OK ? e : pvx_fail(d, e, "%s: %s", a->rig, pvx_diag_text(&why, e));
}

/* ---- the recording ------------------------------------------------------------------------------ */

static pvx_err put_notes(const struct temperature_args *a, const struct rec_spectral *s,
                         vol_thermal *out, struct pvx_diag *d)
{
    PVX_TRY(vol_thermal_note(out, "source", 0, a->in, d));
    if (!isnan(a->noise))
        PVX_TRY(vol_thermal_note(out, "noise", a->noise, NULL, d));
    if (s == NULL)
        return PVX_OK;
    PVX_TRY(vol_thermal_note(out, "em", a->em, NULL, d));
    PVX_TRY(vol_thermal_note(out, "alpha", a->alpha, NULL, d));
    PVX_TRY(vol_thermal_note(out, "reject", a->reject, NULL, d));
    PVX_TRY(vol_thermal_note(out, "self_absorption", a->shade, NULL, d));
    return vol_thermal_note(out, "absolute", s->absolute, NULL, d);
}

/* The mean misfit of the light, and whether it says that the curves are others. */
static bool misfit_far(const struct temperature_voxels *t, double *x, double *sd)
{
    double all = 0;
    for (int k = 0; k < REC_N_SOOT_STATES; k++)
        all += (double)t->sums.state[k];
    rec_misfit_mean(&t->sums.misfit, x, sd);
    return t->sums.judged >= REC_MISFIT_SHARE * all && fabs(*x) > REC_MISFIT_MOST * *sd;
}

static pvx_err put_verdict(const struct temperature_voxels *t, vol_thermal *out, struct pvx_diag *d)
{
    double x, sd;
    if (t->soot == NULL)
        return PVX_OK;
    (void)misfit_far(t, &x, &sd);
    PVX_TRY(vol_thermal_note(out, "misfit", x, NULL, d));
    PVX_TRY(vol_thermal_note(out, "misfit_sd", sd, NULL, d));
    return vol_thermal_note(out, "chi2_mean", t->sums.chi2 / t->sums.judged, NULL, d);
}

struct outputs {
    vol_thermal *file;
    struct temperature_vdb *vdb; /* or NULL */
};

static pvx_err each_volume(const struct temperature_args *a, vol_reader *r,
                           struct temperature_voxels *t, struct temperature_shaded *shaded,
                           const struct outputs *to, struct pvx_diag *d)
{
    struct cli_progress bar = {.label = "temperature", .quiet = a->quiet};
    uint64_t n = vol_reader_count(r), done = 0;
    vol_reader_modes(r, true);
    for (uint64_t k = 0; k < n; k++) {
        struct vol_volume v;
        PVX_TRY(vol_reader_get(r, k, &v, d));
        if (v.v.set >= (uint64_t)a->from && v.v.set <= (uint64_t)a->to) {
            struct pvx_diag why = {""};
            pvx_err e = shaded != NULL ? temperature_shaded(shaded, t, &v, &why)
                                       : temperature_do(t, &v, &why);
            if (e != PVX_OK)
                return pvx_fail(d, e, "%s: %s", a->in, pvx_diag_text(&why, e));
            PVX_TRY(vol_thermal_put(to->file, &v, (const float *const *)t->field, &t->modes, d));
            if (to->vdb != NULL)
                PVX_TRY(temperature_vdb_put(to->vdb, &v, t, d));
            done++;
            t->sums.own_bars += v.bars.sd != NULL;
        }
        if (!cli_progress(&bar, (double)(k + 1) / (double)n))
            return PVX_ECANCELED;
    }
    return done > 0 ? PVX_OK
                    : pvx_fail(d, PVX_ENOENT, "%s: none of its %llu sets is wanted", a->in,
                               (unsigned long long)n);
}

static void say(const struct temperature_args *a, const struct temperature_voxels *t)
{
    const struct temperature_sums *s = &t->sums;
    uint64_t all = 0;
    for (int k = 0; k < REC_N_SOOT_STATES; k++)
        all += s->state[k];
    double share = 100 / fmax((double)all, 1);
    if (t->soot == NULL) {
        printf("%s: ratios in %llu voxels, %.1f %% of those with light\n", a->out,
               (unsigned long long)s->state[REC_SOOT_OK], share * (double)s->state[REC_SOOT_OK]);
        return;
    }
    printf("%s: %llu voxels with light: soot %.1f %%, too dim %.1f %%, not soot %.1f %%, outside "
           "%.0f..%.0f K %.1f %%\n",
           a->out, (unsigned long long)all, share * (double)s->state[REC_SOOT_OK],
           share * (double)s->state[REC_SOOT_DARK], share * (double)s->state[REC_SOOT_NOT],
           REC_SOOT_T_LO, REC_SOOT_T_HI, share * (double)s->state[REC_SOOT_OUTSIDE]);
    if (s->state[REC_SOOT_OK] > 0)
        printf("soot of %.0f to %.0f K, %.0f K on average; chi^2 %.2f on average (1 by noise)\n",
               s->coldest, s->hottest, s->soot_kelvin / s->soot, s->chi2 / s->judged);
    double x, sd;
    if (misfit_far(t, &x, &sd))
        printf("the light does not fit the response curves of %s: there is %.1f %% %s green than "
               "soot gives with this red and blue, and noise and calibration leave %.1f %%. Check "
               "the curves, filter, colours and gains; the temperatures may be off by more than "
               "their bars\n",
               a->rig, 100 * fabs(x), x > 0 ? "more" : "less", 100 * sd);
    if (s->own_bars > 0 && !isnan(a->noise))
        printf("--noise was not used for the %llu sets that have error bars of their own\n",
               (unsigned long long)s->own_bars);
    if (s->state[REC_SOOT_NOT] > s->state[REC_SOOT_OK])
        printf("most of the light is not soot's: a flame without soot, or curves, colours or gains "
               "that are not these cameras'\n");
}

static pvx_err start_shade(const struct temperature_args *a, const struct rec_rig *rig,
                           const struct vol_head *h, struct temperature_shaded *out,
                           struct pvx_diag *d)
{
    struct rec_soot_params p = rec_soot_defaults;
    double kappa[3];
    if (rig->spectral == NULL || !rig->spectral->absolute)
        return pvx_fail(d, PVX_EINVAL,
                        "--self-absorption needs the amount of soot, so a calibration by a source "
                        "of known temperature (pyrovox calibrate spectral --kelvin), which %s does "
                        "not have",
                        a->rig);
    p.em = a->em;
    p.a = a->alpha;
    rec_shade_kappa(rig->spectral, &p, kappa);
    return temperature_shaded_init(out, rig, &h->start.grid, kappa);
}

static pvx_err temperature_write(const struct temperature_args *a, vol_reader *r,
                                 const struct rec_rig *rig, struct temperature_voxels *t,
                                 const struct outputs *to, struct pvx_diag *d)
{
    struct temperature_shaded shaded = {.room = 0};
    pvx_err e = put_notes(a, rig->spectral, to->file, d);
    if (e == PVX_OK && a->shade)
        e = start_shade(a, rig, vol_reader_head(r), &shaded, d);
    PVX_THEN(e, each_volume(a, r, t, a->shade ? &shaded : NULL, to, d));
    PVX_THEN(e, put_verdict(t, to->file, d));
    temperature_shaded_fini(&shaded);
    return e;
}

static pvx_err temperature_into(const struct temperature_args *a, vol_reader *r,
                                const struct rec_rig *rig, struct temperature_voxels *t,
                                struct pvx_diag *d)
{
    const struct vol_head *h = vol_reader_head(r);
    struct temperature_vdb vdb = {.writer = NULL};
    struct outputs to = {NULL, a->vdb != NULL ? &vdb : NULL};
    PVX_TRY(pvx_pool_new(a->threads, "soot", &t->pool));
    if (a->vdb != NULL && t->soot == NULL)
        return pvx_fail(d, PVX_EINVAL, "--vdb: %s has no `spectral:`, so there is no temperature",
                        a->rig);
    if (a->vdb != NULL)
        PVX_TRY(temperature_vdb_check(&vdb, a->vdb, d));
    pvx_err e =
        vol_thermal_open(a->out, h, t->soot != NULL ? temperature_fields : temperature_ratios,
                         t->soot != NULL ? TEMPERATURE_FIELDS : TEMPERATURE_RATIOS, &to.file, d);
    if (a->vdb != NULL)
        PVX_THEN(e, temperature_vdb_open(&vdb, a->vdb, h, d));
    PVX_THEN(e, temperature_write(a, r, rig, t, &to, d));
    pvx_err vdb_closed = temperature_vdb_close(&vdb, d);
    PVX_THEN(e, vdb_closed);
    pvx_err closed = vol_thermal_close(&to.file, e == PVX_OK, d);
    PVX_THEN(e, closed);
    if (e != PVX_OK)
        temperature_vdb_remove(&vdb);
    return e;
}

static pvx_err temperature_all(const struct temperature_args *a, struct pvx_diag *d)
{
    struct temperature_voxels t = {.noise = a->noise};
    struct rec_rig rig;
    rec_soot *soot = NULL;
    vol_reader *r = NULL;
    PVX_TRY(rec_rig_load(a->rig, &rig, d));
    pvx_err e = vol_reader_open(a->in, &r, d);
    PVX_THEN(e, vol_reader_emission(r, a->in, d));
    if (e == PVX_OK && vol_reader_head(r)->start.grid.channels != 3)
        e = pvx_fail(d, PVX_EINVAL,
                     "%s: has one channel: a temperature needs the three of colour cameras", a->in);
    PVX_THEN(e, same_cameras(a, vol_reader_head(r), &rig, d));
    PVX_THEN(e, make_soot(a, &rig, &soot, d));
    t.soot = soot;
    if (soot != NULL)
        rec_misfit_calibration(rig.spectral->covariance, t.L);
    PVX_THEN(e, temperature_into(a, r, &rig, &t, d));
    if (e == PVX_OK)
        say(a, &t);
    pvx_pool_free(&t.pool);
    temperature_fini(&t);
    rec_soot_free(&soot);
    vol_reader_close(&r);
    rec_rig_fini(&rig);
    return e;
}

static int temperature_run(int argc, char **argv)
{
    struct temperature_args a = {.noise = NAN,
                                 .exposure_ms = NAN,
                                 .em = REC_SOOT_EM,
                                 .alpha = 1,
                                 .reject = REC_SOOT_REJECT,
                                 .to = INT64_MAX};
    struct pvx_diag d = {""};
    cli_parse(rows, &argp, 0, argc, argv, &a);
    cli_catch_stop();
    pvx_err e = temperature_all(&a, &d);
    return cli_end(&d, e, true);
}

const struct cli_command cmd_temperature = {
    "temperature", "kelvin and soot of a recording of volumes", temperature_run};
