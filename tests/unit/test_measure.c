/* test_measure.c - daemon/volumes/measure.h: figures of regions and their bars, against sums that are made here. */
#include "../t.h"

#include <math.h>
#include <stdlib.h>

#include "daemon/volumes/bricks.h"
#include "daemon/volumes/measure.h"

enum { NX = 19, NY = 11, NZ = 13, MODES = 5, MOST = NX * NY * NZ * 3 };
#define CELLS ((size_t)PVP_BRICK * PVP_BRICK * PVP_BRICK)

/* A volume, its modes and t as dense arrays, and the same as bricks. */
struct made {
    struct pvp_grid g;
    size_t n; /* values */
    float x[MOST], d[MODES][MOST], t[MOST];
    struct vol_volume v;
    uint32_t ids[64];
    float *brick, *sd, *modes;
};

static const struct pvp_grid grid = {
    .n = {NX, NY, NZ}, .min = {-0.4, 0.1, 1}, .max = {0.55, 0.54, 1.78}, .channels = 3};

/* Bricks of all voxels, in the order of the ids. */
static void in_bricks(const struct made *m, const float *dense, float *brick)
{
    uint32_t nb[3], c = m->g.channels;
    pvp_grid_bricks(&m->g, nb);
    for (uint32_t id = 0; id < m->v.n_bricks; id++)
        for (size_t q = 0; q < CELLS; q++) {
            size_t i = id % nb[0] * PVP_BRICK + q % PVP_BRICK,
                   j = id / nb[0] % nb[1] * PVP_BRICK + q / PVP_BRICK % PVP_BRICK,
                   k = id / nb[0] / nb[1] * PVP_BRICK + q / PVP_BRICK / PVP_BRICK;
            for (size_t l = 0; l < c && i < NX && j < NY && k < NZ; l++)
                brick[(id * CELLS + q) * c + l] = dense[((k * NY + j) * NX + i) * c + l];
        }
}

static struct made *make(uint32_t channels, bool modes)
{
    uint32_t nb[3];
    struct made *m = calloc(1, sizeof *m);
    m->g = grid;
    m->g.channels = channels;
    m->n = (size_t)NX * NY * NZ * channels;
    m->v = (struct vol_volume){.v = {.grid = m->g}, .n_bricks = pvp_grid_bricks(&m->g, nb)};
    size_t floats = m->v.n_bricks * CELLS * channels;
    m->brick = calloc(floats, sizeof *m->brick);
    m->sd = calloc(floats, sizeof *m->sd);
    m->modes = calloc(MODES * floats, sizeof *m->modes);
    float *sd = calloc(m->n, sizeof *sd);
    for (size_t i = 0; i < m->n; i++) {
        double var = 0;
        m->x[i] = (float)t_uniform(0, 2);
        for (int k = 0; k < MODES && modes; k++) {
            m->d[k][i] = (float)t_uniform(-0.1, 0.1);
            var += (double)m->d[k][i] * (double)m->d[k][i];
        }
        m->t[i] = (float)t_uniform(0, 0.2);
        sd[i] = (float)sqrt(var + (double)m->t[i] * (double)m->t[i]);
    }
    for (uint32_t id = 0; id < m->v.n_bricks; id++)
        m->ids[id] = id;
    in_bricks(m, m->x, m->brick);
    in_bricks(m, sd, m->sd);
    for (int k = 0; k < MODES; k++)
        in_bricks(m, m->d[k], m->modes + (size_t)k * floats);
    m->v.ids = m->ids;
    m->v.brick = m->brick;
    m->v.bars = (struct vol_bars){
        .sd = m->sd, .n_modes = modes ? MODES : 0, .modes = modes ? m->modes : NULL};
    free(sd);
    return m;
}

static void done(struct made *m)
{
    free(m->brick);
    free(m->sd);
    free(m->modes);
    free(m);
}

