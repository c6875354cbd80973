#include "recon/geom/rig_optics.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "recon/geom/bundle.h"
#include "recon/geom/ray_table.h"

#define MAX_COORD 1e6 /* m, as in rig.c */

/* How far X [m] is behind the face towards the camera. */
static double window_beyond(const struct rec_glass *w, const double X[3])
{
    return w->normal[0] * X[0] + w->normal[1] * X[1] + w->normal[2] * X[2] - w->at;
}

static pvx_err window_plane(const pvx_yaml *y, int node, const char *path,
                            const struct rec_camera *c, struct rec_glass *w, struct pvx_diag *d)
{
    double p[4], centre[3];
    PVX_TRY(pvx_yaml_doubles(y, node, path, 4, 4, p, d));
    double n = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    if (!(n > 1e-9 && n < MAX_COORD) || !(fabs(p[3]) < MAX_COORD))
        return pvx_yaml_fail(y, node, path, PVX_EINVAL, d,
                             "should be a normal and a distance: [nx, ny, nz, d], n . x = d in "
                             "metres on the face towards the camera");
    bool unit = fabs(n - 1) <= 1e-15; /* numbers that were written in full stay as they are */
    for (int a = 0; a < 3; a++)
        w->normal[a] = unit ? p[a] : p[a] / n;
    w->at = unit ? p[3] : p[3] / n;
    rec_camera_centre(c, centre);
    double beyond = window_beyond(w, centre);
    if (fabs(beyond) < 1e-9)
        return pvx_yaml_fail(y, node, path, PVX_EINVAL, d,
                             "the plane goes through camera %s; give the face of the glass that is "
                             "towards the camera",
                             c->name);
    if (beyond > 0) { /* the normal is turned to the flame */
        for (int a = 0; a < 3; a++)
            w->normal[a] = -w->normal[a];
        w->at = -w->at;
    }
    return PVX_OK;
}

/* The volume is behind the glass, all of it. */
static pvx_err window_before(const pvx_yaml *y, int node, const char *path,
                             const struct rec_grid *g, const struct rec_camera *c,
                             const struct rec_glass *w, struct pvx_diag *d)
{
    double least = INFINITY, X[3];
    for (int i = 0; i < 8; i++) {
        for (int a = 0; a < 3; a++)
            X[a] = i >> a & 1 ? g->max[a] : g->min[a];
        least = fmin(least, window_beyond(w, X) - w->thickness);
    }
    if (least >= 0)
        return PVX_OK;
    return pvx_yaml_fail(y, node, path, PVX_EINVAL, d,
                         "the volume reaches %.4g m through the glass towards camera %s: a window "
                         "stands between camera and volume; correct its plane (n . x = d on the "
                         "face towards the camera), or make the volume smaller",
                         -least, c->name);
}

static pvx_err window_read(const pvx_yaml *y, int m, const char *path, const struct rec_grid *g,
                           const struct rec_camera *c, struct rec_glass *w, struct pvx_diag *d)
{
    static const char *const keys[] = {"plane", "thickness", "n"};
    int node[3];
    char full[112];
    PVX_TRY(pvx_yaml_known(y, m, path, "plane thickness n", d));
    for (int i = 0; i < 3; i++)
        if ((node[i] = pvx_yaml_get(y, m, keys[i])) == 0)
            return pvx_yaml_fail(y, m, path, PVX_EFORMAT, d, "the key '%s' is missing", keys[i]);
    snprintf(full, sizeof full, "%s.thickness", path);
    PVX_TRY(pvx_yaml_double(y, node[1], full, 1e-6, 10, &w->thickness, d));
    snprintf(full, sizeof full, "%s.n", path);
    PVX_TRY(pvx_yaml_double(y, node[2], full, 1, 5, &w->index, d));
    snprintf(full, sizeof full, "%s.plane", path);
    PVX_TRY(window_plane(y, node[0], full, c, w, d));
    return window_before(y, node[0], full, g, c, w, d);
}

