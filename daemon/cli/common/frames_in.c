#include "daemon/cli/common/frames_in.h"

#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"
#include "capture/files/said.h"
#include "capture/files/sequence.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/take_notes.h"
#include "daemon/volumes/volumes.h"

/* ---- finding the frames ---- */

static bool there(const struct frames_in *f, size_t i, size_t c)
{
    return f->row[i * f->rig->n_cameras + c] >= 0;
}

/* One set of the recording. */
struct frames_in_set {
    int64_t number;
    const int64_t *row; /* [cameras] */
};
static struct frames_in_set frames_in_set(const struct frames_in *f, size_t i)
{
    return (struct frames_in_set){f->number[i], f->row + i * f->rig->n_cameras};
}

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

/* Of the `all` sets found keep those from number `first` to `last`. */
static pvx_err frames_in_choose(struct frames_in *f, size_t all, int64_t first, int64_t last,
                                struct pvx_diag *d)
{
    size_t cams = f->rig->n_cameras, from = 0;
    int64_t least = f->number[0], most = f->number[all - 1];
    if (last >= FRAMES_IN_LAST)
        last = INT64_MAX;
    while (from < all && f->number[from] < first)
        from++;
    while (from + f->n < all && f->number[from + f->n] <= last)
        f->n++;
    memmove(f->number, f->number + from, f->n * sizeof *f->number);
    memmove(f->row, f->row + from * cams, f->n * cams * sizeof *f->row);
    if (f->t_ns != NULL)
        memmove(f->t_ns, f->t_ns + from, f->n * sizeof *f->t_ns);
    return f->n > 0
               ? PVX_OK
               : pvx_fail(d, PVX_ENOENT,
                          "%s: no frames from %06lld to %06lld; it has %06lld to %06lld", f->dir,
                          (long long)first, (long long)last, (long long)least, (long long)most);
}

/* What the folder has beside the rig's cameras, for a camera that has nothing: its name may be misspelt. */
static void frames_in_others(const struct frames_in *f, char *text, size_t size)
{
    struct dirent *e;
    size_t n = 0;
    bool pictures = false;
    char unread[100] = "";
    DIR *h = opendir(f->dir);
    *text = '\0';
    while (h != NULL && (e = readdir(h)) != NULL) {
        char path[CAP_REEL_NAME], name[sizeof e->d_name];
        struct stat st;
        snprintf(path, sizeof path, "%s/%s", f->dir, e->d_name);
        snprintf(name, sizeof name, "%s", e->d_name);
        if (e->d_name[0] == '.' || stat(path, &st) != 0)
            continue;
        pictures = pictures || (!S_ISDIR(st.st_mode) && cap_is_image(name));
        bool unknown = !S_ISDIR(st.st_mode) && cap_is_unknown(name);
        if (!S_ISDIR(st.st_mode) && !cap_is_video(name) && !unknown)
            continue;
        char *dot = strrchr(name, '.');
        if (!S_ISDIR(st.st_mode) && dot != NULL)
            *dot = '\0';
        if (unknown && rec_rig_find(f->rig, name) >= 0)
            snprintf(unread, sizeof unread, "%.60s is of no type that is read", e->d_name);
        if (!unknown && rec_rig_find(f->rig, name) < 0 && n++ < 3)
            snprintf(text + strlen(text), size - strlen(text), "%s'%.60s'", n > 1 ? ", " : "",
                     e->d_name);
    }
    if (h != NULL)
        closedir(h);
    if (n > 0)
        snprintf(text + strlen(text), size - strlen(text),
                 "%s in it belongs to no camera of the rig; is a name misspelt?",
                 n > 3 ? " and more" : "");
    else if (unread[0] != '\0')
        snprintf(text, size, "%s", unread);
    else if (pictures)
        snprintf(text, size, "the pictures that lie in it directly belong to no camera");
}

