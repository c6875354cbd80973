#include "daemon/cli/pictures/hull_picture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/files/imgio.h"
#include "daemon/cli/pictures/paint.h"
#include "recon/frame/inside.h"
#include "recon/view/render.h"

enum { TILE_W = 320, TILE_H = 240, LABEL = 14, GAP = 8, TOP = 34, COLUMNS = 5, FIRST_CAMERA = 5 };

static const struct paint_rgb ground = {0.07f, 0.07f, 0.08f}, panel = {0, 0, 0},
                              ink = {0.85f, 0.85f, 0.85f}, inside = {1, 0.2f, 0.12f},
                              partial = {0.15f, 0.85f, 0.25f}, outside = {0.95f, 0.85f, 0.2f},
                              fog = {0.16f, 0.145f, 0.04f}, outline = {0.25f, 0.9f, 1};

struct hull_picture {
    const rec_sysmat *S;
    const struct rec_rig *rig;
    pvx_pool *pool;
    rec_hull *hull;
    struct rec_hull_params params;
    int nch;
    size_t row0[REC_MAX_CAMERAS + 1];
    int32_t *col;   /* [N] */
    uint8_t *klass; /* [N] */
    float *dense;   /* [N][3] inside and partial as light */
    float view[TILE_H * TILE_W * 3];
};

pvx_err hull_picture_new(const rec_sysmat *S, const struct rec_rig *rig, int nch,
                         uint32_t min_views, pvx_pool *pool, hull_picture **out)
{
    *out = NULL;
    hull_picture *h = pvx_calloc(1, sizeof *h);
    PVX_NEED(h);
    size_t n = rec_grid_count(&S->grid);
    h->S = S;
    h->rig = rig;
    h->pool = pool;
    h->nch = nch;
    h->params = (struct rec_hull_params){.min_views = min_views, .keep_partial = 1};
    memcpy(h->row0, S->row0, (S->n_cameras + 1) * sizeof *h->row0);
    h->col = pvx_calloc(n, sizeof *h->col);
    h->klass = pvx_calloc(n, 1);
    h->dense = pvx_calloc(n * 3, sizeof *h->dense);
    pvx_err e = PVX_ENOMEM;
    if (h->col != NULL && h->klass != NULL && h->dense != NULL)
        e = rec_hull_new(S, &h->hull);
    if (e != PVX_OK) {
        hull_picture_free(&h);
        return e;
    }
    *out = h;
    return PVX_OK;
}

void hull_picture_free(hull_picture **hp)
{
    hull_picture *h = *hp;
    if (h == NULL)
        return;
    rec_hull_free(&h->hull);
    free(h->col);
    free(h->klass);
    free(h->dense);
    free(h);
    *hp = NULL;
}

/* Upper left of tile i, below its label. */
static void tile(int i, int32_t *x, int32_t *y)
{
    *x = GAP + i % COLUMNS * (TILE_W + GAP);
    *y = TOP + i / COLUMNS * (TILE_H + LABEL + GAP) + LABEL;
}

static void hull_picture_label(struct paint *p, int i, const char *text)
{
    int32_t x, y;
    tile(i, &x, &y);
    paint_text(p, x, y - LABEL + 3, 1, ink, text);
}

/* Part of an image, in pixels.  (0,0) is the centre of the first pixel. */
struct window {
    double x0, y0, x1, y1;
};

static struct window hull_picture_whole(const struct rec_camera *c)
{
    return (struct window){-0.5, -0.5, c->width - 0.5, c->height - 0.5};
}

/* The part of the image with the volume and `room` times its size all round.  The whole image if some of the volume
 * is not in front of the camera. */
