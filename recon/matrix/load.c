#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "recon/matrix/format.h"

#define REMEDY "delete it, it is rebuilt when needed"

struct loader {
    const char *path;
    struct pvx_diag *d;
    uint8_t *base;
    uint64_t bytes;
    size_t levels;
    rec_sysmat *level[REC_SYSMAT_LEVELS_MAX];
    struct section section[REC_SYSMAT_LEVELS_MAX * SECTIONS]; /* level after level */
};

static pvx_err load_fail_errno(struct pvx_diag *d, const char *path, const char *what)
{
    int en = errno;
    return pvx_fail(d, pvx_err_from_errno(en), "%s: %s: %s", path, what, strerror(en));
}

static pvx_err corrupt(const struct loader *l, const char *what)
{
    return pvx_fail(l->d, PVX_ECORRUPT, "%s: damaged (%s); " REMEDY, l->path, what);
}

static pvx_err corrupt_section(const struct loader *l, size_t level, size_t s, const char *what)
{
    static const char *const name[] = {"windows", "weights", "further windows"};
    char camera[48];
    snprintf(camera, sizeof camera, "footprints of camera %zu", s - SECTION_FP);
    return pvx_fail(l->d, PVX_ECORRUPT, "%s: damaged (level %zu, %s: %s); " REMEDY, l->path, level,
                    s < SECTION_FP ? name[s] : camera, what);
}

/* ---- header and table -------------------------------------------------------------------------- */

static bool grid_ok(const struct rec_grid *g)
{
    for (int a = 0; a < 3; a++)
        if (g->n[a] < 1 || g->n[a] > REC_GRID_MAX || !isfinite(g->min[a]) || !isfinite(g->max[a]) ||
            !(g->max[a] > g->min[a]))
            return false;
    return g->basis == REC_BOX || g->basis == REC_TRILINEAR;
}

/* Nothing in the header is trusted before its checksum. */
static pvx_err check_head(struct loader *l, uint64_t key, uint32_t *n_cameras)
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
    uint64_t file_key = get_u64(&c), bytes = get_u64(&c);
    uint32_t cameras = get_u32(&c), levels = get_u32(&c);
    if (cameras < 1 || cameras > REC_MAX_CAMERAS || levels < 1 || levels > REC_SYSMAT_LEVELS_MAX ||
        head != head_bytes(cameras, levels) || head > l->bytes)
        return corrupt(l, "header length");
    c.p = l->base + HASH_AT;
    if (get_u64(&c) != head_hash(l->base, head))
        return corrupt(l, "header checksum");
    if (bytes != l->bytes)
        return pvx_fail(l->d, PVX_ECORRUPT,
                        "%s: damaged (%llu bytes long, should be %llu); " REMEDY, l->path,
                        (unsigned long long)l->bytes, (unsigned long long)bytes);
    if (key != 0 && key != file_key)
        return pvx_fail(l->d, PVX_ESTALE,
                        "%s: made for another rig, grid, basis, binning or number of rays (key "
                        "%016llx, needed %016llx); " REMEDY,
                        l->path, (unsigned long long)file_key, (unsigned long long)key);
    *n_cameras = cameras;
    l->levels = levels;
    return PVX_OK;
}

/* The finest level without its arrays. */
static pvx_err read_finest(struct loader *l, rec_sysmat *m)
{
    struct cursor c = {l->base + 16};
    m->key = get_u64(&c);
    c.p = l->base + 40;
    get(&c, m->grid.min, 24);
    get(&c, m->grid.max, 24);
    get(&c, m->grid.n, 12);
    uint32_t basis = get_u32(&c);
    m->grid.basis = basis == 0 ? REC_BOX : REC_TRILINEAR;
    m->binning = (int32_t)get_u32(&c);
    m->rays_per_bin = (int32_t)get_u32(&c);
    get(&c, &m->unit, 4);
    if (!grid_ok(&m->grid) || basis > 1 || m->binning < 1 || m->binning > 64 ||
        m->rays_per_bin < 1 || m->rays_per_bin > 16 || !(m->unit > 0) || !isfinite(m->unit))
        return corrupt(l, "impossible grid or parameters");
    if (l->levels != rec_sysmat_levels(&m->grid))
        return corrupt(l, "number of levels");
    c.p = l->base + HEADER;
    for (size_t i = 0; i < m->n_cameras; i++) {
        uint32_t bw = get_u32(&c), bh = get_u32(&c);
        if (bw < 1 || bw > 16384 || bh < 1 || bh > 16384)
            return corrupt(l, "impossible size of an image");
        m->block[i].bw = (int32_t)bw;
        m->block[i].bh = (int32_t)bh;
    }
    return rec_sysmat_number_rows(m, NULL) == PVX_OK ? PVX_OK : corrupt(l, "too many rows");
}