pvx_err rec_windows_read(const pvx_yaml *y, int seq, const char *path, const struct rec_grid *g,
                         struct rec_camera *c, struct pvx_diag *d)
{
    char full[80];
    size_t n = pvx_yaml_length(y, seq);
    snprintf(full, sizeof full, "%s.windows", path);
    if (pvx_yaml_kind(y, seq) != PVX_YAML_SEQ || n > REC_WINDOWS)
        return pvx_yaml_fail(y, seq, full, PVX_EFORMAT, d,
                             "should be a list of at most %d windows ({ plane, thickness, n })",
                             REC_WINDOWS);
    for (size_t i = 0; i < n; i++) {
        snprintf(full, sizeof full, "%s.windows[%zu]", path, i);
        PVX_TRY(window_read(y, pvx_yaml_item(y, seq, i), full, g, c, &c->window[i], d));
        c->n_windows++;
    }
    return PVX_OK;
}

static pvx_err blur_lens(const pvx_yaml *y, int map, const char *path, const struct rec_grid *g,
                         struct rec_camera *c, struct pvx_diag *d)
{
    char full[80];
    int node = pvx_yaml_get(y, map, "aperture"), focus = pvx_yaml_get(y, map, "focus");
    if (node == 0 || focus == 0)
        return pvx_yaml_fail(
            y, map, path, PVX_EFORMAT, d,
            "should have the key 'sigma' (px), or both 'aperture' and 'focus' (m)");
    if (c->model != REC_PINHOLE && c->model != REC_SCHEIMPFLUG)
        return pvx_yaml_fail(
            y, node, path, PVX_EUNSUP, d,
            "an aperture is for model pinhole and scheimpflug; model %s has sigma only",
            rec_camera_model_name(c->model));
    snprintf(full, sizeof full, "%s.aperture", path);
    PVX_TRY(pvx_yaml_double(y, node, full, 1e-9, 10, &c->blur.aperture, d));
    snprintf(full, sizeof full, "%s.focus", path);
    PVX_TRY(pvx_yaml_double(y, focus, full, 1e-6, MAX_COORD, &c->blur.focus, d));
    double disc = rec_blur_disc(c, g);
    if (disc > REC_BLUR_MAX)
        return pvx_yaml_fail(y, node, path, PVX_EINVAL, d,
                             "points of the volume become discs of radius %.3g px; at most %g are "
                             "supported: aperture (its diameter) and focus are in metres",
                             disc, REC_BLUR_MAX);
    return PVX_OK;
}

pvx_err rec_blur_read(const pvx_yaml *y, int map, const char *path, const struct rec_grid *g,
                      struct rec_camera *c, struct pvx_diag *d)
{
    char full[64], sigma[80];
    snprintf(full, sizeof full, "%s.blur", path);
    if (c->blur.rays > 0)
        return pvx_yaml_fail(y, map, full, PVX_EINVAL, d,
                             "does not go with bundles of rays, which are the blur themselves; "
                             "leave it out, or give a file of one ray per pixel");
    PVX_TRY(pvx_yaml_known(y, map, full, "sigma aperture focus", d));
    int node = pvx_yaml_get(y, map, "sigma");
    if (node == 0)
        return blur_lens(y, map, full, g, c, d);
    if (pvx_yaml_get(y, map, "aperture") != 0 || pvx_yaml_get(y, map, "focus") != 0)
        return pvx_yaml_fail(y, map, full, PVX_EFORMAT, d,
                             "has sigma (px) or aperture and focus (m), not both");
    snprintf(sigma, sizeof sigma, "%s.sigma", full);
    return pvx_yaml_double(y, node, sigma, 0, REC_BLUR_MAX, &c->blur.sigma, d);
}

void rec_blur_write(FILE *f, const struct rec_camera *c)
{
    if (c->blur.sigma > 0)
        fprintf(f, "    blur: { sigma: %.17g }\n", c->blur.sigma);
    if (c->blur.aperture > 0)
        fprintf(f, "    blur: { aperture: %.17g, focus: %.17g }\n", c->blur.aperture,
                c->blur.focus);
}

