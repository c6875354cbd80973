/* vdb_head.c - the notes in a file: the beginning of a .vdb, magic, versions, metadata (openvdb/io/Archive.cc,
 * MetaMap.cc); the same metadata as blind data of a .nvdb's first grid (nanovdb/util/IO.h, NanoVDB.h). */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/volumes/vdb_notes.h"

#define MAGIC     INT64_C(0x56444220) /* " BDV" */
#define VERSION_0 222u                /* first file version with this header */
#define UUID_LEN  36
#define NOTES_MAX ((size_t)65536) /* they need some 3 KB */

/* NanoVDB: sizes and places of what is read here. */
#define NANO_MAGIC  "NanoVDB0"
#define NANO_HEADER 16  /* io::Header: magic, version, count of grids at 12, codec at 14 */
#define NANO_META   176 /* io::MetaData: length of the name that follows at 136 */
#define NANO_GRID   672 /* GridData: magic, offset of blind metadata at 640, their count at 648 */
#define NANO_BLIND  288 /* GridBlindMetaData: offset of data at 0, their count at 8, name at 32 */

struct cursor {
    const char *p;
    size_t left;
};

static const char *vdb_head_take(struct cursor *c, size_t n)
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
    const char *p = vdb_head_take(c, sizeof *out);
    if (p != NULL)
        memcpy(out, p, sizeof *out);
    return p != NULL;
}

/* Take a length and then so many bytes. */
static bool take_bytes(struct cursor *c, const char **p, uint32_t *n)
{
    if (!take_u32(c, n))
        return false;
    *p = vdb_head_take(c, *n);
    return *p != NULL;
}

static bool vdb_head_is(const char *p, uint32_t n, const char *word)
{
    return n == strlen(word) && memcmp(p, word, n) == 0;
}

/* false: of a kind or length that pyrovox does not write. */
static bool to_note(const char *type, uint32_t type_n, const char *p, uint32_t n,
                    struct vol_vdb_note *out)
{
    if (vdb_head_is(type, type_n, "string") && n < sizeof out->text) {
        out->kind = VOL_VDB_TEXT;
        memcpy(out->text, p, n);
    } else if (vdb_head_is(type, type_n, "int64") && n == sizeof out->i) {
        out->kind = VOL_VDB_INT;
        memcpy(&out->i, p, n);
    } else if (vdb_head_is(type, type_n, "int32") && n == sizeof(int32_t)) {
        int32_t small; /* Python's openvdb writes numbers that fit as int32 */
        memcpy(&small, p, n);
        out->kind = VOL_VDB_INT;
        out->i = small;
    } else if (vdb_head_is(type, type_n, "double") && n == sizeof out->x[0]) {
        out->kind = VOL_VDB_REAL;
        memcpy(out->x, p, n);
    } else if (vdb_head_is(type, type_n, "vec3d") && n == sizeof out->x) {
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
    const char *p = vdb_head_take(c, sizeof magic);
    if (p != NULL)
        memcpy(&magic, p, sizeof magic);
    return magic == MAGIC && take_u32(c, &file) && file >= VERSION_0 && take_u32(c, &major) &&
           take_u32(c, &minor) && vdb_head_take(c, 1 + UUID_LEN) != NULL;
}

/* Metadata: their count, and of each key, type and value. */
static pvx_err vdb_head_take_notes(struct cursor c, const char *name, struct vol_vdb_note *note,
                                   size_t *n, struct pvx_diag *d)
{
    uint32_t count = 0;
    bool whole = take_u32(&c, &count);
    for (; whole && count > 0 && *n < VOL_VDB_NOTES_MAX; count--) {
        struct vol_vdb_note one = {.i = 0};
        const char *key, *type, *p;
        uint32_t key_n, type_n, size;
        whole = take_bytes(&c, &key, &key_n) && take_bytes(&c, &type, &type_n) &&
                take_bytes(&c, &p, &size);
        if (!whole || key_n >= sizeof one.key || !to_note(type, type_n, p, size, &one))
            continue;
        memcpy(one.key, key, key_n);
        note[(*n)++] = one;
    }
    return whole ? PVX_OK
                 : pvx_fail(d, PVX_EFORMAT, "%s: cut off, or damaged, in its metadata", name);
}

/* Exactly n bytes from `place`. */
static bool vdb_head_load(FILE *f, int64_t place, void *out, size_t n)
{
    return place >= 0 && fseeko(f, place, SEEK_SET) == 0 && fread(out, 1, n, f) == n;
}

/* Where the notes of a .nvdb are; 0: not there. */
static size_t find_blind(FILE *f, int64_t *place)
{
    unsigned char head[NANO_HEADER], meta[NANO_META], grid[NANO_GRID], blind[NANO_BLIND];
    uint16_t grids, codec;
    uint32_t name_n, blinds;
    int64_t at = NANO_HEADER, ahead;
    uint64_t n;
    if (!vdb_head_load(f, 0, head, sizeof head) || memcmp(head, NANO_MAGIC, 8) != 0)
        return 0;
    memcpy(&grids, head + 12, sizeof grids);
    memcpy(&codec, head + 14, sizeof codec);
    for (uint16_t k = 0; k < grids; k++) {
        if (!vdb_head_load(f, at, meta, sizeof meta))
            return 0;
        memcpy(&name_n, meta + 136, sizeof name_n);
        at += NANO_META + (int64_t)name_n;
    }
    if (grids == 0 || codec != 0 || !vdb_head_load(f, at, grid, sizeof grid) ||
        memcmp(grid, NANO_MAGIC, 8) != 0)
        return 0;
    memcpy(&ahead, grid + 640, sizeof ahead);
    memcpy(&blinds, grid + 648, sizeof blinds);
    if (blinds != 1 || ahead < NANO_GRID || ahead > INT64_MAX / 4 ||
        !vdb_head_load(f, at += ahead, blind, sizeof blind) ||
        memcmp(blind + 32, VOL_NVDB_NOTES, sizeof VOL_NVDB_NOTES) != 0)
        return 0;
    memcpy(&ahead, blind, sizeof ahead);
    memcpy(&n, blind + 8, sizeof n);
    *place = at + ahead;
    return ahead == NANO_BLIND && n <= NOTES_MAX ? (size_t)n : 0;
}

pvx_err vol_vdb_notes_load(FILE *f, bool nano, const char *name, struct vol_vdb_note *note,
                           size_t *n, struct pvx_diag *d)
{
    char *bytes = malloc(NOTES_MAX);
    int64_t at = 0;
    *n = 0;
    PVX_NEED(bytes);
    size_t len = nano ? find_blind(f, &at) : NOTES_MAX;
    bool there = len > 0 && fseeko(f, at, SEEK_SET) == 0;
    struct cursor c = {bytes, there ? fread(bytes, 1, len, f) : 0};
    pvx_err e = PVX_OK;
    if (nano && (!there || c.left != len))
        e = pvx_fail(d, PVX_EFORMAT, "%s: cut off, damaged, or not a .nvdb that pyrovox wrote",
                     name);
    else if (!nano && !skip_header(&c))
        e = pvx_fail(d, PVX_EFORMAT, "%s: not a .vdb file, or one of before 2013", name);
    PVX_THEN(e, vdb_head_take_notes(c, name, note, n, d));
    free(bytes);
    return e;
}
