/* The matrix on disk.  Little-endian throughout:
 *
 *   header, 128 bytes
 *     0  u8[8]  "PVXMATRX"          88  i32[3] voxels n
 *     8  u32    format version 1   100  u32    basis: 0 box, 1 trilinear
 *    12  u32    header + table     104  i32    binning
 *    16  u64    key                108  i32    rays per bin side
 *    24  u64    bytes of the file  112  u32    cameras
 *    32  u64    entries in all     116  u32    0
 *    40  f64[3] min, f64[3] max    120  u64    XXH3-64 of header + table with this field 0
 *   table, one row of 112 bytes per camera
 *     u32 bw, u32 bh, u64 nnz, then for colptr, row, val, fp: u64 offset, u64 bytes, u64 XXH3-64
 *   sections, in the table's order, each at a multiple of 64 with zeros before it
 *
 * Sections are the arrays as they are in memory, so that a mapped file is the matrix. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "base/mem.h"
#include "recon/sysmat_priv.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "mapped files are little-endian arrays");
_Static_assert(sizeof(struct rec_rect) == 8 && sizeof(float) == 4, "as the file has them");

#define MAGIC      "PVXMATRX"
#define VERSION    1u
#define HEADER     128u
#define ROW        112u
#define HASH_AT    120u
#define HEADER_MAX (HEADER + ROW * REC_MAX_CAMERAS)

static const char *const section_name[4] = {"column starts", "rows", "values", "footprints"};

/* ---- header ----------------------------------------------------------------------------------- */

struct cursor {
    uint8_t *p;
};

static void put(struct cursor *c, const void *v, size_t n)
{
    memcpy(c->p, v, n);
    c->p += n;
}
static void put_u32(struct cursor *c, uint32_t v)
{
    put(c, &v, 4);
}
static void put_u64(struct cursor *c, uint64_t v)
{
    put(c, &v, 8);
}

static void get(struct cursor *c, void *v, size_t n)
{
    memcpy(v, c->p, n);
    c->p += n;
}
static uint32_t get_u32(struct cursor *c)
{
    uint32_t v;
    get(c, &v, 4);
    return v;
}
static uint64_t get_u64(struct cursor *c)
{
    uint64_t v;
    get(c, &v, 8);
    return v;
}

struct section {
    uint64_t offset, bytes, hash;
};

static uint64_t align64(uint64_t n)
{
    return (n + 63) & ~(uint64_t)63;
}

static uint64_t header_hash(const uint8_t *header, size_t bytes)
{
    static const uint8_t zero[8];
    XXH3_state_t h;
    XXH3_64bits_reset(&h);
    XXH3_64bits_update(&h, header, HASH_AT);
    XXH3_64bits_update(&h, zero, 8);
    XXH3_64bits_update(&h, header + HASH_AT + 8, bytes - HASH_AT - 8);
    return XXH3_64bits_digest(&h);
}

static void arrays(const struct rec_sysmat_block *b, const void *out[4])
{
    out[0] = b->colptr;
    out[1] = b->row;
    out[2] = b->val;
    out[3] = b->fp;
}

/* Lay out the file: header + table into `buf`; returns their length, *total = the file's. */
static size_t encode_header(const rec_sysmat *m, uint8_t buf[HEADER_MAX], uint64_t *total)
{
    size_t bytes = HEADER + ROW * m->n_cameras;
    uint64_t at = bytes;
    struct cursor c = {buf + HEADER};
    for (size_t i = 0; i < m->n_cameras; i++) {
        const struct rec_sysmat_block *b = &m->block[i];
        const void *data[4];
        uint64_t size[4];
        arrays(b, data);
        rec_sysmat_section_bytes(m, b, size);
        put_u32(&c, (uint32_t)b->bw);
        put_u32(&c, (uint32_t)b->bh);
        put_u64(&c, b->nnz);
        for (int s = 0; s < 4; s++) {
            at = align64(at);
            put_u64(&c, at);
            put_u64(&c, size[s]);
            put_u64(&c, XXH3_64bits(data[s], size[s]));
            at += size[s];
        }
    }
    *total = at;
    c.p = buf;
    put(&c, MAGIC, 8);
    put_u32(&c, VERSION);
    put_u32(&c, (uint32_t)bytes);
    put_u64(&c, m->key);
    put_u64(&c, at);
    put_u64(&c, m->nnz);
    put(&c, m->grid.min, 24);
    put(&c, m->grid.max, 24);
    put(&c, m->grid.n, 12);
    put_u32(&c, (uint32_t)m->grid.basis);
    put_u32(&c, (uint32_t)m->binning);
    put_u32(&c, (uint32_t)m->rays_per_bin);
    put_u32(&c, (uint32_t)m->n_cameras);
    put_u32(&c, 0);
    put_u64(&c, 0);
    c.p = buf + HASH_AT;
    put_u64(&c, header_hash(buf, bytes));
    return bytes;
}

