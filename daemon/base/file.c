#include "base/file.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static pvx_err fail_errno(struct pvx_diag *d, const char *path, const char *what)
{
    int en = errno;
    return pvx_fail(d, pvx_err_from_errno(en), "%s: %s: %s", path, what, strerror(en));
}

pvx_err pvx_file_sync(const char *path, struct pvx_diag *d)
{
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    pvx_err e = fd < 0 || (fsync(fd) != 0 && errno != EINVAL)
                    ? fail_errno(d, path, "cannot be written")
                    : PVX_OK;
    if (fd >= 0)
        close(fd);
    return e;
}

pvx_err pvx_file_read(const char *path, size_t max, char **out, size_t *len, struct pvx_diag *d)
{
    *out = NULL;
    *len = 0;
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return fail_errno(d, path, "cannot open");
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
            e = fail_errno(d, path, "cannot read");
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

pvx_err pvx_file_write(const char *path, const void *data, size_t len, struct pvx_diag *d)
{
    char tmp[PATH_MAX];
    int n = snprintf(tmp, sizeof tmp, "%s.tmp.%ld", path, (long)getpid());
    if (n < 0 || (size_t)n >= sizeof tmp)
        return pvx_fail(d, PVX_EINVAL, "%s: path too long", path);
    int fd = open(tmp, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (fd < 0)
        return fail_errno(d, tmp, "cannot create");
    const char *p = data;
    size_t left = len;
    pvx_err e = PVX_OK;
    while (left > 0 && e == PVX_OK) {
        ssize_t w = write(fd, p, left);
        if (w < 0) {
            if (errno != EINTR)
                e = fail_errno(d, path, "cannot write");
            continue;
        }
        p += w;
        left -= (size_t)w;
    }
    if (e == PVX_OK && fsync(fd) != 0 && errno != EINVAL)
        e = fail_errno(d, path, "cannot flush to disk");
    if (close(fd) != 0 && e == PVX_OK)
        e = fail_errno(d, path, "cannot close");
    if (e == PVX_OK && rename(tmp, path) != 0)
        e = fail_errno(d, path, "cannot rename into place");
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
            return fail_errno(d, buf, "cannot create directory");
        *p = c;
        if (c == '\0')
            break;
    }
    struct stat st;
    if (stat(path, &st) != 0 || !S_ISDIR(st.st_mode)) {
        errno = ENOTDIR;
        return fail_errno(d, path, "cannot create directory");
    }
    return PVX_OK;
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
