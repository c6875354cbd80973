/* volume_bed.h - volumes for recordings, with values that a half holds exactly. */
#ifndef TESTS_VOLUME_BED_H
#define TESTS_VOLUME_BED_H
#include "tests/lib/bed_value.h"
#include "tests/lib/volumes.h"

struct volume_bed {
    struct vol_head head;
    uint32_t ids[4096];
    float *brick;
    struct vol_volume v;
};

static inline void volume_bed_new(struct volume_bed *b, uint32_t nx, uint32_t ny, uint32_t nz,
                                  uint32_t channels, uint32_t basis)
{
    *b = (struct volume_bed){.head = {.rig = "cameras: []\n"}};
    b->head.start = (struct pvp_start){.grid = {{nx, ny, nz}, BED_MIN, BED_MAX, basis, channels},
                                       .session = 0xfedcba9876543210u,
                                       .rig_hash = 0x8123456789abcdefu,
                                       .n_cameras = 5,
                                       .fps = 20,
                                       .units = "1/m",
                                       .software = "volume_bed"};
    b->brick = calloc(sizeof b->ids / sizeof b->ids[0] * 512 * channels, sizeof *b->brick);
    if (b->brick == NULL)
        exit(1);
}

static inline void volume_bed_free(struct volume_bed *b)
{
    free(b->brick);
    b->brick = NULL;
}

/* Every second brick of set `set`, at `t_ns`. */
static inline const struct vol_volume *volume_bed_make(struct volume_bed *b, uint64_t set,
                                                       int64_t t_ns)
{
    const struct pvp_grid *g = &b->head.start.grid;
    uint32_t nb[3], all = pvp_grid_bricks(g, nb);
    b->v = volumes_empty(&b->head.start, set, t_ns);
    b->v.ids = b->ids;
    b->v.brick = b->brick;
    for (uint32_t id = (uint32_t)(set & 1); id < all; id += 2) {
        float *out = b->brick + (size_t)b->v.n_bricks * 512 * g->channels;
        memset(out, 0, 512 * g->channels * sizeof *out);
        const uint32_t x = id % nb[0] * 8, y = id / nb[0] % nb[1] * 8, z = id / nb[0] / nb[1] * 8;
        for (uint32_t cell = 0; cell < 512 * g->channels; cell++) {
            const uint32_t v = cell / g->channels, i = x + v % 8, j = y + v / 8 % 8, k = z + v / 64;
            if (i < g->n[0] && j < g->n[1] && k < g->n[2])
                out[cell] = bed_value(g->n, set, i, j, k, cell % g->channels);
        }
        b->ids[b->v.n_bricks++] = id;
    }
    return &b->v;
}
#endif
