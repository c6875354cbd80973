/* piece.h - one file of a take as it is read (read.c); take.c puts those of a recording that rolled over together.
 *
 * All tables are in memory from piece_open on; the file is only needed for pixels, and may be closed and opened again.
 * Threads: one at a time. */
#ifndef CAP_TAKE_PIECE_H
#define CAP_TAKE_PIECE_H
#include "capture/take/h5.h"

enum { PIECE_SETS = CAP_MAX_CAMERAS, PIECE_GAPS, PIECE_TABLES };

struct piece_camera {
    struct cap_take_camera c; /* its strings are owned here */
    struct cap_take_row *row;
    hid_t frames;
    int rank;
    hsize_t dims[4];
    hid_t type;
    uint64_t stream; /* bytes of JPEG that there are */
    size_t largest;
};

struct piece {
    char *path;
    hid_t file; /* -1 = closed */
    uint64_t file_bytes;
    struct cap_take_head head;
    uint64_t sets, sets_lost, gaps; /* as in cap_take_info */
    bool closed, goes_on;           /* in order; in another file */
    struct piece_camera *camera;    /* [CAP_MAX_CAMERAS] */
    struct cap_take_set *set;
    int64_t *member; /* [sets][n_cameras] */
    struct cap_take_gap *gap;
    /* take.c's: */
    uint64_t first
        [PIECE_TABLES]; /* places in the whole take of its first frame of each camera, set and gap */
    uint64_t used;      /* when, in turns */
};

/* Everything but the pixels; errors as cap_take_open.  The file is open. */
PVX_MUST_CHECK pvx_err piece_open(const char *path, struct piece **out, struct pvx_diag *d);
void piece_free(struct piece **p);
void piece_shut(struct piece *p);
/* False: it cannot be opened any more. */
bool piece_reopen(struct piece *p);
/* Pixels of a frame into mem, which has room for them; false: libhdf5 cannot. */
bool piece_fetch(const struct piece *p, uint32_t camera, uint64_t row, void *mem);
/* They are what was recorded: the image that they are. */
bool piece_is(const struct piece *p, uint32_t camera, uint64_t row, const void *mem,
              struct cap_image *img);
#endif
