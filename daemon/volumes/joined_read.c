/* joined_read.c - reads what join.c made by way of its parts: each volume comes from the part that has it and is
 * checked there, which a virtual dataset would not do.
 *
 * Everything in the file is checked before it is used: a mapping's place against the columns, a name against the
 * folder, a volume's number against the part's.  A part that is not there is a gap, not an error. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "daemon/volumes/hdf5.h"

#define NONE SIZE_MAX

/* Sets [to, to + n) of the joined file are sets [from, from + n) of a part. */
struct run {
    char *path;
    uint64_t to, n, from;
    uint64_t index; /* of its first volume, among the volumes that are there */
};

struct joined {
    char *path;
    uint64_t sets, *number; /* [sets] */
    struct run *run;        /* [n_runs] ascending, those of parts that are there */
    size_t n_runs;
    struct vol_gap *gap;
    uint64_t n_gaps;
    void *head_of,
        *part; /* the first part, which owns the texts of head; the open part, of run `at` */
    size_t at;
    uint64_t part_sets;
    struct vol_head head;
    bool modes; /* are wanted */
};

static pvx_err joined_read_wrong(const struct joined *r, struct pvx_diag *d, const char *what)
{
    H5Eclear2(H5E_DEFAULT);
    return pvx_fail(d, PVX_EFORMAT, "%s: is not a joined recording of volumes, or damaged: %s",
                    r->path, what);
}

/* Whether the file is a joined one.  Only a file without filters is read as a whole. */
static bool is_virtual(hid_t file, const char *path, uint64_t bytes)
{
    bool candidate = file >= 0 && !vol_hdf5_filtered(file, "emission") &&
                     H5Lexists(file, "emission", H5P_DEFAULT) > 0 && bytes <= VOL_HEAPS_MOST &&
                     vol_hdf5_heaps_end(path, bytes);
    hid_t s = candidate ? H5Dopen2(file, "emission", H5P_DEFAULT) : -1;
    hid_t p = s >= 0 ? H5Dget_create_plist(s) : -1;
    bool yes = p >= 0 && H5Pget_layout(p) == H5D_VIRTUAL;
    H5Pclose(p);
    H5Dclose(s);
    return yes;
}

static bool joined_is(const char *path)
{
    uint64_t bytes;
    take_h5_init();
    if (!take_h5_looks(path, &bytes))
        return false;
    hid_t file = take_h5_open(path);
    bool yes = is_virtual(file, path, bytes);
    H5Fclose(file);
    H5Eclear2(H5E_DEFAULT);
    return yes;
}

/* Parts lie in the folder of the file, or below. */
static bool stays_below(const char *name)
{
    if (name[0] == '/' || name[0] == '\0')
        return false;
    for (const char *p = name; p != NULL; p = strchr(p, '/')) {
        p += *p == '/';
        if (strncmp(p, "..", 2) == 0 && (p[2] == '/' || p[2] == '\0'))
            return false;
    }
    return true;
}

/* First set and number of sets of a selection.  It need not have whole sets, as volumes come from the part. */
static bool bounds(hid_t space, uint64_t *first, uint64_t *n)
{
    hsize_t lo[VOL_RANK], hi[VOL_RANK];
    bool ok = space >= 0 && H5Sget_simple_extent_ndims(space) == VOL_RANK &&
              H5Sget_select_bounds(space, lo, hi) >= 0;
    H5Sclose(space);
    if (ok) {
        *first = lo[0];
        *n = hi[0] - lo[0] + 1;
    }
    return ok;
}

/* Append mapping k to the runs, unless its part is not there. */
static bool read_mapping(struct joined *r, hid_t p, size_t k)
{
    char name[1024];
    struct run *run = &r->run[r->n_runs];
    uint64_t there;
    ssize_t len = H5Pget_virtual_filename(p, k, name, sizeof name);
    if (len <= 0 || (size_t)len >= sizeof name || !stays_below(name) ||
        !bounds(H5Pget_virtual_vspace(p, k), &run->to, &run->n) ||
        !bounds(H5Pget_virtual_srcspace(p, k), &run->from, &there) || there != run->n ||
        run->to > r->sets || run->n > r->sets - run->to)
        return false;
    if (r->n_runs > 0 && run->to < run[-1].to + run[-1].n)
        return false; /* join.c writes them in order */
    const char *slash = strrchr(r->path, '/');
    int dir = slash != NULL ? (int)(slash + 1 - r->path) : 0;
    if (asprintf(&run->path, "%.*s%s", dir, r->path, name) < 0)
        return false;
    if (access(run->path, R_OK) == 0)
        r->n_runs++;
    else
        PVX_FREE(run->path);
    return true;
}

