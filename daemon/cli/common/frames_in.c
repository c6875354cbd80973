#include "daemon/cli/common/frames_in.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/frames_in_impl.h"

/* ---- one set ---- */

/* Name of a frame for messages: its file, or for a take its set and camera. */
static const char *frames_in_name_of(const struct frames_in *f, struct frames_in_set s, size_t c,
                                     char room[CAP_REEL_NAME])
{
    if (f->take == NULL)
        return cap_reel_name(&f->reel[c], (size_t)s.row[c], room);
    snprintf(room, CAP_REEL_NAME, "%s: set %lld, camera %s", f->dir, (long long)s.number,
             f->rig->cameras[c].name);
    return room;
}

static pvx_err load_from_take(const struct frames_in *f, int64_t row, size_t c,
                              struct cap_loaded *l, struct pvx_diag *d)
{
    uint32_t camera = (uint32_t)f->take_camera[c];
    size_t size = cap_take_frame_max(f->take, camera);
    *l = (struct cap_loaded){.mem = malloc(size)};
    if (l->mem == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a frame", f->dir);
    pvx_err e = cap_take_read(f->take, camera, (uint64_t)row, l->mem, size, &l->img, d);
    if (e != PVX_OK)
        cap_loaded_free(l);
    return e;
}

pvx_err frames_in_read_as(const struct frames_in *f, const char *path, struct cap_loaded *l,
                          struct pvx_diag *d)
{
    if (f->how.fmt == CAP_FMT_NONE)
        return PVX_OK;
    pvx_err e = PVX_OK;
    enum cap_pixfmt other = cap_pixfmt_of_depth(l->img.fmt, cap_pixfmt_depth(f->how.fmt));
    if (!cap_pixfmt_fits(l->img.fmt, f->how.fmt))
        e = pvx_fail(d, PVX_EINVAL, "%s: a %s image cannot be read as %s%s%s", path,
                     cap_pixfmt_name(l->img.fmt), cap_pixfmt_name(f->how.fmt),
                     other == CAP_FMT_NONE ? "" : ", but as ",
                     other == CAP_FMT_NONE ? "" : cap_pixfmt_name(other));
    l->img.fmt = f->how.fmt;
    if (e != PVX_OK)
        cap_loaded_free(l);
    return e;
}

pvx_err frames_in_load_one(const struct frames_in *f, struct frames_in_set s, size_t c,
                           struct cap_loaded *l, struct pvx_diag *d)
{
    char room[CAP_REEL_NAME];
    PVX_TRY(f->take != NULL ? load_from_take(f, s.row[c], c, l, d)
                            : cap_reel_load(&f->reel[c], (size_t)s.row[c], l, d));
    return frames_in_read_as(f, frames_in_name_of(f, s, c, room), l, d);
}

struct frames_in_job {
    struct frames_in *f;
    struct frames_in_set s;
};
static void load_piece(void *ctx, size_t c)
{
    struct frames_in_job *j = ctx;
    struct frames_in *f = j->f;
    f->image[c] = NULL;
    f->why[c].text[0] = '\0';
    f->loaded[c] = (struct cap_loaded){0};
    if (j->s.row[c] >= 0 && frames_in_load_one(f, j->s, c, &f->loaded[c], &f->why[c]) == PVX_OK)
        f->image[c] = &f->loaded[c].img;
}

void frames_in_say_bits(const struct frames_in *f, uint64_t which, int bits, enum cap_pixfmt fmt)
{
    static bool said;
    char names[200] = "", room[120];
    for (size_t c = 0; c < f->rig->n_cameras && !said; c++)
        if (which >> c & 1 && strlen(names) + REC_NAME_MAX < sizeof names)
            snprintf(names + strlen(names), sizeof names - strlen(names), "%s%s",
                     names[0] == '\0' ? "" : ", ", f->rig->cameras[c].name);
    if (!said)
        fprintf(stderr,
                "pyrovox: %s: samples of %s go up to %d and stop there: these are %d bits in 16, "
                "saturated at %d; %s\n",
                f->dir, names, (1 << bits) - 1, bits, (1 << bits) - 1,
                cap_depth_remedy(fmt, bits, "--pixel-format ", room));
    said = true;
}

/* After a set: report the images that could not be used, the first one in *first, and free all images. */
static void frames_in_let_go(struct frames_in *f, struct frames_in_set s, uint64_t mask,
                             struct pvx_diag *first)
{
    for (size_t c = 0; c < f->rig->n_cameras; c++) {
        char room[CAP_REEL_NAME];
        struct pvx_diag *why = &f->why[c];
        int bits = dmn_images_bits(f->images, c);
        if (f->image[c] != NULL && bits > 0)
            frames_in_say_bits(f, 1ull << c, bits, f->image[c]->fmt);
        if (f->image[c] != NULL && !(mask >> c & 1))
            pvx_fail(why, PVX_EINVAL, "%s: %s", frames_in_name_of(f, s, c, room),
                     dmn_images_why(f->images, c));
        if (why->text[0] != '\0') {
            fprintf(stderr, "pyrovox: %s\n", why->text);
            if (first->text[0] == '\0')
                *first = *why;
        }
        cap_loaded_free(&f->loaded[c]);
    }
}

/* Numbers in a camera's bins. */
static size_t frames_in_values(const struct frames_in *f, size_t c)
{
    const struct rec_camera *k = &f->rig->cameras[c];
    size_t bins = (size_t)(k->width / f->binning) * (size_t)(k->height / f->binning);
    return bins * (f->nch == 3 ? 4 : 1);
}

/* One set of the recording into out, or into a frame. */
static uint64_t frames_in_one(struct frames_in *f, struct frames_in_set s, float *const *out,
                              rec_frame *frame, struct pvx_diag *first)
{
    uint64_t mask;
    pvx_pool_run(f->pool, f->rig->n_cameras, load_piece, &(struct frames_in_job){f, s});
    int64_t t0 = pvx_now_mono();
    if (frame != NULL)
        (void)dmn_images_bin_frame(f->images, f->image, frame, &mask);
    else
        (void)dmn_images_bin(f->images, f->image, out, &mask);
    f->bin_ns += pvx_now_mono() - t0;
    frames_in_let_go(f, s, mask, first);
    return mask;
}

struct frames_in_sums {
    struct frames_in *f;
    float *out[REC_MAX_CAMERAS];
    float full[REC_MAX_CAMERAS];
    struct means_sum sum[REC_MAX_CAMERAS];
    uint64_t mask; /* of the last set; of all sets at the end */
};
static void frames_in_add(void *ctx, size_t c)
{
    struct frames_in_sums *m = ctx;
    bool floats = dmn_images_floats(m->f->images, c);
    float full = dmn_images_saturated(m->f->images, c);
    if ((m->mask >> c & 1) == 0)
        return;
    m->full[c] = floats ? INFINITY : full > 0 ? full : 1;
    means_add(&m->sum[c], m->out[c], m->full[c]);
}
static void frames_in_mean(void *ctx, size_t c)
{
    struct frames_in_sums *m = ctx;
    if (m->sum[c].n > 0)
        means_take(&m->sum[c], m->out[c], m->full[c]);
}

/* A mean of several sets.  Ctrl-C leaves it incomplete. */
static uint64_t frames_in_several(struct frames_in *f, size_t i, float *const *out,
                                  rec_frame *frame, struct pvx_diag *first)
{
    size_t cams = f->rig->n_cameras;
    struct frames_in_sums m = {.f = f};
    struct rec_frame_camera camera[REC_MAX_CAMERAS];
    uint64_t all = 0;
    for (size_t c = 0; c < cams; c++) {
        m.out[c] = out != NULL ? out[c] : rec_frame_input(frame, c);
        m.sum[c] =
            (struct means_sum){f->sum[c], f->square[c], f->full[c], frames_in_values(f, c), 0};
        memset(f->sum[c], 0, m.sum[c].values * sizeof *f->sum[c]);
        memset(f->square[c], 0, m.sum[c].values * sizeof *f->square[c]);
        memset(f->full[c], 0, m.sum[c].values);
    }
    for (size_t k = f->means.begin[i]; k < f->means.begin[i + 1] && !cli_stop; k++) {
        size_t set = f->means.member[k];
        m.mask = frames_in_one(
            f, (struct frames_in_set){f->member_number[set], f->member_row + set * cams}, out,
            frame, first);
        for (size_t c = 0; c < cams && frame != NULL; c++)
            if (m.mask >> c & 1)
                camera[c] = *rec_frame_camera(frame, c);
        if (frame != NULL)
            (void)rec_frame_input(frame, 0); /* bins of what a card would unpack */
        pvx_pool_run(f->pool, cams, frames_in_add, &m);
        all |= m.mask;
        if (f->bar != NULL)
            cli_progress(f->bar, (double)(k + 1) / (double)f->means.begin[f->means.n]);
    }
    pvx_pool_run(f->pool, cams, frames_in_mean, &m);
    for (size_t c = 0; c < cams && frame != NULL; c++)
        if (all >> c & 1) {
            camera[c].pictures = m.sum[c].n;
            if (means_noise(&m.sum[c], f->nch == 3 ? 4 : 1, (size_t)f->nch, camera[c].noise) !=
                PVX_OK)
                memset(camera[c].noise, 0, sizeof camera[c].noise); /* measured in the mean */
            *rec_frame_camera(frame, c) = camera[c];
        }
    return all;
}

static uint64_t frames_in_get(struct frames_in *f, size_t i, float *const *out, rec_frame *frame,
                              struct pvx_diag *first)
{
    return f->means.n > 0 ? frames_in_several(f, i, out, frame, first)
                          : frames_in_one(f, frames_in_set_of(f, i), out, frame, first);
}

uint64_t frames_in_load(struct frames_in *f, size_t i, float *const *out)
{
    return frames_in_get(f, i, out, NULL, &(struct pvx_diag){""});
}

uint64_t frames_in_load_frame(struct frames_in *f, size_t i, rec_frame *frame)
{
    return frames_in_get(f, i, NULL, frame, &(struct pvx_diag){""});
}

static pvx_err frames_in_next(void *ctx, struct dmn_slot *s)
{
    struct frames_in *f = ctx;
    if (f->left == 0 || cli_stop || atomic_load(&f->stop))
        return PVX_ECLOSED;
    size_t i = f->n - f->left--;
    int64_t number =
        f->means.n > 0 ? f->member_number[f->means.member[f->means.begin[i]]] : f->number[i];
    f->bin_ns = 0;
    s->set = (uint64_t)f->number[i];
    s->t_exposure_ns = f->t_ns != NULL ? f->t_ns[i] : 0;
    s->spread_ns = 0;
    if (f->take != NULL) {
        int64_t k = cap_take_find_set(f->take, (uint64_t)number);
        const struct cap_take_set *set = cap_take_set(f->take, (uint64_t)k, NULL);
        s->t_exposure_ns = set->t_exposure_ns;
        s->spread_ns = set->spread_ns;
    }
    s->mask = frames_in_get(f, i, NULL, s->frame, &s->problem);
    s->n_present = (uint32_t)__builtin_popcountll(s->mask);
    s->bin_ns = f->bin_ns;
    s->t_last_mono_ns = pvx_now_mono() - s->bin_ns;
    if (s->n_present == 0)
        s->why = DMN_DROP_IMAGES;
    return f->means.n > 0 && cli_stop ? PVX_ECLOSED : PVX_OK;
}

struct dmn_source frames_in_source(struct frames_in *f)
{
    f->left = f->n;
    return (struct dmn_source){.next = frames_in_next, .ctx = f};
}

float *frames_in_room(const struct frames_in *f, size_t c)
{
    return pvx_calloc(frames_in_values(f, c), sizeof(float));
}

/* ---- open and close ---- */

/* The sets found become members of means, and each mean takes the place of a set.  A mean has the cameras of any of its
 * members. */
static pvx_err frames_in_average(struct frames_in *f, struct pvx_diag *d)
{
    size_t cams = f->rig->n_cameras;
    int64_t *t_ns = f->t_ns, *taken = NULL;
    if (f->take != NULL) {
        t_ns = taken = pvx_calloc(f->n, sizeof *taken);
        PVX_NEED(taken);
        for (size_t i = 0; i < f->n; i++)
            taken[i] =
                cap_take_set(f->take, (uint64_t)cap_take_find_set(f->take, (uint64_t)f->number[i]),
                             NULL)
                    ->t_exposure_ns;
    }
    pvx_err e = means_find(&f->how.means, f->number, t_ns, f->n, &f->means, d);
    free(taken);
    PVX_TRY(e);
    f->member_number = f->number;
    f->member_row = f->row;
    f->members = f->n;
    f->n = f->means.n;
    f->number = pvx_calloc(f->n, sizeof *f->number);
    f->row = pvx_calloc(f->n * cams, sizeof *f->row);
    if (f->number == NULL || f->row == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < f->n; i++) {
        f->number[i] = f->means.number[i];
        if (f->t_ns != NULL) /* ascending in i: member[begin] >= i */
            f->t_ns[i] = f->t_ns[f->means.member[f->means.begin[i]]];
        for (size_t c = 0; c < cams; c++) {
            f->row[i * cams + c] = -1;
            for (size_t k = f->means.begin[i];
                 k < f->means.begin[i + 1] && f->row[i * cams + c] < 0; k++)
                f->row[i * cams + c] = f->member_row[f->means.member[k] * cams + c];
        }
    }
    return PVX_OK;
}

pvx_err frames_in_open(struct frames_in *f, const char *dir, int64_t first, int64_t last,
                       enum frames_in_kinds kinds, struct pvx_diag *d)
{
    f->dir = dir;
    f->kinds = kinds;
    pvx_err e = frames_in_find(f, first, last, d);
    PVX_THEN(e, frames_in_look(f, d));
    if (f->how.means.average != NULL || f->how.means.phases != NULL)
        PVX_THEN(e, frames_in_average(f, d));
    return e != PVX_ENOMEM ? e : pvx_fail(d, e, "%s: no memory for the list of frames", dir);
}

/* Print a note if the take or the rig lacks the temperature needed to check the darks. */
static void note_unknown(const struct frames_in *f)
{
    const char *first = NULL;
    size_t n = 0;
    for (size_t c = 0; c < f->rig->n_cameras; c++) {
        const struct rec_photometry *p = &f->rig->cameras[c].photometry;
        int k = f->take_camera[c];
        if (k < 0 || p->dark.file[0] == '\0' ||
            (p->has_temperature && isfinite(cap_take_info(f->take)->head.camera[k].temperature_c)))
            continue;
        first = n++ == 0 ? f->rig->cameras[c].name : first;
    }
    if (n > 0)
        fprintf(stderr,
                "pyrovox: %s: the temperature of %zu cameras' darks is not checked (%s and "
                "others): take or rig does not say it\n",
                f->dir, n, first);
}

/* A recording of a high-speed camera says its exposure, and neither gain nor temperature. */
static pvx_err frames_in_check_raw(const struct frames_in *f, size_t c, struct pvx_diag *d)
{
    const struct cap_reel *r = &f->reel[c];
    for (int k = 0; k < 2 && r->n > 0 && r->raw.exposure_s[k] > 0; k++) {
        const struct dmn_photometry_taken as = {r->raw.exposure_s[k], (double)NAN, (double)NAN,
                                                NULL, NULL};
        PVX_TRY(dmn_photometry_check(&f->rig->cameras[c], &as, r->path[0], d));
    }
    return PVX_OK;
}

pvx_err frames_in_check_light(const struct frames_in *f, struct pvx_diag *d)
{
    bool means = f->means.n > 0;
    const int64_t *rows = means ? f->member_row : f->row;
    size_t n = means ? f->members : f->n;
    for (size_t c = 0; f->reel != NULL && c < f->rig->n_cameras; c++)
        PVX_TRY(frames_in_check_raw(f, c, d));
    for (size_t c = 0; f->take != NULL && c < f->rig->n_cameras; c++)
        for (size_t i = 0; i < n; i++) {
            int64_t at = rows[i * f->rig->n_cameras + c];
            if (at < 0)
                continue;
            uint32_t camera = (uint32_t)f->take_camera[c];
            const struct cap_take_row *row = cap_take_row(f->take, camera, (uint64_t)at);
            const struct cap_take_camera *k = &cap_take_info(f->take)->head.camera[camera];
            const struct dmn_photometry_taken as = {row->exposure_us * 1e-6, row->gain,
                                                    k->temperature_c, k->uri, k->serial};
            PVX_TRY(dmn_photometry_check(&f->rig->cameras[c], &as, f->dir, d));
        }
    if (f->take != NULL)
        note_unknown(f);
    return PVX_OK;
}

static uint64_t place_in_take(const struct frames_in *f, size_t i)
{
    return (uint64_t)cap_take_find_set(f->take, (uint64_t)f->number[i]);
}

void frames_in_only(struct frames_in *f, size_t first, size_t end)
{
    size_t cams = f->rig->n_cameras, n = end - first;
    if (f->means.n > 0) {
        memmove(f->means.begin, f->means.begin + first, (n + 1) * sizeof *f->means.begin);
        f->means.n = n;
    }
    memmove(f->number, f->number + first, n * sizeof *f->number);
    memmove(f->row, f->row + first * cams, n * cams * sizeof *f->row);
    if (f->t_ns != NULL)
        memmove(f->t_ns, f->t_ns + first, n * sizeof *f->t_ns);
    if (f->take != NULL && f->member_row == NULL)
        cap_take_only(f->take, place_in_take(f, 0), n > 0 ? place_in_take(f, n - 1) + 1 : 0);
    f->n = n;
}

void frames_in_close(struct frames_in *f)
{
    for (size_t c = 0; f->reel != NULL && c < f->rig->n_cameras; c++)
        cap_reel_close(&f->reel[c]);
    PVX_FREE(f->reel);
    PVX_FREE(f->row);
    PVX_FREE(f->number);
    PVX_FREE(f->t_ns);
    PVX_FREE(f->member_row);
    PVX_FREE(f->member_number);
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++) {
        PVX_FREE(f->sum[c]);
        PVX_FREE(f->square[c]);
        PVX_FREE(f->full[c]);
    }
    means_free(&f->means);
    cap_take_free(&f->take);
    dmn_images_free(&f->images);
}

