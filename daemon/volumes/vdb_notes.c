#include "daemon/volumes/vdb_notes.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"

#define FORMAT  "pyrovox volume"
#define VERSION 1
#define DOUBT   "bars_doubt"

enum kind { U32, U64, I64, F64, HEX, TEXT, VECTOR };
static const struct field {
    const char *key;
    enum kind kind;
    size_t at, size;
} fields[] = {
#define FIELD(key, kind, member)                           \
    {                                                      \
        key, kind, offsetof(struct vol_vdb_about, member), \
            sizeof(((struct vol_vdb_about *)NULL)->member) \
    }
    FIELD("set", U64, v.set),
    FIELD("session", HEX, v.session),
    FIELD("t_exposure_ns", I64, v.t_exposure_ns),
    FIELD("t_publish_ns", I64, v.t_publish_ns),
    FIELD("spread_ns", I64, v.spread_ns),
    FIELD("latency_ns", I64, v.latency_ns),
    FIELD("cameras_present", U32, v.cameras_present),
    FIELD("camera_mask", HEX, v.camera_mask),
    FIELD("nx", U32, v.grid.n[0]),
    FIELD("ny", U32, v.grid.n[1]),
    FIELD("nz", U32, v.grid.n[2]),
    FIELD("min_m", VECTOR, v.grid.min),
    FIELD("max_m", VECTOR, v.grid.max),
    FIELD("basis_number", U32, v.grid.basis),
    FIELD("channels", U32, v.grid.channels),
    FIELD("status", U32, v.report.status),
    FIELD("solver", TEXT, v.report.solver),
    FIELD("iterations", U32, v.report.iterations),
    FIELD("rel_residual", F64, v.report.rel_residual),
    FIELD("active_voxels", U32, v.report.active_voxels),
    FIELD("active_rays", U32, v.report.active_rays),
    FIELD("entries", U64, v.report.entries),
    FIELD("photometry_ns", I64, v.report.photometry_ns),
    FIELD("hull_ns", I64, v.report.hull_ns),
    FIELD("restrict_ns", I64, v.report.restrict_ns),
    FIELD("solve_ns", I64, v.report.solve_ns),
    FIELD("total_ns", I64, v.report.total_ns),
    FIELD("sample", U32, sample),
    FIELD("clamped", U32, clamped),
    FIELD("y_up", U32, y_up),
    FIELD("split", U32, split),
    FIELD("unit_m", F64, unit_m),
    FIELD("rig_hash", HEX, start.rig_hash),
    FIELD("n_cameras", U32, start.n_cameras),
    FIELD("fps", F64, start.fps),
    FIELD("units", TEXT, start.units),
    FIELD("software", TEXT, start.software),
};
#define N_FIELDS (sizeof fields / sizeof fields[0])
_Static_assert(N_FIELDS + 4 <= VOL_VDB_NOTES_MAX, "room for all notes");

static void vdb_notes_put_text(struct vol_vdb_note *n, const char *key, const char *text)
{
    *n = (struct vol_vdb_note){.kind = VOL_VDB_TEXT};
    snprintf(n->key, sizeof n->key, "%s", key);
    snprintf(n->text, sizeof n->text, "%s", text);
}

static void put_field(const struct field *f, const char *from, struct vol_vdb_note *n)
{
    *n = (struct vol_vdb_note){.kind = VOL_VDB_INT};
    snprintf(n->key, sizeof n->key, "%s", f->key);
    uint32_t u32;
    uint64_t u64;
    switch (f->kind) {
    case U32:
        memcpy(&u32, from, sizeof u32);
        n->i = u32;
        break;
    case U64:
    case I64: memcpy(&n->i, from, sizeof n->i); break;
    case HEX:
        memcpy(&u64, from, sizeof u64);
        n->kind = VOL_VDB_TEXT;
        snprintf(n->text, sizeof n->text, "%016" PRIx64, u64);
        break;
    case F64:
    case VECTOR:
        n->kind = f->kind == F64 ? VOL_VDB_REAL : VOL_VDB_VECTOR;
        memcpy(n->x, from, f->size);
        break;
    case TEXT:
        n->kind = VOL_VDB_TEXT;
        snprintf(n->text, sizeof n->text, "%.*s", (int)f->size, from);
        break;
    }
}

size_t vol_vdb_notes_make(const struct vol_vdb_about *a, struct vol_vdb_note *note)
{
    size_t n = 0;
    vdb_notes_put_text(&note[n++], "format", FORMAT);
    vdb_notes_put_text(&note[n++], "basis", a->v.grid.basis == 1 ? "trilinear" : "box");
    note[n] = (struct vol_vdb_note){.key = "version", .kind = VOL_VDB_INT, .i = VERSION};
    n++;
    for (size_t i = 0; i < N_FIELDS; i++)
        put_field(&fields[i], (const char *)a + fields[i].at, &note[n++]);
    if (a->bars) /* readers take the notes that they know */
        note[n++] = (struct vol_vdb_note){.key = DOUBT, .kind = VOL_VDB_INT, .i = a->doubt};
    return n;
}