/* Whether a voxel's centre is in the region, from the region's words. */
static bool inside(const struct vol_region *r, const size_t at[3])
{
    double p[3], r2 = 0;
    for (int a = 0; a < 3; a++) {
        double h = (grid.max[a] - grid.min[a]) / grid.n[a];
        p[a] = grid.min[a] + ((double)at[a] + 0.5) * h;
        if (r->kind == VOL_BOX && (p[a] < r->at[a] || p[a] > r->at[a + 3]))
            return false;
        if (r->kind == VOL_SLICE && a == (int)r->at[0] && fabs(p[a] - r->at[1]) > h / 2)
            return false;
        r2 += (p[a] - r->at[a]) * (p[a] - r->at[a]);
    }
    return r->kind != VOL_SPHERE || r2 <= r->at[3] * r->at[3];
}

/* Sum over the region of the mean of the channels, or of one. */
static double sum_of(const struct made *m, const struct vol_region *r, int channel, const float *v,
                     bool squares, uint64_t *n)
{
    double sum = 0;
    size_t c = m->g.channels, at[3];
    *n = 0;
    for (at[2] = 0; at[2] < NZ; at[2]++)
        for (at[1] = 0; at[1] < NY; at[1]++)
            for (at[0] = 0; at[0] < NX; at[0]++) {
                const float *p = v + ((at[2] * NY + at[1]) * NX + at[0]) * c;
                double one = 0;
                if (!inside(r, at))
                    continue;
                for (size_t l = 0; l < c; l++)
                    one += channel < 0 ? (double)p[l] / (double)c
                                       : (double)p[l] * (double)(l == (size_t)channel);
                sum += squares ? one * one : one;
                ++*n;
            }
    return sum;
}

static const struct vol_region regions[] = {
    {.kind = VOL_ALL},
    {.kind = VOL_BOX, .at = {-0.21, 0.15, 1.1, 0.3, 0.4, 1.5}},
    {.kind = VOL_SPHERE, .at = {0.05, 0.33, 1.4, 0.17}},
    {.kind = VOL_SLICE, .at = {2, 1.31}},
    {.kind = VOL_SLICE, .at = {0, 0.52}},
};

T_CASE(sums_and_their_bars)
{
    for (uint32_t channels = 1; channels <= 3; channels += 2)
        for (size_t i = 0; i < sizeof regions / sizeof *regions; i++)
            for (int channel = -1; channel < (int)channels; channel++) {
                struct made *m = make(channels, true);
                struct vol_measure_how how = {.region = regions[i], .channel = channel, .level = 1};
                struct vol_measured got;
                uint64_t n;
                double V = 0.05 * 0.04 * 0.06, var = 0;
                double sum = sum_of(m, &regions[i], channel, m->x, false, &n);
                for (int k = 0; k < MODES; k++) {
                    double one = sum_of(m, &regions[i], channel, m->d[k], false, &n);
                    var += one * one;
                }
                var += sum_of(m, &regions[i], channel, m->t, true, &n);
                T_EQ_I(vol_measure(&m->v, &how, &got, NULL), PVX_OK);
                T_OK(n > 20);
                T_EQ_I(got.voxels, n);
                T_NEAR(got.mean.v, sum / (double)n, 1e-6);
                T_NEAR(got.light.v, V * sum, 1e-6 * V * sum);
                T_NEAR(got.mean.sd, sqrt(var) / (double)n, 1e-5 * sqrt(var) / (double)n);
                T_NEAR(got.light.sd, V * sqrt(var), 1e-5 * V * sqrt(var));
                T_OK(got.bars && got.modes && got.volume.sd > 0);
                T_OK((got.height.sd > 0) == (i != 3)); /* a layer has one height */
                done(m);
            }
}

