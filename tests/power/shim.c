/* shim.c - preloaded into a program that records: what it writes to one file and when it syncs, in order, goes to a log.
 *
 * PYROVOX_POWER_FILE: the file, by its name; PYROVOX_POWER_LOG: the log, struct power_op and what was written.
 * One lock is held from before the real call to after it is logged, so the log's order is that of the page cache;
 * a sync has two entries and is not locked, since writes go on meanwhile. */
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tests/power/log.h"

ssize_t pwrite(int fd, const void *buf, size_t n, off_t at);
ssize_t pwrite64(int fd, const void *buf, size_t n, off_t at);
ssize_t write(int fd, const void *buf, size_t n);
int ftruncate(int fd, off_t size);
int ftruncate64(int fd, off_t size);
int fsync(int fd);
int fdatasync(int fd);

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int log_fd = -1;

static void *real(const char *name)
{
    return dlsym(RTLD_NEXT, name);
}

static bool is_it(int fd)
{
    const char *path = getenv("PYROVOX_POWER_FILE");
    struct stat a, b;
    return path != NULL && fstat(fd, &a) == 0 && S_ISREG(a.st_mode) && stat(path, &b) == 0 &&
           a.st_ino == b.st_ino && a.st_dev == b.st_dev;
}

static void put(const void *p, size_t n)
{
    ssize_t (*do_write)(int, const void *, size_t) =
        (ssize_t(*)(int, const void *, size_t))real("write");
    for (const char *at = p; n > 0;) {
        ssize_t k = do_write(log_fd, at, n);
        if (k <= 0)
            abort(); /* a log with a hole would say anything */
        at += k;
        n -= (size_t)k;
    }
}

static void note(enum power_what what, off_t at, const void *data, size_t n)
{
    const char *log = getenv("PYROVOX_POWER_LOG");
    if (log_fd < 0 && log != NULL)
        log_fd = open(log, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
    struct power_op op = {
        .what = what, .thread = (uint32_t)gettid(), .at = (uint64_t)at, .bytes = n};
    put(&op, sizeof op);
    if (what == POWER_WRITE)
        put(data, n);
}

static ssize_t written(int fd, const void *buf, size_t n, off_t at)
{
    ssize_t (*do_it)(int, const void *, size_t, off_t) =
        (ssize_t(*)(int, const void *, size_t, off_t))real("pwrite");
    if (!is_it(fd))
        return do_it(fd, buf, n, at);
    pthread_mutex_lock(&lock);
    ssize_t k = do_it(fd, buf, n, at);
    if (k > 0)
        note(POWER_WRITE, at, buf, (size_t)k);
    pthread_mutex_unlock(&lock);
    return k;
}

ssize_t pwrite(int fd, const void *buf, size_t n, off_t at)
{
    return written(fd, buf, n, at);
}

ssize_t pwrite64(int fd, const void *buf, size_t n, off_t at)
{
    return written(fd, buf, n, at);
}

ssize_t write(int fd, const void *buf, size_t n)
{
    ssize_t (*do_it)(int, const void *, size_t) =
        (ssize_t(*)(int, const void *, size_t))real("write");
    if (!is_it(fd))
        return do_it(fd, buf, n);
    pthread_mutex_lock(&lock);
    off_t at = lseek(fd, 0, SEEK_CUR);
    ssize_t k = do_it(fd, buf, n);
    if (k > 0)
        note(POWER_WRITE, at, buf, (size_t)k);
    pthread_mutex_unlock(&lock);
    return k;
}

static int cut(int fd, off_t size)
{
    int (*do_it)(int, off_t) = (int (*)(int, off_t))real("ftruncate");
    if (!is_it(fd))
        return do_it(fd, size);
    pthread_mutex_lock(&lock);
    int r = do_it(fd, size);
    if (r == 0)
        note(POWER_SIZE, size, NULL, 0);
    pthread_mutex_unlock(&lock);
    return r;
}

int ftruncate(int fd, off_t size)
{
    return cut(fd, size);
}

int ftruncate64(int fd, off_t size)
{
    return cut(fd, size);
}

static int synced(int fd, const char *name)
{
    int (*do_it)(int) = (int (*)(int))real(name);
    if (!is_it(fd))
        return do_it(fd);
    pthread_mutex_lock(&lock);
    note(POWER_SYNC, 0, NULL, 0);
    pthread_mutex_unlock(&lock);
    int r = do_it(fd);
    pthread_mutex_lock(&lock);
    if (r == 0)
        note(POWER_SYNCED, 0, NULL, 0);
    pthread_mutex_unlock(&lock);
    return r;
}

int fsync(int fd)
{
    return synced(fd, "fsync");
}

int fdatasync(int fd)
{
    return synced(fd, "fdatasync");
}
