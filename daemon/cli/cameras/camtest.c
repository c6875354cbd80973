#include "daemon/cli/cameras/camtest.h"

#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"
#include "capture/pixel/jpeg.h"
#include "capture/pixel/pixfmt.h"
#include "daemon/cli/pictures/look.h"
#include "recon/carve/photo.h"

#define OPEN_NS (10 * PVX_NS_PER_S) /* longest wait for cameras that do not open */
#define SAID_NS (2 * PVX_NS_PER_S)  /* longest wait if all of them report an error */
#define LOOK_NS (50 * PVX_NS_PER_MS)

#define MOST_BINS (1 << 20) /* of a picture whose dark is looked at: noise needs no more */

/* ---- frames ----------------------------------------------------------------------------------- */

/* Under the lock. */
static void note_frame(struct camtest *t, const struct cap_frame *f)
{
    struct camtest_camera *c = &t->camera[f->camera];
    c->seen = true;
    if (!t->measuring)
        return;
    if (c->frames > 0 && f->id == c->last_id + 1) {
        camtest_add(&c->arrival, (double)(f->t_arrival_mono_ns - c->last_arrival_ns) * 1e-9);
        if (f->t_device_ns != 0 && c->last_device_ns != 0)
            camtest_add(&c->device, (double)(f->t_device_ns - c->last_device_ns) * 1e-9);
    }
    if (c->frames == 0)
        c->first_mono_ns = f->t_arrival_mono_ns;
    c->last_mono_ns = c->last_arrival_ns = f->t_arrival_mono_ns;
    c->last_id = f->id;
    c->last_device_ns = f->t_device_ns;
    c->width = f->img.width;
    c->height = f->img.height;
    c->fmt = f->img.fmt;
    c->frames++;
    c->bytes += f->img.size;
}

static void on_stray(void *ctx, struct cap_frame *f, enum cap_count why)
{
    struct camtest *t = ctx;
    (void)why;
    pthread_mutex_lock(&t->lock);
    note_frame(t, f);
    pthread_mutex_unlock(&t->lock);
    cap_frame_release(f);
}

static void note_set(struct camtest *t, struct cap_set *s)
{
    pthread_mutex_lock(&t->lock);
    for (uint32_t i = 0; i < t->n; i++) {
        const struct cap_frame *f = s->frame[i];
        struct camtest_camera *c = &t->camera[i];
        if (f == NULL)
            continue;
        note_frame(t, f);
        if (t->measuring && s->n > 1)
            camtest_add(&c->offset, (double)(f->t_exposure_ns - s->t_exposure_ns) * 1e-9);
        cap_set_ref(s);
        cap_set_release(c->last);
        c->last = s;
    }
    if (t->measuring) {
        t->sets++;
        t->by_size[s->n]++;
        if (s->n > 1) {
            camtest_add(&t->spread, (double)s->spread_ns * 1e-9);
            pvx_hist_add(&t->spread_hist, s->spread_ns);
        }
    }
    pthread_mutex_unlock(&t->lock);
}

/* ---- set-up ----------------------------------------------------------------------------------- */

/* Make a rig of cameras that have only names and sizes, and the cameras of its configuration c. */
static pvx_err make_rig(struct camtest *t, const struct camtest_options *o, struct dmn_config *c,
                        struct pvx_diag *d)
{
    if (o->n > REC_MAX_CAMERAS)
        return pvx_fail(d, PVX_EINVAL, "%zu cameras; at most %d are possible", o->n,
                        REC_MAX_CAMERAS);
    t->made = pvx_calloc(o->n, sizeof *t->made);
    if (t->made == NULL)
        return PVX_ENOMEM;
    t->rig.cameras = t->made;
    t->rig.n_cameras = o->n;
    c->cameras.n = o->n;
    for (size_t i = 0; i < o->n; i++) {
        struct rec_camera *k = &t->made[i];
        bool sim = strncmp(o->uri[i], "sim:", 4) == 0;
        snprintf(k->name, sizeof k->name, "cam%zu", i);
        k->width = o->width > 0 || !sim ? o->width : 640;
        k->height = o->height > 0 || !sim ? o->height : 480;
        snprintf(c->cameras.item[i].key, sizeof c->cameras.item[i].key, "%s", k->name);
        if (snprintf(c->cameras.item[i].value, DMN_WORD_MAX, "%s", o->uri[i]) >= DMN_WORD_MAX)
            return pvx_fail(d, PVX_ERANGE, "'%s' is too long", o->uri[i]);
    }
    return PVX_OK;
}

