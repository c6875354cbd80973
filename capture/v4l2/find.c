/* find.c - finds the camera that a name means, also after it was plugged into another port. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <systemd/sd-device.h>
#include <unistd.h>

#include "base/mem.h"
#include "capture/v4l2/v4l2.h"

#define MAX_NODES 256
#define LIST_TEXT 16384

struct node {
    struct v4l_device dev; /* fd = -1 */
    unsigned number;       /* of /dev/videoN */
    unsigned index;        /* of the node within its device */
    char serial[64];       /* of the USB device; "" = none */
};

struct nodes {
    unsigned n, forbidden; /* capture nodes; nodes that may not be opened */
    struct node *at;
};

/* ---- errors ----------------------------------------------------------------------------------- */

/* The processes that have the node open, "firefox (pid 123)"; only root sees those of all users. */
static void say_users(const char *node, struct v4l_text *t)
{
    struct stat want, st;
    DIR *proc = opendir("/proc");
    if (proc == NULL || stat(node, &want) != 0) {
        if (proc != NULL)
            closedir(proc);
        return;
    }
    for (const struct dirent *p; (p = readdir(proc)) != NULL;) {
        char path[300], comm[32] = "";
        if (p->d_name[0] < '1' || p->d_name[0] > '9' || strlen(p->d_name) > 12)
            continue;
        bool has = false, self = atoi(p->d_name) == (int)getpid();
        unsigned opened = 0;
        snprintf(path, sizeof path, "/proc/%s/fd", p->d_name);
        DIR *fds = opendir(path);
        for (const struct dirent *f; fds != NULL && (f = readdir(fds)) != NULL;) {
            snprintf(path, sizeof path, "/proc/%s/fd/%.12s", p->d_name, f->d_name);
            opened += stat(path, &st) == 0 && S_ISCHR(st.st_mode) && st.st_rdev == want.st_rdev;
        }
        if (fds != NULL)
            closedir(fds);
        has = opened > (self ? 1u : 0u); /* our own attempt is one */
        if (!has)
            continue;
        snprintf(path, sizeof path, "/proc/%s/comm", p->d_name);
        FILE *f = fopen(path, "re");
        if (f != NULL && fgets(comm, sizeof comm, f) != NULL)
            comm[strcspn(comm, "\n")] = '\0';
        if (f != NULL)
            fclose(f);
        v4l_say(t, "%s%s (pid %s%s)", t->len > 0 ? ", " : "", comm, p->d_name,
                self ? ", this program: is the camera there twice?" : "");
    }
    closedir(proc);
}

static pvx_err forbidden(const struct cap_source_config *c, const char *node, struct pvx_diag *d)
{
    struct stat st;
    struct group entry, *g = NULL;
    char names[1024];
    if (stat(node, &st) != 0 || getgrgid_r(st.st_gid, &entry, names, sizeof names, &g) != 0)
        g = NULL;
    const char *group = g != NULL ? g->gr_name : "video";
    return CAP_FAIL(c, "v4l2", d, PVX_EPERM,
                    "%s may not be opened: put the user into the group %s "
                    "(usermod -aG %s USER, then log in again)",
                    node, group, group);
}

pvx_err v4l_fail(const struct cap_source_config *c, const char *node, const char *what,
                 struct pvx_diag *d)
{
    int err = errno;
    char text[256] = "";
    const char *remedy = "";
    switch (err) {
    case EBUSY:
        say_users(node, &(struct v4l_text){text, sizeof text, 0});
        return CAP_FAIL(c, "v4l2", d, PVX_EBUSY, "%s: %s is in use by %s", what, node,
                        text[0] != '\0' ? text : "another program");
    case EACCES:
    case EPERM: return forbidden(c, node, d);
    case ENODEV:
    case ENXIO: return CAP_FAIL(c, "v4l2", d, PVX_ENODEV, "%s: %s is gone: unplugged?", what, node);
    case ENOSPC:
        remedy = ": no room on the USB bus for it: a port of another host controller, JPEG, a "
                 "smaller image or a lower rate";
        break;
    case EPIPE:
        remedy = ": the way from its sensor to memory is not set up: media-ctl does that, or use "
                 "libcamera:";
        break;
    }
    return CAP_FAIL(c, "v4l2", d, pvx_err_from_errno(err), "%s: %s: %s%s", node, what,
                    strerror(err), remedy);
}

