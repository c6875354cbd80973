/* list.c - the cameras that Aravis sees.
 *
 * Maker, model, serial number and address come from the discovery, which disturbs no camera.  Formats are in the
 * camera's features, and Aravis takes control of a GigE camera to read them.  So they are read only where the control
 * channel's register, which every program may read, says that no other program has control. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/gev/find.h"
#include "capture/gev/last.h"

#define MAX_TEXT 4096

struct entry {
    char id[256], address[64];
    char vendor[64], model[64], serial[64], protocol[32];
};

static void list_copy(char *out, size_t size, const char *text)
{
    snprintf(out, size, "%s", text != NULL ? text : "");
}

static void list_add(char *out, size_t size, const char *text)
{
    size_t n = strlen(out);
    snprintf(out + n, size - n, "%s", text);
}

/* "Mono8 640x480 0.1 to 60 Hz", a line for each of the camera's formats that we know. */
static void describe_formats(ArvCamera *cam, char *out, size_t size)
{
    int w = 0, h = 0;
    double min = 0, max = 0;
    guint n = 0;
    arv_camera_get_sensor_size(cam, &w, &h, NULL);
    arv_camera_get_frame_rate_bounds(cam, &min, &max, NULL);
    gint64 *list = arv_camera_dup_available_pixel_formats(cam, &n, NULL);
    out[0] = '\0';
    for (guint i = 0; list != NULL && i < n; i++) {
        enum cap_pixfmt fmt = cap_pixfmt_from_pfnc((ArvPixelFormat)list[i]);
        char line[96];
        if (fmt == CAP_FMT_NONE)
            continue;
        snprintf(line, sizeof line, "%s%s", out[0] != '\0' ? "\n" : "", cap_pixfmt_name(fmt));
        list_add(out, size, line);
        if (w > 0 && h > 0) { /* a camera may not give its sensor's size */
            snprintf(line, sizeof line, " %dx%d", w, h);
            list_add(out, size, line);
        }
        if (max <= 0)
            continue;
        snprintf(line, sizeof line, " %.4g to %.4g Hz", min, max);
        list_add(out, size, line);
    }
    g_free(list);
}

static ArvCamera *open_to_read(const struct entry *e, uint32_t address)
{
    struct cap_source_config c = {.uri = address != 0 ? e->address : e->id, .name = e->id};
    struct aravis_route route;
    ArvCamera *cam = NULL;
    if (address != 0 && aravis_controlled(address))
        return NULL;
    return aravis_open_camera(&c, &cam, &route, NULL) == PVX_OK ? cam : NULL;
}

static void list_tell(const struct entry *e, void (*cb)(void *ctx, const struct cap_found *f),
                      void *ctx)
{
    char uri[300], text[512], formats[MAX_TEXT];
    uint32_t address = aravis_address(e->address);
    struct aravis_who who = {"", "", "", ""};
    bool used = false;
    if (address != 0) {
        aravis_probe(address, &who);
        used = aravis_controlled(address);
    }
    snprintf(uri, sizeof uri, "aravis:%s", address != 0 ? e->address : e->id);
    snprintf(text, sizeof text, "%s %s, serial %s%s%s, %s%s", e->vendor, e->model, e->serial,
             who.name[0] != '\0' ? ", name " : "", who.name, e->protocol,
             used ? ", in use by a program" : "");
    ArvCamera *cam = open_to_read(e, address);
    if (cam != NULL)
        describe_formats(cam, formats, sizeof formats);
    cb(ctx, &(struct cap_found){uri, text, cam != NULL && formats[0] != '\0' ? formats : NULL});
    aravis_close_camera(&cam);
}

pvx_err aravis_list(void (*cb)(void *ctx, const struct cap_found *f), void *ctx, struct pvx_diag *d)
{
    (void)d;
    aravis_list_lock();
    arv_update_device_list();
    unsigned n = arv_get_n_devices();
    struct entry *list = n > 0 ? pvx_calloc(n, sizeof *list) : NULL;
    for (unsigned i = 0; list != NULL && i < n; i++) {
        list_copy(list[i].id, sizeof list[i].id, arv_get_device_id(i));
        list_copy(list[i].address, sizeof list[i].address, arv_get_device_address(i));
        list_copy(list[i].vendor, sizeof list[i].vendor, arv_get_device_vendor(i));
        list_copy(list[i].model, sizeof list[i].model, arv_get_device_model(i));
        list_copy(list[i].serial, sizeof list[i].serial, arv_get_device_serial_nbr(i));
        list_copy(list[i].protocol, sizeof list[i].protocol, arv_get_device_protocol(i));
    }
    aravis_list_unlock();
    if (n > 0 && list == NULL)
        return PVX_ENOMEM;
    for (unsigned i = 0; i < n; i++)
        list_tell(&list[i], cb, ctx);
    free(list);
    return PVX_OK;
}
