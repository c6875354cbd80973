/* find.c - find the cameras and the pictures: folders, videos or a take. */
#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/mem.h"
#include "capture/files/said.h"
#include "capture/files/sequence.h"
#include "daemon/cli/calibrate/look.h"
#include "daemon/cli/common/take_notes.h"

size_t calibrate_camera(const struct calibrate_look *l, const char *name, size_t len)
{
    size_t c = 0;
    while (c < l->n_cameras &&
           (strlen(l->camera[c].name) != len || memcmp(l->camera[c].name, name, len) != 0))
        c++;
    return c;
}

/* Add a camera.  Messages use `where` and `what` to say where the name was found. */
static pvx_err find_add_camera(struct calibrate_look *l, const char *where, const char *what,
                               const char *name, struct pvx_diag *d)
{
    if (!rec_rig_name_ok(name))
        return pvx_fail(
            d, PVX_EINVAL,
            "%s: %s has a name that no camera can have: letters, digits and . _ - only, at most %d",
            where, what, REC_NAME_MAX - 1);
    if (calibrate_camera(l, name, strlen(name)) < l->n_cameras)
        return pvx_fail(d, PVX_EINVAL, "%s: there is more than one %s", where, name);
    if (l->n_cameras == REC_MAX_CAMERAS)
        return pvx_fail(d, PVX_ERANGE, "%s: more than %d cameras", where, REC_MAX_CAMERAS);
    snprintf(l->camera[l->n_cameras++].name, REC_NAME_MAX, "%s", name);
    return PVX_OK;
}

/* Add the camera of a folder, a film or a stack.  A folder without pictures is said, and no camera. */
static pvx_err find_add_reel(struct calibrate_look *l, const char *dir, const char *path,
                             const char *name, struct pvx_diag *d)
{
    struct pvx_diag why = {""};
    struct cap_reel r;
    const bool film = cap_is_video(path);
    bool mixed = l->n_reels > 0 && cap_reel_timed(&l->reel[0]) != film;
    if (film)
        PVX_TRY(find_add_camera(l, dir, "a video", name, d));
    r = (struct cap_reel){0};
    pvx_err e = film && mixed ? PVX_EINVAL : cap_reel_open(path, &r, &why);
    if (e == PVX_OK && r.raw.filter)
        e = pvx_fail(&why, PVX_EUNSUP,
                     "%s: its pictures have a colour filter, but it does not say which: save them "
                     "as grey or as TIFF",
                     r.path[0]);
    if (e == PVX_OK && !film)
        e = find_add_camera(l, dir, "a folder with pictures in it", name, &why);
    if (e == PVX_OK && l->n_reels > 0)
        mixed = cap_reel_timed(&r) != cap_reel_timed(&l->reel[0]);
    if (mixed && (film || e == PVX_OK))
        e = pvx_fail(&why, PVX_EINVAL,
                     "%s: folders with pictures and videos side by side: give a folder with "
                     "pictures or one with videos",
                     dir);
    for (char *rest = r.said, *line; e == PVX_OK && (line = cap_said_next(&rest)) != NULL;)
        fprintf(stderr, "pyrovox: camera %s: %s\n", name, line);
    if (e == PVX_OK) {
        l->reel[l->n_reels++] = r;
        if (r.kind != CAP_REEL_PICTURES)
            l->source = CALIBRATE_REELS;
        return PVX_OK;
    }
    cap_reel_close(&r);
    if (e == PVX_ENOENT && !film) {
        fprintf(stderr, "pyrovox: %s\n", why.text);
        return PVX_OK;
    }
    return e == PVX_ENOMEM ? e : pvx_fail(d, e, "%s", pvx_diag_text(&why, e));
}

static pvx_err add_entry(struct calibrate_look *l, const char *dir, const char *name,
                         struct pvx_diag *d)
{
    char path[4096], camera[256];
    struct stat st;
    uint32_t pages = 0;
    if (snprintf(path, sizeof path, "%s/%s", dir, name) >= (int)sizeof path)
        return pvx_fail(d, PVX_ERANGE, "%.80s...: name too long", dir);
    if (stat(path, &st) != 0)
        return PVX_OK;
    if (S_ISDIR(st.st_mode))
        return find_add_reel(l, dir, path, name, d);
    struct pvx_diag why = {""};
    bool film = cap_is_video(name);
    pvx_err e = PVX_OK;
    if (!film && cap_is_image(name))
        e = cap_image_pages(path, &pages, &why);
    else if (cap_is_unknown(name))
        e = pvx_fail(&why, PVX_EUNSUP,
                     "%s: no type that is read (" CAP_IMAGES " " CAP_VIDEOS "): left out", path);
    if (e != PVX_OK)
        fprintf(stderr, "pyrovox: %s\n", pvx_diag_text(&why, e));
    if (!film && pages < 2)
        return PVX_OK;
    snprintf(camera, sizeof camera, "%.*s", (int)(strrchr(name, '.') - name), name);
    return find_add_reel(l, dir, path, camera, d);
}

