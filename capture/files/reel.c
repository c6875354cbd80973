#include "capture/files/reel.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/median.h"
#include "base/mem.h"
#include "capture/files/said.h"
#include "capture/files/sequence.h"

#define GAP 1.5 /* steps: from here on a frame is missing */

/* ---- what a folder has ------------------------------------------------------------------------ */

static bool reel_is_folder(const char *path)
{
    struct stat st;
    return stat(path, &st) == 0 && S_ISDIR(st.st_mode);
}

/* Whether the file, or folder, of this name belongs to the camera.  NULL: to any. */
static bool reel_belongs(const char *file, const char *path, const char *camera)
{
    size_t n = camera != NULL ? strlen(camera) : 0;
    const char *dot = strrchr(file, '.');
    if (*file == '.')
        return false;
    if (camera == NULL)
        return cap_is_video(file) && !reel_is_folder(path);
    if (strcmp(file, camera) == 0)
        return reel_is_folder(path);
    uint32_t pages; /* a picture of one page is a background, not a stack */
    return dot != NULL && (size_t)(dot - file) == n && memcmp(file, camera, n) == 0 &&
           (cap_is_video(file) ||
            (cap_is_stack(file) && (cap_image_pages(path, &pages, NULL) != PVX_OK || pages > 1)));
}

/* The one file or folder in `dir` that belongs to the camera; camera NULL: the one film.  *out NULL: there is none. */
static pvx_err reel_one_of(const char *dir, const char *camera, char **out, struct pvx_diag *d)
{
    struct dirent *f;
    pvx_err e = PVX_OK;
    DIR *h = opendir(dir);
    *out = NULL;
    if (h == NULL)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", dir, strerror(errno));
    while (e == PVX_OK && (f = readdir(h)) != NULL) {
        char *path;
        if (asprintf(&path, "%s/%s", dir, f->d_name) < 0) {
            e = PVX_ENOMEM;
        } else if (!reel_belongs(f->d_name, path, camera)) {
            free(path);
        } else if (*out == NULL) {
            *out = path;
        } else {
            e = pvx_fail(d, PVX_EINVAL, "%s and %s: one camera has one of them%s", *out, path,
                         camera == NULL ? "; join films that follow each other into one, or name "
                                          "the one that is meant: --frames CAMERA=FILE,..."
                                        : "");
            free(path);
        }
    }
    closedir(h);
    if (e != PVX_OK)
        PVX_FREE(*out);
    return e;
}

pvx_err cap_reel_of(const char *dir, const char *camera, char **path, struct pvx_diag *d)
{
    PVX_TRY(reel_one_of(dir, camera, path, d));
    return *path != NULL ? PVX_OK : PVX_ENOENT;
}

/* ---- open ------------------------------------------------------------------------------------- */

static pvx_err reel_open_raw(struct cap_reel *r, const char *path, struct pvx_diag *d)
{
    r->kind = CAP_REEL_RAW;
    PVX_TRY(cap_raw_open(path, &r->raw, d));
    r->frame = pvx_calloc(r->raw.n + 1, sizeof *r->frame);
    r->path = pvx_calloc(1, sizeof *r->path);
    if (r->frame == NULL || r->path == NULL || (r->path[0] = strdup(r->raw.path)) == NULL)
        return PVX_ENOMEM;
    r->files = 1;
    for (; r->n < r->raw.n; r->n++)
        r->frame[r->n] = (struct cap_reel_frame){.at = r->raw.frame[r->n].t_ns};
    r->said = r->raw.said;
    r->raw.said = NULL;
    return PVX_OK;
}

static pvx_err reel_open_film(struct cap_reel *r, const char *path, struct pvx_diag *d)
{
    int64_t *t;
    if (cap_is_raw(path))
        return reel_open_raw(r, path, d);
    r->kind = CAP_REEL_FILM;
    PVX_TRY(cap_video_times(path, &t, &r->n, d));
    r->frame = pvx_calloc(r->n + 1, sizeof *r->frame);
    r->path = pvx_calloc(1, sizeof *r->path);
    pvx_err e = r->frame != NULL && r->path != NULL && (r->path[0] = strdup(path)) != NULL
                    ? PVX_OK
                    : PVX_ENOMEM;
    r->files = r->path != NULL;
    for (size_t i = 0; i < r->n && e == PVX_OK; i++)
        r->frame[i].at = t[i];
    free(t);
    return e == PVX_OK && r->n == 0 ? pvx_fail(d, PVX_EFORMAT, "%s: no frame in it", path) : e;
}

static pvx_err reel_add_pages(struct cap_reel *r, size_t file, struct pvx_diag *d)
{
    uint32_t pages;
    PVX_TRY(cap_image_pages(r->path[file], &pages, d));
    void *more = realloc(r->frame, (r->n + pages) * sizeof *r->frame);
    if (more == NULL)
        return PVX_ENOMEM;
    r->frame = more;
    for (uint32_t p = 0; p < pages; p++, r->n++)
        r->frame[r->n] =
            (struct cap_reel_frame){.at = (int64_t)r->n, .file = (uint32_t)file, .page = p};
    return PVX_OK;
}

