/* npy.h - the header of a .npy file (NumPy's documented format, versions 1 to 3); inside capture.
 * Threads: pure.  Every offset and product is checked against the bytes present. */
#ifndef CAP_NPY_H
#define CAP_NPY_H
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

enum cap_npy_type { CAP_NPY_F2, CAP_NPY_F4, CAP_NPY_F8, CAP_NPY_U1, CAP_NPY_U2 };

struct cap_npy {
    enum cap_npy_type type;
    size_t item;      /* bytes per element */
    size_t shape[4];  /* unused = 1 */
    int ndim;         /* 1..4 */
    size_t count;     /* elements, >= 1 */
    const void *data; /* [count], unaligned, inside the bytes parsed */
};

/* `name`: the file's name in messages.  PVX_EFORMAT, PVX_EUNSUP (known to NumPy, not read here), PVX_EVERSION; the
 * diag says which property is wrong. */
PVX_MUST_CHECK pvx_err cap_npy_header(const void *bytes, size_t len, const char *name,
                                      struct cap_npy *out, struct pvx_diag *d);
/* IEEE 754 binary16. */
float cap_npy_half(uint16_t h);
/* All elements as float (integers unscaled) to out [count]. */
void cap_npy_floats(const struct cap_npy *a, float *out);
#endif
