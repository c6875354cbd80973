#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "base/mem.h"
#include "recon/matrix/format.h"

struct writer {
    const char *path;
    struct pvx_diag *d;
    size_t n; /* sections of all levels */
    struct section section[REC_SYSMAT_LEVELS_MAX * SECTIONS];
    uint64_t *piece; /* their pieces' checksums, end to end */
    uint64_t *first; /* [n+1] first piece of each section */
};

static pvx_err save_fail_errno(const struct writer *w, const char *what)
{
    int en = errno;
    return pvx_fail(w->d, pvx_err_from_errno(en), "%s: %s: %s", w->path, what, strerror(en));
}

/* Where everything goes; returns the file's length. */
static uint64_t save_lay_out(struct writer *w, const rec_sysmat *finest, size_t head)
{
    uint64_t at = head;
    for (const rec_sysmat *m = finest; m != NULL; m = m->coarse) {
        struct section *s = w->section + w->n;
        size_t n = section_sizes(m, s);
        s[SECTION_AT].data = m->win.at;
        s[SECTION_W].data = m->win.w;
        s[SECTION_MORE].data = m->win.more;
        for (size_t c = 0; c < m->n_cameras; c++)
            s[SECTION_FP + c].data = m->block[c].fp;
        for (size_t i = 0; i < n; i++) {
            s[i].offset = align64(at);
            at = s[i].offset + s[i].bytes;
        }
        w->n += n;
    }
    return at;
}

static void hash_piece(void *ctx, size_t task)
{
    struct writer *w = ctx;
    size_t s = 0;
    while (task >= w->first[s + 1])
        s++;
    w->piece[task] = piece_hash(&w->section[s], task - w->first[s]);
}

static pvx_err hash_sections(struct writer *w, pvx_pool *pool)
{
    w->first = pvx_calloc(w->n + 1, sizeof *w->first);
    if (w->first == NULL)
        return PVX_ENOMEM;
    for (size_t s = 0; s < w->n; s++)
        w->first[s + 1] = w->first[s] + pieces(w->section[s].bytes);
    w->piece = pvx_calloc(w->first[w->n], sizeof *w->piece);
    if (w->piece == NULL)
        return PVX_ENOMEM;
    pvx_pool_run(pool, w->first[w->n], hash_piece, w);
    for (size_t s = 0; s < w->n; s++)
        w->section[s].hash =
            XXH3_64bits(w->piece + w->first[s], (w->first[s + 1] - w->first[s]) * sizeof *w->piece);
    return PVX_OK;
}

static void encode_head(const struct writer *w, const rec_sysmat *m, size_t levels, uint64_t total,
                        uint8_t *buf)
{
    size_t bytes = head_bytes(m->n_cameras, levels);
    struct cursor c = {buf};
    put(&c, MAGIC, 8);
    put_u32(&c, VERSION);
    put_u32(&c, (uint32_t)bytes);
    put_u64(&c, m->key);
    put_u64(&c, total);
    put_u32(&c, (uint32_t)m->n_cameras);
    put_u32(&c, (uint32_t)levels);
    put(&c, m->grid.min, 24);
    put(&c, m->grid.max, 24);
    put(&c, m->grid.n, 12);
    put_u32(&c, (uint32_t)m->grid.basis);
    put_u32(&c, (uint32_t)m->binning);
    put_u32(&c, (uint32_t)m->rays_per_bin);
    put(&c, &m->unit, 4);
    put_u32(&c, 0);
    put_u64(&c, 0);
    for (size_t i = 0; i < m->n_cameras; i++) {
        put_u32(&c, (uint32_t)m->block[i].bw);
        put_u32(&c, (uint32_t)m->block[i].bh);
    }
    const struct section *s = w->section;
    for (const rec_sysmat *l = m; l != NULL; l = l->coarse) {
        for (size_t i = 0; i < l->n_cameras; i++)
            put_u64(&c, l->block[i].nnz);
        put_u32(&c, (uint32_t)l->win.high);
        put_u32(&c, (uint32_t)l->win.wide);
        for (size_t i = 0; i < SECTION_FP + l->n_cameras; i++, s++) {
            put_u64(&c, s->offset);
            put_u64(&c, s->bytes);
            put_u64(&c, s->hash);
        }
    }
    c.p = buf + HASH_AT;
    put_u64(&c, head_hash(buf, bytes));
}

static pvx_err save_write_all(const struct writer *w, int fd, const void *data, uint64_t n)
{
    const uint8_t *p = data;
    while (n > 0) {
        ssize_t done = write(fd, p, n < (1u << 30) ? (size_t)n : 1u << 30);
        if (done < 0 && errno == EINTR)
            continue;
        if (done < 0)
            return save_fail_errno(w, "cannot write");
        p += done;
        n -= (uint64_t)done;
    }
    return PVX_OK;
}

static pvx_err write_matrix(struct writer *w, const rec_sysmat *m, int fd, pvx_pool *pool)
{
    static const uint8_t zeros[64];
    uint8_t head[HEAD_MAX];
    size_t levels = 1;
    for (const rec_sysmat *l = m->coarse; l != NULL; l = l->coarse)
        levels++;
    uint64_t at = head_bytes(m->n_cameras, levels), total = save_lay_out(w, m, at);
    /* A full disk fails here, not after gigabytes.  File systems without fallocate go on. */
    if (fallocate(fd, 0, 0, (off_t)total) != 0 && errno == ENOSPC)
        return save_fail_errno(w, "cannot write");
    pvx_err e = hash_sections(w, pool);
    if (e != PVX_OK)
        return pvx_fail(w->d, e, "%s: out of memory for checksums", w->path);
    encode_head(w, m, levels, total, head);
    PVX_TRY(save_write_all(w, fd, head, at));
    for (size_t s = 0; s < w->n; s++) {
        PVX_TRY(save_write_all(w, fd, zeros, w->section[s].offset - at));
        PVX_TRY(save_write_all(w, fd, w->section[s].data, w->section[s].bytes));
        at = w->section[s].offset + w->section[s].bytes;
    }
    return PVX_OK;
}

static pvx_err write_file(struct writer *w, const rec_sysmat *m, int fd, pvx_pool *pool)
{
    PVX_TRY(write_matrix(w, m, fd, pool));
    if (fsync(fd) != 0 && errno != EINVAL)
        return save_fail_errno(w, "cannot flush to disk");
    return PVX_OK;
}

pvx_err rec_sysmat_save(const rec_sysmat *m, const char *path, pvx_pool *pool, struct pvx_diag *d)
{
    static atomic_uint counter; /* two threads of one process may save the same matrix */
    struct writer w = {.path = path, .d = d};
    char tmp[PATH_MAX];
    int n = snprintf(tmp, sizeof tmp, "%s.tmp.%ld.%u", path, (long)getpid(),
                     atomic_fetch_add(&counter, 1));
    if (n < 0 || (size_t)n >= sizeof tmp)
        return pvx_fail(d, PVX_EINVAL, "%s: path too long", path);
    int fd = open(tmp, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (fd < 0)
        return save_fail_errno(&w, "cannot create");
    pvx_err e = write_file(&w, m, fd, pool);
    free(w.first);
    free(w.piece);
    if (close(fd) != 0 && e == PVX_OK)
        e = save_fail_errno(&w, "cannot close");
    if (e == PVX_OK && rename(tmp, path) != 0)
        e = save_fail_errno(&w, "cannot rename into place");
    if (e != PVX_OK)
        unlink(tmp);
    return e;
}
