/* h5.h - libhdf5 for takes and recordings of volumes: the text of its errors, attributes, texts and growing tables,
 * and the types of a take, which write.c and read.c share.
 * Every getter compares type and size before it reads a byte. */
#ifndef CAP_TAKE_H5_H
#define CAP_TAKE_H5_H
#include <hdf5.h>
#include "capture/take/take.h"

#define TAKE_ROWS     64          /* rows per chunk of a table */
#define TAKE_STREAM   (64u << 10) /* bytes per chunk of a stream of JPEGs */
#define TAKE_ALIGN    4096        /* a page: frames are larger by far */
#define TAKE_SIDE_MAX 65536       /* pixels */

/* Call it first in each thread.  libhdf5 then prints no errors, and does nothing at exit. */
void take_h5_init(void);
/* "PATH: what: libhdf5's reason"; PVX_ENOSPC when the disk is full, else e. */
pvx_err take_h5_fail(struct pvx_diag *d, pvx_err e, const char *path, const char *what);

/* Properties of a file: format 1.10, closing it closes all objects that are open in it, metadata in blocks.
 * Owner: caller.  Each piece begins at a multiple of `align`.  A power cut leaves pages of different times on the
 * disk.  A piece of which one half is older is lost, with all that it describes. */
hid_t take_h5_access(hsize_t align);

/* libhdf5 (1.10.8) crashes when it closes a dataset that it cannot write: on a full disk, in H5D_close.  So room on
 * the disk is reserved before libhdf5 gets the data. */
struct take_h5_room {
    int fd;            /* of the same file */
    uint64_t reserved; /* bytes from its start that are reserved on the disk */
};
PVX_MUST_CHECK pvx_err take_h5_reserve(struct take_h5_room *r, hid_t file, const char *path,
                                       uint64_t bytes, struct pvx_diag *d);
/* PVX_EBUSY: path is there.  Makes its folder. */
PVX_MUST_CHECK pvx_err take_h5_check(const char *path, struct pvx_diag *d);
/* Makes path, which must not be there, with its folder and first room; an error leaves no file.  Owner of *file and
 * r->fd: caller. */
PVX_MUST_CHECK pvx_err take_h5_create(struct take_h5_room *r, const char *path, hid_t fcpl,
                                      hid_t fapl, hid_t *file, struct pvx_diag *d);

/* Whether path is a regular file that begins like HDF5; *bytes = its size. */
bool take_h5_looks(const char *path, uint64_t *bytes);
/* Opens for reading, in SWMR mode if the file is being written or was not closed.  Two kinds of files need the
 * properties that h5clear uses: a file whose writer ended while out of that mode (it is still marked as open for
 * writing), and a file that was cut after it was closed (it is shorter than it says). */
hid_t take_h5_open(const char *path);

bool take_h5_put_attr(hid_t at, const char *name, hid_t type, const void *value);
/* A new attribute of n elements in one dimension. */
bool take_h5_put_list(hid_t at, const char *name, hid_t type, hsize_t n, const void *v);
bool take_h5_put_int(hid_t at, const char *name, int64_t v);
bool take_h5_put_text(hid_t at, const char *name, const char *text);
/* Long texts are datasets, because an attribute holds at most 64 KiB. */
bool take_h5_put_long_text(hid_t at, const char *name, const char *text);
/* A dataset that grows along its first dimension, `chunk` of it at a time. */
bool take_h5_make_table(hid_t at, const char *name, hid_t type, int rank, const hsize_t *chunk,
                        hid_t *out);
/* Appends `count` rows to a table that has `n` rows; width 0 = the table has one column and rank 1. */
bool take_h5_append(hid_t table, hid_t type, hsize_t width, uint64_t n, hsize_t count,
                    const void *rows);

bool take_h5_get_attr(hid_t at, const char *name, hid_t type, size_t file_size, void *out);
bool take_h5_get_int(hid_t at, const char *name, int64_t *out);
/* A string of fixed length, from an attribute or (is_dataset) a dataset; owner: caller, free().  NULL = none. */
char *take_h5_get_text(hid_t at, const char *name, bool is_dataset);
/* Whether the data of a dataset lie in its file.  Others are named in it: any file that can be read. */
bool take_h5_is_inside(hid_t set);
/* Opens the dataset of this name, if it is inside and has this element type and shape (dims[0] is not compared; *n = the
 * dataset's).  -1 = there is none such. */
hid_t take_h5_open_table(hid_t at, const char *name, hid_t type, int rank, const hsize_t *dims,
                         uint64_t *n);
/* Rows [from, from+count) of a table of rank 1 or 2. */
bool take_h5_read_rows(hid_t set, hid_t type, int rank, hsize_t width, uint64_t from,
                       uint64_t count, void *out);

/* Compound types of the tables; the layout in memory and in the file is the same.  Owner: caller. */
hid_t take_h5_row_type(void);
hid_t take_h5_set_type(void);
hid_t take_h5_gap_type(void);
hid_t take_h5_trigger_type(void);
hid_t take_h5_lost_type(void);

/* Shape of one frame in its dataset.  Returns the rank: the frame's number and rank - 1 dimensions; 1 = a stream of
 * bytes.  *type = element type (a library constant).  Bytes of a frame: the product of the dimensions. */
int take_h5_shape(enum cap_pixfmt fmt, int32_t width, int32_t height, hsize_t dims[4], hid_t *type);

uint64_t take_row_check(const struct cap_take_row *r);
uint64_t take_set_check(const struct cap_take_set *s, const int64_t *member, uint32_t n);
#endif
