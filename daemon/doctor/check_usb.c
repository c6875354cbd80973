/* check_usb.c - USB cameras: memory for transfers, power saving, speed of the port, shared buses. */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/doctor/checks.h"

#define SYS_USB  "/sys/bus/usb/devices"
#define MAX_CAMS 64

struct usb_camera {
    char dev[64], product[80]; /* "2-1.4" */
    bool u3v;                  /* USB3 Vision, else UVC */
    int64_t speed;             /* Mb/s */
    unsigned bus;
};

/* Interfaces "2-1.4:1.0" say what a device is: video is class 0e, USB3 Vision is ef/05. */
static size_t find_cameras(struct doctor *d, struct usb_camera *out)
{
    struct doc_names *names = doc_names(d->host, SYS_USB);
    size_t n = 0;
    for (size_t i = 0; names != NULL && i < names->n && n < MAX_CAMS; i++) {
        char class[16], sub[16] = "";
        const char *name = names->v[i];
        size_t len = strcspn(name, ":");
        if (name[len] != ':' || !isdigit((unsigned char)name[0]) ||
            !doc_text(d->host, class, sizeof class, SYS_USB "/%s/bInterfaceClass", name))
            continue;
        (void)doc_text(d->host, sub, sizeof sub, SYS_USB "/%s/bInterfaceSubClass", name);
        bool uvc = strcmp(class, "0e") == 0;
        bool u3v = strcmp(class, "ef") == 0 && strcmp(sub, "05") == 0;
        struct usb_camera c = {.u3v = u3v, .bus = (unsigned)strtoul(name, NULL, 10)};
        snprintf(c.dev, sizeof c.dev, "%.*s", (int)len, name);
        if ((!uvc && !u3v) || (n > 0 && strcmp(out[n - 1].dev, c.dev) == 0))
            continue;
        if (!doc_text(d->host, c.product, sizeof c.product, SYS_USB "/%s/product", c.dev))
            snprintf(c.product, sizeof c.product, "camera");
        (void)doc_int(d->host, &c.speed, SYS_USB "/%s/speed", c.dev);
        out[n++] = c;
    }
    free(names);
    return n;
}

static void usbfs_memory(struct doctor *d, size_t cameras)
{
    int64_t mb;
    double need = (double)cameras * (double)d->load.frame_bytes * d->load.buffers / 1048576.0;
    if (doc_settled(!doc_int(d->host, &mb, "/sys/module/usbcore/parameters/usbfs_memory_mb"), d,
                    DOC_UNKNOWN, 40, "usb.memory",
                    "usbcore.usbfs_memory_mb cannot be read: no USB in this kernel?"))
        return;
    if (mb == 0 || (double)mb >= need) {
        doc_say(d, DOC_OK, 86, "usb.memory", "USB transfers may take %lld MiB, need %.0f",
                (long long)mb, need);
        return;
    }
    long long want = 256;
    while ((double)want < 2 * need && want < 65536)
        want *= 2;
    struct doc_finding *f = doc_say(d, DOC_FAIL, 86, "usb.memory",
                                    "USB transfers may take only %lld MiB, %zu camera%s need %.0f",
                                    (long long)mb, cameras, cameras == 1 ? "" : "s", need);
    doc_means(f, "streams do not start, or break off, as soon as several cameras run");
    doc_command(f, "echo %lld > /sys/module/usbcore/parameters/usbfs_memory_mb", want);
    doc_note(f, "for good: usbcore.usbfs_memory_mb=%lld on the kernel's command line", want);
}

static void autosuspend(struct doctor *d, const struct usb_camera *c, size_t n)
{
    char control[32];
    for (size_t i = 0; i < n; i++) {
        if (!doc_text(d->host, control, sizeof control, SYS_USB "/%s/power/control", c[i].dev) ||
            strcmp(control, "auto") != 0)
            continue;
        struct doc_finding *f = doc_say(d, DOC_WARN, 57, "usb.autosuspend",
                                        "%s (USB %s) may be put to sleep", c[i].product, c[i].dev);
        doc_means(f, "the camera is lost for a moment, or for good, when it has been idle");
        doc_command(f, "echo on > " SYS_USB "/%s/power/control", c[i].dev);
        doc_add_line(f, "/etc/udev/rules.d/91-pyrovox-power.rules",
                     "ACTION==\"add\", SUBSYSTEM==\"usb\", ENV{DEVTYPE}==\"usb_device\", "
                     "ENV{ID_USB_INTERFACES}==\"*:ef05*:*|*:0e01*:*\", ATTR{power/control}=\"on\"");
        return; /* one remedy for all */
    }
    if (n > 0)
        doc_say(d, DOC_OK, 57, "usb.autosuspend", "no camera is put to sleep");
}

static void ports(struct doctor *d, const struct usb_camera *c, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (!c[i].u3v || c[i].speed == 0 || c[i].speed >= 5000)
            continue;
        struct doc_finding *f =
            doc_say(d, DOC_FAIL, 91, "usb.speed", "%s (USB %s) runs at %lld Mb/s", c[i].product,
                    c[i].dev, (long long)c[i].speed);
        doc_means(f, "a USB3 Vision camera gets a tenth of its rate on a USB 2 port or cable");
        doc_note(f, "use a SuperSpeed (blue) port and a short USB 3 cable of good quality");
    }
}

/* Net rates that a bus carries, from its Mb/s. */
static double bus_bytes(int64_t speed)
{
    return speed >= 10000 ? 900e6 : speed >= 5000 ? 400e6 : speed >= 480 ? 40e6 : 1e6;
}

static void sharing(struct doctor *d, const struct usb_camera *c, size_t n)
{
    double each = (double)d->load.frame_bytes * d->load.fps;
    bool said = false;
    for (size_t i = 0; i < n; i++) {
        size_t same = 0, before = 0;
        for (size_t k = 0; k < n; k++) {
            same += c[k].bus == c[i].bus;
            before += k < i && c[k].bus == c[i].bus;
        }
        if (same < 2 || before > 0)
            continue;
        double room = bus_bytes(c[i].speed), need = each * (double)same;
        if (need < 0.8 * room)
            continue;
        said = true;
        struct doc_finding *f =
            doc_say(d, need > room ? DOC_FAIL : DOC_WARN, 89, "usb.shared",
                    "%zu cameras share USB bus %u: they need %.0f MB/s, it carries %.0f", same,
                    c[i].bus, need * 1e-6, room * 1e-6);
        doc_means(f, "the bus has no room: frames come cut short, or a camera does not start "
                     "(\"No space left on device\")");
        doc_note(f, "plug some into ports of another controller (`lsusb -t` shows which), or add a "
                    "card with one controller per port; MJPG or GREY instead of YUYV for webcams");
    }
    if (!said)
        doc_say(d, DOC_OK, 89, "usb.shared", "no USB bus has more cameras than it carries");
}

void doc_check_usb(struct doctor *d)
{
    struct usb_camera *c = calloc(MAX_CAMS, sizeof *c);
    size_t u3v = doc_load_count(&d->load, DOC_CAM_USB3), configured = u3v;
    if (c == NULL)
        return;
    size_t n = find_cameras(d, c), here = 0;
    for (size_t i = 0; i < n; i++)
        here += c[i].u3v;
    if (here > u3v)
        u3v = here;
    if (u3v > 0 || configured > 0)
        usbfs_memory(d, u3v);
    if (n > 0) {
        autosuspend(d, c, n);
        ports(d, c, n);
        sharing(d, c, n);
    }
    free(c);
}
