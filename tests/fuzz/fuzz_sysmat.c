/* Any bytes as a matrix file: refused with a message, or a matrix whose every index is in bounds.
 * Each input is tried as it is and with its checksums made right, so that what lies behind them is
 * reached too. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "recon/sysmat.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define MUST(cond)                                                     \
    do {                                                               \
        if (!(cond)) {                                                 \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #cond); \
            abort();                                                   \
        }                                                              \
    } while (0)

/* What a reader of the matrix does, without checks of its own. */
static void use(const rec_sysmat *m)
{
    size_t N = rec_grid_count(&m->grid);
    uint64_t nnz = 0;
    double sum = 0;
    for (size_t c = 0; c < m->n_cameras; c++) {
        const struct rec_sysmat_block *b = &m->block[c];
        for (size_t j = 0; j < N; j++) {
            struct rec_rect f = b->fp[j];
            MUST(!rec_rect_seen(f) || (f.x1 < b->bw && f.y1 < b->bh && f.y0 <= f.y1));
            for (uint32_t e = b->colptr[j]; e < b->colptr[j + 1]; e++, nnz++) {
                MUST(b->row[e] < (uint32_t)b->bw * (uint32_t)b->bh);
                MUST(b->val[e] > 0 && isfinite(b->val[e]));
                sum += b->val[e];
            }
        }
    }
    MUST(nnz == m->nnz && sum >= 0);
}

static void try(const uint8_t *data, size_t size)
{
    char path[64];
    struct pvx_diag d = {""};
    int fd = memfd_create("sysmat", MFD_CLOEXEC);
    MUST(fd >= 0);
    MUST(write(fd, data, size) == (ssize_t)size);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    rec_sysmat *m;
    pvx_err e = rec_sysmat_load(path, 0, true, &m, &d);
    if (e == PVX_OK)
        use(m);
    else
        MUST(m == NULL && d.text[0] != '\0');
    rec_sysmat_free(&m);
    close(fd);
}

/* Length and checksums that fit what is there, wherever the table points inside the file. */
static void mend(uint8_t *p, size_t size)
{
    uint32_t cameras, head;
    uint64_t length = size, zero = 0, at, bytes, hash;
    if (size < 128)
        return;
    memcpy(&cameras, p + 112, 4);
    cameras = cameras < 1 || cameras > 64 ? 1 : cameras;
    head = 128 + 112 * cameras;
    if (head > size)
        return;
    memcpy(p, "PVXMATRX\1\0\0\0", 12);
    memcpy(p + 12, &head, 4);
    memcpy(p + 24, &length, 8);
    memcpy(p + 112, &cameras, 4);
    for (uint32_t s = 0; s < 4 * cameras; s++) {
        uint8_t *row = p + 128 + 112 * (s / 4) + 16 + 24 * (s % 4);
        memcpy(&at, row, 8);
        memcpy(&bytes, row + 8, 8);
        if (at <= size && bytes <= size - at) {
            hash = XXH3_64bits(p + at, bytes);
            memcpy(row + 16, &hash, 8);
        }
    }
    memcpy(p + 120, &zero, 8);
    hash = XXH3_64bits(p, head);
    memcpy(p + 120, &hash, 8);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    try(data, size);
    uint8_t *copy = malloc(size + 1);
    if (copy == NULL)
        return 0;
    memcpy(copy, data, size);
    mend(copy, size);
    try(copy, size);
    free(copy);
    return 0;
}
