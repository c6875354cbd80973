#include "capture/libcamera/hold.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/log.h"

#define CLASS "/sys/class/video4linux"
#define MAX   256 /* the kernel has this many numbers of video devices */

static struct {
    pthread_mutex_t lock;
    dev_t number[MAX];
    size_t n;
} held = {.lock = PTHREAD_MUTEX_INITIALIZER};

/* Whether the device is on USB.  Other devices cannot be unplugged and keep their numbers. */
static bool on_usb(const char *name)
{
    char link[PATH_MAX], path[PATH_MAX];
    snprintf(link, sizeof link, CLASS "/%s", name);
    return realpath(link, path) != NULL && strstr(path, "/usb") != NULL;
}

static bool hold_is_held(dev_t number)
{
    for (size_t i = 0; i < held.n; i++)
        if (held.number[i] == number)
            return true;
    return false;
}

static void libcamera_hold(const char *name)
{
    char node[PATH_MAX];
    struct stat st;
    snprintf(node, sizeof node, "/dev/%s", name);
    if (held.n == MAX || stat(node, &st) != 0 || !S_ISCHR(st.st_mode) || hold_is_held(st.st_rdev) ||
        !on_usb(name))
        return;
    int fd = open(node, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0) {
        LOG_D(CAPTURE, "libcamera: %s cannot be held: %s", node, strerror(errno));
        return;
    }
    /* fd is never closed: see the header. */
    held.number[held.n++] = st.st_rdev;
}

void lc_hold(void)
{
    pthread_mutex_lock(&held.lock);
    DIR *all = opendir(CLASS);
    for (const struct dirent *e; all != NULL && (e = readdir(all)) != NULL;)
        if (e->d_name[0] != '.')
            libcamera_hold(e->d_name);
    if (all != NULL)
        closedir(all);
    pthread_mutex_unlock(&held.lock);
}