static pvx_err read_mappings(struct joined *r, hid_t file, struct pvx_diag *d)
{
    size_t n = 0;
    hid_t s = H5Dopen2(file, "emission", H5P_DEFAULT), p = H5Dget_create_plist(s);
    bool ok = H5Pget_virtual_count(p, &n) >= 0 && n > 0 && n <= r->sets;
    r->run = ok ? pvx_calloc(n, sizeof *r->run) : NULL;
    for (size_t k = 0; k < n && r->run != NULL && ok; k++)
        ok = read_mapping(r, p, k);
    H5Pclose(p);
    H5Dclose(s);
    return ok ? r->run != NULL ? PVX_OK : PVX_ENOMEM : joined_read_wrong(r, d, "its parts");
}

static pvx_err joined_read_read_numbers(struct joined *r, hid_t file, uint64_t bytes,
                                        struct pvx_diag *d)
{
    hid_t s = take_h5_open_table(file, "sets/number", H5T_STD_U64LE, 1, NULL, &r->sets);
    bool ok = s >= 0 && r->sets > 0 && r->sets <= bytes; /* a number takes more than one byte */
    r->number = ok ? pvx_calloc(r->sets, sizeof *r->number) : NULL;
    if (r->number != NULL)
        ok = take_h5_read_rows(s, H5T_NATIVE_UINT64, 1, 1, 0, r->sets, r->number);
    for (uint64_t k = 1; k < r->sets && r->number != NULL && ok; k++)
        ok = r->number[k] > r->number[k - 1];
    H5Dclose(s);
    return ok ? r->number != NULL ? PVX_OK : PVX_ENOMEM : joined_read_wrong(r, d, "sets/number");
}

/* The gaps: sets that lie in no part that is there; *count: number of the other sets. */
static pvx_err find_gaps(struct joined *r, uint64_t *count)
{
    uint64_t k = 0;
    *count = 0;
    r->gap = pvx_calloc(r->n_runs + 1, sizeof *r->gap);
    if (r->gap == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i <= r->n_runs; i++) {
        uint64_t end = i < r->n_runs ? r->run[i].to : r->sets;
        if (end > k)
            r->gap[r->n_gaps++] = (struct vol_gap){.why = VOL_GAP_UNSOLVED,
                                                   .set_first = r->number[k],
                                                   .set_last = r->number[end - 1],
                                                   .volumes = end - k};
        if (i == r->n_runs)
            break;
        r->run[i].index = *count;
        *count += r->run[i].n;
        k = end + r->run[i].n;
    }
    return PVX_OK;
}

static pvx_err open_part(struct joined *r, size_t i, struct pvx_diag *d)
{
    struct vol_head head;
    bool cut;
    if (r->at == i)
        return PVX_OK;
    if (r->part != NULL)
        vol_hdf5_reader.close(r->part);
    r->part = NULL;
    r->at = NONE;
    pvx_err e = joined_is(r->run[i].path)
                    ? pvx_fail(d, PVX_EFORMAT, "%s: is made of parts itself", r->run[i].path)
                    : vol_hdf5_reader.open(&r->part, r->run[i].path, &head, &r->part_sets, &cut, d);
    if (e != PVX_OK)
        return e;
    if (r->head_of != NULL && (!pvp_grid_same(&head.start.grid, &r->head.start.grid) ||
                               head.start.session != r->head.start.session))
        return pvx_fail(d, PVX_EFORMAT, "%s: is a part of another recording than %s",
                        r->run[i].path, r->path);
    vol_hdf5_reader.modes(r->part, r->modes);
    r->at = i;
    return PVX_OK;
}

