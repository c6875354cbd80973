#include "daemon/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"

struct dmn_scene {
    struct cap_scene cap;
    struct rec_flame flame;
    struct rec_rig rig;
    float *image[REC_MAX_CAMERAS]; /* one work area per camera */
};

static float clip(float v)
{
    return !(v > 0) ? 0.0f : v > 1 ? 1.0f : v;
}

/* Which channel a Bayer camera measures at (x, y); the name gives the first two pixels of row 0. */
static int bayer_channel(enum cap_pixfmt fmt, int32_t x, int32_t y)
{
    static const int8_t tile[4][2][2] = {
        {{0, 1}, {1, 2}}, {{1, 0}, {2, 1}}, {{1, 2}, {0, 1}}, {{2, 1}, {1, 0}}};
    return tile[fmt - CAP_BAYER_RG8][y & 1][x & 1];
}

/* Radiance of sample `ch` of one pixel; ch < 0 = grey. */
static float sample(const float *p, int ch)
{
    return ch < 0 ? (p[0] + p[1] + p[2]) / 3 : p[ch];
}

void dmn_scene_pack(const float *image, int32_t w, int32_t h, enum cap_pixfmt fmt, void *data)
{
    size_t bytes = cap_pixfmt_row(fmt, 1), n = 0;
    int bayer = cap_pixfmt_bayer(fmt) != NULL;
    int samples = bayer ? 1 : cap_pixfmt_channels(fmt);
    size_t width = bytes / (size_t)samples;
    for (int32_t y = 0; y < h; y++)
        for (int32_t x = 0; x < w; x++) {
            const float *p = image + ((size_t)y * (size_t)w + (size_t)x) * 3;
            for (int s = 0; s < samples; s++, n++) {
                int ch = bayer ? bayer_channel(fmt, x, y) : samples == 1 ? -1 : s;
                float v = sample(p, ch);
                if (width == 4)
                    ((float *)data)[n] = v;
                else if (width == 2)
                    ((uint16_t *)data)[n] = (uint16_t)lrintf(clip(v) * 65535);
                else
                    ((uint8_t *)data)[n] = (uint8_t)lrintf(clip(v) * 255);
            }
        }
}

static void render(void *ctx, uint32_t camera, int64_t t_real_ns, enum cap_pixfmt fmt, int32_t w,
                   int32_t h, void *data)
{
    dmn_scene *s = ctx;
    const struct rec_camera *c = &s->rig.cameras[camera];
    struct rec_flame_pose pose;
    /* Whole periods are taken off in integers: a double has no nanoseconds left at 1e18. */
    int64_t period = (int64_t)(s->flame.period_s * (double)PVX_NS_PER_S);
    rec_flame_at(&s->flame, (double)(t_real_ns % period) * 1e-9, &pose);
    if (w != c->width || h != c->height) {
        memset(data, 0, cap_pixfmt_image(fmt, w, h));
        return; /* not the size that the rig was calibrated for */
    }
    rec_flame_render(&pose, c, 1, 0, h, s->image[camera]);
    dmn_scene_pack(s->image[camera], w, h, fmt, data);
}

pvx_err dmn_scene_new(const struct rec_rig *rig, uint32_t seed, double period_s, dmn_scene **out)
{
    *out = NULL;
    dmn_scene *s = pvx_calloc(1, sizeof *s);
    if (s == NULL)
        return PVX_ENOMEM;
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
    s->cap = (struct cap_scene){.render = render, .ctx = s};
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
    return &s->cap;
}

const struct rec_flame *dmn_scene_flame(const dmn_scene *s)
{
    return &s->flame;
}