/* ---- nodes ------------------------------------------------------------------------------------ */

/* Open the node and query its capabilities; *capture: images can be streamed from it.  False: see errno. */
static bool find_look(const char *path, struct v4l_device *dev, bool *capture)
{
    struct v4l2_capability cap = {0};
    *dev = (struct v4l_device){.fd = open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC)};
    snprintf(dev->node, sizeof dev->node, "%s", path);
    if (dev->fd < 0)
        return false;
    if (v4l_call(dev->fd, VIDIOC_QUERYCAP, &cap) != 0) {
        int err = errno;
        v4l_close(dev);
        errno = err;
        return false;
    }
    snprintf(dev->card, sizeof dev->card, "%.32s", (const char *)cap.card);
    snprintf(dev->driver, sizeof dev->driver, "%.16s", (const char *)cap.driver);
    snprintf(dev->bus, sizeof dev->bus, "%.32s", (const char *)cap.bus_info);
    uint32_t caps = cap.capabilities & V4L2_CAP_DEVICE_CAPS ? cap.device_caps : cap.capabilities;
    dev->type = caps & V4L2_CAP_VIDEO_CAPTURE ? V4L2_BUF_TYPE_VIDEO_CAPTURE
                                              : V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
    *capture = (caps & (V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_VIDEO_CAPTURE_MPLANE)) != 0 &&
               (caps & V4L2_CAP_STREAMING) != 0;
    return true;
}

static int find_by_number(const void *a, const void *b)
{
    const struct node *x = a, *y = b;
    return (x->number > y->number) - (x->number < y->number);
}

/* Read the node's entries in sysfs, which also works without udevd. */
static void find_describe(sd_device *dev, struct node *k)
{
    sd_device *usb;
    const char *text;
    if (sd_device_get_sysnum(dev, &text) >= 0)
        k->number = (unsigned)strtoul(text, NULL, 10);
    if (sd_device_get_sysattr_value(dev, "index", &text) >= 0)
        k->index = (unsigned)strtoul(text, NULL, 10);
    if (sd_device_get_parent_with_subsystem_devtype(dev, "usb", "usb_device", &usb) >= 0 &&
        sd_device_get_sysattr_value(usb, "serial", &text) >= 0)
        snprintf(k->serial, sizeof k->serial, "%s", text);
}

/* List the capture nodes, in order.  Owner: caller, free(at). */
static pvx_err scan(struct nodes *out)
{
    sd_device_enumerator *all = NULL;
    *out = (struct nodes){.at = pvx_calloc(MAX_NODES, sizeof *out->at)};
    if (out->at == NULL || sd_device_enumerator_new(&all) < 0 ||
        sd_device_enumerator_allow_uninitialized(all) < 0 ||
        sd_device_enumerator_add_match_subsystem(all, "video4linux", true) < 0 ||
        sd_device_enumerator_add_match_sysname(all, "video*") < 0) {
        sd_device_enumerator_unref(all);
        free(out->at);
        return PVX_ENOMEM;
    }
    for (sd_device *dev = sd_device_enumerator_get_device_first(all);
         dev != NULL && out->n < MAX_NODES; dev = sd_device_enumerator_get_device_next(all)) {
        struct node *k = &out->at[out->n];
        const char *path;
        bool capture = false;
        if (sd_device_get_devname(dev, &path) < 0)
            continue;
        if (!find_look(path, &k->dev, &capture)) {
            out->forbidden += errno == EACCES || errno == EPERM;
            continue;
        }
        v4l_close(&k->dev);
        if (capture) {
            find_describe(dev, k);
            out->n++;
        }
    }
    sd_device_enumerator_unref(all);
    qsort(out->at, out->n, sizeof *out->at, find_by_number);
    return PVX_OK;
}