/* Say which cameras (bits of `none`) have nothing, or fail if all have. */
static pvx_err frames_in_say_none(const struct frames_in *f, uint64_t none, struct pvx_diag *d)
{
    size_t cams = f->rig->n_cameras, n = 0;
    char text[400] = "", others[400];
    for (size_t c = 0; c < cams; c++)
        if (none >> c & 1 && n++ < 8)
            snprintf(text + strlen(text), sizeof text - strlen(text), "%s%s", n > 1 ? ", " : "",
                     f->rig->cameras[c].name);
    if (n == 0)
        return PVX_OK;
    frames_in_others(f, others, sizeof others);
    const char *more = n > 8 ? " and others" : "", *hint = *others != '\0' ? "; " : "";
    if (n == cams)
        return pvx_fail(
            d, PVX_ENOENT,
            "%s: no frames for the rig's cameras (%s%s): looked for a folder %s/%s with "
            "numbered pictures or a film, and for %s.(mp4|avi|mkv|mov|cine|mraw|tif)%s%s",
            f->dir, text, more, f->dir, f->rig->cameras[0].name, f->rig->cameras[0].name, hint,
            others);
    fprintf(stderr, "pyrovox: %s: no frames of %s%s, missing in all sets%s%s\n", f->dir, text, more,
            hint, others);
    return PVX_OK;
}

/* Whether the text is a list CAMERA=FILE,...  A folder whose name has a = in it is a folder. */
static bool frames_in_is_list(const char *text)
{
    struct stat st;
    return strchr(text, '=') != NULL && stat(text, &st) != 0;
}

/* The next CAMERA=PATH of a list, up to a comma that another begins after: a path may have commas.  *rest: the text at
 * first.  The text is cut up. */
static char *frames_in_entry(char **rest)
{
    char *entry = *rest, *comma = entry;
    while (comma != NULL && (comma = strchr(comma, ',')) != NULL) {
        size_t n = strcspn(++comma, "=,/");
        if (comma[n] == '=')
            break;
    }
    if (comma != NULL)
        comma[-1] = '\0';
    *rest = comma;
    return entry;
}

/* What a list names for each camera, by its place in the rig; all point into `text`. */
static pvx_err frames_in_list(const struct frames_in *f, char *text, char *path[],
                              struct pvx_diag *d)
{
    for (char *entry; text != NULL && (entry = frames_in_entry(&text)) != NULL;) {
        char *value = strchr(entry, '=');
        if (value == NULL || value == entry || value[1] == '\0')
            return pvx_fail(d, PVX_EINVAL, "--frames: \"%s\" should be CAMERA=FILE", entry);
        *value++ = '\0';
        int c = rec_rig_find(f->rig, entry);
        if (c < 0)
            return pvx_fail(d, PVX_EINVAL, "--frames: there is no camera %s in the rig; %s is one",
                            entry, f->rig->cameras[0].name);
        if (path[c] != NULL)
            return pvx_fail(d, PVX_EINVAL, "--frames: camera %s has %s and %s", entry, path[c],
                            value);
        path[c] = value;
    }
    return PVX_OK;
}

/* Where the frames of camera c are; owner: caller, free().  PVX_ENOENT: nowhere. */
static pvx_err frames_in_place(const struct frames_in *f, size_t c, char **path, struct pvx_diag *d)
{
    char *named[REC_MAX_CAMERAS] = {NULL};
    if (!frames_in_is_list(f->dir))
        return cap_reel_of(f->dir, f->rig->cameras[c].name, path, d);
    char *text = strdup(f->dir);
    pvx_err e = text != NULL ? frames_in_list(f, text, named, d) : PVX_ENOMEM;
    if (e == PVX_OK && named[c] == NULL)
        e = PVX_ENOENT;
    if (e == PVX_OK && (*path = strdup(named[c])) == NULL)
        e = PVX_ENOMEM;
    free(text);
    return e;
}

