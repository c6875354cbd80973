#include "daemon/cli/calibrate/light.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/opt_rig.h"

enum { OPT_RIG = 0x900, OPT_OUT, OPT_FRAMES, OPT_EXPOSURE, OPT_FORMAT, OPT_FORCE, OPT_THREADS };

static const struct argp_option options[] = {
    {"rig", OPT_RIG, "FILE", 0, "rig.yaml: its cameras are measured", 0},
    {"frames", OPT_FRAMES, "DIR|FILE.h5", 0,
     "pictures of one scene: DIR/<camera>/<number>.(npy|png|tif), or a take; may be repeated", 0},
    {"exposure", OPT_EXPOSURE, "MS", 0,
     "exposure time of the pictures of the --frames before it, where no take says it", 0},
    {"pixel-format", OPT_FORMAT, "NAME", 0,
     "what grey images are: BayerRG8 for raw pictures of a colour camera, Mono12 for 12 bits in 16 "
     "...",
     0},
    {"out", OPT_OUT, "FILE", 0, "the new rig, in the folder of the old one; maps lie beside it", 0},
    {"force", OPT_FORCE, NULL, 0, "write over a file of that name", 0},
    {"threads", OPT_THREADS, "N", 0, "threads to work with (0: one per CPU)", 0},
    {0}};

