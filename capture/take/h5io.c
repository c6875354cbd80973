/* h5io.c - attributes, texts and tables that grow, written and read back with every type and size compared. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "capture/take/h5.h"

#define TEXT_MAX (4u << 20)
#define META     (256u << 10)
#define SMALL    64u        /* smaller pieces are part of larger ones: not aligned */
#define ROOM     (4u << 20) /* for all metadata between two reservations, and for closing */

hid_t take_h5_access(hsize_t align)
{
    hid_t fapl = H5Pcreate(H5P_FILE_ACCESS);
    H5Pset_libver_bounds(fapl, H5F_LIBVER_V110, H5F_LIBVER_V110);
    H5Pset_fclose_degree(fapl, H5F_CLOSE_STRONG); /* closes what is open in it */
    H5Pset_meta_block_size(fapl, META);
    H5Pset_alignment(fapl, SMALL, align);
    /* No locks: a reader's lock must not prevent the closing of the file, and no other process writes it (O_EXCL). */
    H5Pset_file_locking(fapl, 0, 1);
    return fapl;
}

pvx_err take_h5_reserve(struct take_h5_room *r, hid_t file, const char *path, uint64_t bytes,
                        struct pvx_diag *d)
{
    hsize_t now = 0;
    if (file >= 0)
        H5Fget_filesize(file, &now); /* includes data not written yet */
    uint64_t want = now + bytes + ROOM;
    if (want <= r->reserved)
        return PVX_OK;
    if (fallocate(r->fd, FALLOC_FL_KEEP_SIZE, (off_t)r->reserved,
                  (off_t)(want + ROOM - r->reserved)) != 0 &&
        errno != EOPNOTSUPP) {
        pvx_err e = pvx_err_from_errno(errno);
        struct statvfs st = {0};
        int why = errno;
        if (e == PVX_ENOSPC && fstatvfs(r->fd, &st) == 0)
            return pvx_fail(d, e,
                            "%s: cannot be written: the disk is full: %.1f MB are left, %.1f are "
                            "needed",
                            path, (double)st.f_bavail * (double)st.f_frsize * 1e-6,
                            (double)(want + ROOM - r->reserved) * 1e-6);
        return pvx_fail(d, e, "%s: cannot be written: %s", path, strerror(why));
    }
    r->reserved = want + ROOM;
    return PVX_OK;
}

pvx_err take_h5_check(const char *path, struct pvx_diag *d)
{
    const char *slash = strrchr(path, '/');
    if (slash != NULL && slash != path) {
        char *dir = strndup(path, (size_t)(slash - path));
        pvx_err e = dir != NULL ? pvx_mkdirs(dir, d) : PVX_ENOMEM;
        free(dir);
        PVX_TRY(e);
    }
    return access(path, F_OK) != 0
               ? PVX_OK
               : pvx_fail(d, PVX_EBUSY, "%s: is there already; name another file", path);
}

