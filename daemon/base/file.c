#include "base/file.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <linux/magic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

static pvx_err file_fail_errno(struct pvx_diag *d, const char *path, const char *what)
{
    int en = errno;
    return pvx_fail(d, pvx_err_from_errno(en), "%s: %s: %s", path, what, strerror(en));
}

pvx_err pvx_file_sync(const char *path, struct pvx_diag *d)
{
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    pvx_err e = fd < 0 || (fsync(fd) != 0 && errno != EINVAL)
                    ? file_fail_errno(d, path, "cannot be written")
                    : PVX_OK;
    if (fd >= 0)
        close(fd);
    return e;
}

/* Checks before opening: opening alone would wait for a pipe's writer, and has an effect on some devices. */
static pvx_err file_may_read(const char *path, bool named_pipe, struct pvx_diag *d)
{
    struct stat st;
    struct statfs fs;
    if (stat(path, &st) != 0)
        return file_fail_errno(d, path, "cannot open");
    if (S_ISREG(st.st_mode) ||
        (S_ISFIFO(st.st_mode) &&
         (named_pipe || (statfs(path, &fs) == 0 && fs.f_type == PIPEFS_MAGIC))))
        return PVX_OK;
    return pvx_fail(d, PVX_EFORMAT, "%s: is %s", path,
                    S_ISFIFO(st.st_mode)   ? "a named pipe, which may never end: write what comes "
                                             "through it into a file, and name that"
                    : S_ISDIR(st.st_mode)  ? "a folder: name a file in it"
                    : S_ISSOCK(st.st_mode) ? "a socket: name a file"
                                           : "a device, which may never end: name a file");
}

pvx_err pvx_file_check(const char *path, struct pvx_diag *d)
{
    return file_may_read(path, false, d);
}

static pvx_err open_it(const char *path, int *fd, struct pvx_diag *d)
{
    *fd = open(path, O_RDONLY | O_CLOEXEC);
    return *fd >= 0 ? PVX_OK : file_fail_errno(d, path, "cannot open");
}

pvx_err pvx_file_open(const char *path, int *fd, struct pvx_diag *d)
{
    *fd = -1;
    PVX_TRY(file_may_read(path, false, d));
    return open_it(path, fd, d);
}

static pvx_err read_whole(const char *path, size_t max, bool named_pipe, char **out, size_t *len,
                          struct pvx_diag *d)
{
    int fd;
    *out = NULL;
    *len = 0;
    PVX_TRY(file_may_read(path, named_pipe, d));
    PVX_TRY(open_it(path, &fd, d));
    pvx_err e = PVX_OK;
    size_t cap = 65536, n = 0;
    struct stat st;
    if (fstat(fd, &st) == 0 && S_ISREG(st.st_mode) && st.st_size > 0)
        cap = (size_t)st.st_size + 2;
    if (cap > max + 2)
        cap = max + 2;
    char *buf = malloc(cap);
    for (;;) {
        if (buf == NULL) {
            e = pvx_fail(d, PVX_ENOMEM, "%s: out of memory", path);
            break;
        }
        ssize_t r = read(fd, buf + n, cap - 1 - n);
        if (r < 0) {
            if (errno == EINTR)
                continue;
            e = file_fail_errno(d, path, "cannot read");
            break;
        }
        n += (size_t)r;
        if (n > max) {
            e = pvx_fail(d, PVX_ERANGE, "%s: larger than the %zu bytes allowed here", path, max);
            break;
        }
        if (r == 0)
            break;
        if (n == cap - 1) {
            cap = cap * 2 < max + 2 ? cap * 2 : max + 2;
            char *bigger = realloc(buf, cap);
            if (bigger == NULL)
                free(buf);
            buf = bigger;
        }
    }
    close(fd);
    if (e != PVX_OK) {
        free(buf);
        return e;
    }
    buf[n] = '\0';
    *out = buf;
    *len = n;
    return PVX_OK;
}