/* Whether the numbered files go on with the one that has no number: a dark beside a recording is no part of it. */
static bool reel_goes_on(const struct cap_sequence *s)
{
    const char *first = s->first_unnumbered;
    size_t n = strlen(first), dot;
    while (n > 0 && first[n - 1] != '/')
        n--;
    dot = n + strcspn(first + n, ".");
    for (size_t i = 0; i < s->n; i++)
        if (strncmp(s->item[i].path, first, dot) != 0)
            return false;
    return true;
}

/* The pages of all files.  The number of a page is known only if no file is missing. */
static pvx_err reel_open_pages(struct cap_reel *r, const struct cap_sequence *s, struct pvx_diag *d)
{
    r->kind = CAP_REEL_PAGES;
    if (s->unnumbered > 1)
        return pvx_fail(d, PVX_EINVAL,
                        "%s and others have no number: nothing tells the order of the files",
                        s->first_unnumbered);
    size_t before = r->files - s->n; /* the file without a number */
    r->begin = s->n > 0 ? s->item[0].number - (int64_t)before : -1;
    for (size_t i = 1; i < s->n; i++)
        if (s->item[i].number != s->item[i - 1].number + 1)
            return pvx_fail(d, PVX_EINVAL,
                            "%s and %s: a file is missing between them, so it is not known which "
                            "frames the pages of the second are",
                            r->path[before + i - 1], r->path[before + i]);
    for (size_t i = 0; i < r->files; i++)
        PVX_TRY(reel_add_pages(r, i, d));
    return PVX_OK;
}

static pvx_err reel_open_pictures(struct cap_reel *r, struct cap_sequence *s, struct pvx_diag *d)
{
    bool stack = s->unnumbered == 1 && cap_is_stack(s->first_unnumbered);
    bool first = stack && reel_goes_on(s);
    uint32_t pages = 1;
    if ((r->path = pvx_calloc(s->n + 1, sizeof *r->path)) == NULL)
        return PVX_ENOMEM;
    const char *look = first ? s->first_unnumbered : s->n > 0 ? s->item[0].path : "";
    if (cap_is_stack(look))
        PVX_TRY(cap_image_pages(look, &pages, d));
    if (pages > 1 && stack && !first)
        return pvx_fail(d, PVX_EINVAL,
                        "%s has no number, and the names of the others, as %s, do not begin as its "
                        "own: give it a number, or move it away if it is no part of the recording",
                        s->first_unnumbered, s->item[0].path);
    if (pages > 1 && first && (r->path[r->files++] = strdup(look)) == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < s->n; i++) {
        r->path[r->files++] = s->item[i].path;
        s->item[i].path = NULL;
    }
    if (pages > 1)
        return reel_open_pages(r, s, d);
    if ((r->frame = pvx_calloc(s->n + 1, sizeof *r->frame)) == NULL)
        return PVX_ENOMEM;
    for (; r->n < s->n; r->n++)
        r->frame[r->n] = (struct cap_reel_frame){s->item[r->n].number, (uint32_t)r->n, 0};
    while (r->other < r->n && cap_is_jpeg(r->path[r->other]) == cap_is_jpeg(r->path[0]))
        r->other++;
    r->other %= r->n > 0 ? r->n : 1;
    if (s->odd > 0)
        PVX_TRY(cap_said_add(&r->said, "%s and %s are names of two kinds; both are frames",
                             r->path[0], r->path[s->odd]));
    if (s->unnumbered > 0)
        PVX_TRY(cap_said_add(&r->said, "pictures without a number are left out: %s%s",
                             s->first_unnumbered, s->unnumbered > 1 ? " and others" : ""));
    return PVX_OK;
}

pvx_err cap_reel_open(const char *name, struct cap_reel *r, struct pvx_diag *d)
{
    char *film = NULL;
    struct stat st;
    struct cap_sequence s;
    struct pvx_diag why = {""};
    *r = (struct cap_reel){0};
    if (reel_is_folder(name))
        PVX_TRY(reel_one_of(name, NULL, &film, d));
    else if ((cap_is_video(name) || cap_is_raw(name)) &&
             (stat(name, &st) == 0 || strpbrk(name, "%*?[") == NULL))
        return reel_open_film(r, name, d);
    pvx_err e = cap_sequence_find(name, &s, &why);
    if (film != NULL && s.n > 0)
        e = pvx_fail(&why, PVX_EINVAL, "%s and %s: pictures beside a film; keep one of them there",
                     s.item[0].path, film);
    else if (film != NULL)
        e = reel_open_film(r, film, &why);
    else if (e == PVX_OK || (e == PVX_ENOENT && s.unnumbered > 0))
        e = reel_open_pictures(r, &s, &why);
    if (e == PVX_OK && r->n == 0)
        e = PVX_ENOENT;
    if (e == PVX_OK && s.unknown > 0)
        e = cap_said_add(&r->said,
                         "%s%s: no type that is read (" CAP_IMAGES " " CAP_VIDEOS
                         "): left out; save pictures as one of these, and move "
                         "away what is none",
                         s.first_unknown, s.unknown > 1 ? " and others" : "");
    cap_sequence_free(&s);
    free(film);
    return e == PVX_OK ? e : pvx_fail(d, e, "%s", pvx_diag_text(&why, e));
}

