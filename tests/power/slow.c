/* slow.c - preloaded into a program that records: a disk that takes PYROVOX_SLOW_MBS megabytes a second, and now and then
 * nothing for 0.3 to 1 s. */
#include <dlfcn.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/types.h>
#include <time.h>
#include <unistd.h>

#define STALLS_PER_S 0.2 /* of writing */

ssize_t pwrite(int fd, const void *buf, size_t n, off_t at);
ssize_t pwrite64(int fd, const void *buf, size_t n, off_t at);

static void slow_wait(size_t n)
{
    static _Thread_local uint64_t x = 88172645463325252u;
    const char *text = getenv("PYROVOX_SLOW_MBS");
    double s = text != NULL ? (double)n / (atof(text) * 1e6) : 0;
    x ^= x << 13;
    x ^= x >> 7;
    x ^= x << 17;
    if ((double)(x >> 11) * 0x1p-53 < s * STALLS_PER_S)
        s += 0.3 + 0.7 * (double)(x & 1023) / 1023;
    struct timespec ts = {.tv_sec = (time_t)s, .tv_nsec = (long)((s - (double)(time_t)s) * 1e9)};
    nanosleep(&ts, NULL);
}

ssize_t pwrite(int fd, const void *buf, size_t n, off_t at)
{
    ssize_t (*next)(int, const void *, size_t, off_t);
    *(void **)&next = dlsym(RTLD_NEXT, "pwrite");
    slow_wait(n);
    return next(fd, buf, n, at);
}

ssize_t pwrite64(int fd, const void *buf, size_t n, off_t at)
{
    ssize_t (*next)(int, const void *, size_t, off_t);
    *(void **)&next = dlsym(RTLD_NEXT, "pwrite64");
    slow_wait(n);
    return next(fd, buf, n, at);
}
