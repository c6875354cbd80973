/* format.h - the matrix on disk.  Not for other modules.  Little-endian throughout:
 *
 *   header, 128 bytes
 *     0  u8[8]  "PVXMATRX"          88  i32[3] voxels n
 *     8  u32    format version 5   100  u32    basis: 0 box, 1 trilinear
 *    12  u32    header + table     104  i32    binning
 *    16  u64    key                108  i32    rays per bin side
 *    24  u64    bytes of the file  112  f32    unit of the values
 *    32  u32    cameras            116  u32    0
 *    36  u32    levels             120  u64    XXH3-64 of header + table with this field 0
 *    40  f64[3] min, f64[3] max
 *   table
 *     per camera: u32 bw, u32 bh
 *     per level, finest first: u64 entries of each camera; u32 rows and u32 columns of a window; then
 *     for at, w (with its padding) and more (recon/simd/windows.h) and each camera's footprints:
 *     u64 offset, u64 bytes, u64 checksum
 *   sections, in the table's order, each at a multiple of 64 with zeros before it
 *
 * Grid, images and unit of a coarser level follow from the finer one (sysmat.h (4)).
 * The checksum of a section is the XXH3-64 of the XXH3-64s of its pieces of 1 MiB, so that many
 * threads can work on one section.
 * Sections are the arrays as they are in memory, so that a mapped file is the matrix. */
#ifndef REC_SYSMAT_FORMAT_H
#define REC_SYSMAT_FORMAT_H
#include <string.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "recon/matrix/entries.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "mapped files are little-endian arrays");
_Static_assert(sizeof(struct rec_rect) == 8 && sizeof(float) == 4 && sizeof(struct rec_more) == 28,
               "as the file has them");

#define MAGIC    "PVXMATRX"
#define VERSION  5u
#define HEADER   128u
#define HASH_AT  120u
#define PIECE    ((uint64_t)1 << 20)
#define SECTIONS (3 + REC_MAX_CAMERAS) /* of a level, at most */

enum { SECTION_AT, SECTION_W, SECTION_MORE, SECTION_FP };

struct section {
    const void *data;
    uint64_t offset, bytes, hash;
};

struct cursor {
    uint8_t *p;
};
static inline void put(struct cursor *c, const void *v, size_t n)
{
    memcpy(c->p, v, n);
    c->p += n;
}
static inline void put_u32(struct cursor *c, uint32_t v)
{
    put(c, &v, 4);
}
static inline void put_u64(struct cursor *c, uint64_t v)
{
    put(c, &v, 8);
}
static inline void get(struct cursor *c, void *v, size_t n)
{
    memcpy(v, c->p, n);
    c->p += n;
}
static inline uint32_t get_u32(struct cursor *c)
{
    uint32_t v;
    get(c, &v, 4);
    return v;
}
static inline uint64_t get_u64(struct cursor *c)
{
    uint64_t v;
    get(c, &v, 8);
    return v;
}

static inline uint64_t align64(uint64_t n)
{
    return (n + 63) & ~(uint64_t)63;
}
static inline uint64_t pieces(uint64_t bytes)
{
    return (bytes + PIECE - 1) / PIECE;
}
static inline uint64_t piece_hash(const struct section *s, uint64_t piece)
{
    uint64_t at = piece * PIECE, left = s->bytes - at;
    return XXH3_64bits((const uint8_t *)s->data + at, left < PIECE ? left : PIECE);
}

/* Header and table. */
static inline size_t head_bytes(size_t cameras, size_t levels)
{
    return HEADER + cameras * 8 + levels * (cameras * 8 + 8 + (3 + cameras) * 24);
}
#define HEAD_MAX                    \
    (HEADER + REC_MAX_CAMERAS * 8 + \
     REC_SYSMAT_LEVELS_MAX * (REC_MAX_CAMERAS * 8 + 8 + (3 + REC_MAX_CAMERAS) * 24))

static inline uint64_t head_hash(const uint8_t *head, size_t bytes)
{
    static const uint8_t zero[8];
    XXH3_state_t h;
    XXH3_64bits_reset(&h);
    XXH3_64bits_update(&h, head, HASH_AT);
    XXH3_64bits_update(&h, zero, 8);
    XXH3_64bits_update(&h, head + HASH_AT + 8, bytes - HASH_AT - 8);
    return XXH3_64bits_digest(&h);
}

/* Sizes in bytes of the sections of one level, whose grid, shape and number of windows are known.  Returns the number
 * of sections. */
static inline size_t section_sizes(const rec_sysmat *m, struct section *s)
{
    uint64_t N = rec_grid_count(&m->grid);
    uint64_t windows = N * (uint64_t)m->win.slots;
    s[SECTION_AT].bytes = windows * sizeof *m->win.at;
    s[SECTION_W].bytes = windows * rec_window_size(&m->win) + REC_WINDOWS_PAD;
    s[SECTION_MORE].bytes = (uint64_t)m->win.n_more * sizeof *m->win.more;
    for (size_t c = 0; c < m->n_cameras; c++)
        s[SECTION_FP + c].bytes = rec_brick_places(&m->grid) * sizeof *m->block[c].fp;
    return SECTION_FP + m->n_cameras;
}

#endif
