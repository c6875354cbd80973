/* vdb_read.c - reads numbered .vdb or .nvdb files (or one) as a recording.  Values in their notes are checked against
 * bounds (vdb_notes.h).  OpenVDB reads the rest, where it can do no harm (vdb_child.h). */
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/file.h"
#include "daemon/volumes/folder.h"
#include "daemon/volumes/vdb_child.h"
#include "daemon/volumes/vdb_layout.h"
#include "daemon/volumes/vdb_module.h"
#include "daemon/volumes/vdb_notes.h"

#define FILE_MAX ((size_t)1 << 36)
#define TEXT_MAX ((size_t)1 << 24)

struct file {
    char *path;
    uint64_t set, session;
};

struct vdb_in {
    vol_vdb_read_fn *decode;
    bool nano;
    struct file *file;
    size_t n;
    struct vol_gap *gap;
    size_t n_gaps;
    char *rig, *config;
    struct vol_head head;
    struct vol_vdb_bricks last; /* of the volume given last */
};

static bool is_vdb(const char *path)
{
    return vol_folder_has(path, ".vdb");
}
static bool is_nvdb(const char *path)
{
    return vol_folder_has(path, ".nvdb");
}

static pvx_err add_gap(struct vdb_in *r, uint64_t first, uint64_t last)
{
    struct vol_gap *more = realloc(r->gap, (r->n_gaps + 1) * sizeof *more);
    PVX_NEED(more);
    r->gap = more;
    r->gap[r->n_gaps++] =
        (struct vol_gap){.why = VOL_GAP_LOST, .set_first = first, .set_last = last};
    return PVX_OK;
}

/* The next file of the recording; one that repeats the set before is passed over. */
static pvx_err add_file(struct vdb_in *r, const char *path, const struct vol_vdb_about *about,
                        struct pvx_diag *d)
{
    const struct vol_vdb_about a = *about;
    const struct file *before = r->n > 0 ? &r->file[r->n - 1] : NULL;
    if (before == NULL)
        r->head.start = a.start;
    else if (before->session == a.v.session && before->set == a.v.set)
        return PVX_OK;
    if (!pvp_grid_same(&a.v.grid, &r->head.start.grid))
        return pvx_fail(d, PVX_EFORMAT,
                        "%s: has another grid than the files before it: another recording's", path);
    if (before != NULL && before->session == a.v.session && a.v.set > before->set + 1)
        PVX_TRY(add_gap(r, before->set + 1, a.v.set - 1));
    struct file *more = realloc(r->file, (r->n + 1) * sizeof *more);
    PVX_NEED(more);
    r->file = more;
    r->file[r->n] = (struct file){strdup(path), a.v.set, a.v.session};
    return r->file[r->n++].path != NULL ? PVX_OK : PVX_ENOMEM;
}

/* NULL where there is none. */
static pvx_err take_text(const char *dir, const char *name, char **out, struct pvx_diag *d)
{
    char path[PATH_MAX];
    size_t len;
    snprintf(path, sizeof path, "%s/%s", dir, name);
    struct pvx_diag own = {""};
    pvx_err e = pvx_file_read(path, TEXT_MAX, out, &len, &own);
    return e == PVX_OK || e == PVX_ENOENT ? PVX_OK : pvx_fail(d, e, "%s", own.text);
}

/* Whether the list beside the files (numbered.h) says that the recording was closed. */
static bool vdb_read_closed(const char *dir)
{
    struct vol_folder f;
    char path[PATH_MAX], *text;
    size_t len;
    bool yes = false;
    if (vol_folder_list(dir, ".json", &f, NULL) == PVX_OK && f.n > 0) {
        snprintf(path, sizeof path, "%s/%s", dir, f.name[0]);
        if (pvx_file_read(path, TEXT_MAX, &text, &len, NULL) == PVX_OK) {
            yes = strstr(text, "\"closed\":true") != NULL;
            free(text);
        }
    }
    vol_folder_free(&f);
    return yes;
}

/* A file whose beginning is damaged or cut off is a set that is missing. */
static pvx_err vdb_read_add_folder(struct vdb_in *r, const char *dir, bool *cut, struct pvx_diag *d)
{
    struct vol_folder f;
    struct vol_vdb_about a = {.unit_m = 1};
    struct pvx_diag first = {""}, one = {""};
    char path[PATH_MAX];
    *cut = !vdb_read_closed(dir);
    pvx_err e = vol_folder_list(dir, r->nano ? ".nvdb" : ".vdb", &f, d);
    for (size_t i = 0; i < f.n && e == PVX_OK; i++) {
        snprintf(path, sizeof path, "%s/%s", dir, f.name[i]);
        e = vol_vdb_about_load(path, r->nano, &a, &one);
        if (e == PVX_EFORMAT) {
            first = first.text[0] == '\0' ? one : first;
            *cut = true;
            e = PVX_OK;
        } else {
            e = e == PVX_OK ? add_file(r, path, &a, d) : pvx_fail(d, e, "%s", one.text);
        }
    }
    if (e == PVX_OK && r->n == 0)
        e = f.n > 0 ? pvx_fail(d, PVX_EFORMAT, "%s", first.text)
                    : pvx_fail(d, PVX_ENOENT, "%s: no volumes in it", dir);
    vol_folder_free(&f);
    PVX_THEN(e, take_text(dir, "rig.yaml", &r->rig, d));
    PVX_THEN(e, take_text(dir, "pyrovoxd.yaml", &r->config, d));
    return e;
}