/* Find the frames of camera c.  *none: there are none. */
static pvx_err frames_in_find(struct frames_in *f, size_t c, uint64_t *none, struct pvx_diag *d)
{
    const char *camera = f->rig->cameras[c].name;
    char *path;
    struct pvx_diag why = {""};
    pvx_err e = frames_in_place(f, c, &path, &why);
    if (e == PVX_OK) {
        e = cap_reel_open(path, &f->reel[c], &why);
        free(path);
        if (e == PVX_ENOENT && frames_in_is_list(f->dir)) /* it was named */
            e = PVX_EINVAL;
        if (e == PVX_ENOENT)
            fprintf(stderr, "pyrovox: %s\n", pvx_diag_text(&why, e));
    }
    if (e == PVX_OK && f->reel[c].raw.filter && f->how.fmt == CAP_FMT_NONE)
        e = pvx_fail(&why, PVX_EINVAL,
                     "camera %s: %s: its pictures have a colour filter, but it does not say which: "
                     "say --pixel-format BayerRG%d (or GR, GB, BG in the place of RG), or Mono%d "
                     "if they are grey",
                     camera, f->reel[c].path[0], cap_pixfmt_depth(f->reel[c].raw.fmt),
                     cap_pixfmt_depth(f->reel[c].raw.fmt));
    if (e == PVX_ENOENT) {
        *none |= UINT64_C(1) << c;
        cap_reel_close(&f->reel[c]);
        return PVX_OK;
    }
    if (e == PVX_OK && f->reel[c].other > 0 && f->how.transfer == CAP_TRANSFER_AUTO)
        e = pvx_fail(
            &why, PVX_EINVAL,
            "camera %s: %s and %s: samples of JPEG files are taken as sRGB, those of other "
            "types as light; keep one type, or say for all: --transfer srgb or linear",
            camera, f->reel[c].path[0], f->reel[c].path[f->reel[c].other]);
    for (char *rest = f->reel[c].said, *line; e == PVX_OK && (line = cap_said_next(&rest)) != NULL;)
        fprintf(stderr, "pyrovox: camera %s: %s\n", camera, line);
    return e == PVX_OK ? e : pvx_fail(d, e, "%s", pvx_diag_text(&why, e));
}