/* Which pictures are of one instant, and the list of them where all are looked at. */
static pvx_err find_pair(struct calibrate_look *l, const char *dir, struct pvx_diag *d)
{
    const char *name[REC_MAX_CAMERAS];
    struct cap_pairs *p = &l->pairs;
    bool pictures = l->source == CALIBRATE_FOLDERS;
    for (size_t c = 0; c < l->n_cameras; c++)
        name[c] = l->camera[c].name;
    pvx_err e = cap_pairs_find(l->reel, name, l->n_cameras, l->numbers,
                               pictures && l->numbers == CAP_NUMBERS_COUNT, p, d);
    for (char *rest = p->said, *line; (line = cap_said_next(&rest)) != NULL;)
        fprintf(stderr, "pyrovox: %s: %s\n", dir, line);
    PVX_TRY(e);
    for (size_t c = 0; c < l->n_cameras; c++) {
        const struct cap_reel *r = &l->reel[c];
        if (r->kind == CAP_REEL_PICTURES && l->numbers == CAP_NUMBERS_COUNT &&
            r->frame[r->n - 1].at >= REC_NO_FRAME)
            return pvx_fail(d, PVX_ERANGE,
                            "%s: its number is too large; if it is a time, say --numbers ms, us or "
                            "ns",
                            r->path[r->n - 1]);
        l->n += pictures ? r->n : 0;
    }
    if (l->n == 0)
        return PVX_OK;
    if ((l->picture = pvx_calloc(l->n, sizeof *l->picture)) == NULL)
        return PVX_ENOMEM;
    l->n = 0;
    for (uint32_t c = 0; c < l->n_cameras; c++)
        for (size_t k = 0; k < p->n; k++) {
            int64_t row = p->row[k * l->n_cameras + c];
            if (row < 0)
                continue;
            struct calibrate_picture *to = &l->picture[l->n++];
            *to = (struct calibrate_picture){.camera = c,
                                             .frame = (uint32_t)p->number[k],
                                             .path = strdup(l->reel[c].path[row]),
                                             .at = CALIBRATE_NO_VIEW};
            l->count[c].pictures++;
            if (to->path == NULL)
                return PVX_ENOMEM;
        }
    return PVX_OK;
}

static int find_by_name(const void *a, const void *b)
{
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

static pvx_err find_take(struct calibrate_look *l, const char *path, struct pvx_diag *d)
{
    const char *name[REC_MAX_CAMERAS];
    size_t n = 0;
    PVX_TRY(cap_take_open(path, &l->take, d));
    const struct cap_take_info *info = cap_take_info(l->take);
    l->source = CALIBRATE_TAKE;
    if (info->sets == 0)
        return pvx_fail(d, PVX_ENOENT, "%s: no complete set in it", path);
    take_notes(l->take);
    if (cap_take_set(l->take, info->sets - 1, NULL)->number >= REC_NO_FRAME)
        return pvx_fail(d, PVX_ERANGE, "%s: its sets' numbers are too large", path);
    for (uint32_t c = 0; c < info->head.n_cameras && n < REC_MAX_CAMERAS; c++)
        if (info->head.camera[c].frames > 0)
            name[n++] = info->head.camera[c].name;
        else
            snprintf(l->said, sizeof l->said, "; %s is in it without a frame",
                     rec_rig_name_ok(info->head.camera[c].name) ? info->head.camera[c].name
                                                                : "a camera");
    qsort(name, n, sizeof *name, find_by_name);
    for (size_t c = 0; c < n; c++) {
        PVX_TRY(find_add_camera(l, path, "a camera", name[c], d));
        l->take_camera[c] = cap_take_find(l->take, name[c]);
    }
    return (l->path = strdup(path)) != NULL ? PVX_OK : PVX_ENOMEM;
}

pvx_err calibrate_find(struct calibrate_look *l, const char *path, enum cap_numbers numbers,
                       struct pvx_diag *d)
{
    struct dirent **entry;
    struct stat st;
    *l = (struct calibrate_look){.always = REC_NO_FRAME, .to = REC_NO_FRAME, .numbers = numbers};
    bool there = stat(path, &st) == 0;
    if (there && S_ISREG(st.st_mode) && (cap_is_video(path) || cap_is_image(path)))
        return pvx_fail(d, PVX_EINVAL,
                        "%s: is one file: give the folder that has a folder of pictures or a video "
                        "for each camera",
                        path);
    if (there && S_ISREG(st.st_mode))
        return find_take(l, path, d);
    int n = scandir(path, &entry, NULL, alphasort);
    if (n < 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", path, strerror(errno));
    pvx_err e = PVX_OK;
    for (int i = 0; i < n; i++) {
        if (e == PVX_OK && entry[i]->d_name[0] != '.')
            e = add_entry(l, path, entry[i]->d_name, d);
        free(entry[i]);
    }
    free(entry);
    if (e == PVX_OK && l->n_cameras == 0)
        e = pvx_fail(d, PVX_ENOENT,
                     "%s: no pictures; looked for %s/<camera>/<number>.(npy|png|tif|jpg) and "
                     "%s/<camera>.(mp4|avi|mkv|mov|cine|mraw)",
                     path, path, path);
    return e == PVX_OK ? find_pair(l, path, d) : e;
}