static void close_in(void *self)
{
    struct vdb_in *r = self;
    for (size_t i = 0; i < r->n; i++)
        free(r->file[i].path);
    free(r->file);
    free(r->gap);
    free(r->rig);
    free(r->config);
    vol_vdb_child_free(&r->last);
    free(r);
}

static pvx_err open_file(struct vdb_in *r, const char *path, struct pvx_diag *d)
{
    struct vol_vdb_about a = {.unit_m = 1};
    PVX_TRY(vol_vdb_about_load(path, r->nano, &a, d));
    return add_file(r, path, &a, d);
}

static pvx_err vdb_read_open_any(bool nano, void **self, const char *path, struct vol_head *head,
                                 uint64_t *count, bool *cut, struct pvx_diag *d)
{
    const struct vol_vdb *module;
    struct stat st;
    *self = NULL;
    *cut = false;
    PVX_TRY(vol_vdb_need(path, &module, d));
    struct vdb_in *r = calloc(1, sizeof *r);
    PVX_NEED(r);
    r->nano = nano;
    r->decode = nano ? module->read_nvdb : module->read_vdb;
    pvx_err e = stat(path, &st) == 0 && S_ISDIR(st.st_mode) ? vdb_read_add_folder(r, path, cut, d)
                                                            : open_file(r, path, d);
    if (e != PVX_OK) {
        close_in(r);
        return e;
    }
    r->head.rig = r->rig;
    r->head.config = r->config;
    *head = r->head;
    *count = r->n;
    *self = r;
    return PVX_OK;
}

static pvx_err vdb_read_open_vdb(void **self, const char *path, struct vol_head *head,
                                 uint64_t *count, bool *cut, struct pvx_diag *d)
{
    return vdb_read_open_any(false, self, path, head, count, cut, d);
}
static pvx_err vdb_read_open_nvdb(void **self, const char *path, struct vol_head *head,
                                  uint64_t *count, bool *cut, struct pvx_diag *d)
{
    return vdb_read_open_any(true, self, path, head, count, cut, d);
}

static pvx_err vdb_read_get(void *self, uint64_t k, struct vol_volume *out, struct pvx_diag *d)
{
    struct vdb_in *r = self;
    struct vol_vdb_about a = {.unit_m = 1};
    char *bytes;
    size_t len;
    if (k >= r->n)
        return pvx_fail(d, PVX_EINVAL, "no volume %llu", (unsigned long long)k);
    const char *path = r->file[k].path;
    vol_vdb_child_free(&r->last);
    PVX_TRY(vol_vdb_about_load(path, r->nano, &a, d));
    if (!pvp_grid_same(&a.v.grid, &r->head.start.grid))
        return pvx_fail(d, PVX_ECORRUPT, "%s: has changed while it was read", path);
    PVX_TRY(pvx_file_read(path, FILE_MAX, &bytes, &len, d));
    struct vol_vdb_bricks *b = &r->last;
    vol_vdb_place(&a, b);
    pvx_err e = vol_vdb_child_read(r->decode, path, bytes, len, b, d);
    free(bytes);
    PVX_TRY(e);
    *out = (struct vol_volume){.v = a.v,
                               /* a .vdb holds halves */
                               .sample = r->nano && a.sample == PVP_F32 ? PVP_F32 : PVP_F16,
                               .clamped = a.clamped != 0,
                               .n_bricks = b->n_bricks,
                               .ids = b->ids,
                               .brick = b->brick,
                               .bars = {.sd = b->sd, .doubt = b->sd != NULL ? a.doubt : 0},
                               .kelvin = b->kelvin};
    return PVX_OK;
}

static const struct vol_gap *gap_at(const void *self, uint64_t k)
{
    const struct vdb_in *r = self;
    return k < r->n_gaps ? &r->gap[k] : NULL;
}

const struct vol_reader_ops vol_vdb_reader = {
    .is = is_vdb, .open = vdb_read_open_vdb, .get = vdb_read_get, .gap = gap_at, .close = close_in};
const struct vol_reader_ops vol_nvdb_reader = {.is = is_nvdb,
                                               .open = vdb_read_open_nvdb,
                                               .get = vdb_read_get,
                                               .gap = gap_at,
                                               .close = close_in};