/* Light that grows upwards at a rate that one mode changes: the height and its bar are known. */
T_CASE(height)
{
    struct made *m = make(1, true);
    size_t floats = m->v.n_bricks * CELLS;
    const struct vol_measure_how how = {.region = {.kind = VOL_ALL}, .channel = -1, .level = 0.5};
    struct vol_measured got;
    for (size_t i = 0; i < m->n; i++) {
        size_t z = i / (NX * NY);
        m->x[i] = z < 10 ? 1 : 0; /* 98 % of ten layers: 0.2 of a layer below their top */
        m->d[0][i] = z == 10 ? 0.1F : 0;
    }
    in_bricks(m, m->x, m->brick);
    memset(m->modes, 0, MODES * floats * sizeof *m->modes);
    in_bricks(m, m->d[0], m->modes);
    T_EQ_I(vol_measure(&m->v, &how, &got, NULL), PVX_OK);
    double h = 0.06;
    T_NEAR(got.height.v, 1 + 9.8 * h, 1e-9);
    /* ten layers and a tenth: 2 % of it is 0.202; the tenth is above, 0.102 of the layer below */
    double up = 1 + (10 - 0.102) * h, down = NAN;
    /* ten layers less a tenth: 2 % of it is 0.198, and -0.1 lies above: 0.298 of the layer below */
    down = 1 + (10 - 0.298) * h;
    T_NEAR(got.height.sd, fabs(up - down) / 2, 1e-7);
    T_NEAR(got.volume.v, 0.05 * 0.04 * h * 10 * NX * NY, 1e-9);
    T_NEAR(got.volume.sd, 0, 1e-12); /* no voxel comes near the level */
    done(m);
}

/* Without modes a sum has no bar, a voxel has one; without bars nothing has one. */
T_CASE(what_is_not_known)
{
    struct made *m = make(3, false);
    struct vol_measure_how how = {.region = {.kind = VOL_ALL}, .channel = 1, .level = 1};
    struct vol_measured got;
    T_EQ_I(vol_measure(&m->v, &how, &got, NULL), PVX_OK);
    T_OK(got.bars && !got.modes && isnan(got.light.sd) && isnan(got.height.sd));
    T_OK(isnan(got.volume.sd) && got.most.sd >= 0);
    how.region = (struct vol_region){.kind = VOL_BOX, .at = {0.02, 0.28, 1.36, 0.03, 0.31, 1.42}};
    T_EQ_I(vol_measure(&m->v, &how, &got, NULL), PVX_OK);
    T_EQ_I(got.voxels, 1);
    T_OK(got.mean.sd > 0 && got.mean.sd == got.most.sd);
    m->v.bars = (struct vol_bars){0};
    T_EQ_I(vol_measure(&m->v, &how, &got, NULL), PVX_OK);
    T_OK(!got.bars && isnan(got.mean.sd) && isnan(got.most.sd));
    done(m);
}

T_CASE(refused)
{
    struct made *m = make(1, true);
    struct vol_measure_how how = {.region = {.kind = VOL_SPHERE, .at = {9, 9, 9, 0.1}},
                                  .channel = -1};
    struct vol_measured got;
    struct pvx_diag d = {""};
    T_EQ_I(vol_measure(&m->v, &how, &got, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "the volume goes from -0.4 0.1 1 to 0.55 0.54 1.78 m");
    how = (struct vol_measure_how){.region = {.kind = VOL_SLICE, .at = {2, 2}}, .channel = -1};
    T_EQ_I(vol_measure(&m->v, &how, &got, &d), PVX_EINVAL);
    how = (struct vol_measure_how){.channel = 2};
    d.text[0] = '\0';
    T_EQ_I(vol_measure(&m->v, &how, &got, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "there is no channel 3");
    done(m);
}

T_CASE(text_of_a_figure)
{
    static const struct {
        double v, sd;
        const char *text;
    } cases[] = {{12.34, 0.81, "12.34 \u00b1 0.81"},
                 {12.3, 1.4, "12.3 \u00b1 1.4"},
                 {1234, 56.7, "1234 \u00b1 57"},
                 {0.0123456, 0.00081, "0.01235 \u00b1 0.00081"},
                 {1.2345e-5, 2e-7, "(1.234 \u00b1 0.020)e-05"},
                 {4.56e7, 1.23e5, "(4.560 \u00b1 0.012)e+07"},
                 {0, 0.5, "0.00 \u00b1 0.50"},
                 {3.14159265, NAN, "3.142"},
                 {NAN, 1, "-"}};
    char text[VOL_FIGURE_TEXT];
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        T_EQ_S(vol_figure_text((struct vol_figure){cases[i].v, cases[i].sd}, text), cases[i].text);
}