/* ---- writing ---------------------------------------------------------------------------------- */

static pvx_err fail_errno(struct pvx_diag *d, const char *path, const char *what)
{
    int en = errno;
    return pvx_fail(d, pvx_err_from_errno(en), "%s: %s: %s", path, what, strerror(en));
}

static pvx_err write_all(int fd, const void *data, uint64_t n, const char *path, struct pvx_diag *d)
{
    const uint8_t *p = data;
    while (n > 0) {
        ssize_t w = write(fd, p, n < (1u << 30) ? (size_t)n : 1u << 30);
        if (w < 0 && errno == EINTR)
            continue;
        if (w < 0)
            return fail_errno(d, path, "cannot write");
        p += w;
        n -= (uint64_t)w;
    }
    return PVX_OK;
}

static pvx_err write_matrix(const rec_sysmat *m, int fd, const char *path, struct pvx_diag *d)
{
    static const uint8_t zeros[64];
    uint8_t header[HEADER_MAX];
    uint64_t total, at, size[4];
    size_t n = encode_header(m, header, &total);
    /* a disk that is too full says so now, not after gigabytes; file systems without it go on */
    if (fallocate(fd, 0, 0, (off_t)total) != 0 && errno == ENOSPC)
        return fail_errno(d, path, "cannot write");
    PVX_TRY(write_all(fd, header, n, path, d));
    at = n;
    for (size_t i = 0; i < m->n_cameras; i++) {
        const void *data[4];
        arrays(&m->block[i], data);
        rec_sysmat_section_bytes(m, &m->block[i], size);
        for (int s = 0; s < 4; s++) {
            PVX_TRY(write_all(fd, zeros, align64(at) - at, path, d));
            PVX_TRY(write_all(fd, data[s], size[s], path, d));
            at = align64(at) + size[s];
        }
    }
    if (fsync(fd) != 0 && errno != EINVAL)
        return fail_errno(d, path, "cannot flush to disk");
    return PVX_OK;
}