/* Whether `name` ("usb-SERIAL", "SERIAL", bus, card), without #INDEX, means this node. */
static bool find_means(const struct node *k, const char *name)
{
    if (strcmp(name, k->dev.bus) == 0 || strcmp(name, k->dev.card) == 0)
        return true;
    if (k->serial[0] == '\0')
        return false;
    return strcmp(name, k->serial) == 0 ||
           (strncmp(name, "usb-", 4) == 0 && strcmp(name + 4, k->serial) == 0);
}

/* "NAME#2" -> NAME, 2; no number: -1. */
static int find_split(const char *uri, char *name, size_t size)
{
    int index = -1, n = 0;
    snprintf(name, size, "%s", uri);
    char *hash = strrchr(name, '#');
    if (hash != NULL && sscanf(hash, "#%3d%n", &index, &n) == 1 && hash[n] == '\0' && index >= 0)
        *hash = '\0';
    else
        index = -1;
    return index;
}

static const struct node *v4l2_find(const struct nodes *all, const char *uri, unsigned *matches)
{
    char name[256];
    int index = find_split(uri, name, sizeof name);
    const struct node *found = NULL;
    *matches = 0;
    for (unsigned i = 0; i < all->n; i++) {
        const struct node *k = &all->at[i];
        if (!find_means(k, name) || (index >= 0 && (unsigned)index != k->index))
            continue;
        found = k;
        ++*matches;
    }
    return found;
}

/* The shortest name that means only this node and stays valid when the device is plugged in again. */
static void stable_name(const struct nodes *all, const struct node *k, char *out, size_t size)
{
    unsigned n;
    for (int with_index = 0; with_index < 2; with_index++)
        for (int kind = k->serial[0] != '\0' ? 0 : 1; kind < 2; kind++) {
            int w = snprintf(out, size, "%s%s", kind == 0 ? "usb-" : "",
                             kind == 0 ? k->serial : k->dev.bus);
            if (with_index && w > 0 && (size_t)w < size)
                snprintf(out + w, size - (size_t)w, "#%u", k->index);
            v4l2_find(all, out, &n);
            if (n == 1)
                return;
        }
    snprintf(out, size, "%s", k->dev.node);
}

static void say_candidates(const struct nodes *all, const char *uri, struct v4l_text *t)
{
    char name[256], stable[192];
    find_split(uri, name, sizeof name);
    for (unsigned i = 0; i < all->n; i++) {
        const struct node *k = &all->at[i];
        if (uri[0] != '\0' && !find_means(k, name))
            continue;
        stable_name(all, k, stable, sizeof stable);
        v4l_say(t, "%sv4l2:%s (%s, %s)", t->len > 0 ? ", " : "", stable, k->dev.card, k->dev.node);
    }
}

void v4l_serial(const struct v4l_device *dev, char *out, size_t size)
{
    struct nodes all;
    const struct node *it = NULL;
    char *node = realpath(dev->node, NULL);
    out[0] = '\0';
    if (node == NULL || scan(&all) != PVX_OK) {
        free(node);
        return;
    }
    for (unsigned i = 0; i < all.n; i++)
        if (strcmp(all.at[i].dev.node, node) == 0)
            it = &all.at[i];
    bool alone = it != NULL && it->serial[0] != '\0';
    for (unsigned i = 0; i < all.n && alone; i++)
        alone = strcmp(all.at[i].serial, it->serial) != 0 ||
                strcmp(all.at[i].dev.bus, it->dev.bus) == 0;
    if (alone && strlen(it->serial) + 5 <= size)
        snprintf(out, size, "usb-%s", it->serial);
    free(all.at);
    free(node);
}

/* ---- open ------------------------------------------------------------------------------------- */

static pvx_err open_path(const struct cap_source_config *c, const char *path,
                         struct v4l_device *out, struct pvx_diag *d)
{
    bool capture;
    if (!find_look(path, out, &capture)) {
        if (errno == ENOENT)
            return CAP_FAIL(c, "v4l2", d, PVX_ENOENT,
                            "there is no %s; `pyrovox cameras v4l2` lists the cameras there are",
                            path);
        if (errno == ENOTTY)
            return CAP_FAIL(c, "v4l2", d, PVX_EUNSUP, "%s is no V4L2 device", path);
        return v4l_fail(c, path, "open", d);
    }
    if (capture)
        return PVX_OK;
    v4l_close(out);
    return CAP_FAIL(c, "v4l2", d, PVX_EUNSUP,
                    "%s (%s) streams no images: it is another node of the "
                    "device (metadata, output); `pyrovox cameras v4l2` lists those that do",
                    path, out->card);
}