/* Refuse what is no folder of cameras. */
static pvx_err frames_in_is_folder(const char *dir, struct pvx_diag *d)
{
    struct stat st;
    if (frames_in_is_list(dir))
        return PVX_OK;
    if (stat(dir, &st) != 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: no frames: %s", dir, strerror(errno));
    if (!S_ISDIR(st.st_mode))
        return pvx_fail(d, PVX_EINVAL,
                        "%s: is %s: frames are in a take (TAKE.h5) or in a folder that has a "
                        "folder, film or stack for each camera, DIR/<camera>.mp4; or name each, "
                        "--frames CAMERA=FILE,...",
                        dir,
                        cap_is_video(dir) || cap_is_raw(dir) ? "one film"
                        : cap_is_image(dir)                  ? "one picture file"
                                                             : "a file");
    return PVX_OK;
}

static pvx_err scan_folder(struct frames_in *f, int64_t first, int64_t last, struct pvx_diag *d)
{
    size_t cams = f->rig->n_cameras;
    uint64_t none = 0;
    const char *name[REC_MAX_CAMERAS];
    struct cap_pairs p;
    PVX_TRY(frames_in_is_folder(f->dir, d));
    if ((f->reel = pvx_calloc(cams, sizeof *f->reel)) == NULL)
        return PVX_ENOMEM;
    for (size_t c = 0; c < cams; c++) {
        name[c] = f->rig->cameras[c].name;
        PVX_TRY(frames_in_find(f, c, &none, d));
    }
    PVX_TRY(frames_in_say_none(f, none, d));
    pvx_err e = cap_pairs_find(f->reel, name, cams, (enum cap_numbers)f->how.numbers,
                               f->kinds == FRAMES_IN_EACH, &p, d);
    for (char *rest = p.said, *line; (line = cap_said_next(&rest)) != NULL;)
        fprintf(stderr, "pyrovox: %s: %s\n", f->dir, line);
    free(p.said);
    f->number = p.number;
    f->t_ns = p.t_ns;
    f->row = p.row;
    return e == PVX_OK ? frames_in_choose(f, p.n, first, last, d) : e;
}

static pvx_err scan_take(struct frames_in *f, int64_t first, int64_t last, struct pvx_diag *d)
{
    PVX_TRY(cap_take_open(f->dir, &f->take, d));
    uint64_t sets = cap_take_info(f->take)->sets;
    size_t cams = f->rig->n_cameras;
    bool any = false;
    for (size_t c = 0; c < cams; c++) {
        f->take_camera[c] = cap_take_find(f->take, f->rig->cameras[c].name);
        any = any || f->take_camera[c] >= 0;
    }
    if (sets == 0 || !any)
        return pvx_fail(d, PVX_ENOENT, "%s: %s", f->dir,
                        any ? "no complete set in it" : "none of the rig's cameras is in it");
    take_notes(f->take);
    if (cap_take_set(f->take, sets - 1, NULL)->number > FRAMES_IN_LAST)
        return pvx_fail(d, PVX_ERANGE, "%s: its sets' numbers are too large", f->dir);
    f->number = pvx_calloc(sets, sizeof *f->number);
    f->row = pvx_calloc(sets * cams, sizeof *f->row);
    if (f->number == NULL || f->row == NULL)
        return PVX_ENOMEM;
    for (uint64_t k = 0; k < sets; k++) {
        const int64_t *member;
        f->number[k] = (int64_t)cap_take_set(f->take, k, &member)->number;
        for (size_t c = 0; c < cams; c++)
            f->row[k * cams + c] = f->take_camera[c] >= 0 ? member[f->take_camera[c]] : -1;
    }
    return frames_in_choose(f, sets, first, last, d);
}

/* ---- one set ---- */

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

/* Give a loaded image the pixel format that the user wants.  If it does not fit, the image is freed. */
static pvx_err read_as(const struct frames_in *f, const char *path, struct cap_loaded *l,
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

static pvx_err common_frames_in_load(const struct frames_in *f, struct frames_in_set s, size_t c,
                                     struct cap_loaded *l, struct pvx_diag *d)
{
    char room[CAP_REEL_NAME];
    PVX_TRY(f->take != NULL ? load_from_take(f, s.row[c], c, l, d)
                            : cap_reel_load(&f->reel[c], (size_t)s.row[c], l, d));
    return read_as(f, frames_in_name_of(f, s, c, room), l, d);
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
    if (j->s.row[c] >= 0 && common_frames_in_load(f, j->s, c, &f->loaded[c], &f->why[c]) == PVX_OK)
        f->image[c] = &f->loaded[c].img;
}

/* The pictures of the cameras in `which` end at so many bits: say it, once. */
static void frames_in_say_bits(const struct frames_in *f, uint64_t which, int bits,
                               enum cap_pixfmt fmt)
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
                          : frames_in_one(f, frames_in_set(f, i), out, frame, first);
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

/* Bin the float images, or all others.  Floats get no photometry: `calibrate background` wrote them with it. */
static pvx_err bin_some(struct frames_in *f, bool floats, const char *dir, float **out,
                        struct pvx_diag *d)
{
    const struct cap_image *some[REC_MAX_CAMERAS] = {0};
    struct frames_in plain = *f;
    dmn_images *images = f->images;
    pvx_err e = PVX_OK;
    uint64_t mask;
    for (size_t c = 0; c < f->rig->n_cameras; c++)
        if ((cap_pixfmt_layout(f->image[c]->fmt) == CAP_LAYOUT_F32) == floats)
            some[c] = f->image[c];
    if (floats && f->light != NULL) {
        plain.light = NULL;
        plain.images = NULL;
        e = frames_in_begin(&plain, f->binning, f->mosaic, d);
        images = plain.images;
    }
    if (e == PVX_OK)
        dmn_images_bin(images, some, out, &mask);
    for (size_t c = 0; c < f->rig->n_cameras && e == PVX_OK; c++)
        if (some[c] != NULL && !(mask >> c & 1))
            e = pvx_fail(d, PVX_EINVAL, "%s/%s: %s", dir, f->rig->cameras[c].name,
                         dmn_images_why(images, c));
    if (images != f->images)
        dmn_images_free(&images);
    return e;
}

pvx_err frames_in_background_file(const char *dir, const char *camera, char *path, size_t size,
                                  struct pvx_diag *d)
{
    struct dirent *e;
    size_t n = strlen(camera);
    DIR *h = opendir(dir);
    *path = '\0';
    pvx_err r =
        h != NULL ? PVX_OK : pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", dir, strerror(errno));
    while (h != NULL && r == PVX_OK && (e = readdir(h)) != NULL) {
        if (strncmp(e->d_name, camera, n) != 0 || strrchr(e->d_name, '.') != e->d_name + n ||
            !cap_is_image(e->d_name))
            continue;
        if (*path != '\0')
            r = pvx_fail(d, PVX_EINVAL, "%s and %s/%s: a camera has one background", path, dir,
                         e->d_name);
        else
            snprintf(path, size, "%s/%s", dir, e->d_name);
    }
    if (h != NULL)
        closedir(h);
    if (r == PVX_OK && *path == '\0')
        r = pvx_fail(d, PVX_ENOENT, "%s: no background %s.(npy|png|tif|jpg) for camera %s", dir,
                     camera, camera);
    return r;
}

pvx_err frames_in_background(struct frames_in *f, const char *dir, float **out, struct pvx_diag *d)
{
    char path[CAP_REEL_NAME];
    pvx_err e = PVX_OK;
    size_t n = 0;
    for (; n < f->rig->n_cameras && e == PVX_OK; n++) {
        const char *name = f->rig->cameras[n].name;
        f->loaded[n] = (struct cap_loaded){0};
        e = frames_in_background_file(dir, name, path, sizeof path, d);
        PVX_THEN(e, pvx_file_check(path, d));
        PVX_THEN(e, cap_image_load(path, &f->loaded[n], d));
        bool floats = cap_pixfmt_layout(f->loaded[n].img.fmt) == CAP_LAYOUT_F32;
        if (e == PVX_OK && !floats)
            e = read_as(f, path, &f->loaded[n], d);
        int channels = cap_pixfmt_channels(f->loaded[n].img.fmt);
        if (e == PVX_OK && f->kinds == FRAMES_IN_SAME && channels != f->nch)
            e = pvx_fail(d, PVX_EINVAL,
                         "%s: this background %s, the pictures of %s %s: take it with the same "
                         "camera (pyrovox calibrate background), or solve one channel (--grey)",
                         path, channels == 1 ? "is grey" : "has colour", name,
                         channels == 1 ? "have colour" : "are grey");
        f->image[n] = &f->loaded[n].img;
        out[n] = frames_in_room(f, n);
        if (e == PVX_OK && out[n] == NULL)
            e = pvx_fail(d, PVX_ENOMEM, "%s: no memory for backgrounds", dir);
    }
    PVX_THEN(e, bin_some(f, false, dir, out, d));
    PVX_THEN(e, bin_some(f, true, dir, out, d));
    for (size_t c = 0; c < n; c++)
        cap_loaded_free(&f->loaded[c]);
    return e;
}

/* ---- open and close ---- */

#define LOOKS 8 /* sets, spread over the recording */

/* What pictures of a camera showed of it. */
struct frames_in_seen {
    enum cap_pixfmt fmt;     /* NONE: no picture could be read */
    enum cap_transfer curve; /* of the first picture */
    size_t equal, different; /* pixels whose three samples are alike, and not */
    pvx_err e;               /* of the last one */
};

/* A sample as a number; full: its full scale, 0 for floats. */
static double frames_in_sample(const struct cap_image *img, int32_t x, int32_t y, int s,
                               double *full)
{
    const char *at = (const char *)img->data + y * img->stride;
    size_t i = (size_t)x * 3 + (size_t)s;
    uint16_t word;
    float f;
    if (cap_pixfmt_layout(img->fmt) == CAP_LAYOUT_8) {
        *full = 255;
        return (uint8_t)at[i];
    }
    if (cap_pixfmt_layout(img->fmt) == CAP_LAYOUT_16) {
        *full = 65535;
        memcpy(&word, at + i * sizeof word, sizeof word);
        return word;
    }
    *full = 0;
    memcpy(&f, at + i * sizeof f, sizeof f);
    return (double)f;
}

/* Count the pixels of a picture with three samples.  Black, white and what repeats its neighbour say nothing: a dark
 * picture of a colour camera has three equal samples too. */
static void frames_in_compare(const struct cap_image *img, struct frames_in_seen *s)
{
    for (int32_t y = 0; y < img->height; y += 1 + img->height / 256)
        for (int32_t x = 1; x < img->width; x++) {
            double full, v[3];
            for (int k = 0; k < 3; k++)
                v[k] = frames_in_sample(img, x, y, k, &full);
            bool same = v[0] == v[1] && v[1] == v[2];
            s->different += !same;
            s->equal += same && v[0] != 0 && v[0] != full &&
                        v[0] != frames_in_sample(img, x - 1, y, 0, &full);
        }
}

/* Note a picture.  Returns whether more pictures of this camera can say more. */
static bool frames_in_note(const struct cap_image *img, struct frames_in_seen *s,
                           struct cap_depth *depth)
{
    enum cap_layout l = cap_pixfmt_layout(img->fmt);
    bool words = cap_pixfmt_depth(img->fmt) == 16;
    bool three = cap_pixfmt_channels(img->fmt) == 3 && cap_pixfmt_bayer(img->fmt) == NULL &&
                 (l == CAP_LAYOUT_8 || l == CAP_LAYOUT_16 || l == CAP_LAYOUT_F32);
    s->curve = s->fmt == CAP_FMT_NONE ? cap_transfer_declared(img) : s->curve;
    s->fmt = s->fmt == CAP_FMT_NONE ? img->fmt : s->fmt;
    if (three)
        frames_in_compare(img, s);
    if (words)
        cap_depth_look(depth, img, 0, img->height, 1);
    return words || (three && s->different == 0);
}

/* Look at some of camera c's pictures, at least one that can be read. */
static void look_piece(void *ctx, size_t c)
{
    struct frames_in *f = ctx;
    struct frames_in_seen *s = &f->seen[c];
    size_t have = 0, k = 0;
    bool more = true;
    f->why[c].text[0] = '\0';
    for (size_t i = 0; i < f->n; i++)
        have += there(f, i, c);
    for (size_t i = 0; i < f->n && more && !cli_stop; i++) {
        struct cap_loaded l;
        struct pvx_diag why = {""};
        if (!there(f, i, c))
            continue;
        size_t parts = have > LOOKS ? have - 1 : 1;
        bool chosen = have <= LOOKS || k * (LOOKS - 1) % parts < LOOKS - 1;
        if (f->reel != NULL && f->reel[c].kind == CAP_REEL_FILM) /* read in order */
            chosen = k < LOOKS;
        k++;
        if (!chosen && s->fmt != CAP_FMT_NONE)
            continue;
        s->e = common_frames_in_load(f, frames_in_set(f, i), c, &l, &why);
        if (s->e != PVX_OK) {
            f->why[c] = f->why[c].text[0] == '\0' ? why : f->why[c];
            continue;
        }
        more = frames_in_note(&l.img, s, &f->depth[c]);
        cap_loaded_free(&l);
    }
}

/* Names of the cameras whose pictures are of that kind: 1 grey, 2 with colour, 3 grey in three samples. */
static int frames_in_kind(const struct frames_in_seen *s)
{
    bool grey = s->equal >= 64 && s->different == 0;
    return s->fmt == CAP_FMT_NONE ? 0 : cap_pixfmt_channels(s->fmt) == 1 ? 1 : grey ? 3 : 2;
}
static const char *frames_in_names(const struct frames_in *f, const struct frames_in_seen *seen,
                                   int kind, char *out, size_t size)
{
    out[0] = '\0';
    for (size_t c = 0; c < f->rig->n_cameras; c++)
        if (frames_in_kind(&seen[c]) == kind && strlen(out) + REC_NAME_MAX < size)
            snprintf(out + strlen(out), size - strlen(out), "%s%s", out[0] == '\0' ? "" : ", ",
                     f->rig->cameras[c].name);
    return out;
}

static pvx_err frames_in_two_kinds(const struct frames_in *f, const struct frames_in_seen *seen,
                                   int grey, struct pvx_diag *d)
{
    char a[200], b[200];
    return pvx_fail(d, PVX_EINVAL,
                    "%s: the pictures of %s are grey%s, those of %s have colour: solve one channel "
                    "from all (reconstruct --grey), or leave one kind out (--cameras A,B,...)",
                    f->dir, frames_in_names(f, seen, grey, a, sizeof a),
                    grey == 3 ? " (three equal samples in a pixel)" : "",
                    frames_in_names(f, seen, 2, b, sizeof b));
}

/* Say where a sample of one camera is another light than that of another: sRGB or floats beside linear integers. */
static void frames_in_say_scales(const struct frames_in *f, const struct frames_in_seen *seen)
{
    const char *coded = NULL, *linear = NULL, *floats = NULL, *whole = NULL;
    for (size_t c = 0; c < f->rig->n_cameras; c++) {
        const char *name = f->rig->cameras[c].name;
        if (seen[c].fmt == CAP_FMT_NONE)
            continue;
        *(seen[c].curve == CAP_TRANSFER_LINEAR ? &linear : &coded) = name;
        *(cap_pixfmt_layout(seen[c].fmt) == CAP_LAYOUT_F32 ? &floats : &whole) = name;
    }
    if (coded != NULL && linear != NULL && f->how.transfer == CAP_TRANSFER_AUTO)
        fprintf(stderr,
                "pyrovox: %s: samples of %s are decoded (JPEG, and films that name a transfer "
                "function), those of %s are taken as light; if all cameras code alike, say "
                "--transfer srgb or linear\n",
                f->dir, coded, linear);
    if (floats != NULL && whole != NULL)
        fprintf(
            stderr,
            "pyrovox: %s: samples of %s are floats, taken as they are, those of %s are integers, "
            "where 1.0 is full scale; they must have one unit\n",
            f->dir, floats, whole);
}

/* Set the number of channels, from pictures of all cameras. */
static pvx_err frames_in_look(struct frames_in *f, struct pvx_diag *d)
{
    struct frames_in_seen seen[REC_MAX_CAMERAS] = {0};
    bool has[4] = {false};
    size_t bad = REC_MAX_CAMERAS;
    f->seen = seen;
    pvx_pool_run(f->pool, f->rig->n_cameras, look_piece, f);
    f->seen = NULL;
    for (int bits = 10; bits < 16; bits++) {
        uint64_t which = 0;
        enum cap_pixfmt fmt = CAP_FMT_NONE;
        for (size_t c = 0; c < f->rig->n_cameras; c++)
            if (cap_depth_bits(&f->depth[c], 1) == bits) {
                which |= 1ull << c;
                fmt = seen[c].fmt;
            }
        if (which != 0)
            frames_in_say_bits(f, which, bits, fmt);
    }
    for (size_t c = 0; c < f->rig->n_cameras; c++) {
        enum cap_pixfmt fmt = seen[c].fmt;
        bad = bad == REC_MAX_CAMERAS && f->why[c].text[0] != '\0' ? c : bad;
        has[frames_in_kind(&seen[c])] = true;
        if (f->black > 1 && fmt != CAP_FMT_NONE && cap_pixfmt_layout(fmt) != CAP_LAYOUT_F32)
            return pvx_fail(d, PVX_EINVAL,
                            "--black %g: should be 0 to 1, a share of full scale, for the %s "
                            "pictures of %s",
                            f->black, cap_pixfmt_name(fmt), f->rig->cameras[c].name);
    }
    frames_in_say_scales(f, seen);
    if (!has[1] && !has[2] && !has[3])
        return bad == REC_MAX_CAMERAS ? PVX_ECANCELED
                                      : pvx_fail(d, seen[bad].e, "%s", f->why[bad].text);
    f->nch = f->kinds == FRAMES_IN_GREY || !(has[2] || has[3]) ? 1 : 3;
    f->grey = 0;
    for (size_t c = 0; c < f->rig->n_cameras && has[2]; c++)
        f->grey |= (uint64_t)(frames_in_kind(&seen[c]) % 2) << c; /* 1 or 3 */
    if (f->kinds == FRAMES_IN_SAME && f->grey != 0)
        return frames_in_two_kinds(f, seen, has[1] ? 1 : 3, d);
    if (f->kinds == FRAMES_IN_SAME && has[1] && has[3])
        f->kinds = FRAMES_IN_EACH; /* all are grey */
    return PVX_OK;
}

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
    pvx_err e = vol_hdf5_name(dir) && !frames_in_is_list(dir) ? scan_take(f, first, last, d)
                                                              : scan_folder(f, first, last, d);
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
        if (!there(f, i, c))
            return false;
    return true;
}
