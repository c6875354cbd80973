/* find.c - find the cameras and the pictures: folders, videos or a take. */
#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

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
            "%s: %s has a name that no camera can have: letters, digits and . _ - only, at "
            "most %d",
            where, what, REC_NAME_MAX - 1);
    if (calibrate_camera(l, name, strlen(name)) < l->n_cameras)
        return pvx_fail(d, PVX_EINVAL, "%s: there is more than one %s", where, name);
    if (l->n_cameras == REC_MAX_CAMERAS)
        return pvx_fail(d, PVX_ERANGE, "%s: more than %d cameras", where, REC_MAX_CAMERAS);
    snprintf(l->camera[l->n_cameras++].name, REC_NAME_MAX, "%s", name);
    return PVX_OK;
}

static pvx_err find_add_folder(struct calibrate_look *l, const char *dir, const char *path,
                               const char *name, struct pvx_diag *d)
{
    struct cap_sequence s;
    pvx_err e = cap_sequence_find(path, &s, d);
    if (e == PVX_ENOENT && d != NULL) /* the folder has no pictures */
        d->text[0] = '\0';
    if (e != PVX_OK) {
        cap_sequence_free(&s);
        return e == PVX_ENOENT ? PVX_OK : e;
    }
    uint32_t c = (uint32_t)l->n_cameras;
    struct calibrate_picture *more = NULL;
    e = find_add_camera(l, dir, "a folder with pictures in it", name, d);
    if (e == PVX_OK && s.item[s.n - 1].number >= REC_NO_FRAME)
        e = pvx_fail(d, PVX_ERANGE, "%s: its number is too large", s.item[s.n - 1].path);
    if (e == PVX_OK && (more = realloc(l->picture, (l->n + s.n) * sizeof *more)) == NULL)
        e = PVX_ENOMEM;
    if (e == PVX_OK) {
        l->picture = more;
        for (size_t i = 0; i < s.n; i++) {
            l->picture[l->n++] = (struct calibrate_picture){.camera = c,
                                                            .frame = (uint32_t)s.item[i].number,
                                                            .path = s.item[i].path,
                                                            .at = CALIBRATE_NO_VIEW};
            s.item[i].path = NULL;
        }
        l->count[c].pictures = s.n;
    }
    cap_sequence_free(&s);
    return e;
}

static pvx_err add_video(struct calibrate_look *l, const char *dir, const char *path,
                         const char *name, struct pvx_diag *d)
{
    char camera[256];
    size_t c = l->n_cameras;
    snprintf(camera, sizeof camera, "%.*s", (int)(strrchr(name, '.') - name), name);
    PVX_TRY(find_add_camera(l, dir, "a video", camera, d));
    l->source = CALIBRATE_VIDEOS;
    return (l->video[c] = strdup(path)) != NULL ? PVX_OK : PVX_ENOMEM;
}

static pvx_err add_entry(struct calibrate_look *l, const char *dir, const char *name,
                         struct pvx_diag *d)
{
    char path[4096];
    struct stat st;
    if (snprintf(path, sizeof path, "%s/%s", dir, name) >= (int)sizeof path)
        return pvx_fail(d, PVX_ERANGE, "%.80s...: name too long", dir);
    if (stat(path, &st) != 0)
        return PVX_OK;
    if (S_ISDIR(st.st_mode))
        PVX_TRY(find_add_folder(l, dir, path, name, d));
    else if (cap_is_video(name))
        PVX_TRY(add_video(l, dir, path, name, d));
    if (l->n > 0 && l->source == CALIBRATE_VIDEOS)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: folders with pictures and videos side by side: give a "
                        "folder with pictures or one with videos",
                        dir);
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
    return (l->video[0] = strdup(path)) != NULL ? PVX_OK : PVX_ENOMEM;
}

pvx_err calibrate_find(struct calibrate_look *l, const char *path, struct pvx_diag *d)
{
    struct dirent **entry;
    struct stat st;
    *l = (struct calibrate_look){.always = REC_NO_FRAME, .to = REC_NO_FRAME};
    if (stat(path, &st) == 0 && S_ISREG(st.st_mode))
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
                     "%s/<camera>.(mp4|avi|mkv|mov)",
                     path, path, path);
    return e;
}
