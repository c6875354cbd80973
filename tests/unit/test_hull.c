/* The carved set against rule (1) of hull.h taken literally, and against the flame itself. */
#include "tests/lib/scene.h"

static struct scene sc;

static uint8_t *lit[REC_MAX_CAMERAS];

static void silhouettes(double threshold)
{
    for (size_t c = 0; c < sc.rig.n_cameras; c++)
        for (int32_t i = 0; i < sc.S->block[c].bw * sc.S->block[c].bh; i++)
            lit[c][i] = sc.image[c][(size_t)i * 4] >= threshold;
}

static int rule(int32_t j, const bool *present, uint32_t min_views)
{
    uint32_t views = 0;
    bool inside = true;
    for (size_t c = 0; c < sc.rig.n_cameras; c++) {
        struct rec_rect r = rec_footprint(sc.S, c, j);
        if (!present[c] || !rec_rect_seen(r))
            continue;
        int64_t count = 0;
        for (int32_t y = r.y0; y <= r.y1; y++)
            for (int32_t x = r.x0; x <= r.x1; x++)
                count += lit[c][y * sc.S->block[c].bw + x] != 0;
        if (count == 0) {
            if (r.x0 > 0 && r.y0 > 0 && r.x1 + 1 < sc.S->block[c].bw &&
                r.y1 + 1 < sc.S->block[c].bh)
                return 0;
            inside = false;
            continue;
        }
        inside = inside && count == (r.x1 - r.x0 + 1) * (r.y1 - r.y0 + 1);
        views++;
    }
    return views == 0 || views < min_views ? 0 : inside ? 2 : 1;
}

static void check(const bool *present, struct rec_hull_params p)
{
    rec_hull *h;
    if (rec_hull_new(sc.S, &h) != PVX_OK)
        exit(2);
    int32_t *col = pvx_calloc(sc.voxels, sizeof *col), at = 0;
    uint8_t *klass = pvx_calloc(sc.voxels, 1);
    struct rec_hull_kept kept = {.col = col, .klass = klass};
    struct rec_hull_counts want = {0};
    memset(klass, 9, sc.voxels);
    rec_hull_carve(h, &p, (const uint8_t *const *)lit, present, sc.pool, &kept);
    const struct rec_hull_counts cn = kept.counts;
    int32_t n = kept.n;
    int64_t wrong = 0;
    for (int32_t j = 0; j < (int32_t)sc.voxels; j++) {
        int k = rule(j, present, p.min_views);
        want.inside += k == 2;
        want.partial += k == 1;
        want.outside += k == 0;
        bool keep = k == 2 || (k == 1 && p.keep_partial);
        wrong += klass[j] != (keep ? k : 0);
        if (keep)
            wrong += at >= n || col[at++] != j;
    }
    T_EQ_I(wrong, 0);
    T_EQ_I(at, n);
    T_EQ_I(cn.inside, want.inside);
    T_EQ_I(cn.partial, want.partial);
    T_EQ_I(cn.outside, want.outside);
    free(col);
    free(klass);
    rec_hull_free(&h);
}

T_CASE(equals_the_rule)
{
    bool all[REC_MAX_CAMERAS] = {true, true, true, true, true, true};
    bool some[REC_MAX_CAMERAS] = {true, false, true, false, false, true};
    bool none[REC_MAX_CAMERAS] = {false};
    struct rec_hull_params p = REC_HULL_DEFAULTS, strict = {.min_views = 2, .keep_partial = 0},
                           many = {.min_views = 6, .keep_partial = 1},
                           zero = {.min_views = 0, .keep_partial = 1};
    for (int t = 0; t < 3; t++) {
        silhouettes(t == 0 ? 0.02 : t == 1 ? 0.3 : -1);
        check(all, p);
        check(some, p);
        check(all, strict);
        check(some, many);
        check(none, zero);
    }
    /* silhouettes that contradict each other: each camera sees another corner lit */
    for (size_t c = 0; c < sc.rig.n_cameras; c++) {
        size_t n = (size_t)(sc.S->block[c].bw * sc.S->block[c].bh);
        memset(lit[c], 0, n);
        lit[c][c % 2 == 0 ? 0 : n - 1] = 1;
    }
    check(all, p);
}

/* No coefficient that carries light into dark pixels alone is needed, but none that carries light
 * may go: what is carved away holds less than the threshold allows along any ray. */
T_CASE(no_light_is_carved)
{
    const double threshold = 0.004;
    bool all[REC_MAX_CAMERAS] = {true, true, true, true, true, true};
    silhouettes(threshold);
    double lost = 0, sum = 0, worst = 0;
    for (int32_t j = 0; j < (int32_t)sc.voxels; j++) {
        double v = sc.truth[(size_t)j * 3];
        sum += v;
        if (rule(j, all, 2) == 0) {
            lost += v;
            worst = v > worst ? v : worst;
        }
    }
    T_OK(sum > 0);
    T_LE(lost, 0.02 * sum);
    /* a voxel on a dark ray: v * chord <= threshold, chord at least about half a voxel */
    T_LE(worst, threshold / (0.5 * rec_grid_h(&sc.rig.grid, 0)));
}

int main(void)
{
    scene_new(&sc, 6, 56, 18, 2, 2); /* 18 is no multiple of a brick */
    for (size_t c = 0; c < sc.rig.n_cameras; c++)
        lit[c] = pvx_calloc((size_t)(sc.S->block[c].bw * sc.S->block[c].bh), 1);
    t_run();
    for (size_t c = 0; c < sc.rig.n_cameras; c++)
        free(lit[c]);
    scene_free(&sc);
    return t_done();
}
