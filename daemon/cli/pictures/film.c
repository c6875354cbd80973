#include "daemon/cli/pictures/film.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "base/spawn.h"

struct film {
    char *path, *part;
    int fps;
    struct look look;
    int32_t w, h;
    int nch;
    uint8_t *samples; /* NULL: no picture yet */
    int to, complain; /* ffmpeg's input; a file in memory with its messages */
    pid_t pid;
    bool begun;
};

/* Colours of a video are converted to BT.709 in studio range and marked as such.  Sides are made even, as 4:2:0
 * requires. */
#define VIDEO                                                                                     \
    "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv", "-pix_fmt", \
        "yuv420p", "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709",    \
        "-c:v"
enum { OPTIONS_MAX = 20 };
static const struct kind {
    const char *end, *options[OPTIONS_MAX];
} kinds[] = {
    {".mp4", {VIDEO, "libx264", "-crf", "16", "-movflags", "+faststart"}},
    {".mov", {VIDEO, "libx264", "-crf", "16", "-movflags", "+faststart"}},
    {".mkv", {VIDEO, "libx264", "-crf", "16", "-preset", "medium"}},
    {".webm", {VIDEO, "libvpx-vp9", "-crf", "24", "-b:v", "0"}},
    {".apng", {"-plays", "0"}}, /* for ever */
};

static const struct kind *kind_of(const char *path)
{
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
        if (pvx_path_ends(path, kinds[i].end))
            return &kinds[i];
    return NULL;
}

bool film_named(const char *path)
{
    return kind_of(path) != NULL;
}

pvx_err film_new(const char *path, int fps, const struct look *look, struct film **out,
                 struct pvx_diag *d)
{
    *out = NULL;
    if (!film_named(path))
        return pvx_fail(d, PVX_EINVAL, "%s: a film is an .apng, .mp4, .mov, .mkv or .webm", path);
    struct film *f = pvx_calloc(1, sizeof *f);
    if (f == NULL || (f->path = strdup(path)) == NULL ||
        asprintf(&f->part, "%s.tmp.%ld%s", path, (long)getpid(), kind_of(path)->end) < 0) {
        if (f != NULL)
            free(f->path);
        free(f);
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a film", path);
    }
    f->fps = fps;
    f->look = *look;
    f->look.depth = 8;
    f->to = f->complain = -1;
    *out = f;
    return PVX_OK;
}

/* Start ffmpeg, which reads pictures from `from`.  Returns an errno. */
static int film_spawn(struct film *f, int from)
{
    const struct kind *k = kind_of(f->path);
    char size[32], rate[16];
    snprintf(size, sizeof size, "%dx%d", f->w, f->h);
    snprintf(rate, sizeof rate, "%d", f->fps);
    const char *const head[] = {"ffmpeg",
                                "-loglevel",
                                "error",
                                "-f",
                                "rawvideo",
                                "-pixel_format",
                                f->nch == 3 ? "rgb24" : "gray",
                                "-video_size",
                                size,
                                "-framerate",
                                rate,
                                "-i",
                                "pipe:0"};
    enum { HEAD = sizeof head / sizeof *head };
    const char *argv[HEAD + OPTIONS_MAX + 3];
    size_t n = HEAD;
    memcpy(argv, head, sizeof head);
    for (size_t i = 0; i < OPTIONS_MAX && k->options[i] != NULL; i++)
        argv[n++] = k->options[i];
    argv[n++] = "-y";
    argv[n++] = f->part;
    argv[n] = NULL;
    return pvx_spawn(argv, from, f->complain, &f->pid);
}

static pvx_err film_begin(struct film *f, int32_t w, int32_t h, int nch, struct pvx_diag *d)
{
    int end[2] = {-1, -1}, err;
    f->w = w;
    f->h = h;
    f->nch = nch;
    f->samples = pvx_calloc((size_t)w * (size_t)h, (size_t)nch);
    if (f->samples == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a picture", f->path);
    f->complain = memfd_create("ffmpeg", MFD_CLOEXEC);
    /* a socket, not a pipe: send() can avoid the signal when the reader has gone */
    if (f->complain < 0 || socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, end) != 0)
        err = errno;
    else
        err = film_spawn(f, end[1]);
    if (end[1] >= 0)
        close(end[1]);
    f->to = end[0];
    f->begun = err == 0;
    if (f->begun)
        return PVX_OK;
    f->pid = 0;
    if (err == ENOENT)
        return pvx_fail(d, PVX_ENOENT,
                        "%s: ffmpeg makes films and is not installed: apt install ffmpeg (or name "
                        "a folder)",
                        f->path);
    return pvx_fail(d, PVX_EIO, "%s: ffmpeg does not start: %s", f->path, strerror(err));
}

/* Wait for ffmpeg's end.  If it failed, the message is the first line that it printed. */
static pvx_err film_wait_for(struct film *f, struct pvx_diag *d)
{
    char said[512] = "";
    int status = 0;
    if (f->to >= 0)
        close(f->to);
    f->to = -1;
    while (waitpid(f->pid, &status, 0) < 0 && errno == EINTR)
        ;
    f->pid = 0;
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0)
        return PVX_OK;
    ssize_t n = pread(f->complain, said, sizeof said - 1, 0);
    said[n > 0 ? n : 0] = '\0';
    said[strcspn(said, "\n")] = '\0';
    bool full = strstr(said, strerror(ENOSPC)) != NULL;
    return pvx_fail(d, full ? PVX_ENOSPC : PVX_EIO, "%s: ffmpeg failed: %s", f->path,
                    said[0] != '\0'       ? said
                    : WIFSIGNALED(status) ? strsignal(WTERMSIG(status))
                                          : "it does not say why");
}

static pvx_err film_send(struct film *f, struct pvx_diag *d)
{
    const size_t all = (size_t)f->w * (size_t)f->h * (size_t)f->nch;
    for (size_t at = 0; at < all;) {
        ssize_t k = send(f->to, f->samples + at, all - at, MSG_NOSIGNAL);
        if (k < 0 && errno == EINTR)
            continue;
        if (k < 0) {
            int why = errno;
            pvx_err e = film_wait_for(f, d);
            return e != PVX_OK ? e
                               : pvx_fail(d, PVX_EIO, "%s: ffmpeg does not listen: %s", f->path,
                                          strerror(why));
        }
        at += (size_t)k;
    }
    return PVX_OK;
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
    return film_send(f, d);
}

pvx_err film_end(struct film **f, struct pvx_diag *d)
{
    pvx_err e = PVX_OK;
    if ((*f)->begun)
        e = (*f)->pid > 0 ? film_wait_for(*f, d)
                          : pvx_fail(d, PVX_EIO, "%s: ffmpeg ended before its time", (*f)->path);
    if (e == PVX_OK && (*f)->begun && rename((*f)->part, (*f)->path) != 0)
        e = pvx_fail(d, PVX_EIO, "%s: cannot be named: %s", (*f)->path, strerror(errno));
    film_drop(f);
    return e;
}

void film_drop(struct film **f)
{
    if (*f == NULL)
        return;
    if ((*f)->pid > 0) {
        kill((*f)->pid, SIGKILL);
        while (waitpid((*f)->pid, NULL, 0) < 0 && errno == EINTR)
            ;
    }
    if ((*f)->to >= 0)
        close((*f)->to);
    if ((*f)->complain >= 0)
        close((*f)->complain);
    unlink((*f)->part);
    free((*f)->samples);
    free((*f)->part);
    free((*f)->path);
    PVX_FREE(*f);
}