static pvx_err open_named(const struct cap_source_config *c, struct v4l_device *out,
                          struct pvx_diag *d)
{
    static const char *const links[] = {"/dev/v4l/by-id/", "/dev/v4l/by-path/"};
    for (size_t i = 0; i < sizeof links / sizeof links[0]; i++) {
        char path[320];
        snprintf(path, sizeof path, "%s%s", links[i], c->uri);
        if (strchr(c->uri, '/') == NULL && access(path, F_OK) == 0)
            return open_path(c, path, out, d);
    }
    struct nodes all;
    PVX_TRY(scan(&all));
    unsigned n;
    char list[500] = "";
    const struct node *k = v4l2_find(&all, c->uri, &n);
    struct v4l_text t = {list, sizeof list, 0};
    pvx_err e;
    if (n == 1) {
        e = open_path(c, k->dev.node, out, d);
    } else if (n > 1) {
        say_candidates(&all, c->uri, &t);
        e = pvx_fail(d, PVX_EINVAL, "camera %s: v4l2:%s can be %u cameras; name one of %s", c->name,
                     c->uri, n, list);
    } else if (all.n == 0 && all.forbidden > 0) {
        errno = EACCES;
        e = v4l_fail(c, "/dev/video0", "open", d);
    } else {
        say_candidates(&all, "", &t);
        e = CAP_FAIL(c, "v4l2", d, PVX_ENOENT, "not plugged in; there %s %s",
                     all.n > 0 ? "are" : "is", all.n > 0 ? list : "no V4L2 camera at all");
    }
    free(all.at);
    return e;
}

pvx_err v4l_open(const struct cap_source_config *c, struct v4l_device *out, struct pvx_diag *d)
{
    *out = (struct v4l_device){.fd = -1};
    if (c->uri[0] == '\0')
        return pvx_fail(d, PVX_EINVAL,
                        "camera %s: v4l2: needs a name after the colon; `pyrovox cameras v4l2` "
                        "lists them",
                        c->name);
    return c->uri[0] == '/' ? open_path(c, c->uri, out, d) : open_named(c, out, d);
}

void v4l_close(struct v4l_device *dev)
{
    if (dev->fd >= 0)
        close(dev->fd);
    dev->fd = -1;
}

pvx_err v4l_list(void (*cb)(void *ctx, const struct cap_found *f), void *ctx, struct pvx_diag *d)
{
    struct nodes all;
    PVX_TRY(scan(&all));
    if (all.n == 0 && all.forbidden > 0) {
        free(all.at);
        return pvx_fail(d, PVX_EPERM,
                        "v4l2: %u devices may not be opened: put the user into the group video",
                        all.forbidden);
    }
    char *formats = pvx_calloc(1, LIST_TEXT);
    for (unsigned i = 0; formats != NULL && i < all.n; i++) {
        const struct node *k = &all.at[i];
        struct v4l_device dev;
        char name[192], uri[200], text[160];
        bool capture = false;
        stable_name(&all, k, name, sizeof name);
        snprintf(uri, sizeof uri, "v4l2:%s", name);
        snprintf(text, sizeof text, "%s, %s, driver %s, %s", k->dev.card, k->dev.bus, k->dev.driver,
                 k->dev.node);
        formats[0] = '\0';
        if (find_look(k->dev.node, &dev, &capture))
            v4l_say_all(&dev, &(struct v4l_text){formats, LIST_TEXT, 0});
        v4l_close(&dev);
        cb(ctx, &(struct cap_found){uri, text, formats});
    }
    pvx_err e = formats != NULL ? PVX_OK : PVX_ENOMEM;
    free(formats);
    free(all.at);
    return e;
}