static struct window around_volume(const struct rec_camera *c, const struct rec_grid *g,
                                   double room)
{
    struct window w = {INFINITY, INFINITY, -INFINITY, -INFINITY};
    for (int corner = 0; corner < 8; corner++) {
        double X[3], uv[2];
        for (int a = 0; a < 3; a++)
            X[a] = corner >> a & 1 ? g->max[a] : g->min[a];
        if (!rec_camera_project(c, X, uv))
            return hull_picture_whole(c);
        w.x0 = fmin(w.x0, uv[0]);
        w.x1 = fmax(w.x1, uv[0]);
        w.y0 = fmin(w.y0, uv[1]);
        w.y1 = fmax(w.y1, uv[1]);
    }
    double by = room * fmax(w.x1 - w.x0, w.y1 - w.y0) + 1;
    return (struct window){w.x0 - by, w.y0 - by, w.x1 + by, w.y1 + by};
}

/* The camera whose image is that part, scaled to fit a tile. */
static struct rec_camera tile_camera(const struct rec_camera *c, struct window w)
{
    struct rec_camera s = *c;
    double k = fmin(TILE_W / (w.x1 - w.x0), TILE_H / (w.y1 - w.y0));
    s.width = (int32_t)fmin(TILE_W, fmax(1, floor((w.x1 - w.x0) * k + 1e-9)));
    s.height = (int32_t)fmin(TILE_H, fmax(1, floor((w.y1 - w.y0) * k + 1e-9)));
    s.fx *= k;
    s.fy *= k;
    s.blur = (struct rec_blur){0}; /* outlines stay sharp */
    s.cx = (c->cx - w.x0) * k - 0.5;
    s.cy = (c->cy - w.y0) * k - 0.5;
    return s;
}

/* Draw the edges of the volume as the camera sees them, cut off at its image. */
static void draw_box(struct paint *p, const struct rec_grid *g, const struct rec_camera *c,
                     int32_t x, int32_t y, struct paint_rgb colour)
{
    enum { PIECES = 48 }; /* of an edge, because a lens bends it */
    for (int edge = 0; edge < 12; edge++) {
        int a = edge / 4, b = (a + 1) % 3, e = (a + 2) % 3;
        double X[3], last[2], uv[2];
        bool had = false;
        X[b] = edge & 1 ? g->max[b] : g->min[b];
        X[e] = edge & 2 ? g->max[e] : g->min[e];
        for (int i = 0; i <= PIECES; i++, memcpy(last, uv, sizeof uv)) {
            X[a] = g->min[a] + (g->max[a] - g->min[a]) * i / PIECES;
            bool in = rec_camera_sees(c, X, uv);
            if (in && had)
                paint_line(p, x + last[0], y + last[1], x + uv[0], y + uv[1], colour);
            had = in;
        }
    }
}

/* Draw the hull as red and green light, seen from a camera. */
static pvx_err hull_picture_draw_view(hull_picture *h, struct paint *p, int at, size_t camera)
{
    struct rec_camera c = tile_camera(&h->rig->cameras[camera],
                                      around_volume(&h->rig->cameras[camera], &h->S->grid, 0.04));
    int32_t x0, y0;
    size_t n = (size_t)c.width * (size_t)c.height * 3;
    float most[2] = {0};
    tile(at, &x0, &y0);
    paint_rect(p, x0, y0, c.width, c.height, panel);
    draw_box(p, &h->S->grid, &c, x0, y0, (struct paint_rgb){0.5f, 0.45f, 0.1f});
    PVX_TRY(rec_render(&h->S->grid, h->dense, 3, &(struct rec_eye){.camera = &c, .sub = 1}, h->pool,
                       h->view));
    for (size_t i = 0; i < n; i += 3)
        for (size_t l = 0; l < 2; l++)
            most[l] = fmaxf(most[l], h->view[i + l]);
    for (int32_t y = 0; y < c.height; y++)
        for (int32_t x = 0; x < c.width; x++) {
            const float *v = h->view + ((size_t)y * (size_t)c.width + (size_t)x) * 3;
            /* depth of either class as brightness; red lies over green */
            float r = most[0] > 0 ? sqrtf(v[0] / most[0]) : 0;
            float g = most[1] > 0 ? sqrtf(v[1] / most[1]) * (1 - 0.8f * r) : 0;
            if (r > 0 || g > 0)
                paint_dot(p, x0 + x, y0 + y,
                          (struct paint_rgb){fminf(1, r * inside.r + g * partial.r),
                                             fminf(1, r * inside.g + g * partial.g),
                                             fminf(1, r * inside.b + g * partial.b)});
        }
    char text[REC_NAME_MAX + 32];
    snprintf(text, sizeof text, "seen from %s", h->rig->cameras[camera].name);
    hull_picture_label(p, at, text);
    return PVX_OK;
}