static error_t light_parse(int key, char *arg, struct argp_state *st)
{
    struct calibrate_light_args *a = st->input;
    switch (key) {
    case OPT_RIG: a->rig = arg; return 0;
    case OPT_OUT: a->out = arg; return 0;
    case OPT_FRAMES:
        if (a->n == CALIBRATE_GROUPS)
            argp_error(st, "--frames: at most %d times", CALIBRATE_GROUPS);
        a->exposure_ms[a->n] = NAN;
        a->frames[a->n++] = arg;
        return 0;
    case OPT_EXPOSURE:
        if (a->n == 0)
            argp_error(st, "--exposure belongs after the --frames that it is of");
        a->exposure_ms[a->n - 1] = cli_arg_double(st, "exposure", arg, 1e-6, 1e9);
        return 0;
    case OPT_FORMAT: a->reading.fmt = cli_arg_pixfmt(st, arg); return 0;
    case OPT_FORCE: a->force = true; return 0;
    case OPT_THREADS: cli_arg_int(st, "threads", arg, 0, 256, &a->threads); return 0;
    case ARGP_KEY_ARG: argp_error(st, "'%s': this step takes options only", arg); return 0;
    case ARGP_KEY_END:
        if (a->nothing)
            return 0;
        if (a->rig == NULL || a->out == NULL || a->n == 0)
            argp_error(st, "needs --rig, --frames and --out");
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

const struct argp calibrate_light_argp = {.options = options, .parser = light_parse};

/* ---- begin and end ---- */

static size_t folder(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash == NULL ? 0 : (size_t)(slash - path) + 1;
}

/* Check that --out may be written.  rig_out: it is a rig.  A step that applies all light terms writes other files. */
static pvx_err may_write(const struct calibrate_light *l, bool rig_out, struct pvx_diag *d)
{
    const char *rig = l->a->rig, *out = l->a->out;
    size_t n = folder(rig);
    PVX_TRY(cli_may_write(out, l->a->force, d));
    if (rig_out && (folder(out) != n || strncmp(out, rig, n) != 0))
        for (size_t c = 0; c < l->rig.n_cameras; c++)
            if (rec_photometry_acts(&l->rig.cameras[c].photometry))
                return pvx_fail(d, PVX_EINVAL,
                                "%s: its maps lie beside %s: write the new rig into that folder",
                                out, rig);
    return PVX_OK;
}

static pvx_err light_begin(struct calibrate_light *l, const struct calibrate_light_args *a,
                           unsigned what, struct pvx_diag *d)
{
    *l = (struct calibrate_light){.a = a};
    PVX_TRY(rec_rig_load(a->rig, &l->rig, d));
    PVX_TRY(may_write(l, what != DMN_LIGHT_ALL, d));
    PVX_TRY(rec_rig_copy(&l->rig, &l->as));
    PVX_TRY(dmn_photometry_load(a->rig, what, &l->as, &l->light, d));
    PVX_TRY(pvx_pool_new((unsigned)a->threads, "light", &l->pool));
    l->stack = pvx_calloc(a->n * REC_MAX_CAMERAS, sizeof *l->stack);
    return l->stack == NULL ? PVX_ENOMEM : PVX_OK;
}

static void light_fini(struct calibrate_light *l)
{
    for (size_t i = 0; l->stack != NULL && i < l->a->n * REC_MAX_CAMERAS; i++) {
        free(l->stack[i].sum);
        free(l->stack[i].sum2);
        free(l->stack[i].mean);
        free(l->stack[i].var);
    }
    PVX_FREE(l->stack);
    dmn_photometry_free(&l->light);
    pvx_pool_free(&l->pool);
    rec_rig_fini(&l->as);
    rec_rig_fini(&l->rig);
}

pvx_err calibrate_light_fail(const struct rec_camera *k, pvx_err e, const struct pvx_diag *why,
                             struct pvx_diag *d)
{
    return pvx_fail(d, e, "camera %s: %s", k->name, pvx_diag_text(why, e));
}

pvx_err calibrate_light_cameras(struct calibrate_light *l,
                                pvx_err (*one)(struct calibrate_light *l, size_t c,
                                               const struct rec_light_picture *p, size_t m,
                                               struct pvx_diag *d),
                                struct pvx_diag *d)
{
    struct rec_light_picture p[CALIBRATE_GROUPS];
    size_t with = 0;
    for (size_t c = 0; c < l->rig.n_cameras; c++) {
        size_t m = 0;
        for (size_t g = 0; g < l->a->n; g++)
            if (calibrate_light_stack(l, g, c)->picture.n > 0)
                p[m++] = calibrate_light_stack(l, g, c)->picture;
        if (m > 0)
            PVX_TRY(one(l, c, p, m, d));
        with += m > 0;
    }
    if (with == 0)
        return pvx_fail(d, PVX_ENOENT, "%s: no picture could be used", l->a->frames[0]);
    return calibrate_light_save(l, d);
}

pvx_err calibrate_light_noise(struct rec_camera *k, const struct rec_light_picture *p, size_t m,
                              struct pvx_diag *why)
{
    struct rec_noise noise;
    PVX_TRY(rec_light_noise(p, m, &noise, why));
    k->photometry.has_noise = true;
    k->photometry.read_noise = fmin(noise.read, 1);
    k->photometry.noise_gain = fmin(noise.gain, 1);
    printf("%-12s variance = %.5f^2 + %.3g * light (full scale = 1), %zu levels\n", k->name,
           noise.read, noise.gain, m);
    return PVX_OK;
}

/* ---- pictures ---- */

struct calibrate_stack *calibrate_light_stack(const struct calibrate_light *l, size_t group,
                                              size_t camera)
{
    return &l->stack[group * REC_MAX_CAMERAS + camera];
}

/* The first picture of a camera sets the shape of its stack. */
static pvx_err light_room(struct calibrate_stack *s, const struct frames_in *f, size_t c)
{
    struct rec_light_picture *p = &s->picture;
    p->width = f->rig->cameras[c].width;
    p->height = f->rig->cameras[c].height;
    p->channels = dmn_images_samples(f->images, c);
    p->cell = dmn_images_bayer(f->images, c);
    size_t n = (size_t)p->width * (size_t)p->height * (size_t)p->channels;
    s->sum = pvx_calloc(n, sizeof *s->sum);
    s->sum2 = pvx_calloc(n, sizeof *s->sum2);
    s->mean = pvx_calloc(n, sizeof *s->mean);
    s->var = pvx_calloc(n, sizeof *s->var);
    p->mean = s->mean;
    p->var = s->var;
    return s->sum != NULL && s->sum2 != NULL && s->mean != NULL && s->var != NULL ? PVX_OK
                                                                                  : PVX_ENOMEM;
}

static void light_add(struct calibrate_stack *s, const struct frames_in *f, size_t c,
                      const float *v)
{
    const struct rec_light_picture *p = &s->picture;
    float top = dmn_images_saturated(f->images, c);
    size_t w = (size_t)p->width, ch = (size_t)p->channels, cs = f->nch == 3 ? 4 : 1;
    bool full = !dmn_images_floats(f->images, c);
    double sum = 0, count = 0;
    if (top <= 0)
        top = 1;
    for (size_t i = 0; i < w * (size_t)p->height; i++)
        for (size_t k = 0; k < ch; k++) {
            size_t lane = p->cell != NULL && cs == 4 ? p->cell[i / w % 2 * 2 + i % w % 2] : k;
            double x = (double)v[i * cs + lane];
            s->sum[i * ch + k] += x;
            s->sum2[i * ch + k] += x * x;
            sum += isfinite(x) ? x : 0;
            count += isfinite(x);
            s->saturated += full && v[i * cs + lane] == top;
        }
    rec_light_still_add(&s->still, v, (const int32_t[]){p->width, p->height}, f->nch, (int)cs);
    s->samples += w * (size_t)p->height * ch;
    s->picture.n++;
    s->whole += sum / fmax(count, 1);
    s->whole2 += pow(sum / fmax(count, 1), 2);
}

static void light_conclude(struct calibrate_stack *s)
{
    struct rec_light_picture *p = &s->picture;
    size_t n = (size_t)p->width * (size_t)p->height * (size_t)p->channels;
    double m = p->n;
    for (size_t i = 0; i < n; i++) {
        double mean = s->sum[i] / m;
        s->mean[i] = (float)mean;
        s->var[i] = p->n > 1 ? (float)fmax(0, (s->sum2[i] - m * mean * mean) / (m - 1)) : 0;
    }
    double whole = s->whole / m;
    p->flicker = whole > 0.01 && p->n > 1
                     ? fmax(0, s->whole2 - m * whole * whole) / (m - 1) / (whole * whole)
                     : 0;
    p->saturated = s->samples > 0 ? (double)s->saturated / (double)s->samples : 0;
    PVX_FREE(s->sum);
    PVX_FREE(s->sum2);
}

/* Read from the take how its pictures were taken.  All pictures of a group must have one exposure and gain. */
static pvx_err how_taken(struct calibrate_stack *s, const struct frames_in *f, size_t c,
                         struct pvx_diag *d)
{
    s->gain = s->temperature = NAN;
    for (size_t i = 0; f->take != NULL && i < f->n; i++) {
        int64_t at = f->row[i * f->rig->n_cameras + c];
        if (at < 0)
            continue;
        uint32_t k = (uint32_t)f->take_camera[c];
        const struct cap_take_row *row = cap_take_row(f->take, k, (uint64_t)at);
        double t = row->exposure_us * 1e-6;
        const struct cap_take_camera *is = &cap_take_info(f->take)->head.camera[k];
        if (strlen(is->uri) < sizeof s->serial && rec_photometry_plain(is->uri))
            snprintf(s->serial, sizeof s->serial, "%s", is->uri);
        if (strlen(is->serial) < sizeof s->device && rec_photometry_plain(is->serial))
            snprintf(s->device, sizeof s->device, "%s", is->serial);
        s->temperature = is->temperature_c;
        if (fabs(t - s->picture.exposure) > 0.02 * t || fabs(row->gain - s->gain) > 0.1)
            return pvx_fail(
                d, PVX_EINVAL,
                "%s: camera %s changed its exposure or gain within the take: record one take "
                "for each",
                f->dir, f->rig->cameras[c].name);
        s->picture.exposure = t;
        s->gain = row->gain;
    }
    return PVX_OK;
}

/* Add all sets of an open group to the stacks. */
static pvx_err stack_up(struct calibrate_light *l, struct frames_in *f, size_t g, float **out,
                        struct pvx_diag *d)
{
    for (size_t i = 0; i < f->n; i++) {
        if (cli_stop)
            return PVX_ECANCELED;
        uint64_t mask = frames_in_load(f, i, out);
        for (size_t c = 0; c < l->rig.n_cameras; c++) {
            struct calibrate_stack *s = calibrate_light_stack(l, g, c);
            if (!(mask >> c & 1))
                continue;
            if (s->sum == NULL)
                PVX_TRY(light_room(s, f, c));
            if (s->picture.channels != dmn_images_samples(f->images, c) ||
                s->picture.cell != dmn_images_bayer(f->images, c))
                return pvx_fail(d, PVX_EINVAL, "%s: camera %s has pictures of two kinds", f->dir,
                                l->rig.cameras[c].name);
            light_add(s, f, c, out[c]);
        }
    }
    return PVX_OK;
}

static pvx_err read_group(struct calibrate_light *l, size_t g, struct pvx_diag *d)
{
    const struct calibrate_light_args *a = l->a;
    struct frames_in f = {.rig = &l->as, .pool = l->pool, .how = a->reading, .light = l->light};
    float *out[REC_MAX_CAMERAS] = {0};
    pvx_err e = frames_in_open(&f, a->frames[g], 0, FRAMES_IN_LAST, FRAMES_IN_EACH, d);
    PVX_THEN(e, frames_in_begin(&f, 1, CAP_MOSAIC_RAYS, d));
    for (size_t c = 0; c < l->rig.n_cameras && e == PVX_OK; c++) {
        struct calibrate_stack *s = calibrate_light_stack(l, g, c);
        s->picture.exposure = NAN;
        out[c] = frames_in_room(&f, c);
        e = out[c] == NULL ? PVX_ENOMEM : how_taken(s, &f, c, d);
        if (isfinite(a->exposure_ms[g]))
            s->picture.exposure = a->exposure_ms[g] * 1e-3;
    }
    PVX_THEN(e, stack_up(l, &f, g, out, d));
    for (size_t c = 0; c < l->rig.n_cameras; c++) {
        free(out[c]);
        if (e == PVX_OK && calibrate_light_stack(l, g, c)->picture.n > 0)
            light_conclude(calibrate_light_stack(l, g, c));
    }
    frames_in_close(&f);
    return e;
}

static pvx_err light_read(struct calibrate_light *l, struct pvx_diag *d)
{
    for (size_t g = 0; g < l->a->n; g++)
        PVX_TRY(read_group(l, g, d));
    return PVX_OK;
}

/* ---- output ---- */

pvx_err calibrate_light_map(const struct calibrate_light *l, size_t camera, const char *kind,
                            const float *v, struct rec_map *m, struct pvx_diag *d)
{
    const char *out = l->a->out;
    const struct rec_light_picture *p = NULL;
    char path[PATH_MAX], named[PATH_MAX];
    for (size_t g = 0; g < l->a->n && p == NULL; g++)
        if (calibrate_light_stack(l, g, camera)->picture.n > 0)
            p = &calibrate_light_stack(l, g, camera)->picture;
    if (p == NULL)
        return pvx_fail(d, PVX_ENOENT, "camera %s has no pictures", l->rig.cameras[camera].name);
    int n = (int)folder(out);
    size_t shape[3] = {(size_t)p->height, (size_t)p->width, (size_t)p->channels};
    snprintf(path, sizeof path, "%.*s%s-%s.tmp.npy", n, out, l->rig.cameras[camera].name, kind);
    PVX_TRY(cap_npy_save(path, v, shape, p->channels == 1 ? 2 : 3, d));
    PVX_TRY(dmn_photometry_hash(path, &m->hash, d));
    /* the name contains the hash, so the maps of older rigs are not overwritten */
    snprintf(m->file, sizeof m->file, "%s-%s-%08x.npy", l->rig.cameras[camera].name, kind,
             (unsigned)(m->hash >> 32));
    snprintf(named, sizeof named, "%.*s%s", n, out, m->file);
    if (rename(path, named) != 0)
        return pvx_fail(d, PVX_EIO, "%s: cannot be named %s", path, named);
    return PVX_OK;
}

void calibrate_light_identity(const struct calibrate_stack *s, struct rec_photometry *p)
{
    if (s->serial[0] == '\0')
        return;
    snprintf(p->serial, sizeof p->serial, "%s", s->serial);
    snprintf(p->device, sizeof p->device, "%s", s->device);
}

pvx_err calibrate_light_save(const struct calibrate_light *l, struct pvx_diag *d)
{
    PVX_TRY(opt_rig_save(&l->rig, NULL, l->a->out, d));
    fprintf(stderr, "%s written\n", l->a->out);
    return PVX_OK;
}

/* ---- a step ---- */

int calibrate_light_run(const struct calibrate_light_args *a, unsigned what,
                        pvx_err (*step)(struct calibrate_light *l, struct pvx_diag *d))
{
    struct calibrate_light l;
    struct pvx_diag d = {""};
    cli_catch_stop();
    pvx_err e = light_begin(&l, a, what, &d);
    PVX_THEN(e, light_read(&l, &d));
    PVX_THEN(e, step(&l, &d));
    light_fini(&l);
    return cli_end(&d, e, true);
}

int calibrate_light_main(const char *doc, unsigned what,
                         pvx_err (*step)(struct calibrate_light *l, struct pvx_diag *d), int argc,
                         char **argv)
{
    const struct argp argp = {.options = options, .parser = light_parse, .doc = doc};
    struct calibrate_light_args a = {0};
    if (argp_parse(&argp, argc, argv, 0, NULL, &a) != 0)
        return 2;
    if (what == 0)
        a.reading.transfer = CAP_TRANSFER_LINEAR;
    return calibrate_light_run(&a, what, step);
}