static pvx_err alloc_levels(struct loader *l, size_t cameras)
{
    pvx_err e = PVX_OK;
    for (size_t i = 0; i < l->levels && e == PVX_OK; i++) {
        e = rec_sysmat_alloc(cameras, &l->level[i]);
        if (e != PVX_OK)
            break;
        ((struct rec_sysmat_store *)l->level[i]->priv)->borrowed = true;
        if (i > 0)
            l->level[i - 1]->coarse = l->level[i];
    }
    return e == PVX_OK ? e : pvx_fail(l->d, e, "%s: out of memory", l->path);
}

/* Table row of one level: where its arrays lie.  `at` is the end of what lies before. */
static pvx_err read_level(struct loader *l, size_t level, struct cursor *c, uint64_t *at)
{
    rec_sysmat *m = l->level[level];
    struct section *s = l->section + level * SECTIONS;
    for (size_t i = 0; i < m->n_cameras; i++) {
        m->block[i].nnz = get_u64(c);
        if (m->block[i].nnz > UINT32_MAX)
            return corrupt(l, "impossible number of entries");
        m->nnz += m->block[i].nnz;
    }
    if (m->nnz > UINT32_MAX)
        return corrupt(l, "impossible number of entries");
    rec_sysmat_window_frame(m);
    uint32_t high = get_u32(c), wide = get_u32(c);
    if (high < 2 || high > 4 || (wide != 4 && (wide != 2 || high != 2)))
        return corrupt(l, "impossible shape of windows");
    m->win.high = (int32_t)high;
    m->win.wide = (int32_t)wide;
    size_t n = section_sizes(m, s);
    for (size_t i = 0; i < n; i++) {
        uint64_t want = s[i].bytes;
        s[i].offset = get_u64(c);
        s[i].bytes = get_u64(c);
        s[i].hash = get_u64(c);
        if (i == SECTION_MORE && s[i].bytes % sizeof(struct rec_more) == 0 &&
            s[i].bytes / sizeof(struct rec_more) <= UINT32_MAX) {
            want = s[i].bytes;
            m->win.n_more = (uint32_t)(want / sizeof(struct rec_more));
        }
        if (s[i].offset != align64(*at) || s[i].bytes != want || s[i].offset > l->bytes ||
            want > l->bytes - s[i].offset)
            return corrupt_section(l, level, i, "does not lie where it should");
        *at = s[i].offset + want;
        s[i].data = l->base + s[i].offset;
    }
    m->win.at = (uint32_t *)s[SECTION_AT].data;
    m->win.w = (uint8_t *)s[SECTION_W].data;
    m->win.more = (struct rec_more *)s[SECTION_MORE].data;
    for (size_t i = 0; i < m->n_cameras; i++)
        m->block[i].fp = s[SECTION_FP + i].data;
    return PVX_OK;
}

static pvx_err load_read_levels(struct loader *l)
{
    size_t cameras = l->level[0]->n_cameras;
    struct cursor c = {l->base + HEADER + 8 * cameras};
    uint64_t at = head_bytes(cameras, l->levels);
    for (size_t i = 0; i < l->levels; i++) {
        if (i > 0)
            rec_sysmat_coarse_frame(l->level[i - 1], l->level[i]);
        PVX_TRY(read_level(l, i, &c, &at));
    }
    return at == l->bytes ? PVX_OK : corrupt(l, "sizes do not add up");
}

/* ---- contents ---------------------------------------------------------------------------------- */

enum verdict { SOUND, BAD_RANGE, BAD_ORDER };
static const char *const verdict_text[] = {"", "outside what there is", "not ascending"};

/* Two passes over pieces: first the places of windows, by which their weights are then checked; then the other
 * sections. */
struct check {
    const struct loader *l;
    struct piece {
        uint32_t level, section;
        uint64_t index, hash, nnz; /* weights that are not 0 */
        enum verdict verdict;
    } * piece;
    size_t n;
    uint64_t *hash; /* of the pieces of one section */
};

/* The windows of `size` bytes that begin in bytes [a,b) of a section; the last one may end behind b. */
static void windows_in(uint64_t a, uint64_t b, size_t size, size_t *w0, size_t *w1)
{
    *w0 = (size_t)((a + size - 1) / size);
    *w1 = (size_t)((b + size - 1) / size);
}

static uint64_t load_count(const uint8_t *w, size_t n)
{
    uint64_t not_zero = 0;
    for (size_t i = 0; i < n; i++)
        not_zero += w[i] != 0;
    return not_zero;
}
static bool load_is_zero(const uint8_t *w, size_t n)
{
    uint8_t any = 0;
    for (size_t i = 0; i < n; i++)
        any |= w[i];
    return any == 0;
}

