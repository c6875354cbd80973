/* frames_find.c - the frames of a folder, of a list or of a take, set by set. */
#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/mem.h"
#include "capture/files/said.h"
#include "capture/files/sequence.h"
#include "daemon/cli/common/frames_in_impl.h"
#include "daemon/cli/common/take_notes.h"
#include "daemon/volumes/volumes.h"

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
bool frames_in_is_list(const char *text)
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

/* Where the frames of camera c are: `named` by a list, or in the folder; owner: caller, free().  PVX_ENOENT: nowhere. */
static pvx_err frames_in_place(const struct frames_in *f, size_t c, const char *named, char **path,
                               struct pvx_diag *d)
{
    if (!frames_in_is_list(f->dir))
        return cap_reel_of(f->dir, f->rig->cameras[c].name, path, d);
    *path = named != NULL ? strdup(named) : NULL;
    return named == NULL ? PVX_ENOENT : *path == NULL ? PVX_ENOMEM : PVX_OK;
}

/* Find the frames of camera c.  *none: there are none. */
static pvx_err find_camera(struct frames_in *f, size_t c, const char *named, uint64_t *none,
                           struct pvx_diag *d)
{
    const char *camera = f->rig->cameras[c].name;
    char *path;
    struct pvx_diag why = {""};
    pvx_err e = frames_in_place(f, c, named, &path, &why);
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

/* Find the frames of all cameras, in the folder or as the list names them. */
static pvx_err find_cameras(struct frames_in *f, struct pvx_diag *d)
{
    char *named[REC_MAX_CAMERAS] = {NULL}, *text = NULL;
    uint64_t none = 0;
    pvx_err e = PVX_OK;
    if (frames_in_is_list(f->dir)) {
        text = strdup(f->dir);
        e = text != NULL ? frames_in_list(f, text, named, d) : PVX_ENOMEM;
    }
    for (size_t c = 0; c < f->rig->n_cameras && e == PVX_OK; c++)
        e = find_camera(f, c, named[c], &none, d);
    free(text);
    return e == PVX_OK ? frames_in_say_none(f, none, d) : e;
}

static pvx_err scan_folder(struct frames_in *f, int64_t first, int64_t last, struct pvx_diag *d)
{
    size_t cams = f->rig->n_cameras;
    const char *name[REC_MAX_CAMERAS];
    struct cap_pairs p;
    PVX_TRY(frames_in_is_folder(f->dir, d));
    if ((f->reel = pvx_calloc(cams, sizeof *f->reel)) == NULL)
        return PVX_ENOMEM;
    PVX_TRY(find_cameras(f, d));
    for (size_t c = 0; c < cams; c++)
        name[c] = f->rig->cameras[c].name;
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

pvx_err frames_in_find(struct frames_in *f, int64_t first, int64_t last, struct pvx_diag *d)
{
    bool take = vol_hdf5_name(f->dir) && !frames_in_is_list(f->dir);
    return take ? scan_take(f, first, last, d) : scan_folder(f, first, last, d);
}