pvx_err frames_in_begin(struct frames_in *f, int32_t binning, enum cap_mosaic mosaic,
                        struct pvx_diag *d)
{
    const struct dmn_images_params p = {.nch = f->nch,
                                        .binning = binning,
                                        /* files come decoded */
                                        .fmt = f->take != NULL ? CAP_FMT_NONE : CAP_GREY8,
                                        .transfer = f->how.transfer,
                                        .mosaic = mosaic,
                                        .light = f->light,
                                        .alike = f->kinds == FRAMES_IN_SAME};
    dmn_images_free(&f->images);
    f->binning = binning;
    f->mosaic = mosaic;
    PVX_TRY(dmn_images_new(&p, f->rig, f->pool, &f->images, d));
    for (size_t c = 0; c < f->rig->n_cameras; c++) {
        dmn_images_seen(f->images, c, &f->depth[c]);
        if (f->means.n == 0)
            continue;
        size_t values = frames_in_values(f, c);
        PVX_FREE(f->sum[c]);
        PVX_FREE(f->square[c]);
        PVX_FREE(f->full[c]);
        f->square[c] = pvx_calloc(values, sizeof *f->square[c]);
        f->sum[c] = pvx_calloc(values, sizeof *f->sum[c]);
        f->full[c] = pvx_calloc(values, sizeof *f->full[c]);
        if (f->sum[c] == NULL || f->square[c] == NULL || f->full[c] == NULL)
            return pvx_fail(d, PVX_ENOMEM, "no memory for the mean of pictures");
    }
    return PVX_OK;
}

bool frames_in_complete(const struct frames_in *f, size_t i)
{
    for (size_t c = 0; c < f->rig->n_cameras; c++)
        if (!frames_in_there(f, i, c))
            return false;
    return true;
}
