#include "daemon/volumes/hdf5.h"

#include <stddef.h>
#include <string.h>
#include <xxhash.h>

const char *const vol_gap_columns[VOL_GAP_COLS] = {"why", "set_first", "set_last", "volumes"};

void vol_columns(struct vol_column out[VOL_COLUMNS])
{
    hid_t text = H5Tcopy(H5T_C_S1);
    H5Tset_size(text, sizeof((struct vol_row *)0)->solver);
#define COLUMN(member, type)                            \
    {                                                   \
#member, type, offsetof(struct vol_row, member) \
    }
    const struct vol_column all[VOL_COLUMNS] = {
        COLUMN(time, H5T_IEEE_F64LE),           COLUMN(t_exposure_ns, H5T_STD_I64LE),
        COLUMN(t_publish_ns, H5T_STD_I64LE),    COLUMN(spread_ns, H5T_STD_I64LE),
        COLUMN(latency_ns, H5T_STD_I64LE),      COLUMN(camera_mask, H5T_STD_U64LE),
        COLUMN(cameras_present, H5T_STD_U32LE), COLUMN(clamped, H5T_STD_U8LE),
        COLUMN(sample, H5T_STD_U8LE),           COLUMN(status, H5T_STD_U32LE),
        COLUMN(iterations, H5T_STD_U32LE),      COLUMN(rel_residual, H5T_IEEE_F64LE),
        COLUMN(active_voxels, H5T_STD_U32LE),   COLUMN(active_rays, H5T_STD_U32LE),
        COLUMN(entries, H5T_STD_U64LE),         COLUMN(photometry_ns, H5T_STD_I64LE),
        COLUMN(hull_ns, H5T_STD_I64LE),         COLUMN(restrict_ns, H5T_STD_I64LE),
        COLUMN(solve_ns, H5T_STD_I64LE),        COLUMN(total_ns, H5T_STD_I64LE),
        COLUMN(chunks, H5T_STD_U32LE),          COLUMN(solver, text),
        COLUMN(check, H5T_STD_U64LE),           COLUMN(number, H5T_STD_U64LE),
    };
#undef COLUMN
    memcpy(out, all, sizeof all);
}

void vol_columns_done(struct vol_column c[VOL_COLUMNS])
{
    for (int k = 0; k < VOL_COLUMNS; k++)
        if (strcmp(c[k].name, "solver") == 0)
            H5Tclose(c[k].type);
}

struct vol_tiles vol_tiles(const struct pvp_grid *g)
{
    struct vol_tiles t = {.all = 1, .floats = g->channels};
    for (int a = 0; a < 3; a++) {
        t.side[a] = g->n[a] < VOL_CHUNK ? g->n[a] : VOL_CHUNK;
        t.n[a] = (g->n[a] + t.side[a] - 1) / t.side[a];
        t.all *= t.n[a];
        t.floats *= t.side[a];
    }
    return t;
}

bool vol_all_zero(const float *v, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (v[i] != 0)
            return false;
    return true;
}

uint64_t vol_hash(uint64_t before, uint32_t id, uint64_t h)
{
    const uint64_t link[2] = {id, h};
    return XXH3_64bits_withSeed(link, sizeof link, before);
}

uint64_t vol_row_check(const struct vol_column c[VOL_COLUMNS], const struct vol_row *r,
                       uint64_t seed)
{
    struct vol_row all;
    memset(&all, 0, sizeof all); /* with what lies between the members */
    for (int k = 0; k < VOL_COLUMNS; k++)
        if (c[k].offset != offsetof(struct vol_row, check))
            memcpy((char *)&all + c[k].offset, (const char *)r + c[k].offset,
                   H5Tget_size(c[k].type));
    return XXH3_64bits_withSeed(&all, sizeof all, seed);
}
