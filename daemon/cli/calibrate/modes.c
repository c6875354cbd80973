#include "daemon/cli/calibrate/modes.h"

#include <math.h>
#include <string.h>

#include "capture/pixel/pixfmt.h"
#include "daemon/cli/calibrate/options.h"

/* ---- declared ---- */

/* As calibrate_parse_numbers, but only whole numbers 0..most. */
static const char *modes_read_numbers(const char *s, size_t n, int32_t most, int32_t *out)
{
    double v[4];
    const char *name = calibrate_parse_numbers(s, n, v);
    for (size_t i = 0; i < n && name != NULL; i++) {
        if (v[i] < 0 || v[i] > most || v[i] != floor(v[i]))
            return NULL;
        out[i] = (int32_t)v[i];
    }
    return name;
}

static pvx_err camera_of(const struct calibrate_look *l, const char *name, size_t *first,
                         size_t *end, struct pvx_diag *d)
{
    *first = 0;
    *end = l->n_cameras;
    if (*name == '\0')
        return PVX_OK;
    *first = calibrate_camera(l, name, strlen(name));
    *end = *first + 1;
    return *first < l->n_cameras
               ? PVX_OK
               : pvx_fail(d, PVX_ENOENT, "no pictures of a camera called '%s'", name);
}

pvx_err calibrate_mode_binning(struct calibrate_look *l, const char *text, struct pvx_diag *d)
{
    int32_t n;
    size_t first, end;
    const char *name = modes_read_numbers(text, 1, CAP_BINNING_MAX, &n);
    if (name == NULL || n < 1)
        return pvx_fail(d, PVX_EINVAL, "--binning %s: should be N or N,CAMERA with N from 1 to %d",
                        text, CAP_BINNING_MAX);
    PVX_TRY(camera_of(l, name, &first, &end, d));
    for (size_t c = first; c < end; c++)
        if (*name != '\0' || l->mode[c].binning == 0)
            l->mode[c].binning = n;
    return PVX_OK;
}

pvx_err calibrate_mode_region(struct calibrate_look *l, const char *text, struct pvx_diag *d)
{
    int32_t v[4];
    size_t first, end;
    const char *name = modes_read_numbers(text, 4, 16384, v);
    if (name == NULL || v[2] < 1 || v[3] < 1)
        return pvx_fail(
            d, PVX_EINVAL,
            "--region %s: should be X,Y,WIDTH,HEIGHT or X,Y,WIDTH,HEIGHT,CAMERA in pixels", text);
    PVX_TRY(camera_of(l, name, &first, &end, d));
    for (size_t c = first; c < end; c++)
        if (*name != '\0' || l->mode[c].width == 0) {
            l->mode[c].x = v[0];
            l->mode[c].y = v[1];
            l->mode[c].width = v[2];
            l->mode[c].height = v[3];
        }
    return PVX_OK;
}

/* ---- found ---- */

static bool modes_is(const struct calibrate_picture *p, int32_t width, int32_t height)
{
    return p->width == width && p->height == height;
}

/* Find the size of the whole picture after binning.  The declared region must fit into it. */
static pvx_err modes_whole(struct calibrate_look *l, size_t c, struct pvx_diag *d)
{
    struct rec_calib_camera *k = &l->camera[c];
    struct calibrate_mode *m = &l->mode[c];
    int32_t w = 0, h = 0;
    m->binning = m->binning > 0 ? m->binning : 1;
    for (size_t i = 0; i < l->n; i++) {
        const struct calibrate_picture *p = &l->picture[i];
        bool declared = m->binning > 1 || m->width > 0;
        if (p->camera == c && !p->unreadable && (w == 0 || (declared && p->width > w))) {
            w = p->width;
            h = p->height;
        }
    }
    if (w == 0)
        return PVX_OK; /* no picture can be read: another check reports it */
    k->width = w / m->binning;
    k->height = h / m->binning;
    if (k->width < 1 || k->height < 1)
        return pvx_fail(d, PVX_EINVAL, "--binning %d: pictures of %s have %d x %d pixels only",
                        m->binning, k->name, w, h);
    if (m->x + m->width > k->width || m->y + m->height > k->height)
        return pvx_fail(d, PVX_EINVAL, "--region %d,%d,%d,%d: pictures of %s have %d x %d pixels%s",
                        m->x, m->y, m->width, m->height, k->name, k->width, k->height,
                        m->binning > 1 ? " when they are binned" : "");
    return PVX_OK;
}

static void into_whole(struct calibrate_picture *p, double by, double x, double y)
{
    for (size_t i = 0; i < p->view.n; i++) {
        struct rec_board_corner *o = &p->view.corner[i];
        o->x = (o->x + 0.5) / by - 0.5 + x;
        o->y = (o->y + 0.5) / by - 0.5 + y;
        for (int k = 0; k < 3; k++)
            o->cov[k] /= by * by;
    }
}

pvx_err calibrate_mode_sizes(struct calibrate_look *l, struct pvx_diag *d)
{
    for (size_t c = 0; c < l->n_cameras; c++)
        PVX_TRY(modes_whole(l, c, d));
    for (size_t i = 0; i < l->n; i++) {
        struct calibrate_picture *p = &l->picture[i];
        const struct rec_calib_camera *c = &l->camera[p->camera];
        const struct calibrate_mode *m = &l->mode[p->camera];
        if (p->unreadable)
            continue;
        if (modes_is(p, c->width, c->height))
            continue;
        if (p->width / m->binning == c->width && p->height / m->binning == c->height)
            into_whole(p, m->binning, 0, 0);
        else if (m->width > 0 && modes_is(p, m->width, m->height))
            into_whole(p, 1, m->x, m->y);
        else
            return pvx_fail(d, PVX_EINVAL,
                            "%s: %d x %d pixels, but other pictures of %s have %d x %d: one lens "
                            "is one size, so "
                            "keep binning and region as they are, or say --binning or --region",
                            p->path, p->width, p->height, c->name, c->width, c->height);
    }
    return PVX_OK;
}

void calibrate_mode_crop(const struct calibrate_look *l, struct rec_rig *rig)
{
    for (size_t c = 0; c < l->n_cameras; c++) {
        const struct calibrate_mode *m = &l->mode[c];
        int at = rec_rig_find(rig, l->camera[c].name);
        if (m->width == 0 || at < 0)
            continue;
        struct rec_camera *k = &rig->cameras[at];
        k->cx -= m->x;
        k->cy -= m->y;
        k->width = m->width;
        k->height = m->height;
    }
}

void calibrate_mode_uncrop(const struct calibrate_look *l, struct rec_rig *old)
{
    for (size_t c = 0; c < l->n_cameras; c++) {
        const struct calibrate_mode *m = &l->mode[c];
        int at = rec_rig_find(old, l->camera[c].name);
        if (at < 0 || old->cameras[at].width != m->width || old->cameras[at].height != m->height)
            continue;
        struct rec_camera *k = &old->cameras[at];
        k->cx += m->x;
        k->cy += m->y;
        k->width = l->camera[c].width;
        k->height = l->camera[c].height;
    }
}
