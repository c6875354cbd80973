/* h5.h - what write.c and read.c share: names, types, the text of libhdf5's errors. */
#ifndef CAP_TAKE_H5_H
#define CAP_TAKE_H5_H
#include <hdf5.h>
#include "capture/take/take.h"

#define TAKE_ROWS     64          /* rows per chunk of a table */
#define TAKE_STREAM   (64u << 10) /* bytes per chunk of a stream of JPEGs */
#define TAKE_SIDE_MAX 65536       /* pixels */

/* Before any other call: errors are not printed, and nothing is done at exit. */
void take_h5_init(void);
/* "PATH: what: libhdf5's reason"; PVX_ENOSPC when the disk is full, else e. */
pvx_err take_h5_fail(struct pvx_diag *d, pvx_err e, const char *path, const char *what);

/* Compound types of the tables in memory, which is their layout in the file too; owner: caller. */
hid_t take_h5_row_type(void);
hid_t take_h5_set_type(void);
hid_t take_h5_gap_type(void);

/* Shape of one frame in its dataset: rank - 1 dimensions after the frame's number; 1 = a stream of bytes.
 * *type = element type (a library constant).  Bytes of a frame: their product. */
int take_h5_shape(enum cap_pixfmt fmt, int32_t width, int32_t height, hsize_t dims[4], hid_t *type);

uint64_t take_row_check(const struct cap_take_row *r);
uint64_t take_set_check(const struct cap_take_set *s, const int64_t *member, uint32_t n);
#endif