/* The picture of sim: cameras without a rig: a ramp that moves. */
static void camtest_ramp(void *ctx, uint32_t camera, int64_t t_ns, enum cap_pixfmt fmt, int32_t w,
                         int32_t h, void *data)
{
    (void)ctx;
    size_t row = cap_pixfmt_row(fmt, w);
    uint32_t shift = (uint32_t)(t_ns / 10000000) + 40 * camera;
    for (int32_t y = 0; y < h; y++)
        for (size_t x = 0; x < row; x++)
            ((uint8_t *)data)[(size_t)y * row + x] = (uint8_t)((x + (size_t)y + shift) % 240);
}

static pvx_err override(const struct camtest_options *o, struct dmn_config *c, struct pvx_diag *d)
{
    char text[256];
    int n = 0;
    if (o->fps > 0)
        c->fps = o->fps;
    if (o->pixel_format == NULL && o->trigger == NULL)
        return PVX_OK;
    if (o->pixel_format != NULL)
        n += snprintf(text + n, sizeof text - (size_t)n, "pixel_format: %.60s\n", o->pixel_format);
    if (o->trigger != NULL)
        n += snprintf(text + n, sizeof text - (size_t)n, "trigger: %.60s\n", o->trigger);
    struct dmn_config *word = pvx_calloc(1, sizeof *word);
    PVX_NEED(word);
    dmn_config_defaults(word);
    pvx_err e = dmn_config_parse(text, (size_t)n, "options", word, d);
    if (e == PVX_OK && o->pixel_format != NULL)
        c->pixel_format = word->pixel_format;
    if (e == PVX_OK && o->trigger != NULL)
        c->trigger = word->trigger;
    free(word);
    return e;
}

static pvx_err camtest_set_up(struct camtest *t, const struct camtest_options *o,
                              struct dmn_config *c, struct pvx_diag *d)
{
    static const struct cap_scene moving = {.render = camtest_ramp};
    const struct cap_scene *scene = &moving;
    if (o->config != NULL) {
        PVX_TRY(dmn_config_load(o->config, c, d));
        PVX_TRY(override(o, c, d));
        PVX_TRY(dmn_config_rig(c, &t->rig, d));
        if (dmn_config_simulated(c))
            PVX_TRY(dmn_scene_new(&t->rig, (uint32_t)c->sim_seed, c->sim_period_s, c->sim_ignite_s,
                                  &t->scene));
        scene = dmn_scene_cap(t->scene);
    } else {
        dmn_config_defaults(c);
        c->min_cameras = c->min_views = 1; /* one camera may be judged alone */
        PVX_TRY(override(o, c, d));
        PVX_TRY(make_rig(t, o, c, d));
    }
    t->n = (uint32_t)t->rig.n_cameras;
    t->fps = c->fps;
    t->seconds = o->seconds;
    t->triggered = c->trigger != CAP_TRIGGER_FREE_RUN;
    t->ptp = c->ptp;
    for (uint32_t i = 0; i < t->n; i++)
        snprintf(t->camera[i].name, sizeof t->camera[i].name, "%s", t->rig.cameras[i].name);
    PVX_TRY(dmn_sources_init(&t->sources, c, &t->rig, scene, d));
    struct cap_capture_config *cc = &t->sources.capture;
    cc->sets.policy = CAP_POLICY_PARTIAL; /* every frame is looked at */
    cc->sets.min_cameras = 1;
    cc->tap = (struct cap_tap){.stray = on_stray, .ctx = t};
    return cap_capture_new(cc, &t->capture, d);
}

pvx_err camtest_new(const struct camtest_options *o, struct camtest **out, struct pvx_diag *d)
{
    *out = NULL;
    struct camtest *t = pvx_calloc(1, sizeof *t);
    struct dmn_config *c = pvx_calloc(1, sizeof *c);
    pvx_err e = t == NULL || c == NULL ? PVX_ENOMEM : PVX_OK;
    if (e == PVX_OK) {
        pthread_mutex_init(&t->lock, NULL);
        e = camtest_set_up(t, o, c, d);
        if (e != PVX_OK)
            camtest_free(&t);
        *out = t;
    } else {
        free(t);
    }
    free(c);
    return e;
}

