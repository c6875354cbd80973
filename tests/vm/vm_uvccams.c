/* vm_uvccams.c - up to eight virtual USB cameras that see what is on disk.
 *
 *   vm_uvccams [--quality N] [--rate HZ] DIR      DIR/<camera>/<6 digits>.png, as simcams writes
 * quality: of the JPEGs (95).  rate: what a host gets that asks for none: 30 (default), 15 or 5.
 * Needs vhci_hcd and root; plugs in one camera per folder of DIR, in the order of their names, and
 * prints "serving N cameras".  Their serial numbers are FLAME000, FLAME001 ...
 * Lines on standard input, each answered with "ok" or "no: why":
 *   unplug CAM, plug CAM, drop CAM SHARE, cut CAM SHARE, freeze CAM 0|1, stats; CAM is a number or
 *   "all".  SIGTERM or the end of standard input unplugs all and prints the statistics. */
#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "tests/vm/uvc/camera.h"
#include "tests/vm/uvc/descriptors.h"

#define MAX 8 /* ports of vhci_hcd.0 */

struct rig {
    unsigned n;
    char name[MAX][64], serial[MAX][16];
    struct uvc_images images[MAX];
    uvc_camera *camera[MAX];
};
static struct rig rig;

static int fail(pvx_err e, const struct pvx_diag *d)
{
    fprintf(stderr, "vm_uvccams: %s\n", pvx_diag_text(d, e));
    return 1;
}

static int is_camera(const struct dirent *e)
{
    return e->d_name[0] != '.';
}

static pvx_err load(const char *dir, int quality, struct pvx_diag *d)
{
    struct dirent **list;
    int n = scandir(dir, &list, is_camera, versionsort);
    if (n < 1)
        return pvx_fail(d, PVX_ENOENT, "%s: no folders of images", dir);
    pvx_err e = PVX_OK;
    for (int i = 0; i < n; i++) {
        char path[4096];
        struct stat st;
        snprintf(path, sizeof path, "%s/%s", dir, list[i]->d_name);
        if (e == PVX_OK && rig.n < MAX && stat(path, &st) == 0 && S_ISDIR(st.st_mode)) {
            snprintf(rig.name[rig.n], sizeof rig.name[0], "Flame %.40s", list[i]->d_name);
            snprintf(rig.serial[rig.n], sizeof rig.serial[0], "FLAME%03u", rig.n);
            e = uvc_images_load(path, UVC_ALL_FORMATS, quality, &rig.images[rig.n], d);
            rig.n++;
        }
        free(list[i]);
    }
    free(list);
    return e;
}

static pvx_err plug_all(struct pvx_diag *d)
{
    for (unsigned i = 0; i < rig.n; i++) {
        struct uvc_camera_config c = {i, rig.name[i], rig.serial[i], &rig.images[i], i + 1};
        PVX_TRY(uvc_camera_new(&c, &rig.camera[i]));
        PVX_TRY(uvc_camera_plug(rig.camera[i], d));
    }
    return PVX_OK;
}

static void stats(void)
{
    for (unsigned i = 0; i < rig.n; i++) {
        struct uvc_camera_stats s;
        uvc_camera_stats(rig.camera[i], &s);
        printf("camera %u %s sent %llu dropped %llu cut %llu busy %llu started %llu unlinked %llu "
               "exposure %d gain %d brightness %d turned %llu turned_at %llu\n",
               i, s.plugged ? "plugged" : "unplugged", (unsigned long long)s.sent,
               (unsigned long long)s.dropped, (unsigned long long)s.cut, (unsigned long long)s.busy,
               (unsigned long long)s.started, (unsigned long long)s.unlinked, s.exposure_100us,
               s.gain, s.brightness, (unsigned long long)s.turned, (unsigned long long)s.turned_at);
    }
}

static pvx_err order_one(unsigned i, const char *what, double value, struct pvx_diag *d)
{
    static const char *const fault[UVC_N_FAULTS] = {"drop", "cut", "freeze"};
    if (strcmp(what, "plug") == 0)
        return uvc_camera_plug(rig.camera[i], d);
    if (strcmp(what, "unplug") == 0) {
        uvc_camera_unplug(rig.camera[i]);
        return PVX_OK;
    }
    for (int f = 0; f < UVC_N_FAULTS; f++)
        if (strcmp(what, fault[f]) == 0) {
            uvc_camera_fault(rig.camera[i], (enum uvc_fault)f, value);
            return PVX_OK;
        }
    return pvx_fail(d, PVX_EINVAL, "'%s' is no order", what);
}

static pvx_err order(const char *line, struct pvx_diag *d)
{
    char what[16], camera[8];
    double value = 0;
    int n = sscanf(line, "%15s %7s %lf", what, camera, &value);
    if (n == 1 && strcmp(what, "stats") == 0) {
        stats();
        return PVX_OK;
    }
    if (n < 2)
        return pvx_fail(d, PVX_EINVAL, "orders are WHAT CAMERA [NUMBER], or stats");
    bool all = strcmp(camera, "all") == 0;
    char *end;
    unsigned long one = strtoul(camera, &end, 10);
    if (!all && (*end != '\0' || one >= rig.n))
        return pvx_fail(d, PVX_EINVAL, "'%s' is no camera", camera);
    for (unsigned i = 0; i < rig.n; i++)
        if (all || i == one)
            PVX_TRY(order_one(i, what, value, d));
    return PVX_OK;
}

static void on_signal(int sig)
{
    (void)sig; /* ends the read of standard input */
}

int main(int argc, char **argv)
{
    int quality = UVC_QUALITY, rate = 30, at = 1;
    for (; at + 2 < argc; at += 2)
        if (strcmp(argv[at], "--quality") == 0)
            quality = atoi(argv[at + 1]);
        else if (strcmp(argv[at], "--rate") == 0)
            rate = atoi(argv[at + 1]);
        else
            break;
    if (at != argc - 1 || quality < 1 || quality > 100 || !uvc_set_default_rate(rate)) {
        fprintf(stderr, "usage: vm_uvccams [--quality 1..100] [--rate 30|15|5] DIR\n");
        return 2;
    }
    struct sigaction sa = {.sa_handler = on_signal}; /* no SA_RESTART */
    sigaction(SIGTERM, &sa, NULL);
    sigaction(SIGINT, &sa, NULL);
    setvbuf(stdout, NULL, _IOLBF, 0);
    struct pvx_diag d = {""};
    pvx_err e = load(argv[argc - 1], quality, &d);
    if (e == PVX_OK)
        e = plug_all(&d);
    int rc = e == PVX_OK ? 0 : fail(e, &d);
    if (rc == 0) {
        printf("serving %u cameras\n", rig.n);
        char line[128];
        while (fgets(line, sizeof line, stdin) != NULL) {
            d.text[0] = '\0';
            e = order(line, &d);
            if (e == PVX_OK)
                puts("ok");
            else
                printf("no: %s\n", pvx_diag_text(&d, e));
        }
        stats();
    }
    for (unsigned i = 0; i < rig.n; i++) {
        uvc_camera_free(&rig.camera[i]);
        uvc_images_free(&rig.images[i]);
    }
    return rc;
}