/* Draw the plane of voxels across axis `a` through voxel `k`, with z (or y) upwards. */
static void draw_slice(const hull_picture *h, struct paint *p, int at, int a, int32_t k)
{
    static const char *const plane[] = {"y-z slice at x", "x-z slice at y", "x-y slice at z"};
    const struct rec_grid *g = &h->S->grid;
    int u = a == 0 ? 1 : 0, v = a == 2 ? 1 : 2;
    double wide = g->max[u] - g->min[u], high = g->max[v] - g->min[v];
    double scale = fmin(TILE_W / wide, TILE_H / high); /* px per metre */
    int32_t w = (int32_t)(wide * scale), hh = (int32_t)(high * scale), x0, y0, ijk[3];
    tile(at, &x0, &y0);
    ijk[a] = k;
    for (int32_t y = 0; y < hh; y++)
        for (int32_t x = 0; x < w; x++) {
            ijk[u] = (int32_t)((int64_t)x * g->n[u] / w);
            ijk[v] = g->n[v] - 1 - (int32_t)((int64_t)y * g->n[v] / hh);
            uint8_t c = h->klass[rec_grid_index(g, ijk[0], ijk[1], ijk[2])];
            bool rim = x == 0 || y == 0 || x == w - 1 || y == hh - 1;
            paint_dot(p, x0 + x, y0 + y, rim ? outside : c == 2 ? inside : c == 1 ? partial : fog);
        }
    char text[64];
    snprintf(text, sizeof text, "%s = %.3f m", plane[a], g->min[a] + (k + 0.5) * rec_grid_h(g, a));
    hull_picture_label(p, at, text);
}

/* Brightest value of all cameras, so that all get the same exposure. */
static float hull_picture_brightest(const hull_picture *h, const rec_frame *f, const bool *present)
{
    size_t cs = h->nch == 3 ? 4 : 1;
    const float *b = rec_frame_rhs(f);
    float most = 0;
    for (size_t c = 0; c < h->S->n_cameras; c++)
        for (size_t i = h->row0[c]; present[c] && i < h->row0[c + 1]; i++)
            for (size_t l = 0; l < (size_t)h->nch; l++)
                most = fmaxf(most, b[i * cs + l]);
    return most > 0 ? most : 1;
}

static float shown(float v, float most)
{
    return v > 0 ? 0.8f * powf(v / most, 1 / 2.2f) : 0;
}

/* The part of the image that a tile shows: the volume's surroundings, or all if there is light elsewhere. */
static struct window shown_part(const hull_picture *h, size_t c, const uint8_t *lit)
{
    const struct rec_camera *cam = &h->rig->cameras[c];
    const struct rec_sysmat_block *b = &h->S->block[c];
    struct window all = hull_picture_whole(cam), w = around_volume(cam, &h->S->grid, 0.3);
    double size = h->S->binning;
    w.x0 = fmax(w.x0, all.x0);
    w.y0 = fmax(w.y0, all.y0);
    w.x1 = fmin(w.x1, all.x1);
    w.y1 = fmin(w.y1, all.y1);
    if (!(w.x1 - w.x0 > 2 * size && w.y1 - w.y0 > 2 * size))
        return all;
    for (int32_t y = 0; y < b->bh; y++)
        for (int32_t x = 0; x < b->bw; x++) {
            double u = (x + 0.5) * size - 0.5, v = (y + 0.5) * size - 0.5;
            if (lit[(size_t)y * (size_t)b->bw + (size_t)x] &&
                (u < w.x0 || u > w.x1 || v < w.y0 || v > w.y1))
                return all;
        }
    return w;
}

/* How the pixels of a tile lie on the bins of a camera. */
struct sight {
    const struct rec_sysmat_block *b;
    struct window w;
    double k; /* tile pixels per raw pixel */
    int32_t binning;
    const uint8_t *lit;
};