void rec_windows_write(FILE *f, const struct rec_camera *c)
{
    for (int32_t i = 0; i < c->n_windows; i++) {
        const struct rec_glass *w = &c->window[i];
        fprintf(f,
                "%s      - { plane: [%.17g, %.17g, %.17g, %.17g], thickness: %.17g, n: %.17g }\n",
                i == 0 ? "    windows:\n" : "", w->normal[0], w->normal[1], w->normal[2], w->at,
                w->thickness, w->index);
    }
}

size_t rec_window_numbers(const struct rec_camera *c, double out[6 * REC_WINDOWS])
{
    size_t n = 0;
    for (int32_t i = 0; i < c->n_windows; i++) {
        const struct rec_glass *w = &c->window[i];
        for (int a = 0; a < 3; a++)
            out[n++] = w->normal[a];
        out[n++] = w->at;
        out[n++] = w->thickness;
        out[n++] = w->index;
    }
    return n;
}

/* ---- a ray per pixel -------------------------------------------------------------------------- */

/* The absolute path of the file: a rig that is written elsewhere still finds it. */
static bool rays_path(const char *rig, const char *file, char out[REC_RAY_TABLE_FILE])
{
    char path[PATH_MAX], full[PATH_MAX];
    const char *slash = file[0] == '/' ? NULL : strrchr(rig, '/');
    int folder = slash == NULL ? 0 : (int)(slash - rig) + 1;
    int n = snprintf(path, sizeof path, "%.*s%s", folder, rig, file);
    if (n < 0 || (size_t)n >= sizeof path)
        return false;
    n = snprintf(out, REC_RAY_TABLE_FILE, "%s", realpath(path, full) != NULL ? full : path);
    return n < REC_RAY_TABLE_FILE && file[strcspn(file, "\"\\")] == '\0';
}

pvx_err rec_rays_read(const pvx_yaml *y, int map, const char *path, const char *name,
                      struct rec_camera *c, struct pvx_diag *d)
{
    static const char *const others[] = {"K", "distortion", "R", "t", "windows"};
    char full[80], file[REC_RAY_TABLE_FILE];
    struct pvx_diag why = {""};
    for (int i = 0; i < 5; i++)
        if (pvx_yaml_get(y, map, others[i]) != 0)
            return pvx_yaml_fail(y, pvx_yaml_get(y, map, others[i]), path, PVX_EINVAL, d,
                                 "'%s' does not go with model: rays, whose file has the rays as "
                                 "they cross the volume",
                                 others[i]);
    int node = pvx_yaml_get(y, map, "rays");
    snprintf(full, sizeof full, "%s.rays", path);
    if (node == 0 || pvx_yaml_kind(y, node) != PVX_YAML_SCALAR)
        return pvx_yaml_fail(
            y, node != 0 ? node : map, full, PVX_EFORMAT, d,
            "model: rays needs rays: FILE.npy, [height][width][6] or [height][width][k][6] "
            "(ray_table.h)");
    if (!rays_path(name, pvx_yaml_text(y, node), file))
        return pvx_yaml_fail(y, node, full, PVX_EINVAL, d,
                             "the path is longer than %d characters or has a quote in it; rename "
                             "the file",
                             REC_RAY_TABLE_FILE - 1);
    pvx_err e = rec_ray_table_get(file, c->width, c->height, &c->table, &why);
    if (e != PVX_OK)
        return pvx_yaml_fail(y, node, full, e, d, "%.300s: %.600s", pvx_yaml_text(y, node),
                             pvx_diag_text(&why, e));
    c->model = REC_RAYS;
    c->fx = c->fy = 1;
    c->blur.rays = c->table->rays > 1 ? c->table->rays : 0;
    memcpy(c->R, c->table->R, sizeof c->R);
    memcpy(c->t, c->table->t, sizeof c->t);
    return PVX_OK;
}

void rec_rays_write(FILE *f, const struct rec_camera *c)
{
    fprintf(f, "    model: rays\n    rays: \"%s\"\n", c->table->file);
}

size_t rec_rays_numbers(const struct rec_camera *c, double out[2])
{
    if (c->model != REC_RAYS)
        return 0;
    out[0] = (double)(uint32_t)c->table->hash;
    out[1] = (double)(uint32_t)(c->table->hash >> 32);
    return 2;
}
