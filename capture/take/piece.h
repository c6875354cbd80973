/* piece.h - one file of a take while it is read (read.c); take.c joins the files of a recording that rolled over.
 *
 * From piece_open on, all tables are in memory.  The file is only needed for pixels, and may be closed and reopened.
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
    uint64_t stream; /* bytes of JPEG in the file */
    size_t largest;
};

struct piece {
    char *path;
    hid_t file; /* -1 = closed */
    uint64_t file_bytes;
    struct cap_take_head head;
    uint64_t sets, sets_lost, gaps; /* as in cap_take_info */
    bool closed, goes_on;           /* closed in order; goes on in another file */
    struct piece_camera *camera;    /* [CAP_MAX_CAMERAS] */
    struct cap_take_set *set;
    int64_t *member; /* [sets][n_cameras] */
    struct cap_take_gap *gap;
    struct cap_take_trigger *trigger; /* [triggers], of a take that triggers began */
    struct cap_take_lost *lost;       /* [losses] */
    uint64_t triggers, losses;
    /* take.c's: */
    uint64_t first
        [PIECE_TABLES]; /* index in the whole take of its first frame of each camera, set and gap */
    uint64_t used;      /* turn of its last use */
};

/* Reads everything except the pixels; errors as cap_take_open.  Leaves the file open. */
PVX_MUST_CHECK pvx_err piece_open(const char *path, struct piece **out, struct pvx_diag *d);
void piece_free(struct piece **p);
void piece_shut(struct piece *p);
/* False: the file cannot be opened any more. */
bool piece_reopen(struct piece *p);
/* Reads the pixels of a frame into mem, which must have room for them.  False: libhdf5 cannot read them. */
bool piece_fetch(const struct piece *p, uint32_t camera, uint64_t row, void *mem);
/* Whether the pixels in mem are those that were recorded, by their checksum.  *img describes them. */
bool piece_is(const struct piece *p, uint32_t camera, uint64_t row, const void *mem,
              struct cap_image *img);
#endif