pvx_err take_h5_create(struct take_h5_room *r, const char *path, hid_t fcpl, hid_t fapl,
                       hid_t *file, struct pvx_diag *d)
{
    *file = -1;
    PVX_TRY(take_h5_check(path, d));
    r->fd = open(path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (r->fd < 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", path, strerror(errno));
    *file = H5Fcreate(path, H5F_ACC_TRUNC, fcpl, fapl);
    /* first: where libhdf5 fails because no page is free it may give no reason */
    pvx_err e = take_h5_reserve(r, *file, path, 0, d);
    if (e == PVX_OK && *file < 0)
        e = take_h5_fail(d, PVX_EIO, path, "cannot be made");
    if (e != PVX_OK)
        unlink(path);
    return e;
}

bool take_h5_put_attr(hid_t at, const char *name, hid_t type, const void *value)
{
    hid_t space = H5Screate(H5S_SCALAR);
    hid_t a = H5Aexists(at, name) > 0 ? H5Aopen(at, name, H5P_DEFAULT)
                                      : H5Acreate2(at, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = a >= 0 && H5Awrite(a, type, value) >= 0;
    H5Aclose(a);
    H5Sclose(space);
    return ok;
}

bool take_h5_put_list(hid_t at, const char *name, hid_t type, hsize_t n, const void *v)
{
    hid_t space = H5Screate_simple(1, &n, NULL);
    hid_t a = H5Acreate2(at, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = a >= 0 && H5Awrite(a, type, v) >= 0;
    H5Aclose(a);
    H5Sclose(space);
    return ok;
}

bool take_h5_put_int(hid_t at, const char *name, int64_t v)
{
    return take_h5_put_attr(at, name, H5T_STD_I64LE, &v);
}

static hid_t text_type(const char *text)
{
    hid_t t = H5Tcopy(H5T_C_S1);
    H5Tset_size(t, strlen(text) + 1);
    /* Octave reads nothing after the first text that is marked as UTF-8 */
    for (const char *p = text; *p != '\0'; p++)
        if ((unsigned char)*p > 0x7f)
            H5Tset_cset(t, H5T_CSET_UTF8);
    return t;
}

bool take_h5_put_text(hid_t at, const char *name, const char *text)
{
    hid_t t = text_type(text);
    bool ok = take_h5_put_attr(at, name, t, text);
    H5Tclose(t);
    return ok;
}

bool take_h5_put_long_text(hid_t at, const char *name, const char *text)
{
    hid_t t = text_type(text), space = H5Screate(H5S_SCALAR);
    hid_t s = H5Dcreate2(at, name, t, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = s >= 0 && H5Dwrite(s, t, H5S_ALL, H5S_ALL, H5P_DEFAULT, text) >= 0;
    H5Dclose(s);
    H5Sclose(space);
    H5Tclose(t);
    return ok;
}

bool take_h5_make_table(hid_t at, const char *name, hid_t type, int rank, const hsize_t *chunk,
                        hid_t *out)
{
    hsize_t now[H5S_MAX_RANK], most[H5S_MAX_RANK];
    for (int i = 0; i < rank; i++)
        now[i] = most[i] = chunk[i];
    now[0] = 0;
    most[0] = H5S_UNLIMITED;
    hid_t space = H5Screate_simple(rank, now, most), p = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_chunk(p, rank, chunk);
    *out = H5Dcreate2(at, name, type, space, H5P_DEFAULT, p, H5P_DEFAULT);
    H5Pclose(p);
    H5Sclose(space);
    return *out >= 0;
}

bool take_h5_append(hid_t table, hid_t type, hsize_t width, uint64_t n, hsize_t count,
                    const void *rows)
{
    int rank = width > 0 ? 2 : 1;
    hsize_t all[2] = {n + count, width}, at[2] = {n, 0}, size[2] = {count, width};
    if (H5Dset_extent(table, all) < 0)
        return false;
    hid_t space = H5Dget_space(table), mem = H5Screate_simple(rank, size, NULL);
    bool ok = H5Sselect_hyperslab(space, H5S_SELECT_SET, at, NULL, size, NULL) >= 0 &&
              H5Dwrite(table, type, mem, space, H5P_DEFAULT, rows) >= 0;
    H5Sclose(mem);
    H5Sclose(space);
    return ok;
}

bool take_h5_get_attr(hid_t at, const char *name, hid_t type, size_t file_size, void *out)
{
    if (H5Aexists(at, name) <= 0)
        return false;
    hid_t a = H5Aopen(at, name, H5P_DEFAULT), have = H5Aget_type(a), space = H5Aget_space(a);
    bool ok = H5Tget_class(have) == H5Tget_class(type) && H5Tget_size(have) == file_size &&
              H5Sget_simple_extent_npoints(space) == 1 && H5Aread(a, type, out) >= 0;
    H5Sclose(space);
    H5Tclose(have);
    H5Aclose(a);
    return ok;
}

bool take_h5_get_int(hid_t at, const char *name, int64_t *out)
{
    return take_h5_get_attr(at, name, H5T_NATIVE_INT64, 8, out);
}

char *take_h5_get_text(hid_t at, const char *name, bool is_dataset)
{
    if ((is_dataset ? H5Lexists(at, name, H5P_DEFAULT) : H5Aexists(at, name)) <= 0)
        return NULL;
    hid_t a = is_dataset ? H5Dopen2(at, name, H5P_DEFAULT) : H5Aopen(at, name, H5P_DEFAULT);
    hid_t t = is_dataset ? H5Dget_type(a) : H5Aget_type(a);
    hid_t space = is_dataset ? H5Dget_space(a) : H5Aget_space(a);
    size_t n = H5Tget_size(t);
    char *out = NULL;
    if (H5Tget_class(t) == H5T_STRING && H5Tis_variable_str(t) == 0 && n >= 1 && n <= TEXT_MAX &&
        H5Sget_simple_extent_npoints(space) == 1)
        out = malloc(n + 1);
    if (out != NULL &&
        (is_dataset ? H5Dread(a, t, H5S_ALL, H5S_ALL, H5P_DEFAULT, out) : H5Aread(a, t, out)) < 0)
        PVX_FREE(out);
    if (out != NULL)
        out[n] = '\0';
    H5Sclose(space);
    H5Tclose(t);
    if (is_dataset)
        H5Dclose(a);
    else
        H5Aclose(a);
    return out;
}

bool take_h5_is_inside(hid_t set)
{
    hid_t p = H5Dget_create_plist(set);
    bool inside = H5Pget_layout(p) != H5D_VIRTUAL && H5Pget_external_count(p) <= 0;
    H5Pclose(p);
    return inside;
}

hid_t take_h5_open_table(hid_t at, const char *name, hid_t type, int rank, const hsize_t *dims,
                         uint64_t *n)
{
    hsize_t have[H5S_MAX_RANK];
    if (H5Lexists(at, name, H5P_DEFAULT) <= 0)
        return -1;
    hid_t set = H5Dopen2(at, name, H5P_DEFAULT);
    if (set < 0)
        return -1;
    hid_t t = H5Dget_type(set), space = H5Dget_space(set);
    bool ok = H5Tequal(t, type) > 0 && H5Sget_simple_extent_ndims(space) == rank &&
              H5Sget_simple_extent_dims(space, have, NULL) == rank && take_h5_is_inside(set);
    for (int i = 1; i < rank && ok; i++)
        ok = have[i] == dims[i];
    H5Sclose(space);
    H5Tclose(t);
    if (!ok) {
        H5Dclose(set);
        return -1;
    }
    *n = have[0];
    return set;
}

bool take_h5_read_rows(hid_t set, hid_t type, int rank, hsize_t width, uint64_t from,
                       uint64_t count, void *out)
{
    hsize_t at[2] = {from, 0}, size[2] = {count, width};
    hid_t space = H5Dget_space(set), mem = H5Screate_simple(rank, size, NULL);
    bool ok = H5Sselect_hyperslab(space, H5S_SELECT_SET, at, NULL, size, NULL) >= 0 &&
              H5Dread(set, type, mem, space, H5P_DEFAULT, out) >= 0;
    H5Sclose(mem);
    H5Sclose(space);
    return ok;
}

bool take_h5_looks(const char *path, uint64_t *bytes)
{
    static const unsigned char magic[8] = {0x89, 'H', 'D', 'F', '\r', '\n', 0x1a, '\n'};
    unsigned char got[8];
    struct stat st;
    int fd = -1;
    /* does not wait for the writer of a named pipe, which may never come */
    bool ok = pvx_file_open(path, &fd, NULL) == PVX_OK && read(fd, got, 8) == 8 &&
              memcmp(got, magic, 8) == 0 && fstat(fd, &st) == 0 && S_ISREG(st.st_mode);
    *bytes = ok ? (uint64_t)st.st_size : 0;
    if (fd >= 0)
        close(fd);
    return ok;
}

hid_t take_h5_open(const char *path)
{
    static const char *const hidden[] = {"clear_status_flags", "skip_eof_check"};
    hbool_t yes = 1;
    hid_t fapl = H5Pcreate(H5P_FILE_ACCESS);
    H5Pset_libver_bounds(fapl, H5F_LIBVER_EARLIEST, H5F_LIBVER_LATEST);
    H5Pset_fclose_degree(fapl, H5F_CLOSE_STRONG);
    H5Pset_file_locking(fapl, 0, 1);        /* no lock keeps a process from closing it */
    H5Pset_metadata_read_attempts(fapl, 3); /* more would wait for parts that were cut off */
    hid_t f = H5Fopen(path, H5F_ACC_RDONLY, fapl);
    if (f < 0)
        f = H5Fopen(path, H5F_ACC_RDONLY | H5F_ACC_SWMR_READ, fapl);
    for (size_t i = 0; i < sizeof hidden / sizeof *hidden && f < 0; i++)
        if (H5Pexist(fapl, hidden[i]) > 0 && H5Pset(fapl, hidden[i], &yes) >= 0)
            f = H5Fopen(path, H5F_ACC_RDONLY, fapl);
    H5Pclose(fapl);
    return f;
}
