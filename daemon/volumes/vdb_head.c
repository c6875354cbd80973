/* vdb_head.c - the beginning of a .vdb: magic, versions, metadata (openvdb/io/Archive.cc, MetaMap.cc). */
#include <stdio.h>
#include <string.h>

#include "daemon/volumes/vdb_notes.h"

#define MAGIC     INT64_C(0x56444220) /* " BDV" */
#define VERSION_0 222u                /* of the file: the first whose header is as here */
#define UUID_LEN  36

struct cursor {
    const char *p;
    size_t left;
};

static const char *take(struct cursor *c, size_t n)
{
    const char *p = c->p;
    if (n > c->left)
        return NULL;
    c->p += n;
    c->left -= n;
    return p;
}

static bool take_u32(struct cursor *c, uint32_t *out)
{
    const char *p = take(c, sizeof *out);
    if (p != NULL)
        memcpy(out, p, sizeof *out);
    return p != NULL;
}

/* A length and so many bytes. */
static bool take_bytes(struct cursor *c, const char **p, uint32_t *n)
{
    if (!take_u32(c, n))
        return false;
    *p = take(c, *n);
    return *p != NULL;
}

static bool is(const char *p, uint32_t n, const char *word)
{
    return n == strlen(word) && memcmp(p, word, n) == 0;
}

/* false: of a kind or length that pyrovox does not write. */
static bool to_note(const char *type, uint32_t type_n, const char *p, uint32_t n,
                    struct vol_vdb_note *out)
{
    if (is(type, type_n, "string") && n < sizeof out->text) {
        out->kind = VOL_VDB_TEXT;
        memcpy(out->text, p, n);
    } else if (is(type, type_n, "int64") && n == sizeof out->i) {
        out->kind = VOL_VDB_INT;
        memcpy(&out->i, p, n);
    } else if (is(type, type_n, "double") && n == sizeof out->x[0]) {
        out->kind = VOL_VDB_REAL;
        memcpy(out->x, p, n);
    } else if (is(type, type_n, "vec3d") && n == sizeof out->x) {
        out->kind = VOL_VDB_VECTOR;
        memcpy(out->x, p, n);
    } else {
        return false;
    }
    return true;
}

static bool skip_header(struct cursor *c)
{
    uint32_t file = 0, major, minor;
    int64_t magic = 0;
    const char *p = take(c, sizeof magic);
    if (p != NULL)
        memcpy(&magic, p, sizeof magic);
    return magic == MAGIC && take_u32(c, &file) && file >= VERSION_0 && take_u32(c, &major) &&
           take_u32(c, &minor) && take(c, 1 + UUID_LEN) != NULL;
}

pvx_err vol_vdb_notes_parse(const void *bytes, size_t len, const char *name,
                            struct vol_vdb_note *note, size_t *n, struct pvx_diag *d)
{
    struct cursor c = {bytes, len};
    uint32_t count;
    *n = 0;
    if (!skip_header(&c) || !take_u32(&c, &count))
        return pvx_fail(d, PVX_EFORMAT, "%s: not a .vdb file, or one of before 2013", name);
    for (; count > 0 && *n < VOL_VDB_NOTES_MAX; count--) {
        struct vol_vdb_note one = {.i = 0};
        const char *key, *type, *p;
        uint32_t key_n, type_n, size;
        if (!take_bytes(&c, &key, &key_n) || !take_bytes(&c, &type, &type_n) ||
            !take_bytes(&c, &p, &size))
            return pvx_fail(d, PVX_EFORMAT, "%s: cut off, or damaged, in its metadata", name);
        if (key_n >= sizeof one.key || !to_note(type, type_n, p, size, &one))
            continue;
        memcpy(one.key, key, key_n);
        note[(*n)++] = one;
    }
    return PVX_OK;
}