pvx_err pvx_file_read(const char *path, size_t max, char **out, size_t *len, struct pvx_diag *d)
{
    return read_whole(path, max, false, out, len, d);
}

pvx_err pvx_file_await(const char *path, size_t max, char **out, size_t *len, struct pvx_diag *d)
{
    return read_whole(path, max, true, out, len, d);
}

pvx_err pvx_file_write(const char *path, const void *data, size_t len, struct pvx_diag *d)
{
    char tmp[PATH_MAX];
    int n = snprintf(tmp, sizeof tmp, "%s.tmp.%ld", path, (long)getpid());
    if (n < 0 || (size_t)n >= sizeof tmp)
        return pvx_fail(d, PVX_EINVAL, "%s: path too long", path);
    int fd = open(tmp, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (fd < 0)
        return file_fail_errno(d, tmp, "cannot create");
    const char *p = data;
    size_t left = len;
    pvx_err e = PVX_OK;
    while (left > 0 && e == PVX_OK) {
        ssize_t w = write(fd, p, left);
        if (w < 0) {
            if (errno != EINTR)
                e = file_fail_errno(d, path, "cannot write");
            continue;
        }
        p += w;
        left -= (size_t)w;
    }
    if (e == PVX_OK && fsync(fd) != 0 && errno != EINVAL)
        e = file_fail_errno(d, path, "cannot flush to disk");
    if (close(fd) != 0 && e == PVX_OK)
        e = file_fail_errno(d, path, "cannot close");
    if (e == PVX_OK && rename(tmp, path) != 0)
        e = file_fail_errno(d, path, "cannot rename into place");
    if (e != PVX_OK)
        unlink(tmp);
    return e;
}

pvx_err pvx_mkdirs(const char *path, struct pvx_diag *d)
{
    char buf[PATH_MAX];
    size_t n = strlen(path);
    if (n == 0 || n >= sizeof buf)
        return pvx_fail(d, PVX_EINVAL, "%s: empty or over-long path", path);
    memcpy(buf, path, n + 1);
    for (char *p = buf + 1;; p++) {
        if (*p != '/' && *p != '\0')
            continue;
        char c = *p;
        *p = '\0';
        if (mkdir(buf, 0777) != 0 && errno != EEXIST)
            return file_fail_errno(d, buf, "cannot create directory");
        *p = c;
        if (c == '\0')
            break;
    }
    struct stat st;
    if (stat(path, &st) != 0 || !S_ISDIR(st.st_mode)) {
        errno = ENOTDIR;
        return file_fail_errno(d, path, "cannot create directory");
    }
    return PVX_OK;
}

bool pvx_path_ends(const char *path, const char *end)
{
    size_t n = strlen(path), k = strlen(end);
    return n > k && strcmp(path + n - k, end) == 0;
}

pvx_err pvx_path_more(const char *path, const char *more, char *out, size_t size)
{
    const char *dot = strrchr(path, '.'), *slash = strrchr(path, '/');
    bool ending = dot != NULL && dot > path && (slash == NULL || dot > slash + 1);
    int stem = (int)(ending ? (size_t)(dot - path) : strlen(path));
    int n = snprintf(out, size, "%.*s%s%s", stem, path, more, path + stem);
    return n >= 0 && (size_t)n < size ? PVX_OK : PVX_ERANGE;
}

pvx_err pvx_exe_dir(char *out, size_t size)
{
    char buf[PATH_MAX];
    ssize_t n = readlink("/proc/self/exe", buf, sizeof buf - 1);
    if (n <= 0)
        return PVX_EIO;
    buf[n] = '\0';
    char *slash = strrchr(buf, '/');
    if (slash == NULL || slash == buf)
        return PVX_EIO;
    *slash = '\0';
    if ((size_t)(slash - buf) >= size)
        return PVX_ERANGE;
    memcpy(out, buf, (size_t)(slash - buf) + 1);
    return PVX_OK;
}
