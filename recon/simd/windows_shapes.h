/* windows_shapes.h - a product for any shape of window: one function for 2x2, one for rows of four with the number of
 * rows as a constant.  Private to windows_*.c. */
#ifndef REC_WINDOWS_SHAPES_H
#define REC_WINDOWS_SHAPES_H
#include <stdbool.h>

#include "recon/simd/windows.h"

/* The windows of one column in some slots, advanced column by column.  It is a copy: compilers assume that a store
 * into y may change *m, and would read *m again after each. */
struct walk {
    const uint32_t *at; /* [slots] */
    const uint8_t *w;   /* [slots][size] */
    int32_t slots;
    size_t columns_at, columns_w; /* from column to column */
    size_t pitch[REC_SLOTS_MAX];  /* in floats */
};
static inline __attribute__((always_inline)) void walk_from(struct walk *k,
                                                            const struct rec_windows *m,
                                                            struct rec_slots s, int32_t q,
                                                            size_t size, size_t cs)
{
    size_t first = (size_t)q * (size_t)m->slots + (size_t)s.s0;
    k->at = m->at + first;
    k->w = m->w + first * size;
    k->slots = s.s1 - s.s0;
    k->columns_at = (size_t)m->slots;
    k->columns_w = (size_t)m->slots * size;
    for (int32_t i = 0; i < k->slots; i++)
        k->pitch[i] = (size_t)m->pitch[s.s0 + i] * cs;
}
static inline __attribute__((always_inline)) void walk_on(struct walk *k)
{
    k->at += k->columns_at;
    k->w += k->columns_w;
}
/* Whether the next column, which must exist, has all windows at the same places as this one. */
static inline __attribute__((always_inline)) bool walk_two(const struct walk *k)
{
    const uint32_t *next = k->at + k->columns_at;
    int32_t i = 0;
    for (; i + 4 <= k->slots; i += 4)
        if (((k->at[i] ^ next[i]) | (k->at[i + 1] ^ next[i + 1]) | (k->at[i + 2] ^ next[i + 2]) |
             (k->at[i + 3] ^ next[i + 3])) != 0)
            return false;
    for (; i < k->slots; i++)
        if (k->at[i] != next[i])
            return false;
    return true;
}

/* Defines name(m, s, q0, q1, in, out) from name_2x2 and name_rows. */
#define REC_BY_SHAPE(name)                                                                    \
    static void name(const struct rec_windows *m, struct rec_slots s, int32_t q0, int32_t q1, \
                     const float *in, float *out)                                             \
    {                                                                                         \
        if (m->wide == 2)                                                                     \
            name##_2x2(m, s, q0, q1, in, out);                                                \
        else if (m->high == 2)                                                                \
            name##_rows(m, s, q0, q1, in, out, 2);                                            \
        else if (m->high == 3)                                                                \
            name##_rows(m, s, q0, q1, in, out, 3);                                            \
        else                                                                                  \
            name##_rows(m, s, q0, q1, in, out, 4);                                            \
    }
/* Defines name_more(m, s, run, in, out) from name_more_of. */
#define REC_MORE_BY_SHAPE(name)                                                   \
    static void name##_more(const struct rec_windows *m, struct rec_slots s,      \
                            struct rec_more_run run, const float *in, float *out) \
    {                                                                             \
        if (m->wide == 2)                                                         \
            name##_more_of(m, s, run, in, out, 2, 2);                             \
        else if (m->high == 2)                                                    \
            name##_more_of(m, s, run, in, out, 2, 4);                             \
        else if (m->high == 3)                                                    \
            name##_more_of(m, s, run, in, out, 3, 4);                             \
        else                                                                      \
            name##_more_of(m, s, run, in, out, 4, 4);                             \
    }

#endif
