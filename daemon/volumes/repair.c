/* repair.c - repairs folders of volumes that were cut off.  A kill leaves whole files and a list that is not closed.
 * A power cut, or a copy that ended early, also leaves files that are not whole. */
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cjson/cJSON.h>

#include "base/file.h"
#include "daemon/volumes/folder.h"
#include "daemon/volumes/numbered.h"
#include "daemon/volumes/vdb_notes.h"

#define TEXT_MAX ((size_t)1 << 30)

static const char *const ends[VOL_FORMATS] = {
    [VOL_NPY] = ".npy", [VOL_VDB] = ".vdb", [VOL_NVDB] = ".nvdb"};

struct folder {
    const char *dir;
    enum vol_format format;
    struct vol_folder files;
};

static pvx_err repair_list(struct folder *f, struct pvx_diag *d)
{
    vol_folder_free(&f->files);
    return vol_folder_list(f->dir, ends[f->format], &f->files, d);
}

static void repair_path_of(const struct folder *f, size_t i, char path[PATH_MAX])
{
    snprintf(path, PATH_MAX, "%s/%s", f->dir, f->files.name[i]);
}

/* Whether the whole file can be read, as a recording of one volume, and has the grid of the others.  *bare: but for its
 * error bars. */
static pvx_err repair_look(const char *path, const struct pvp_grid *grid, bool *bare,
                           struct pvx_diag *d)
{
    vol_reader *r;
    struct vol_volume v;
    PVX_TRY(vol_reader_open(path, &r, d));
    vol_reader_spare(r);
    pvx_err e = vol_reader_get(r, 0, &v, d);
    *bare = e == PVX_OK && v.bars.damaged;
    if (e == PVX_OK && !pvp_grid_same(&v.v.grid, grid))
        e = pvx_fail(d, PVX_ERANGE,
                     "%s: its grid is not that of the volumes before it: of another recording; "
                     "move it away",
                     path);
    vol_reader_close(&r);
    return e;
}

static pvx_err repair_put_aside(const char *path, struct pvx_diag *d)
{
    char kept[PATH_MAX];
    if (snprintf(kept, sizeof kept, "%s.cut-off", path) >= (int)sizeof kept)
        return pvx_fail(d, PVX_EINVAL, "%s: over-long name", path);
    if (access(kept, F_OK) == 0)
        return pvx_fail(d, PVX_EBUSY, "%s: is there already, of an earlier repair; move it away",
                        kept);
    return rename(path, kept) == 0
               ? PVX_OK
               : pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", path, strerror(errno));
}

static pvx_err repair_look_at_all(const struct folder *f, const struct pvp_grid *grid,
                                  struct vol_repaired *out, struct pvx_diag *d)
{
    char path[PATH_MAX], sd[PATH_MAX];
    for (size_t i = 0; i < f->files.n; i++) {
        struct pvx_diag one = {""};
        repair_path_of(f, i, path);
        bool bare = false;
        pvx_err e = repair_look(path, grid, &bare, &one);
        bool damaged = vol_damaged(e);
        if (e != PVX_OK && !damaged)
            return pvx_fail(d, e, "%s", pvx_diag_text(&one, e));
        if (damaged)
            PVX_TRY(repair_put_aside(path, d));
        if (bare && vol_sd_path(path, sd, sizeof sd))
            PVX_TRY(repair_put_aside(sd, d));
        out->bare += bare;
        *(damaged ? &out->bad : &out->good) += 1;
    }
    return PVX_OK;
}

static pvx_err close_npy(const char *dir, const vol_reader *r, struct pvx_diag *d)
{
    char path[PATH_MAX], *text;
    size_t len;
    const struct vol_gap *g;
    snprintf(path, sizeof path, "%s/recording.json", dir);
    if (access(path, F_OK) != 0)
        return PVX_OK; /* of `pyrovox reconstruct`, or of an earlier version */
    PVX_TRY(pvx_file_read(path, TEXT_MAX, &text, &len, d));
    cJSON *o = cJSON_ParseWithLength(text, len);
    free(text);
    while (cJSON_HasObjectItem(o, "closed")) /* whatever their case is, and however many */
        cJSON_DeleteItemFromObject(o, "closed");
    cJSON_AddBoolToObject(o, "closed", true);
    cJSON *gaps = cJSON_CreateArray(); /* anew, as cJSON's own numbers are doubles */
    for (uint64_t k = 0; (g = vol_reader_gap(r, k)) != NULL; k++)
        vol_npy_put_gap(gaps, g);
    if (!cJSON_ReplaceItemInObjectCaseSensitive(o, "gaps", gaps))
        cJSON_Delete(gaps);
    text = cJSON_IsObject(o) ? cJSON_Print(o) : NULL;
    cJSON_Delete(o);
    if (text == NULL)
        return pvx_fail(d, PVX_EFORMAT, "%s: is not a JSON object", path);
    pvx_err e = pvx_file_write(path, text, strlen(text), d);
    cJSON_free(text);
    return e;
}

static pvx_err list_numbered(const struct folder *f, const struct vol_head *head,
                             struct pvx_diag *d)
{
    vol_numbered *n = NULL;
    const bool nano = f->format == VOL_NVDB;
    char path[PATH_MAX];
    pvx_err e = f->files.n > 0 ? PVX_OK : pvx_fail(d, PVX_ENOENT, "%s: no volume in it", f->dir);
    for (size_t i = 0; i < f->files.n && e == PVX_OK; i++) {
        struct vol_vdb_about a = {.unit_m = 1};
        repair_path_of(f, i, path);
        e = vol_vdb_about_load(path, nano, &a, d);
        const struct vol_options o = {.y_up = a.y_up != 0, .unit_m = a.unit_m};
        if (e == PVX_OK && n == NULL)
            e = vol_numbered_again(f->dir, f->files.name[i], ends[f->format] + 1, head, &o, &n, d);
        PVX_THEN(e, vol_numbered_found(n, f->files.name[i], &a.v, d));
    }
    if (e == PVX_OK)
        return vol_numbered_close(&n, d);
    vol_numbered_drop(&n);
    return e;
}

/* r: of the folder as it was. */
static pvx_err repair(struct folder *f, const vol_reader *r, struct vol_repaired *out,
                      struct pvx_diag *d)
{
    PVX_TRY(repair_list(f, d));
    PVX_TRY(repair_look_at_all(f, &vol_reader_head(r)->start.grid, out, d));
    out->done = out->bad > 0 || out->bare > 0 || vol_reader_cut(r);
    if (!out->done)
        return PVX_OK;
    PVX_TRY(repair_list(f, d)); /* without those that were put aside */
    return f->format == VOL_NPY ? close_npy(f->dir, r, d) : list_numbered(f, vol_reader_head(r), d);
}

pvx_err vol_repair_folder(const char *dir, struct vol_repaired *out, struct pvx_diag *d)
{
    vol_reader *r;
    *out = (struct vol_repaired){0};
    PVX_TRY(vol_reader_open(dir, &r, d));
    struct folder f = {.dir = dir, .format = vol_reader_format(r)};
    struct stat st;
    pvx_err e =
        stat(dir, &st) == 0 && S_ISDIR(st.st_mode)
            ? repair(&f, r, out, d)
            : pvx_fail(d, PVX_EINVAL, "%s: is one file of a recording; name its folder", dir);
    vol_folder_free(&f.files);
    vol_reader_close(&r);
    return e;
}