/* Bin under pixel (x,y) of the tile, or -1 outside of the image. */
static int64_t bin_at(const struct sight *s, int32_t x, int32_t y)
{
    double u = floor((s->w.x0 + (x + 0.5) / s->k + 0.5) / s->binning);
    double v = floor((s->w.y0 + (y + 0.5) / s->k + 0.5) / s->binning);
    return u >= 0 && v >= 0 && u < s->b->bw && v < s->b->bh ? (int64_t)v * s->b->bw + (int64_t)u
                                                            : -1;
}

static bool lit_at(const struct sight *s, int32_t x, int32_t y)
{
    int64_t bin = bin_at(s, x, y);
    return bin >= 0 && s->lit[bin] != 0;
}

/* Draw the picture of camera c, the outline of its silhouette, and the volume. */
static void draw_camera(const hull_picture *h, struct paint *p, const rec_frame *f, size_t c,
                        bool present, float most)
{
    const struct rec_camera *cam = &h->rig->cameras[c];
    int at = FIRST_CAMERA + (int)c;
    char text[REC_NAME_MAX + 48];
    int32_t x0, y0;
    tile(at, &x0, &y0);
    if (!present) {
        paint_rect(p, x0, y0, TILE_W, TILE_H, panel);
        snprintf(text, sizeof text, "%s: no image", cam->name);
        hull_picture_label(p, at, text);
        return;
    }
    struct sight s = {.b = &h->S->block[c], .binning = h->S->binning, .lit = rec_frame_lit(f, c)};
    s.w = shown_part(h, c, s.lit);
    struct rec_camera t = tile_camera(cam, s.w);
    s.k = t.fx / cam->fx;
    size_t cs = h->nch == 3 ? 4 : 1, bins = (size_t)s.b->bw * (size_t)s.b->bh, lit_bins = 0;
    const float *light = rec_frame_rhs(f) + h->row0[c] * cs;
    for (size_t i = 0; i < bins; i++)
        lit_bins += s.lit[i] != 0;
    for (int32_t y = 0; y < t.height; y++)
        for (int32_t x = 0; x < t.width; x++) {
            int64_t bin = bin_at(&s, x, y);
            const float *v = light + (size_t)(bin < 0 ? 0 : bin) * cs;
            struct paint_rgb colour = {shown(v[0], most), shown(v[h->nch == 3 ? 1 : 0], most),
                                       shown(v[h->nch == 3 ? 2 : 0], most)};
            paint_dot(p, x0 + x, y0 + y, bin < 0 ? panel : colour);
        }
    draw_box(p, &h->S->grid, &t, x0, y0, (struct paint_rgb){0.5f, 0.45f, 0.1f});
    for (int32_t y = 0; y < t.height; y++)
        for (int32_t x = 0; x < t.width; x++)
            if (lit_at(&s, x, y) && !(lit_at(&s, x - 1, y) && lit_at(&s, x + 1, y) &&
                                      lit_at(&s, x, y - 1) && lit_at(&s, x, y + 1)))
                paint_dot(p, x0 + x, y0 + y, outline);
    snprintf(text, sizeof text, "%s: %zu of %zu bins lit%s", cam->name, lit_bins, bins,
             s.w.x1 - s.w.x0 < cam->width - 0.1 || s.w.y1 - s.w.y0 < cam->height - 0.1
                 ? ", part of the image"
                 : "");
    hull_picture_label(p, at, text);
}

static int32_t hull_picture_count(struct paint *p, int32_t x, struct paint_rgb c, const char *what,
                                  int64_t n, int64_t of)
{
    char text[96];
    snprintf(text, sizeof text, "%s %lld (%.1f %%)", what, (long long)n,
             100 * (double)n / (double)of);
    paint_rect(p, x, 9, 14, 14, c);
    return x + 20 + paint_text(p, x + 20, 9, 2, ink, text) + 24;
}

