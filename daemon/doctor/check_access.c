/* check_access.c - may the cameras' device files be opened? */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/doctor/checks.h"
#include "daemon/doctor/parse.h"

/* Number of a group in /etc/group; -1: there is none. */
static long group_id(struct doctor *d, const char *name)
{
    char line[1024];
    size_t n = strlen(name);
    long id = -1;
    char *text = doc_file(d->host, "/etc/group");
    const char *p = text != NULL ? text : "";
    while (id < 0 && doc_line_next(&p, line, sizeof line)) {
        const char *x = strchr(line, ':');
        const char *number = x != NULL ? strchr(x + 1, ':') : NULL;
        if (number != NULL && (size_t)(x - line) == n && strncmp(line, name, n) == 0)
            id = strtol(number + 1, NULL, 10);
    }
    free(text);
    return id;
}

static void membership(struct doctor *d, const char *group, const char *what)
{
    char proc[64], list[2048], want[24];
    const char *title;
    uint64_t uid = 1;
    doc_subject(d, proc, sizeof proc, &title);
    char *status = doc_file(d->host, "%s/status", proc);
    char id[48];
    snprintf(id, sizeof id, "access.%s", group);
    if (status == NULL || !doc_parse_key_int(status, "Uid", 10, &uid) ||
        !doc_parse_key(status, "Groups", list, sizeof list)) {
        doc_say(d, DOC_UNKNOWN, 30, id, "groups of %s cannot be read", title);
        free(status);
        return;
    }
    free(status);
    long g = group_id(d, group);
    snprintf(want, sizeof want, "%ld", g);
    if (doc_settled(uid == 0 || (g >= 0 && doc_has_word(list, want)), d, DOC_OK, 70, id,
                    "%s may open %s", title, what))
        return;
    struct doc_finding *f = doc_say(d, DOC_FAIL, 87, id, "%s is not in the group %s", title, group);
    doc_means(f, "%s cannot be opened", what);
    doc_command(f, "adduser \"${SUDO_USER:-$USER}\" %s", group);
    doc_note(f, "then log in again: a new group takes effect at login");
}

static void video_files(struct doctor *d)
{
    struct doc_names *names = doc_names(d->host, "/dev");
    size_t n = 0, shut = 0;
    char first[80] = "";
    if (names == NULL)
        return;
    for (size_t i = 0; i < names->n; i++) {
        const char *v = names->v[i];
        if (strncmp(v, "video", 5) != 0 || !isdigit((unsigned char)v[5]))
            continue;
        n++;
        if (doc_usable(d->host, "/dev/%s", v))
            continue;
        shut++;
        if (first[0] == '\0')
            snprintf(first, sizeof first, "%s", v);
    }
    free(names);
    bool wanted = doc_load_count(&d->load, DOC_CAM_V4L2) > 0;
    if (n == 0 && wanted) {
        struct doc_finding *f =
            doc_say(d, DOC_FAIL, 88, "access.devices", "there is no /dev/video*");
        doc_means(f, "no V4L2 camera can be opened");
        doc_command(f, "modprobe uvcvideo");
        doc_note(
            f, "check that the camera is plugged in; `dmesg | tail` shows whether the kernel found "
               "it. In a container or virtual machine the device must be passed through");
    } else if (shut > 0) {
        struct doc_finding *f =
            doc_say(d, wanted ? DOC_FAIL : DOC_WARN, 84, "access.devices",
                    "/dev/%s and %zu more cannot be opened from here", first, shut - 1);
        doc_means(f, "these cameras cannot be used");
        doc_command(f, "adduser \"${SUDO_USER:-$USER}\" video");
    } else if (n > 0) {
        doc_say(d, DOC_OK, 60, "access.devices", "%zu video devices can be opened", n);
    }
}

/* A rule that gives USB3 Vision cameras to a group. */
static void udev_rule(struct doctor *d)
{
    static const char *const dirs[] = {"/etc/udev/rules.d", "/usr/lib/udev/rules.d",
                                       "/lib/udev/rules.d"};
    bool found = false;
    for (size_t k = 0; k < 3 && !found; k++) {
        struct doc_names *names = doc_names(d->host, "%s", dirs[k]);
        for (size_t i = 0; names != NULL && i < names->n && !found; i++) {
            if (strstr(names->v[i], "aravis") == NULL && strstr(names->v[i], "pyrovox") == NULL)
                continue;
            char *text = doc_file(d->host, "%s/%s", dirs[k], names->v[i]);
            found = text != NULL && strstr(text, "ef05") != NULL;
            free(text);
        }
        free(names);
    }
    if (doc_settled(found, d, DOC_OK, 60, "access.udev",
                    "a udev rule gives USB3 Vision cameras to a group"))
        return;
    struct doc_finding *f =
        doc_say(d, DOC_FAIL, 83, "access.udev", "no udev rule for USB3 Vision cameras");
    doc_means(f, "only root can open them");
    doc_add_line(f, "/etc/udev/rules.d/70-pyrovox-cameras.rules",
                 "SUBSYSTEM==\"usb\", ENV{DEVTYPE}==\"usb_device\", "
                 "ENV{ID_USB_INTERFACES}==\"*:ef05*:*\", MODE=\"0660\", GROUP=\"plugdev\"");
    doc_command(f, "udevadm control --reload && udevadm trigger --subsystem-match=usb");
}

void doc_check_access(struct doctor *d)
{
    if (doc_load_count(&d->load, DOC_CAM_V4L2) > 0)
        membership(d, "video", "V4L2 cameras");
    video_files(d);
    if (doc_load_count(&d->load, DOC_CAM_USB3) > 0) {
        membership(d, "plugdev", "USB3 Vision cameras");
        udev_rule(d);
    }
}
