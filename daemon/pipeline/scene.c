#include "daemon/pipeline/scene.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "capture/pixel/pixfmt_pack.h"
#include "recon/view/flame.h"

struct dmn_scene {
    struct cap_scene cap;
    struct rec_flame flame;
    struct rec_rig rig;
    uint32_t seed;
    int64_t ignite_ns; /* the flame ignites once in each of these; 0 = it always burns */
    float *image[REC_MAX_CAMERAS]; /* one work area per camera */
};

static float clip(float v)
{
    return !(v > 0) ? 0.0f : v > 1 ? 1.0f : v;
}

/* Radiance of sample `ch` of one pixel; ch < 0 = grey. */
static float scene_sample(const float *p, int ch)
{
    return ch < 0 ? (p[0] + p[1] + p[2]) / 3 : p[ch];
}

/* Linear light to sRGB code, 0..1; the inverse of capture/pixel/transfer.h. */
static float coded(float light)
{
    return light <= 0.0031308f ? 12.92f * light : 1.055f * powf(light, 1 / 2.4f) - 0.055f;
}

/* A piece of a row, samples [width][1 or 3]. */
static void samples_of(const float *image, int32_t width, enum cap_pixfmt fmt, const uint8_t *cell,
                       uint16_t *out)
{
    bool yuv = cap_pixfmt_layout(fmt) == CAP_LAYOUT_YUV;
    int per = cell != NULL ? 1 : cap_pixfmt_channels(fmt);
    float full = (float)((1 << cap_pixfmt_depth(fmt)) - 1);
    for (int32_t x = 0; x < width; x++)
        for (int s = 0; s < per; s++) {
            int ch = cell != NULL ? cell[x & 1] : per == 1 ? -1 : s;
            float v = clip(scene_sample(image + (size_t)x * 3, ch));
            *out++ = (uint16_t)lrintf((yuv ? coded(v) : v) * full);
        }
}

static void floats_of(const float *image, int32_t width, int per, void *row)
{
    float *out = row;
    for (int32_t x = 0; x < width; x++)
        for (int s = 0; s < per; s++)
            *out++ = scene_sample(image + (size_t)x * 3, per == 1 ? -1 : s);
}

void dmn_scene_pack(const float *image, int32_t w, int32_t h, enum cap_pixfmt fmt, void *data)
{
    enum { PIECE = 256 }; /* pixels: whole bytes and groups in every layout */
    uint16_t s[PIECE * 3];
    const uint8_t *cell = cap_pixfmt_bayer(fmt);
    size_t bytes = cap_pixfmt_row(fmt, w);
    for (int32_t y = 0; y < h; y++) {
        const float *from = image + (size_t)y * (size_t)w * 3;
        uint8_t *row = (uint8_t *)data + (size_t)y * bytes;
        if (cap_pixfmt_layout(fmt) == CAP_LAYOUT_F32) {
            floats_of(from, w, cap_pixfmt_channels(fmt), row);
            continue;
        }
        for (int32_t x = 0; x < w; x += PIECE) {
            int32_t n = w - x < PIECE ? w - x : PIECE;
            samples_of(from + (size_t)x * 3, n, fmt, cell == NULL ? NULL : cell + (y & 1) * 2, s);
            cap_pixfmt_pack_row(fmt, n, s, row + cap_pixfmt_row(fmt, x));
        }
    }
}

/* When the flame ignites in period k: at 0.1 to 0.6 of it (tests/system/ring.py has the same formula). */
static int64_t scene_ignites(uint32_t seed, int64_t ignite_ns, int64_t k)
{
    uint64_t x = (uint64_t)k * 0x9E3779B97F4A7C15u + seed;
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9u;
    x = (x ^ x >> 27) * 0x94D049BB133111EBu;
    double u = (double)((x ^ x >> 31) >> 11) * 0x1p-53;
    return k * ignite_ns + (int64_t)((0.1 + 0.5 * u) * (double)ignite_ns);
}

static bool burns(const dmn_scene *s, int64_t t)
{
    if (s->ignite_ns == 0)
        return true;
    int64_t since = t - scene_ignites(s->seed, s->ignite_ns, t / s->ignite_ns);
    return since >= 0 && since < s->ignite_ns / 3;
}

static void scene_render(void *ctx, uint32_t camera, int64_t t_real_ns, enum cap_pixfmt fmt,
                         int32_t w, int32_t h, void *data)
{
    dmn_scene *s = ctx;
    const struct rec_camera *c = &s->rig.cameras[camera];
    struct rec_flame_pose pose;
    /* Take off whole periods in integers: at 1e18 a double does not resolve nanoseconds. */
    int64_t period = (int64_t)(s->flame.period_s * (double)PVX_NS_PER_S);
    rec_flame_at(&s->flame, (double)(t_real_ns % period) * 1e-9, &pose);
    if (w != c->width || h != c->height) {
        memset(data, 0, cap_pixfmt_image(fmt, w, h));
        return; /* not the size that the rig was calibrated for */
    }
    if (burns(s, t_real_ns))
        rec_flame_render(&pose, c, 1, 0, h, s->image[camera]);
    else
        memset(s->image[camera], 0, (size_t)w * (size_t)h * 3 * sizeof(float));
    dmn_scene_pack(s->image[camera], w, h, fmt, data);
}

pvx_err dmn_scene_new(const struct rec_rig *rig, uint32_t seed, double period_s, double ignite_s,
                      dmn_scene **out)
{
    *out = NULL;
    dmn_scene *s = pvx_calloc(1, sizeof *s);
    PVX_NEED(s);
    pvx_err e = rec_rig_copy(rig, &s->rig);
    for (size_t c = 0; c < s->rig.n_cameras && e == PVX_OK; c++) {
        const struct rec_camera *k = &s->rig.cameras[c];
        s->image[c] = pvx_calloc((size_t)k->width * (size_t)k->height, 3 * sizeof(float));
        if (s->image[c] == NULL)
            e = PVX_ENOMEM;
    }
    if (e != PVX_OK) {
        dmn_scene_free(&s);
        return e;
    }
    rec_flame_init(&s->flame, &s->rig.grid, seed);
    s->flame.period_s = period_s;
    s->seed = seed;
    s->ignite_ns = (int64_t)(ignite_s * 1e9);
    s->cap = (struct cap_scene){.render = scene_render, .ctx = s};
    *out = s;
    return PVX_OK;
}

void dmn_scene_free(dmn_scene **s)
{
    if (*s == NULL)
        return;
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        free((*s)->image[c]);
    rec_rig_fini(&(*s)->rig);
    PVX_FREE(*s);
}

const struct cap_scene *dmn_scene_cap(const dmn_scene *s)
{
    return s == NULL ? NULL : &s->cap;
}
