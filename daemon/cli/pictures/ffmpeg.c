#include "daemon/cli/pictures/ffmpeg.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/mem.h"
#include "base/spawn.h"

struct ffmpeg {
    char *path, *part;
    size_t n;         /* bytes of a picture */
    int to, complain; /* ffmpeg's input; a file in memory with its messages */
    pid_t pid;
};

static const struct kind {
    const char *end, *codec, *quality, *more, *value;
} kinds[] = {
    {".mp4", "libx264", "16", "-movflags", "+faststart"},
    {".mov", "libx264", "16", "-movflags", "+faststart"},
    {".mkv", "libx264", "16", "-preset", "medium"},
    {".webm", "libvpx-vp9", "24", "-b:v", "0"},
};

static const struct kind *kind_of(const char *path)
{
    size_t n = strlen(path);
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        size_t k = strlen(kinds[i].end);
        if (n > k && strcmp(path + n - k, kinds[i].end) == 0)
            return &kinds[i];
    }
    return NULL;
}

bool ffmpeg_can(const char *path)
{
    return kind_of(path) != NULL;
}

/* Colours are converted to BT.709 in studio range and marked as such.  Sides are made even, as 4:2:0 requires. */
static int ffmpeg_run(ffmpeg *f, int from, int32_t w, int32_t h, int nch, int fps)
{
    const struct kind *k = kind_of(f->path);
    char size[32], rate[16];
    snprintf(size, sizeof size, "%dx%d", w, h);
    snprintf(rate, sizeof rate, "%d", fps);
    const char *const argv[] = {
        "ffmpeg",
        "-loglevel",
        "error",
        "-f",
        "rawvideo",
        "-pixel_format",
        nch == 3 ? "rgb24" : "gray",
        "-video_size",
        size,
        "-framerate",
        rate,
        "-i",
        "pipe:0",
        "-vf",
        "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv",
        "-pix_fmt",
        "yuv420p",
        "-colorspace",
        "bt709",
        "-color_primaries",
        "bt709",
        "-color_trc",
        "bt709",
        "-c:v",
        k->codec,
        "-crf",
        k->quality,
        k->more,
        k->value,
        "-y",
        f->part,
        NULL};
    return pvx_spawn(argv, from, f->complain, &f->pid);
}

pvx_err ffmpeg_begin(const char *path, int32_t w, int32_t h, int nch, int fps, ffmpeg **out,
                     struct pvx_diag *d)
{
    int end[2] = {-1, -1}, err = 0;
    *out = NULL;
    if (!ffmpeg_can(path))
        return pvx_fail(d, PVX_EINVAL, "%s: a video is a .mp4, .mov, .mkv or .webm", path);
    ffmpeg *f = pvx_calloc(1, sizeof *f);
    if (f == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a video", path);
    f->n = (size_t)w * (size_t)h * (size_t)nch;
    f->complain = memfd_create("ffmpeg", MFD_CLOEXEC);
    f->to = -1;
    f->path = strdup(path);
    if (f->path == NULL ||
        asprintf(&f->part, "%s.tmp.%ld%s", path, (long)getpid(), kind_of(path)->end) < 0)
        err = ENOMEM;
    /* a socket, not a pipe: send() can avoid the signal when the reader has gone */
    else if (f->complain < 0 || socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, end) != 0)
        err = errno;
    else
        err = ffmpeg_run(f, end[1], w, h, nch, fps);
    if (end[1] >= 0)
        close(end[1]);
    f->to = end[0];
    if (err == 0) {
        *out = f;
        return PVX_OK;
    }
    f->pid = 0;
    ffmpeg_drop(&f);
    if (err == ENOENT)
        return pvx_fail(d, PVX_ENOENT,
                        "%s: ffmpeg makes videos and is not installed: apt install ffmpeg "
                        "(or name a folder, or an .apng)",
                        path);
    return pvx_fail(d, PVX_EIO, "%s: ffmpeg does not start: %s", path, strerror(err));
}

/* Wait for ffmpeg's end.  If it failed, the message is the first line that it printed. */
static pvx_err ffmpeg_wait_for(ffmpeg *f, struct pvx_diag *d)
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

pvx_err ffmpeg_add(ffmpeg *f, const uint8_t *samples, struct pvx_diag *d)
{
    for (size_t at = 0; at < f->n;) {
        ssize_t k = send(f->to, samples + at, f->n - at, MSG_NOSIGNAL);
        if (k < 0 && errno == EINTR)
            continue;
        if (k < 0) {
            int why = errno;
            pvx_err e = ffmpeg_wait_for(f, d);
            return e != PVX_OK ? e
                               : pvx_fail(d, PVX_EIO, "%s: ffmpeg does not listen: %s", f->path,
                                          strerror(why));
        }
        at += (size_t)k;
    }
    return PVX_OK;
}

pvx_err ffmpeg_end(ffmpeg **f, struct pvx_diag *d)
{
    pvx_err e = (*f)->pid > 0
                    ? ffmpeg_wait_for(*f, d)
                    : pvx_fail(d, PVX_EIO, "%s: ffmpeg ended before its time", (*f)->path);
    if (e == PVX_OK && rename((*f)->part, (*f)->path) != 0)
        e = pvx_fail(d, PVX_EIO, "%s: cannot be named: %s", (*f)->path, strerror(errno));
    ffmpeg_drop(f);
    return e;
}

void ffmpeg_drop(ffmpeg **f)
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
    if ((*f)->part != NULL)
        unlink((*f)->part);
    free((*f)->part);
    free((*f)->path);
    PVX_FREE(*f);
}
