/* bed_value.h - what a test's volume has in a voxel, by the number of its set: no two sets near each other agree. */
#ifndef TESTS_BED_VALUE_H
#define TESTS_BED_VALUE_H
#include <stdint.h>

/* Voxels that are no cubes, a box off the centre. */
#define BED_MIN        \
    {                  \
        -0.3, 0.2, 1.1 \
    }
#define BED_MAX        \
    {                  \
        0.5, 0.9, 1.75 \
    }

/* Of voxel (i, j, k), 0 in two of three voxels; a half holds it exactly. */
static inline float bed_value(const uint32_t n[3], uint64_t set, uint32_t i, uint32_t j, uint32_t k,
                              uint32_t c)
{
    uint32_t at = (k * n[1] + j) * n[0] + i;
    return (at + set) % 3 != 0 ? 0 : (float)((at * 7 + set * 13 + c * 5) % 1000 + 1) / 16;
}

/* Every second brick is there. */
static inline int bed_lit(const uint32_t n[3], uint64_t set, uint32_t i, uint32_t j, uint32_t k)
{
    uint32_t nx = (n[0] + 7) / 8, ny = (n[1] + 7) / 8;
    return ((k / 8 * ny + j / 8) * nx + i / 8) % 2 == set % 2;
}
#endif
