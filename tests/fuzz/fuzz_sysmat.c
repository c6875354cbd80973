/* Any bytes as a matrix file: refused with a message, or a matrix whose every window is in bounds.
 * Each input is tried as it is and with its checksums made right, so that what lies behind them is
 * reached too. */
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "recon/matrix/format.h"
#include "recon/matrix/subsys.h"
#include "tests/fuzz/fuzz.h"

/* A window that a product adds to: every weight that is not 0 to a bin, and no bin behind the room. */
static void use_window(const rec_sysmat *m, size_t slot, uint32_t at, const uint8_t *w)
{
    const struct rec_windows *v = &m->win;
    MUST(at == v->nowhere || (slot < m->n_cameras && at >= m->row0[slot]));
    for (uint32_t r = 0; r < (uint32_t)v->high; r++)
        for (uint32_t k = 0; k < (uint32_t)v->wide; k++, w++) {
            uint64_t bin = (uint64_t)at + (uint64_t)r * (uint32_t)v->pitch[slot] + k;
            MUST(bin < v->room);
            MUST(*w == 0 || (at != v->nowhere && bin < m->row0[slot + 1]));
        }
}

/* What a reader of the matrix does, without checks of its own. */
static void use(const rec_sysmat *m)
{
    size_t N = rec_grid_count(&m->grid), slots = (size_t)m->win.slots;
    size_t size = rec_window_size(&m->win);
    for (size_t c = 0; c < m->n_cameras; c++) {
        const struct rec_sysmat_block *b = &m->block[c];
        MUST(m->row0[c + 1] - m->row0[c] == (size_t)b->bw * (size_t)b->bh);
        for (size_t j = 0; j < rec_brick_places(&m->grid); j++) {
            struct rec_rect f = b->fp[j];
            MUST(!rec_rect_seen(f) || (f.x1 < b->bw && f.y1 < b->bh && f.y0 <= f.y1));
        }
    }
    MUST(slots >= m->n_cameras && slots % REC_SLOT_GROUP == 0 && size <= REC_WINDOW_MAX);
    for (size_t i = 0; i < N * slots; i++)
        use_window(m, i % slots, m->win.at[i], m->win.w + i * size);
    for (size_t i = 0; i < m->win.n_more; i++) {
        const struct rec_more *k = &m->win.more[i];
        MUST(k->column < N && k->slot < m->n_cameras && k->at != m->win.nowhere);
        MUST(i == 0 || k->column >= k[-1].column);
        use_window(m, k->slot, k->at, k->w);
    }
    if (m->coarse != NULL)
        use(m->coarse);
}

/* All its columns and cameras as a system, and both products: nothing that they read or write is checked. */
static void solve(const rec_sysmat *m)
{
    struct rec_subsys *a = NULL;
    struct rec_restrictor *r = NULL;
    struct rec_images images = {0};
    struct rec_kernels k;
    bool present[REC_MAX_CAMERAS];
    size_t N = rec_grid_count(&m->grid), room = m->win.room;
    if (room > 1 << 20) /* it takes too long */
        return;
    memset(present, true, sizeof present);
    rec_kernels_init(&k, PVX_CPU_BEST);
    int32_t *col = malloc(N * sizeof *col);
    float *x = calloc(N, sizeof *x), *y = calloc(room, sizeof *y);
    MUST(col != NULL && x != NULL && y != NULL);
    MUST(rec_subsys_new(m, &k, NULL, 1, &a) == PVX_OK);
    MUST(rec_restrictor_new(m, &r) == PVX_OK && rec_images_new(m, 1, &images) == PVX_OK);
    for (size_t j = 0; j < N; j++) {
        col[j] = (int32_t)j;
        x[j] = 1;
    }
    rec_subsys_restrict(a, r, col, (int32_t)N, present);
    rec_forward(a, &images, x, y);
    rec_adjoint_range(a, y, 0, a->n, x);
    for (size_t i = m->win.nowhere; i < room; i++)
        MUST(y[i] >= 0 && y[i] <= 0);
    rec_images_free(&images);
    rec_restrictor_free(&r);
    rec_subsys_free(&a);
    free(col);
    free(x);
    free(y);
}

static bool try(const uint8_t *data, size_t size)
{
    char path[64];
    struct pvx_diag d = {""};
    int fd = memfd_create("sysmat", MFD_CLOEXEC);
    MUST(fd >= 0);
    MUST(write(fd, data, size) == (ssize_t)size);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    rec_sysmat *m;
    pvx_err e = rec_sysmat_load(path, 0, true, NULL, &m, &d);
    if (e == PVX_OK) {
        fuzz_taken++;
        use(m);
        solve(m);
    } else {
        MUST(m == NULL && d.text[0] != '\0');
    }
    rec_sysmat_free(&m);
    close(fd);
    return e == PVX_OK;
}

/* Checksum of a section of any length: that of its pieces' checksums. */
static uint64_t section_hash(const struct section *s)
{
    uint64_t piece[64], n = pieces(s->bytes) < 64 ? pieces(s->bytes) : 64;
    for (uint64_t i = 0; i < n; i++)
        piece[i] = piece_hash(s, i);
    return XXH3_64bits(piece, n * sizeof *piece);
}

/* Length and checksums that fit what is there, wherever the table points inside the file. */
static void mend(uint8_t *p, size_t size)
{
    struct cursor c = {p + 32};
    if (size < HEADER)
        return;
    uint32_t cameras = get_u32(&c), levels = get_u32(&c);
    cameras = cameras < 1 || cameras > REC_MAX_CAMERAS ? 1 : cameras;
    levels = levels < 1 || levels > REC_SYSMAT_LEVELS_MAX ? 1 : levels;
    size_t head = head_bytes(cameras, levels);
    if (head > size)
        return;
    c.p = p;
    put(&c, MAGIC, 8);
    put_u32(&c, VERSION);
    put_u32(&c, (uint32_t)head);
    c.p = p + 24;
    put_u64(&c, size);
    put_u32(&c, cameras);
    put_u32(&c, levels);
    c.p = p + HEADER + 8 * cameras;
    for (uint32_t l = 0; l < levels; l++) {
        c.p += 8 * cameras + 8;
        for (uint32_t i = 0; i < SECTION_FP + cameras; i++) {
            struct section s;
            s.offset = get_u64(&c);
            s.bytes = get_u64(&c);
            if (s.offset <= size && s.bytes <= size - s.offset) {
                s.data = p + s.offset;
                s.hash = section_hash(&s);
                memcpy(c.p, &s.hash, 8);
            }
            c.p += 8;
        }
    }
    c.p = p + HASH_AT;
    put_u64(&c, head_hash(p, head));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    bool good = try(data, size);
    uint8_t *copy = malloc(size + 1);
    if (copy == NULL)
        return 0;
    memcpy(copy, data, size);
    mend(copy, size);
    MUST(try(copy, size) || !good); /* else this mends what is no matrix any more */
    free(copy);
    return 0;
}