/* ---- run -------------------------------------------------------------------------------------- */

/* Whether every camera gives frames, or the wait for the others is over.  The wait is shorter if all of these report
 * an error, except with PTP: there they may only wait for their clocks. */
static bool settled(struct camtest *t, struct cap_stats *s, int64_t waited_ns)
{
    bool all = true, all_said = true;
    cap_capture_stats(t->capture, s);
    pthread_mutex_lock(&t->lock);
    for (uint32_t i = 0; i < t->n; i++) {
        if (t->camera[i].seen || s->camera[i].state == CAP_ENDED)
            continue;
        all = false;
        all_said = all_said && s->camera[i].error[0] != '\0' && !t->ptp;
    }
    pthread_mutex_unlock(&t->lock);
    return all || waited_ns > (all_said ? SAID_NS : OPEN_NS);
}

/* Take the next set, if there is one.  PVX_ECLOSED: all sources have ended. */
static pvx_err next_set(struct camtest *t)
{
    struct cap_set *s = NULL;
    pvx_err e = cap_capture_next(t->capture, LOOK_NS, &s);
    if (e == PVX_OK) {
        note_set(t, s);
        cap_set_release(s);
    }
    return e == PVX_ECLOSED ? e : PVX_OK;
}

static void camtest_finish(struct camtest *t, struct cap_stats *s, int64_t t0)
{
    t->measured_s = (double)(pvx_now_mono() - t0) * 1e-9;
    cap_capture_stats(t->capture, s);
    pthread_mutex_lock(&t->lock);
    t->measuring = false;
    for (uint32_t i = 0; i < t->n; i++) {
        t->camera[i].stats = s->camera[i];
        for (int k = 0; k < CAP_N_COUNT; k++)
            t->camera[i].count[k] = s->camera[i].count[k] - t->camera[i].base[k];
    }
    pthread_mutex_unlock(&t->lock);
}

pvx_err camtest_run(struct camtest *t, struct pvx_diag *d)
{
    struct cap_stats *s = pvx_calloc(1, sizeof *s);
    struct cli_progress opening = {.label = "opening"}, watching = {.label = "watching"};
    PVX_NEED(s);
    pvx_err e = cap_capture_start(t->capture, d);
    int64_t t0 = pvx_now_mono();
    while (e == PVX_OK && !cli_stop && !settled(t, s, pvx_now_mono() - t0)) {
        cli_progress(&opening, (double)(pvx_now_mono() - t0) / (double)OPEN_NS);
        e = next_set(t);
    }
    if (e == PVX_OK || e == PVX_ECLOSED) {
        cli_progress(&opening, 1);
        pthread_mutex_lock(&t->lock);
        for (uint32_t i = 0; i < t->n; i++)
            memcpy(t->camera[i].base, s->camera[i].count, sizeof t->camera[i].base);
        t->measuring = true;
        pthread_mutex_unlock(&t->lock);
        t0 = pvx_now_mono();
        double done = 0;
        while (e == PVX_OK && done < 1 && !cli_stop) {
            e = next_set(t);
            done = (double)(pvx_now_mono() - t0) * 1e-9 / t->seconds;
            if (done < 1)
                cli_progress(&watching, done);
        }
        camtest_finish(t, s, t0);
        if (!cli_stop)
            cli_progress(&watching, 1);
        else
            fputc('\n', stderr);
        t->interrupted = cli_stop;
        e = PVX_OK;
    }
    cap_capture_stop(t->capture);
    free(s);
    return e;
}

void camtest_free(struct camtest **tp)
{
    struct camtest *t = *tp;
    if (t == NULL)
        return;
    *tp = NULL;
    for (uint32_t i = 0; i < t->n; i++)
        cap_set_release(t->camera[i].last);
    cap_capture_free(&t->capture);
    dmn_scene_free(&t->scene);
    if (t->made == NULL)
        rec_rig_fini(&t->rig);
    free(t->made);
    pthread_mutex_destroy(&t->lock);
    free(t);
}

/* ---- pictures --------------------------------------------------------------------------------- */