void cap_reel_close(struct cap_reel *r)
{
    for (size_t i = 0; i < r->files; i++)
        free(r->path[i]);
    free(r->path);
    free(r->frame);
    free(r->said);
    cap_video_close(&r->video);
    cap_raw_close(&r->raw);
    *r = (struct cap_reel){0};
}

/* ---- frames ----------------------------------------------------------------------------------- */

/* Read on to frame i.  A frame's time says which it is, because one that cannot be decoded is not given. */
static pvx_err reel_load_of_film(struct cap_reel *r, size_t i, struct cap_image *img,
                                 struct pvx_diag *d)
{
    char room[CAP_REEL_NAME];
    bool skip = false, held = r->held.data != NULL && i + 1 == r->next;
    pvx_err e = PVX_OK;
    *img = r->held;
    r->held = (struct cap_image){0};
    if (held)
        return PVX_OK;
    if (r->video == NULL || i < r->next) {
        cap_video_close(&r->video);
        r->next = 0;
        PVX_TRY(cap_video_open(r->path[0], &r->video, NULL, d));
    }
    while (r->next <= i) {
        int64_t t;
        skip = r->next < i;
        if ((e = cap_video_next(r->video, skip ? NULL : img, &t, d)) == PVX_ECLOSED)
            break;
        PVX_TRY(e);
        while (r->next < r->n && r->frame[r->next].at < t)
            r->next++;
        r->next++;
    }
    if (e == PVX_OK && !skip && i + 1 == r->next)
        return PVX_OK;
    if (e == PVX_OK && !skip) /* a later one */
        r->held = *img;
    return pvx_fail(d, PVX_ECORRUPT, "%s cannot be decoded", cap_reel_name(r, i, room));
}

pvx_err cap_reel_load(struct cap_reel *r, size_t i, struct cap_loaded *out, struct pvx_diag *d)
{
    const struct cap_reel_frame *f = &r->frame[i];
    *out = (struct cap_loaded){0};
    switch (r->kind) {
    case CAP_REEL_FILM: return reel_load_of_film(r, i, &out->img, d);
    case CAP_REEL_RAW: return cap_raw_load(&r->raw, i, &out->img, d);
    case CAP_REEL_PAGES: return cap_image_load_page(r->path[f->file], f->page, out, d);
    default: return cap_image_load(r->path[f->file], out, d);
    }
}

const char *cap_reel_name(const struct cap_reel *r, size_t i, char room[CAP_REEL_NAME])
{
    const char *path = r->path[r->frame[i].file];
    if (r->kind == CAP_REEL_FILM)
        snprintf(room, CAP_REEL_NAME, "%s: frame %zu at %.4f s", path, i,
                 (double)r->frame[i].at * 1e-9);
    else if (r->kind == CAP_REEL_RAW)
        snprintf(room, CAP_REEL_NAME, "%s: image %d at %.6f s", path, r->raw.frame[i].number,
                 (double)r->frame[i].at * 1e-9);
    else if (r->kind == CAP_REEL_PAGES)
        snprintf(room, CAP_REEL_NAME, "%s: page %u", path, r->frame[i].page + 1);
    return r->kind == CAP_REEL_PICTURES ? path : room;
}

bool cap_reel_timed(const struct cap_reel *r)
{
    return r->kind == CAP_REEL_FILM || r->kind == CAP_REEL_RAW;
}

double cap_reel_step(const struct cap_reel *r)
{
    size_t n = r->n > 0 ? r->n - 1 : 0, usual = 0;
    double sum = 0, *step = pvx_calloc(n, sizeof *step);
    for (size_t i = 0; i < n && step != NULL; i++)
        step[i] = (double)(r->frame[i + 1].at - r->frame[i].at);
    if (n > 0 && step != NULL)
        qsort(step, n, sizeof *step, pvx_ascending);
    for (size_t i = 0; i < n && step != NULL; i++)
        if (step[i] <= GAP * step[(n - 1) / 2] && step[i] * GAP >= step[(n - 1) / 2]) {
            sum += step[i];
            usual++;
        }
    free(step);
    return usual > 0 ? sum / (double)usual : 0;
}
