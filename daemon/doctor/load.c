/* load.c - what the cameras ask of the host. */
#include <arpa/inet.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "daemon/pipeline/sources.h"
#include "daemon/doctor/doctor.h"

static void load_describe(struct doc_load *l, const char *from)
{
    static const char *const kinds[] = {"other", "GigE or USB3 Vision", "USB3 Vision", "V4L2"};
    char list[200] = "";
    for (int k = 3; k >= 0; k--) {
        size_t n = doc_load_count(l, (enum doc_kind)k);
        if (n > 0)
            snprintf(list + strlen(list), sizeof list - strlen(list), "%s%zu %s",
                     list[0] != '\0' ? " and " : "", n, kinds[k]);
    }
    snprintf(l->source, sizeof l->source,
             "%s: %s camera%s, up to %.2f MB a frame, %g Hz, %.0f MB/s", from, list,
             l->n == 1 ? "" : "s", (double)l->frame_bytes * 1e-6, l->fps, l->bytes_per_s * 1e-6);
}

static void sum(struct doc_load *l)
{
    l->frame_bytes = 0;
    l->bytes_per_s = 0;
    for (size_t i = 0; i < l->n; i++) {
        if (l->camera[i].frame_bytes > l->frame_bytes)
            l->frame_bytes = l->camera[i].frame_bytes;
        l->bytes_per_s += (double)l->camera[i].frame_bytes * l->fps;
    }
}

double doc_load_memory(const struct doc_load *l)
{
    return (double)l->frame_bytes * (double)l->n * (l->buffers + l->held);
}

size_t doc_load_count(const struct doc_load *l, enum doc_kind kind)
{
    size_t n = 0;
    for (size_t i = 0; i < l->n; i++)
        n += l->camera[i].kind == kind;
    return n;
}

void doc_load_assumed(struct doc_load *l)
{
    *l = (struct doc_load){.n = 8, .fps = 20, .buffers = 16};
    for (size_t i = 0; i < l->n; i++) {
        l->camera[i] = (struct doc_load_camera){
            .kind = DOC_CAM_GIGE, .frame_bytes = cap_pixfmt_image(CAP_RGB8, 640, 480)};
        snprintf(l->camera[i].name, sizeof l->camera[i].name, "cam%zu", i);
    }
    sum(l);
    load_describe(l, "no --config, so assumed");
}

static void camera_kind(struct doc_load_camera *k, const char *uri)
{
    struct in_addr a;
    if (strncmp(uri, "aravis:", 7) == 0) {
        k->kind = DOC_CAM_GIGE;
        if (inet_pton(AF_INET, uri + 7, &a) == 1)
            k->address = ntohl(a.s_addr);
        else if (strstr(uri, "U3V") != NULL || strstr(uri, "USB3") != NULL)
            k->kind = DOC_CAM_USB3;
    } else if (strncmp(uri, "v4l2:", 5) == 0 || strncmp(uri, "libcamera:", 10) == 0) {
        k->kind = DOC_CAM_V4L2;
    }
}

/* Folder of the takes; the time of day may be in the file's name, not before. */
static void record_folder(const struct dmn_config *c, struct doc_load *l)
{
    if (c->record_mode == 0)
        return;
    dmn_config_path(c, c->record_path, l->record, sizeof l->record);
    char *slash = strrchr(l->record, '/');
    if (slash == NULL || slash == l->record ||
        (strchr(l->record, '%') != NULL && strchr(l->record, '%') < slash))
        snprintf(l->record, sizeof l->record, "%s", c->dir);
    else
        *slash = '\0';
}

/* Frames of each camera that record.ring holds at most. */
static unsigned ring_frames(const struct dmn_config *c, const struct doc_load *l)
{
    double set = 0, want = ceil(c->ring.seconds * c->fps);
    for (size_t i = 0; i < l->n; i++)
        set += (double)l->camera[i].frame_bytes;
    return c->ring.seconds > 0 && set > 0 ? (unsigned)fmin(want, floor(c->ring.memory / set)) : 0;
}

static bool on_a_wire(const struct doc_load *l)
{
    for (size_t i = 0; i < l->n; i++)
        if (l->camera[i].kind == DOC_CAM_GIGE && l->camera[i].address >> 24 != 127)
            return true;
    return false;
}

pvx_err doc_load_config(const struct dmn_config *c, struct doc_load *l, struct pvx_diag *d)
{
    struct rec_rig rig;
    char path[PATH_MAX];
    PVX_TRY(dmn_config_rig(c, &rig, d));
    dmn_config_path(c, c->rig, path, sizeof path);
    struct dmn_sources *s = pvx_calloc(1, sizeof *s);
    pvx_err e = s == NULL ? PVX_ENOMEM : dmn_config_sees(&rig, path, d);
    if (e == PVX_OK)
        e = dmn_sources_init(s, c, &rig, NULL, d);
    *l = (struct doc_load){.given = true, .fps = c->fps};
    l->n = e == PVX_OK ? rig.n_cameras : 0;
    for (size_t i = 0; i < l->n; i++) {
        const struct cap_source_config *src = &s->source[i];
        enum cap_pixfmt fmt = src->fmt != CAP_FMT_NONE ? src->fmt : CAP_RGB8;
        struct doc_load_camera *k = &l->camera[i];
        snprintf(k->name, sizeof k->name, "%s", src->name);
        k->frame_bytes = cap_pixfmt_image(fmt, src->width, src->height);
        camera_kind(k, src->uri);
    }
    l->packet_size = (int)c->packet_size;
    l->buffers = (unsigned)c->buffers;
    l->held = ring_frames(c, l);
    record_folder(c, l);
    snprintf(l->compute, sizeof l->compute, "%s", c->compute);
    bool scheduled = c->trigger == CAP_TRIGGER_ACTION && c->action_lead_ms > 0;
    bool wire = on_a_wire(l); /* cameras on loopback are simulated: they have the host's clock */
    l->ptp = wire && (c->ptp || scheduled || c->shared_clock);
    l->shared_clock = wire && c->shared_clock;
    l->packet_delay_ns = (int)c->packet_delay_ns;
    l->socket_buffer = (size_t)c->socket_buffer;
    l->triggered = c->trigger != 0;
    sum(l);
    if (e == PVX_OK)
        load_describe(l, c->name);
    free(s);
    rec_rig_fini(&rig);
    return e;
}
