#include "daemon/cli/pictures/film.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/files/imgio.h"
#include "daemon/cli/pictures/ffmpeg.h"

struct film {
    char *path;
    int fps;
    struct look look;
    int32_t w, h;
    int nch;
    uint8_t *samples; /* NULL: no picture yet */
    cap_apng *apng;   /* one of them */
    ffmpeg *video;
};

enum film_kind film_kind(const char *path)
{
    size_t n = strlen(path);
    if (n > 5 && strcmp(path + n - 5, ".apng") == 0)
        return FILM_APNG;
    return ffmpeg_can(path) ? FILM_VIDEO : FILM_NONE;
}

pvx_err film_new(const char *path, int fps, const struct look *look, struct film **out,
                 struct pvx_diag *d)
{
    *out = NULL;
    if (film_kind(path) == FILM_NONE)
        return pvx_fail(d, PVX_EINVAL, "%s: a film is an .apng, .mp4, .mov, .mkv or .webm", path);
    struct film *f = pvx_calloc(1, sizeof *f);
    if (f == NULL || (f->path = strdup(path)) == NULL) {
        free(f);
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a film", path);
    }
    f->fps = fps;
    f->look = *look;
    f->look.depth = 8;
    *out = f;
    return PVX_OK;
}

static pvx_err film_begin(struct film *f, int32_t w, int32_t h, int nch, struct pvx_diag *d)
{
    f->w = w;
    f->h = h;
    f->nch = nch;
    f->samples = pvx_calloc((size_t)w * (size_t)h, (size_t)nch);
    if (f->samples == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a picture", f->path);
    return film_kind(f->path) == FILM_APNG ? cap_apng_begin(f->path, w, h, nch, f->fps, &f->apng, d)
                                           : ffmpeg_begin(f->path, w, h, nch, f->fps, &f->video, d);
}

pvx_err film_add(struct film *f, const float *pix, int32_t w, int32_t h, int nch,
                 struct pvx_diag *d)
{
    if (f->samples == NULL)
        PVX_TRY(film_begin(f, w, h, nch, d));
    if (w != f->w || h != f->h || nch != f->nch)
        return pvx_fail(d, PVX_EFORMAT,
                        "%s: %dx%d with %d channel(s) after %dx%d with %d; one file needs the same "
                        "of all, a folder does not",
                        f->path, w, h, nch, f->w, f->h, f->nch);
    look_samples(&f->look, pix, (size_t)w * (size_t)h, nch, f->samples);
    return f->apng != NULL ? cap_apng_add(f->apng, f->samples, d)
                           : ffmpeg_add(f->video, f->samples, d);
}

pvx_err film_end(struct film **f, struct pvx_diag *d)
{
    pvx_err e = PVX_OK;
    if ((*f)->apng != NULL)
        e = cap_apng_end(&(*f)->apng, d);
    else if ((*f)->video != NULL)
        e = ffmpeg_end(&(*f)->video, d);
    film_drop(f);
    return e;
}

void film_drop(struct film **f)
{
    if (*f == NULL)
        return;
    cap_apng_drop(&(*f)->apng);
    ffmpeg_drop(&(*f)->video);
    free((*f)->samples);
    free((*f)->path);
    PVX_FREE(*f);
}
