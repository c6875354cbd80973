/* fuzz_npy.c - .npy bytes: every accepted file gives exactly what its shape says. */

#include "capture/files/imgio.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    float *v = NULL;
    size_t shape[4];
    int ndim;
    if (cap_npy_parse(data, size, "fuzz", &v, shape, &ndim, NULL) == PVX_OK) {
        fuzz_taken++;
        size_t n = shape[0] * shape[1] * shape[2] * shape[3];
        MUST(ndim >= 1 && ndim <= 4 && n != 0 && n <= size);
        volatile float last = v[n - 1];
        (void)last;
    } else if (v != NULL) {
        abort();
    }
    free(v);
    return 0;
}