static pvx_err open_head(struct joined *r, struct pvx_diag *d)
{
    bool cut;
    uint64_t sets;
    if (r->n_runs == 0)
        return pvx_fail(d, PVX_ENOENT, "%s: none of its parts is there: they lie in %s.parts",
                        r->path, r->path);
    pvx_err e = joined_is(r->run[0].path)
                    ? pvx_fail(d, PVX_EFORMAT, "%s: is made of parts itself", r->run[0].path)
                    : vol_hdf5_reader.open(&r->head_of, r->run[0].path, &r->head, &sets, &cut, d);
    return e;
}

static void joined_close(void *self)
{
    struct joined *r = self;
    take_h5_init();
    if (r->part != NULL)
        vol_hdf5_reader.close(r->part);
    if (r->head_of != NULL)
        vol_hdf5_reader.close(r->head_of);
    for (size_t i = 0; i < r->n_runs; i++)
        free(r->run[i].path);
    free(r->run);
    free(r->number);
    free(r->gap);
    free(r->path);
    free(r);
}

static pvx_err joined_read_open_all(struct joined *r, const char *path, uint64_t *count,
                                    struct pvx_diag *d)
{
    uint64_t bytes;
    if (!take_h5_looks(path, &bytes))
        return joined_read_wrong(r, d, "not HDF5");
    hid_t file = take_h5_open(path);
    pvx_err e = is_virtual(file, path, bytes) ? joined_read_read_numbers(r, file, bytes, d)
                                              : joined_read_wrong(r, d, "emission");
    PVX_THEN(e, read_mappings(r, file, d));
    H5Fclose(file);
    PVX_THEN(e, find_gaps(r, count));
    return e == PVX_OK ? open_head(r, d) : e;
}

static pvx_err joined_open(void **self, const char *path, struct vol_head *head, uint64_t *count,
                           bool *cut, struct pvx_diag *d)
{
    take_h5_init();
    struct joined *r = pvx_calloc(1, sizeof *r);
    PVX_NEED(r);
    r->at = NONE;
    r->path = strdup(path);
    pvx_err e = r->path != NULL ? joined_read_open_all(r, path, count, d) : PVX_ENOMEM;
    if (e != PVX_OK) {
        e = pvx_fail(d, e, "%s: %s", path, pvx_strerror(e));
        joined_close(r);
        return e;
    }
    *head = r->head;
    *cut = r->n_gaps > 0;
    *self = r;
    return PVX_OK;
}

static pvx_err joined_get(void *self, uint64_t k, struct vol_volume *out, struct pvx_diag *d)
{
    struct joined *r = self;
    size_t i = 0;
    take_h5_init();
    for (size_t hi = r->n_runs; hi - i > 1;) { /* the run that has volume k */
        size_t mid = i + (hi - i) / 2;
        if (r->run[mid].index <= k)
            i = mid;
        else
            hi = mid;
    }
    const struct run *run = &r->run[i];
    uint64_t in = k - run->index;
    PVX_TRY(open_part(r, i, d));
    if (run->from + in >= r->part_sets)
        return pvx_fail(d, PVX_ECORRUPT, "%s: has %llu volumes, fewer than when it was joined",
                        run->path, (unsigned long long)r->part_sets);
    PVX_TRY(vol_hdf5_reader.get(r->part, run->from + in, out, d));
    return out->v.set == r->number[run->to + in]
               ? PVX_OK
               : pvx_fail(d, PVX_ECORRUPT, "%s: was written anew since it was joined", run->path);
}

static void joined_modes(void *self, bool on)
{
    struct joined *r = self;
    r->modes = on;
    if (r->part != NULL)
        vol_hdf5_reader.modes(r->part, on);
}

static const struct vol_gap *joined_gap(const void *self, uint64_t k)
{
    const struct joined *r = self;
    return k < r->n_gaps ? &r->gap[k] : NULL;
}

const struct vol_reader_ops vol_joined_reader = {.is = joined_is,
                                                 .open = joined_open,
                                                 .get = joined_get,
                                                 .gap = joined_gap,
                                                 .modes = joined_modes,
                                                 .close = joined_close};
