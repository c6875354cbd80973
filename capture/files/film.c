#include "capture/files/film.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "base/module.h"
#include "capture/files/picture.h"

static struct pvx_module module = {
    .file = "pyrovox-films.so", .entry = "cap_films_module", .version = CAP_FILMS_VERSION};

static const struct cap_films *films(void)
{
    return module.is;
}

static pvx_err film_need_module(const char *path, struct pvx_diag *d)
{
    if (pvx_module(&module) != NULL)
        return PVX_OK;
    return pvx_fail(d, PVX_EUNSUP,
                    "%s: the module of films cannot be loaded: %.500s; pictures work without", path,
                    module.why);
}

/* ---- films ---- */

struct cap_video {
    struct film *film;
};

/* A number of EBML (RFC 8794), which says its own length; UINT64_MAX: not known. */
static uint64_t film_ebml(const uint8_t *b, size_t n, size_t *at)
{
    unsigned len = *at < n && b[*at] != 0 ? (unsigned)__builtin_clz(b[*at]) - 23 : 9;
    if (len > 8 || n - *at < len)
        return UINT64_MAX;
    uint64_t v = b[*at] & (0xFFu >> len);
    for (unsigned i = 1; i < len; i++)
        v = v << 8 | b[*at + i];
    *at += len;
    return v == (1ull << 7 * len) - 1 ? UINT64_MAX : v;
}

/* How long a file says that it is; 0: it does not.  FFmpeg ends a cut Matroska or AVI film without an error. */
static uint64_t film_says_bytes(const uint8_t *b, size_t n)
{
    if (n >= 12 && memcmp(b, "RIFF", 4) == 0) {
        uint32_t size =
            (uint32_t)b[4] | (uint32_t)b[5] << 8 | (uint32_t)b[6] << 16 | (uint32_t)b[7] << 24;
        return size == UINT32_MAX ? 0 : size + 8ull - size % 2;
    }
    size_t at = 4;
    if (n < 12 || memcmp(b, "\x1a\x45\xdf\xa3", 4) != 0)
        return 0;
    uint64_t head = film_ebml(b, n, &at);
    if (head > n || n - at < head + 4 || memcmp(b + at + head, "\x18\x53\x80\x67", 4) != 0)
        return 0;
    at += head + 4;
    uint64_t size = film_ebml(b, n, &at);
    return size > INT64_MAX - n ? 0 : size + at;
}

/* Check the length, and the size of an animated PNG before libavformat, which decodes a picture on opening, allocates
 * one. */
static pvx_err film_check_head(const char *path, uint64_t bytes, struct pvx_diag *d)
{
    uint8_t b[256];
    uint32_t width, height;
    FILE *f = fopen(path, "rb");
    size_t n = f != NULL ? fread(b, 1, sizeof b, f) : 0;
    if (f != NULL)
        fclose(f);
    uint64_t says = film_says_bytes(b, n);
    if (says > bytes)
        return pvx_fail(d, PVX_ECORRUPT,
                        "%s: cut: says it has %llu bytes, but has %llu; record it again, or save "
                        "the frames that are there: ffmpeg -i IN -c copy OUT.mkv",
                        path, (unsigned long long)says, (unsigned long long)bytes);
    cap_picture_png(b, n, &width, &height);
    return cap_picture_fits(width, height, bytes, path, d);
}

static pvx_err film_check_file(const char *path, uint64_t *bytes, struct pvx_diag *d)
{
    struct stat st;
    if (access(path, R_OK) != 0 || stat(path, &st) != 0)
        return pvx_fail(d, PVX_ENOENT, "%s: no such video file, or not readable", path);
    PVX_TRY(pvx_file_check(path, d));
    *bytes = (uint64_t)st.st_size;
    PVX_TRY(film_check_head(path, *bytes, d));
    return film_need_module(path, d);
}

pvx_err cap_video_open(const char *path, cap_video **out, struct cap_video_info *info,
                       struct pvx_diag *d)
{
    struct cap_video_info unused;
    uint64_t bytes;
    *out = NULL;
    PVX_TRY(film_check_file(path, &bytes, d));
    cap_video *v = pvx_calloc(1, sizeof *v);
    if (v == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a film", path);
    pvx_err e = films()->open(path, bytes, &v->film, info != NULL ? info : &unused, d);
    if (e != PVX_OK)
        cap_video_close(&v);
    *out = v;
    return e;
}

pvx_err cap_video_next(cap_video *v, struct cap_image *img, int64_t *t_ns, struct pvx_diag *d)
{
    return films()->next(v->film, img, t_ns, d);
}

pvx_err cap_video_times(const char *path, int64_t **t_ns, size_t *n, struct pvx_diag *d)
{
    uint64_t bytes;
    *t_ns = NULL;
    *n = 0;
    PVX_TRY(film_check_file(path, &bytes, d));
    return films()->times(path, bytes, t_ns, n, d);
}

void cap_video_close(cap_video **v)
{
    if (*v == NULL)
        return;
    films()->close((*v)->film);
    PVX_FREE(*v);
}
