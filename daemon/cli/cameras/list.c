#include "daemon/cli/cameras/list.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "capture/rig/backends.h"
#include "daemon/doctor/host.h"
#include "daemon/doctor/parse.h"

struct collector {
    struct cameras_list *list;
    struct cameras_backend *backend;
};

static void found(void *ctx, const struct cap_found *f)
{
    struct collector *c = ctx;
    if (c->list->n == CAMERAS_MAX)
        return;
    struct cameras_item *i = &c->list->item[c->list->n];
    *i = (struct cameras_item){strdup(f->uri), strdup(f->text != NULL ? f->text : ""),
                               f->formats != NULL ? strdup(f->formats) : NULL};
    if (i->uri == NULL || i->text == NULL) {
        free(i->uri);
        free(i->text);
        free(i->formats);
        return;
    }
    c->list->n++;
    c->backend->n++;
}

/* ---- why nothing was found -------------------------------------------------------------------- */

static size_t count_devices(struct doc_host *h, const char *prefix, size_t *usable)
{
    struct doc_names *names = doc_names(h, "/dev");
    size_t n = 0;
    *usable = 0;
    for (size_t i = 0; names != NULL && i < names->n; i++)
        if (strncmp(names->v[i], prefix, strlen(prefix)) == 0 &&
            isdigit((unsigned char)names->v[i][strlen(prefix)])) {
            n++;
            *usable += doc_usable(h, "/dev/%s", names->v[i]);
        }
    free(names);
    return n;
}

static void why_network(struct doc_host *h, char *out, size_t size)
{
    struct doc_names *names = doc_names(h, "/sys/class/net");
    char up[128] = "";
    for (size_t i = 0; names != NULL && i < names->n; i++) {
        int64_t carrier;
        if (strcmp(names->v[i], "lo") != 0 && strlen(up) + strlen(names->v[i]) + 2 < sizeof up &&
            doc_int(h, &carrier, "/sys/class/net/%s/carrier", names->v[i]) && carrier == 1) {
            size_t len = strlen(up);
            snprintf(up + len, sizeof up - len, " %s", names->v[i]);
        }
    }
    free(names);
    snprintf(
        out, size,
        "GigE cameras answer only on a network that this host has an address of (up:%s), and a "
        "firewall may keep their answers out; USB3 Vision cameras need a udev rule. "
        "`pyrovox doctor` checks all three; simulated ones: pyrovox simcams",
        up[0] != '\0' ? up : " none but lo");
}

static void why_devices(struct doc_host *h, const char *scheme, char *out, size_t size)
{
    bool media = strcmp(scheme, "libcamera") == 0;
    size_t usable, n = count_devices(h, media ? "media" : "video", &usable);
    const char *dev = media ? "/dev/media*" : "/dev/video*";
    if (n == 0)
        snprintf(
            out, size,
            "there is no %s: no camera is plugged in, its driver is not loaded (`modprobe "
            "uvcvideo`; `dmesg | tail`), or a container or virtual machine does not pass it on",
            dev);
    else if (usable == 0)
        snprintf(out, size,
                 "none of %zu %s may be opened from here: adduser %s video, then log in again", n,
                 dev, "\"$USER\"");
    else if (media)
        snprintf(out, size,
                 "%zu %s are there, but libcamera lists only devices that udev has seen "
                 "(does systemd-udevd run?) and that it has a handler for",
                 n, dev);
    else
        snprintf(out, size, "%zu %s are there, but none gives pictures (outputs, radios, metadata)",
                 n, dev);
}

static void why(struct cameras_backend *b)
{
    struct doc_host h;
    doc_host_init(&h);
    if (strcmp(b->ops->scheme, "aravis") == 0)
        why_network(&h, b->why, sizeof b->why);
    else if (strcmp(b->ops->scheme, "v4l2") == 0 || strcmp(b->ops->scheme, "libcamera") == 0)
        why_devices(&h, b->ops->scheme, b->why, sizeof b->why);
    else
        snprintf(b->why, sizeof b->why, "%s", b->ops->help);
}