static void headline(const hull_picture *h, struct paint *p, const struct rec_hull_counts *k,
                     uint64_t number)
{
    const struct rec_grid *g = &h->S->grid;
    char text[96];
    int64_t all = k->inside + k->partial + k->outside;
    snprintf(text, sizeof text, "frame %06llu: %dx%dx%d voxels, %s", (unsigned long long)number,
             g->n[0], g->n[1], g->n[2], rec_basis_name(g->basis));
    int32_t x = GAP + paint_text(p, GAP, 9, 2, ink, text) + 36;
    x = hull_picture_count(p, x, inside, "inside", k->inside, all);
    x = hull_picture_count(p, x, partial, "partly", k->partial, all);
    hull_picture_count(p, x, outside, "outside", k->outside, all);
}

/* The camera whose line of sight is most nearly perpendicular to that of the first camera. */
static size_t other_view(const struct rec_rig *rig)
{
    size_t best = 0;
    double least = 2;
    for (size_t c = 1; c < rig->n_cameras; c++) {
        double dot = 0;
        for (int a = 0; a < 3; a++)
            dot += rig->cameras[0].R[6 + a] * rig->cameras[c].R[6 + a];
        if (fabs(dot) < least) {
            least = fabs(dot);
            best = c;
        }
    }
    return best;
}

/* Classify all voxels, and store the classes as light, too.  *middle: mean place of the voxels that are kept. */
static void hull_picture_classify(hull_picture *h, const rec_frame *f, const bool *present,
                                  struct rec_hull_counts *counts, int32_t middle[3])
{
    const uint8_t *lit[REC_MAX_CAMERAS];
    struct rec_hull_kept kept = {.col = h->col, .klass = h->klass};
    double sum[3] = {0};
    for (size_t c = 0; c < h->S->n_cameras; c++)
        lit[c] = rec_frame_lit(f, c);
    rec_hull_carve(h->hull, &h->params, lit, present, h->pool, &kept);
    *counts = kept.counts;
    memset(h->dense, 0, rec_grid_count(&h->S->grid) * 3 * sizeof *h->dense);
    for (int32_t q = 0; q < kept.n; q++) {
        int32_t ijk[3];
        rec_grid_ijk(&h->S->grid, h->col[q], ijk);
        for (int a = 0; a < 3; a++)
            sum[a] += ijk[a];
        h->dense[(size_t)h->col[q] * 3 + (h->klass[h->col[q]] == 2 ? 0 : 1)] = 1;
    }
    for (int a = 0; a < 3; a++)
        middle[a] = kept.n > 0 ? (int32_t)lrint(sum[a] / kept.n) : h->S->grid.n[a] / 2;
}

pvx_err hull_picture_save(hull_picture *h, const rec_frame *f, const bool *present, uint64_t number,
                          const char *path, struct pvx_diag *d)
{
    struct rec_hull_counts counts;
    struct paint p;
    int32_t middle[3];
    int rows = (FIRST_CAMERA + (int)h->rig->n_cameras + COLUMNS - 1) / COLUMNS;
    hull_picture_classify(h, f, present, &counts, middle);
    pvx_err e =
        paint_init(&p, GAP + COLUMNS * (TILE_W + GAP), TOP + rows * (TILE_H + LABEL + GAP), ground);
    if (e == PVX_OK) {
        headline(h, &p, &counts, number);
        e = hull_picture_draw_view(h, &p, 0, 0);
    }
    PVX_THEN(e, hull_picture_draw_view(h, &p, 1, other_view(h->rig)));
    if (e != PVX_OK) {
        paint_fini(&p);
        return pvx_fail(d, e, "%s: %s", path, pvx_strerror(e));
    }
    draw_slice(h, &p, 2, 1, middle[1]);
    draw_slice(h, &p, 3, 0, middle[0]);
    draw_slice(h, &p, 4, 2, middle[2]);
    float most = hull_picture_brightest(h, f, present);
    for (size_t c = 0; c < h->rig->n_cameras; c++)
        draw_camera(h, &p, f, c, present[c], most);
    e = cap_image_save(path, p.pix, p.w, p.h, 3, d);
    paint_fini(&p);
    return e;
}
