/* windows_shapes.h - a product for any shape of window: that of 2x2, or that of rows of four with their
 * number as a constant.  Private to windows_*.c. */
#ifndef REC_WINDOWS_SHAPES_H
#define REC_WINDOWS_SHAPES_H
#include "recon/simd/windows.h"

/* name(m, s, q0, q1, in, out) from name_2x2 and name_rows. */
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

#endif