/* ---- all backends ----------------------------------------------------------------------------- */

void cameras_find(const char *scheme, struct cameras_list *l)
{
    l->n = l->n_backends = 0;
    for (const struct cap_source_ops *const *p = cap_backends(); *p != NULL; p++) {
        if (scheme != NULL && strcmp((*p)->scheme, scheme) != 0)
            continue;
        if (l->n_backends == sizeof l->backend / sizeof l->backend[0])
            break;
        struct cameras_backend *b = &l->backend[l->n_backends++];
        *b = (struct cameras_backend){.ops = *p, .lists = (*p)->list != NULL, .first = l->n};
        struct collector c = {l, b};
        if (!b->lists)
            continue;
        pvx_err e = (*p)->list(found, &c, &b->error);
        if (e != PVX_OK && b->error.text[0] == '\0')
            snprintf(b->error.text, sizeof b->error.text, "%s", pvx_strerror(e));
        if (e == PVX_OK)
            b->error.text[0] = '\0';
        if (b->n == 0)
            why(b);
    }
}

void cameras_fini(struct cameras_list *l)
{
    for (size_t i = 0; i < l->n; i++) {
        free(l->item[i].uri);
        free(l->item[i].text);
        free(l->item[i].formats);
    }
    l->n = 0;
}

/* ---- formats in few words --------------------------------------------------------------------- */

#define MAX_KINDS 64
struct kind {
    char name[48], rest[96]; /* of the largest size: "640x480 15 30 Hz" */
    long pixels;
    size_t sizes;
};

void cameras_formats(const char *formats, char *out, size_t size)
{
    struct kind *kind = calloc(MAX_KINDS, sizeof *kind);
    size_t n = 0, len = 0;
    out[0] = '\0';
    char line[160];
    while (kind != NULL && doc_line_next(&formats, line, sizeof line)) {
        char name[48] = "";
        int w = 0, h = 0;
        size_t k;
        if (line[0] == '\0')
            continue;
        bool plain = sscanf(line, "%47s %5dx%5d", name, &w, &h) == 3;
        for (k = 0;
             k < n && strncmp(kind[k].name, plain ? name : line, sizeof kind[0].name - 1) != 0;)
            k++;
        if (k == MAX_KINDS)
            break;
        if (k == n)
            snprintf(kind[n++].name, sizeof kind[0].name, "%.47s", plain ? name : line);
        kind[k].sizes++;
        if (plain && (long)w * h > kind[k].pixels) {
            kind[k].pixels = (long)w * h;
            snprintf(kind[k].rest, sizeof kind[k].rest, "%.95s", line + strlen(name) + 1);
        }
    }
    for (size_t k = 0; k < n && len < size; k++) {
        if (kind[k].sizes == 0)
            continue; /* printed with an earlier one */
        len += (size_t)snprintf(out + len, size - len, "%s%s", len > 0 ? "; " : "", kind[k].name);
        for (size_t i = k + 1; i < n && len < size && kind[k].pixels > 0; i++)
            if (kind[i].sizes == kind[k].sizes && strcmp(kind[i].rest, kind[k].rest) == 0) {
                len += (size_t)snprintf(out + len, size - len, ", %s", kind[i].name);
                kind[i].sizes = 0;
            }
        if (len < size)
            len += (size_t)snprintf(out + len, size - len, "%s%s",
                                    kind[k].rest[0] != '\0' ? " " : "", kind[k].rest);
        if (kind[k].sizes > 1 && kind[k].pixels > 0 && len < size)
            len += (size_t)snprintf(out + len, size - len, " (+%zu size%s)", kind[k].sizes - 1,
                                    kind[k].sizes == 2 ? "" : "s");
    }
    free(kind);
}
