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

#include "recon/matrix/sysmat.h"

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
        MUST(m->row0[c + 1] - m->row0[c] == (size_t)b->bw * (size_t)b->bh);
        for (size_t j = 0; j < N; j++) {
            struct rec_rect f = b->fp[j];
            MUST(!rec_rect_seen(f) || (f.x1 < b->bw && f.y1 < b->bh && f.y0 <= f.y1));
        }
    }
    for (size_t j = 0; j < N; j++)
        for (uint32_t e = m->colptr[j]; e < m->colptr[j + 1]; e++, nnz++) {
            MUST(m->row[e] < m->row0[m->n_cameras]);
            MUST(e == m->colptr[j] || m->row[e] > m->row[e - 1]);
            MUST(m->val[e] > 0);
            sum += rec_sysmat_value(m, e);
        }
    MUST(nnz == m->nnz && sum >= 0);
    if (m->coarse != NULL)
        use(m->coarse);
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
    pvx_err e = rec_sysmat_load(path, 0, true, NULL, &m, &d);
    if (e == PVX_OK)
        use(m);
    else
        MUST(m == NULL && d.text[0] != '\0');
    rec_sysmat_free(&m);
    close(fd);
}

/* Checksum of a section of any length: that of its pieces' checksums. */
static uint64_t section_hash(const uint8_t *p, uint64_t bytes)
{
    uint64_t piece[64], n = 0;
    for (uint64_t at = 0; at < bytes && n < 64; at += 1 << 20)
        piece[n++] = XXH3_64bits(p + at, bytes - at < 1 << 20 ? bytes - at : 1 << 20);
    return XXH3_64bits(piece, n * sizeof *piece);
}

/* Length and checksums that fit what is there, wherever the table points inside the file. */
static void mend(uint8_t *p, size_t size)
{
    uint32_t cameras, levels, head;
    uint64_t length = size, zero = 0, at, bytes, hash;
    if (size < 128)
        return;
    memcpy(&cameras, p + 32, 4);
    memcpy(&levels, p + 36, 4);
    cameras = cameras < 1 || cameras > 64 ? 1 : cameras;
    levels = levels < 1 || levels > 7 ? 1 : levels;
    head = 128 + 8 * cameras + levels * (8 * cameras + 24 * (3 + cameras));
    if (head > size)
        return;
    memcpy(p, "PVXMATRX\2\0\0\0", 12);
    memcpy(p + 12, &head, 4);
    memcpy(p + 24, &length, 8);
    memcpy(p + 32, &cameras, 4);
    memcpy(p + 36, &levels, 4);
    for (uint32_t l = 0; l < levels; l++)
        for (uint32_t s = 0; s < 3 + cameras; s++) {
            uint8_t *level = p + 128 + 8 * cameras + l * (8 * cameras + 24 * (3 + cameras));
            uint8_t *section = level + 8 * cameras + 24 * s;
            memcpy(&at, section, 8);
            memcpy(&bytes, section + 8, 8);
            if (at <= size && bytes <= size - at) {
                hash = section_hash(p + at, bytes);
                memcpy(section + 16, &hash, 8);
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