/* The picture in bins of binning x binning pixels, linear, [height / binning][width / binning][nch 3: 4].  Owner: caller. */
static pvx_err cameras_pixels(const struct cap_image *raw, int32_t binning, int *nch, float **out,
                              struct pvx_diag *d)
{
    cap_jpeg *jpeg = NULL;
    struct cap_image img = *raw;
    pvx_err e = PVX_OK;
    *out = NULL;
    if (raw->fmt == CAP_JPEG) {
        e = cap_jpeg_new(raw->width, raw->height, &jpeg);
        PVX_THEN(e, cap_jpeg_decode(jpeg, raw, &img, d));
    }
    *nch = e == PVX_OK ? cap_pixfmt_channels(img.fmt) : 1;
    img.width -= img.width % binning;
    img.height -= img.height % binning;
    size_t bins = (size_t)(img.width / binning) * (size_t)(img.height / binning);
    float *pix = e == PVX_OK ? pvx_calloc(bins * 4, sizeof *pix) : NULL;
    PVX_THEN(e,
             pix == NULL ? PVX_ENOMEM : cap_bin(&img, binning, *nch, 0, img.height / binning, pix));
    cap_jpeg_free(&jpeg);
    if (e != PVX_OK)
        PVX_FREE(pix);
    *out = pix;
    return e;
}

static pvx_err cameras_save(const struct cap_image *raw, const char *path, struct pvx_diag *d)
{
    int nch;
    float *pix;
    size_t pixels = (size_t)raw->width * (size_t)raw->height;
    pvx_err e = cameras_pixels(raw, 1, &nch, &pix, d);
    for (size_t i = 0; e == PVX_OK && nch == 3 && i < pixels; i++) /* four floats to three */
        memmove(pix + 3 * i, pix + 4 * i, 3 * sizeof *pix);
    PVX_THEN(e, look_save(&look_defaults, path, pix, raw->width, raw->height, nch, d));
    free(pix);
    return e;
}

/* Whether blacks are clipped, by the photometry of a frame set, of the camera's last picture.  Bins of 2x2 or more: of
 * single samples that are nearly all 0 it says nothing. */
static pvx_err camtest_black(struct camtest_camera *c, const struct cap_image *img,
                             struct pvx_diag *d)
{
    static const float gain[3] = {1, 1, 1};
    struct rec_photo_stats stats;
    struct rec_photo_image im = {
        .binning = 2, .gain = gain, .params = &rec_photo_defaults, .stats = &stats};
    while ((int64_t)(img->width / im.binning) * (img->height / im.binning) > MOST_BINS)
        im.binning++;
    im.bw = img->width / im.binning;
    im.bh = img->height / im.binning;
    im.bayer = cap_pixfmt_bayer(img->fmt) != NULL ? im.binning : 0;
    size_t bins = (size_t)im.bw * (size_t)im.bh;
    if (bins == 0)
        return PVX_OK;
    PVX_TRY(cameras_pixels(img, im.binning, &im.nch, &im.img, d));
    im.weight = pvx_calloc(bins, sizeof *im.weight);
    im.lit = pvx_calloc(bins, 1);
    im.work = rec_photo_work_new(im.bw, im.bh);
    pvx_err e = im.weight != NULL && im.lit != NULL && im.work != NULL ? PVX_OK : PVX_ENOMEM;
    if (e == PVX_OK) {
        rec_photo_apply(&im, 1, NULL);
        c->cut = (double)stats.cut;
        c->pedestal = (double)stats.pedestal;
    }
    free(im.work);
    free(im.lit);
    free(im.weight);
    free(im.img);
    return e;
}

pvx_err camtest_look(struct camtest *t, struct pvx_diag *d)
{
    for (uint32_t i = 0; i < t->n; i++)
        if (t->camera[i].last != NULL)
            PVX_TRY(camtest_black(&t->camera[i], &t->camera[i].last->frame[i]->img, d));
    return PVX_OK;
}

pvx_err camtest_save(const struct camtest *t, const char *dir, struct pvx_diag *d)
{
    PVX_TRY(pvx_mkdirs(dir, d));
    for (uint32_t i = 0; i < t->n; i++) {
        const struct camtest_camera *c = &t->camera[i];
        char path[PATH_MAX];
        if (c->last == NULL)
            continue;
        if (snprintf(path, sizeof path, "%s/%s.png", dir, c->name) >= (int)sizeof path)
            return pvx_fail(d, PVX_ERANGE, "%s: too long a name", dir);
        PVX_TRY(cameras_save(&c->last->frame[i]->img, path, d));
        fprintf(stderr, "%s\n", path);
    }
    return PVX_OK;
}