/* Whether a window begins in its camera's image. */
static bool begins_right(const rec_sysmat *m, size_t slot, uint32_t at)
{
    return slot < m->n_cameras && at >= m->row0[slot] && at < m->row0[slot + 1];
}
/* Whether weights that hang over the end of the camera's bins are 0, so that nothing is written behind all bins. */
static bool ends_right(const rec_sysmat *m, size_t slot, uint32_t at, const uint8_t *w)
{
    size_t pitch = (size_t)m->win.pitch[slot], wide = (size_t)m->win.wide;
    size_t end = m->row0[slot + 1], high = (size_t)m->win.high;
    if (at + (high - 1) * pitch + wide <= end)
        return true;
    for (size_t r = 0; r < high; r++)
        for (size_t k = 0; k < wide; k++)
            if (at + r * pitch + k >= end && w[r * wide + k] != 0)
                return false;
    return true;
}

static enum verdict check_at(const rec_sysmat *m, size_t w0, size_t w1)
{
    size_t slots = (size_t)m->win.slots, slot = w0 % slots;
    bool bad = false;
    for (size_t i = w0; i < w1; i++) {
        bad |= m->win.at[i] != m->win.nowhere && !begins_right(m, slot, m->win.at[i]);
        slot = slot + 1 == slots ? 0 : slot + 1;
    }
    return bad ? BAD_RANGE : SOUND;
}

/* `at` has been checked before. */
static enum verdict check_weights(const rec_sysmat *m, uint64_t a, uint64_t b, uint64_t *nnz)
{
    size_t size = rec_window_size(&m->win), slots = (size_t)m->win.slots, w0, w1;
    size_t all = rec_grid_count(&m->grid) * slots;
    windows_in(a, b, size, &w0, &w1);
    if (w1 > all) {
        w1 = all;
        if (!load_is_zero(m->win.w + all * size, REC_WINDOWS_PAD))
            return BAD_RANGE;
    }
    *nnz = w0 < w1 ? load_count(m->win.w + w0 * size, (w1 - w0) * size) : 0;
    for (size_t i = w0; i < w1; i++) {
        const uint8_t *w = m->win.w + i * size;
        uint32_t at = m->win.at[i];
        if (at == m->win.nowhere ? !load_is_zero(w, size) : !ends_right(m, i % slots, at, w))
            return BAD_RANGE;
    }
    return SOUND;
}

static enum verdict check_more(const rec_sysmat *m, uint64_t a, uint64_t b, uint64_t *nnz)
{
    size_t size = rec_window_size(&m->win), N = rec_grid_count(&m->grid), w0, w1;
    windows_in(a, b, sizeof *m->win.more, &w0, &w1);
    for (size_t i = w0; i < w1; i++) {
        const struct rec_more *k = &m->win.more[i];
        if (k->column >= N || !begins_right(m, k->slot, k->at) ||
            !ends_right(m, k->slot, k->at, k->w) || !load_is_zero(k->w + size, sizeof k->w - size))
            return BAD_RANGE;
        if (i > 0 && k[-1].column > k->column)
            return BAD_ORDER;
        *nnz += load_count(k->w, size);
    }
    return SOUND;
}

static enum verdict check_footprints(const struct rec_sysmat_block *b, size_t j0, size_t j1)
{
    const int32_t bw = b->bw, bh = b->bh;
    int32_t bad = 0;
    for (size_t j = j0; j < j1; j++) {
        struct rec_rect r = b->fp[j];
        bad |= (r.x1 >= bw) | (r.y1 >= bh) | ((r.x0 <= r.x1) & (r.y0 > r.y1));
    }
    return bad ? BAD_RANGE : SOUND;
}

static void check_piece(void *ctx, size_t task)
{
    const struct check *k = ctx;
    struct piece *p = &k->piece[task];
    const struct section *s = &k->l->section[p->level * SECTIONS + p->section];
    const rec_sysmat *m = k->l->level[p->level];
    uint64_t a = p->index * PIECE, b = a + PIECE < s->bytes ? a + PIECE : s->bytes;
    p->hash = piece_hash(s, p->index);
    switch (p->section) {
    case SECTION_AT: p->verdict = check_at(m, a / 4, b / 4); break;
    case SECTION_W: p->verdict = check_weights(m, a, b, &p->nnz); break;
    case SECTION_MORE: p->verdict = check_more(m, a, b, &p->nnz); break;
    default: p->verdict = check_footprints(&m->block[p->section - SECTION_FP], a / 8, b / 8);
    }
}