pvx_err rec_sysmat_save(const rec_sysmat *m, const char *path, struct pvx_diag *d)
{
    static atomic_uint counter; /* two threads of one process may save the same matrix */
    char tmp[PATH_MAX];
    int n = snprintf(tmp, sizeof tmp, "%s.tmp.%ld.%u", path, (long)getpid(),
                     atomic_fetch_add(&counter, 1));
    if (n < 0 || (size_t)n >= sizeof tmp)
        return pvx_fail(d, PVX_EINVAL, "%s: path too long", path);
    int fd = open(tmp, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (fd < 0)
        return fail_errno(d, path, "cannot create");
    pvx_err e = write_matrix(m, fd, path, d);
    if (close(fd) != 0 && e == PVX_OK)
        e = fail_errno(d, path, "cannot close");
    if (e == PVX_OK && rename(tmp, path) != 0)
        e = fail_errno(d, path, "cannot rename into place");
    if (e != PVX_OK)
        unlink(tmp);
    return e;
}

/* ---- reading ---------------------------------------------------------------------------------- */

#define REMEDY "delete it, it is rebuilt when needed"

struct loader {
    const char *path;
    struct pvx_diag *d;
    uint8_t *base;
    uint64_t bytes;
};

static pvx_err corrupt(const struct loader *l, const char *what)
{
    return pvx_fail(l->d, PVX_ECORRUPT, "%s: damaged (%s); " REMEDY, l->path, what);
}

static pvx_err corrupt_camera(const struct loader *l, size_t camera, const char *section,
                              const char *what)
{
    return pvx_fail(l->d, PVX_ECORRUPT, "%s: damaged (camera %zu, %s: %s); " REMEDY, l->path,
                    camera, section, what);
}

static bool grid_ok(const struct rec_grid *g)
{
    for (int a = 0; a < 3; a++)
        if (g->n[a] < 1 || g->n[a] > REC_GRID_MAX || !isfinite(g->min[a]) || !isfinite(g->max[a]) ||
            !(g->max[a] > g->min[a]))
            return false;
    return g->basis == REC_BOX || g->basis == REC_TRILINEAR;
}

/* Header without the table.  Nothing in it is believed before its checksum. */
static pvx_err read_header(const struct loader *l, uint64_t key, rec_sysmat **out)
{
    if (l->bytes < 8 || memcmp(l->base, MAGIC, 8) != 0)
        return pvx_fail(l->d, PVX_EFORMAT, "%s: not a Pyrovox matrix (wrong magic)", l->path);
    if (l->bytes < HEADER)
        return corrupt(l, "cut off in the header");
    struct cursor c = {l->base + 8};
    uint32_t version = get_u32(&c);
    if (version != VERSION)
        return pvx_fail(l->d, PVX_EVERSION, "%s: matrix format %u, this program reads %u; " REMEDY,
                        l->path, version, VERSION);
    uint32_t head = get_u32(&c);
    c.p = l->base + 112;
    uint32_t cameras = get_u32(&c);
    if (cameras < 1 || cameras > REC_MAX_CAMERAS || head != HEADER + ROW * cameras ||
        head > l->bytes)
        return corrupt(l, "header length");
    c.p = l->base + HASH_AT;
    if (get_u64(&c) != header_hash(l->base, head))
        return corrupt(l, "header checksum");
    c.p = l->base + 16;
    uint64_t file_key = get_u64(&c), bytes = get_u64(&c);
    if (bytes != l->bytes)
        return pvx_fail(l->d, PVX_ECORRUPT,
                        "%s: damaged (%llu bytes long, should be %llu); " REMEDY, l->path,
                        (unsigned long long)l->bytes, (unsigned long long)bytes);
    if (key != 0 && key != file_key)
        return pvx_fail(l->d, PVX_ESTALE,
                        "%s: made for another rig, grid, basis, binning or number of rays (key "
                        "%016llx, needed %016llx); " REMEDY,
                        l->path, (unsigned long long)file_key, (unsigned long long)key);
    rec_sysmat *m;
    PVX_TRY(rec_sysmat_alloc(cameras, &m));
    m->key = file_key;
    m->nnz = get_u64(&c);
    get(&c, m->grid.min, 24);
    get(&c, m->grid.max, 24);
    get(&c, m->grid.n, 12);
    uint32_t basis = get_u32(&c);
    m->grid.basis = basis == 0 ? REC_BOX : REC_TRILINEAR;
    m->binning = (int32_t)get_u32(&c);
    m->rays_per_bin = (int32_t)get_u32(&c);
    if (!grid_ok(&m->grid) || basis > 1 || m->binning < 1 || m->binning > 64 ||
        m->rays_per_bin < 1 || m->rays_per_bin > 16) {
        rec_sysmat_free(&m);
        return corrupt(l, "impossible grid or parameters");
    }
    *out = m;
    return PVX_OK;
}

static pvx_err check_columns(const struct loader *l, const rec_sysmat *m, size_t camera)
{
    const struct rec_sysmat_block *b = &m->block[camera];
    size_t N = rec_grid_count(&m->grid);
    bool bad = b->colptr[0] != 0 || b->colptr[N] != b->nnz;
    for (size_t j = 0; j < N; j++)
        bad |= b->colptr[j] > b->colptr[j + 1];
    if (bad)
        return corrupt_camera(l, camera, section_name[0], "not ascending to the number of entries");
    uint32_t rows = (uint32_t)b->bw * (uint32_t)b->bh, worst = 0;
    for (uint64_t e = 0; e < b->nnz; e++)
        worst = b->row[e] > worst ? b->row[e] : worst;
    if (b->nnz > 0 && worst >= rows)
        return corrupt_camera(l, camera, section_name[1], "outside the image");
    for (size_t j = 0; j < N; j++)
        for (size_t e = (size_t)b->colptr[j] + 1; e < b->colptr[j + 1]; e++)
            bad |= b->row[e] <= b->row[e - 1];
    if (bad)
        return corrupt_camera(l, camera, section_name[1], "not ascending within a column");
    for (uint64_t e = 0; e < b->nnz; e++)
        bad |= !(b->val[e] > 0 && b->val[e] <= 3.4028234e38f);
    if (bad)
        return corrupt_camera(l, camera, section_name[2], "not positive and finite");
    for (size_t j = 0; j < N; j++) {
        struct rec_rect r = b->fp[j];
        bad |= r.x1 >= b->bw || r.y1 >= b->bh || (rec_rect_seen(r) && r.y0 > r.y1) ||
               (!rec_rect_seen(r) && b->colptr[j] != b->colptr[j + 1]);
    }
    if (bad)
        return corrupt_camera(l, camera, section_name[3], "outside the image");
    return PVX_OK;
}

static pvx_err read_block(const struct loader *l, rec_sysmat *m, size_t camera, uint64_t *at,
                          bool verify)
{
    struct rec_sysmat_block *b = &m->block[camera];
    struct cursor c = {l->base + HEADER + ROW * camera};
    uint32_t bw = get_u32(&c), bh = get_u32(&c);
    b->nnz = get_u64(&c);
    if (bw < 1 || bw > 16384 || bh < 1 || bh > 16384 || b->nnz > UINT32_MAX)
        return corrupt_camera(l, camera, "table", "impossible size");
    b->bw = (int32_t)bw;
    b->bh = (int32_t)bh;
    uint64_t want[4];
    const void *data[4];
    rec_sysmat_section_bytes(m, b, want);
    for (int s = 0; s < 4; s++) {
        struct section x = {get_u64(&c), get_u64(&c), get_u64(&c)};
        if (x.offset != align64(*at) || x.bytes != want[s] || x.offset > l->bytes ||
            x.bytes > l->bytes - x.offset)
            return corrupt_camera(l, camera, section_name[s], "does not lie where it should");
        *at = x.offset + x.bytes;
        data[s] = l->base + x.offset;
        if (verify && XXH3_64bits(data[s], x.bytes) != x.hash)
            return corrupt_camera(l, camera, section_name[s], "checksum");
    }
    b->colptr = data[0];
    b->row = data[1];
    b->val = data[2];
    b->fp = data[3];
    return verify ? check_columns(l, m, camera) : PVX_OK;
}

static pvx_err read_matrix(const struct loader *l, uint64_t key, bool verify, rec_sysmat **out)
{
    rec_sysmat *m;
    PVX_TRY(read_header(l, key, &m));
    uint64_t at = HEADER + ROW * m->n_cameras, nnz = 0;
    pvx_err e = PVX_OK;
    for (size_t i = 0; i < m->n_cameras && e == PVX_OK; i++) {
        e = read_block(l, m, i, &at, verify);
        nnz += m->block[i].nnz;
    }
    if (e == PVX_OK && (at != l->bytes || nnz != m->nnz))
        e = corrupt(l, "sizes do not add up");
    if (e != PVX_OK) {
        memset(m->block, 0, m->n_cameras * sizeof *m->block); /* they point into the mapping */
        rec_sysmat_free(&m);
        return e;
    }
    *out = m;
    return PVX_OK;
}

pvx_err rec_sysmat_load(const char *path, uint64_t key, bool verify, rec_sysmat **out,
                        struct pvx_diag *d)
{
    *out = NULL;
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return fail_errno(d, path, "cannot open");
    struct stat st;
    pvx_err e = PVX_OK;
    struct loader l = {.path = path, .d = d};
    if (fstat(fd, &st) != 0)
        e = fail_errno(d, path, "cannot stat");
    else if (!S_ISREG(st.st_mode) || st.st_size == 0)
        e = pvx_fail(d, PVX_EFORMAT, "%s: not a Pyrovox matrix (empty, or no plain file)", path);
    if (e == PVX_OK) {
        l.bytes = (uint64_t)st.st_size;
        l.base = mmap(NULL, l.bytes, PROT_READ, MAP_PRIVATE, fd, 0);
        if (l.base == MAP_FAILED)
            e = fail_errno(d, path, "cannot map");
    }
    close(fd);
    if (e != PVX_OK)
        return e;
    if (verify) /* every byte is about to be read */
        madvise(l.base, l.bytes, MADV_WILLNEED);
    e = read_matrix(&l, key, verify, out);
    if (e != PVX_OK) {
        munmap(l.base, l.bytes);
        return e;
    }
    struct rec_sysmat_store *s = (*out)->priv;
    s->map = l.base;
    s->map_bytes = l.bytes;
    return PVX_OK;
}