static const struct vol_vdb_note *vdb_notes_find(const struct vol_vdb_note *note, size_t n,
                                                 const char *key)
{
    for (size_t i = 0; i < n; i++)
        if (strncmp(note[i].key, key, sizeof note[i].key) == 0)
            return &note[i];
    return NULL;
}

/* false: of another kind, or outside its range. */
static bool take_field(const struct field *f, const struct vol_vdb_note *n, char *to)
{
    static const int kinds[] = {
        [U32] = VOL_VDB_INT,  [U64] = VOL_VDB_INT,   [I64] = VOL_VDB_INT,      [F64] = VOL_VDB_REAL,
        [HEX] = VOL_VDB_TEXT, [TEXT] = VOL_VDB_TEXT, [VECTOR] = VOL_VDB_VECTOR};
    if (n->kind != kinds[f->kind])
        return false;
    uint32_t u32 = (uint32_t)n->i;
    uint64_t u64;
    char *end;
    switch (f->kind) {
    case U32:
        if (n->i < 0 || n->i > UINT32_MAX)
            return false;
        memcpy(to, &u32, sizeof u32);
        return true;
    case U64:
    case I64: memcpy(to, &n->i, sizeof n->i); return true;
    case HEX:
        u64 = strtoull(n->text, &end, 16);
        memcpy(to, &u64, sizeof u64);
        return strlen(n->text) == 16 && *end == '\0';
    case F64:
    case VECTOR: memcpy(to, n->x, f->size); return true;
    case TEXT:
        if (strlen(n->text) >= f->size)
            return false;
        snprintf(to, f->size, "%s", n->text);
        return true;
    }
    return false;
}

pvx_err vol_vdb_notes_read(const struct vol_vdb_note *note, size_t n, const char *name,
                           struct vol_vdb_about *out, struct pvx_diag *d)
{
    *out = (struct vol_vdb_about){.unit_m = 1};
    const struct vol_vdb_note *format = vdb_notes_find(note, n, "format"),
                              *version = vdb_notes_find(note, n, "version");
    if (format == NULL || strcmp(format->text, FORMAT) != 0 || version == NULL)
        return pvx_fail(d, PVX_EFORMAT,
                        "%s: pyrovox's metadata are missing: another program wrote it, or wrote it "
                        "anew without them (vdb_ax keeps them with --copy-file-metadata)",
                        name);
    if (version->i != VERSION)
        return pvx_fail(d, PVX_EVERSION,
                        "%s: version %" PRId64 "; this program reads %d: update it", name,
                        version->i, VERSION);
    for (size_t i = 0; i < N_FIELDS; i++) {
        const struct vol_vdb_note *k = vdb_notes_find(note, n, fields[i].key);
        if (k == NULL || !take_field(&fields[i], k, (char *)out + fields[i].at))
            return pvx_fail(d, PVX_EFORMAT, "%s: its metadata `%s` is missing or cannot be", name,
                            fields[i].key);
    }
    if (!pvp_grid_valid(&out->v.grid))
        return pvx_fail(d, PVX_EFORMAT, "%s: its metadata says a grid that cannot be", name);
    if (out->y_up > 1 || out->split > 1 || !(out->unit_m > 0) || isinf(out->unit_m))
        return pvx_fail(d, PVX_EFORMAT, "%s: its metadata says a layout that cannot be", name);
    const struct vol_vdb_note *doubt = vdb_notes_find(note, n, DOUBT);
    out->bars = doubt != NULL && doubt->kind == VOL_VDB_INT;
    out->doubt = out->bars ? (uint32_t)doubt->i : 0;
    out->start.grid = out->v.grid;
    out->start.session = out->v.session;
    return PVX_OK;
}

pvx_err vol_vdb_about_load(const char *path, bool nano, struct vol_vdb_about *out,
                           struct pvx_diag *d)
{
    struct vol_vdb_note note[VOL_VDB_NOTES_MAX];
    size_t n = 0;
    int fd;
    PVX_TRY(pvx_file_open(path, &fd, d));
    FILE *f = fdopen(fd, "rb");
    if (f == NULL)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", path, strerror(errno));
    pvx_err e = vol_vdb_notes_load(f, nano, path, note, &n, d);
    fclose(f);
    return e == PVX_OK ? vol_vdb_notes_read(note, n, path, out, d) : e;
}