static pvx_err load_judge(const struct check *k)
{
    uint64_t *hash = k->hash;
    for (size_t i = 0; i < k->n;) {
        const struct piece *p = &k->piece[i];
        const struct section *s = &k->l->section[p->level * SECTIONS + p->section];
        size_t n = pieces(s->bytes);
        enum verdict v = SOUND;
        for (size_t q = 0; q < n; q++) {
            hash[q] = p[q].hash;
            v = v == SOUND ? p[q].verdict : v;
        }
        if (XXH3_64bits(hash, n * sizeof *hash) != s->hash)
            return corrupt_section(k->l, p->level, p->section, "checksum");
        if (v != SOUND)
            return corrupt_section(k->l, p->level, p->section, verdict_text[v]);
        i += n;
    }
    return PVX_OK;
}

static pvx_err check_counts(const struct check *k)
{
    uint64_t nnz[REC_SYSMAT_LEVELS_MAX] = {0};
    for (size_t i = 0; i < k->n; i++)
        nnz[k->piece[i].level] += k->piece[i].nnz;
    for (size_t level = 0; level < k->l->levels; level++)
        if (nnz[level] != k->l->level[level]->nnz)
            return corrupt_section(k->l, level, SECTION_W, "number of entries");
    return PVX_OK;
}

static void list_pieces(struct check *k, bool places)
{
    k->n = 0;
    for (uint32_t level = 0; level < k->l->levels; level++)
        for (uint32_t s = 0; s < SECTION_FP + k->l->level[0]->n_cameras; s++)
            for (uint64_t i = 0; i < pieces(k->l->section[level * SECTIONS + s].bytes); i++)
                if ((s == SECTION_AT) == places)
                    k->piece[k->n++] = (struct piece){.level = level, .section = s, .index = i};
}

static pvx_err check_contents(const struct loader *l, pvx_pool *pool)
{
    struct check k = {.l = l};
    size_t n = 0;
    for (size_t i = 0; i < l->levels * SECTIONS; i++)
        n += pieces(l->section[i].bytes);
    k.piece = pvx_calloc(n, sizeof *k.piece);
    k.hash = pvx_calloc(n, sizeof *k.hash);
    pvx_err e = PVX_OK;
    if (k.piece == NULL || k.hash == NULL)
        e = pvx_fail(l->d, PVX_ENOMEM, "%s: out of memory", l->path);
    for (int pass = 0; pass < 2 && e == PVX_OK; pass++) {
        list_pieces(&k, pass == 0);
        pvx_pool_run(pool, k.n, check_piece, &k);
        e = load_judge(&k);
    }
    PVX_THEN(e, check_counts(&k));
    free(k.piece);
    free(k.hash);
    return e;
}

/* ---- file -------------------------------------------------------------------------------------- */

static pvx_err read_matrix(struct loader *l, uint64_t key, bool verify, pvx_pool *pool)
{
    uint32_t cameras = 0;
    PVX_TRY(check_head(l, key, &cameras));
    PVX_TRY(alloc_levels(l, cameras));
    PVX_TRY(read_finest(l, l->level[0]));
    PVX_TRY(load_read_levels(l));
    return verify ? check_contents(l, pool) : PVX_OK;
}

pvx_err rec_sysmat_load(const char *path, uint64_t key, bool verify, pvx_pool *pool,
                        rec_sysmat **out, struct pvx_diag *d)
{
    *out = NULL;
    int fd;
    PVX_TRY(pvx_file_open(path, &fd, d));
    struct stat st;
    pvx_err e = PVX_OK;
    struct loader l = {.path = path, .d = d};
    if (fstat(fd, &st) != 0)
        e = load_fail_errno(d, path, "cannot stat");
    else if (!S_ISREG(st.st_mode) || st.st_size == 0)
        e = pvx_fail(d, PVX_EFORMAT, "%s: not a Pyrovox matrix (empty, or no plain file)", path);
    if (e == PVX_OK) {
        l.bytes = (uint64_t)st.st_size;
        l.base = mmap(NULL, l.bytes, PROT_READ, MAP_PRIVATE, fd, 0);
        if (l.base == MAP_FAILED)
            e = load_fail_errno(d, path, "cannot map");
    }
    close(fd);
    if (e != PVX_OK)
        return e;
    if (verify) /* every byte is about to be read */
        madvise(l.base, l.bytes, MADV_WILLNEED);
    e = read_matrix(&l, key, verify, pool);
    if (e != PVX_OK) {
        rec_sysmat_free(&l.level[0]);
        munmap(l.base, l.bytes);
        return e;
    }
    struct rec_sysmat_store *s = l.level[0]->priv;
    s->map = l.base;
    s->map_bytes = l.bytes;
    *out = l.level[0];
    rec_sysmat_let_go(*out);
    return PVX_OK;
}
