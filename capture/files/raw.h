/* raw.h - recordings of high-speed cameras: .cine (Phantom), and .mraw with .cih or .cihx beside it (Photron).
 *
 *   cine.c, mraw.c   what a file says of its frames -> struct cap_raw
 *   raw.c            frames as pictures
 * Samples come as the file has them: all bits, not scaled, black level and white balance not applied.  Where 10 packed
 * bits of a Phantom stand for 12, they are these 12.  A depth that has no pixel format of its own fills 16 bits.
 * Pictures are turned and mirrored as the file asks, and the order of the colour filter with them.
 * Time 0 is the trigger.  A frame that is not whole in the file is left out, and said.
 * Ownership: the struct is the caller's, cap_raw_close.  Threads: one at a time per struct.  Every offset is checked
 * against the size of the file. */
#ifndef CAP_RAW_H
#define CAP_RAW_H
#include "base/err.h"
#include "capture/files/picture.h"

enum cap_raw_code {
    CAP_RAW_8,
    CAP_RAW_10_TABLE, /* packed, the highest bit first, 10 bits that stand for 12 (cine.c) */
    CAP_RAW_12,       /* packed, the highest bit first */
    CAP_RAW_16        /* little endian */
};

struct cap_raw_frame {
    uint64_t at; /* where its pixels begin; headed: where its annotation begins */
    int64_t t_ns;
    int32_t number; /* as the camera's program counts */
};

struct cap_raw {
    char *path;
    int fd;
    uint64_t bytes; /* of the file */

    /* set by cine.c or mraw.c */
    enum cap_raw_code code;
    int depth, shift;      /* bits of a sample, after a shift to the right */
    int32_t width, height; /* as stored */
    bool bottom_up;
    bool mirror_x, mirror_y;
    int quarters;                  /* of a turn, counterclockwise, after that; 0 to 3 */
    int32_t left, top, wide, high; /* the part that is used, of the upright stored picture */
    char cell[4];          /* 'R' 'G' 'B' of that picture's first 2x2 pixels; cell[0] 0: grey */
    bool filter;           /* a colour filter whose order is not known; grey then */
    bool headed;           /* each frame has an annotation before it */
    const uint16_t *table; /* of CAP_RAW_10_TABLE, borrowed */
    size_t n;
    struct cap_raw_frame *frame; /* [n] times ascend */
    double exposure_s[2];        /* the shortest and the longest; 0: not known */
    char *said;                  /* as in said.h */

    /* raw.c */
    uint64_t frame_bytes, row_bits; /* of the pixels as stored */
    enum cap_pixfmt fmt;
    ptrdiff_t first, right, down; /* picture[first + x * right + y * down] = part[y][x] */
    int32_t out_width, out_height;
    uint8_t *in, *out;
    uint16_t *row;
};

/* Errors: those of pvx_file_open; PVX_EFORMAT, PVX_ECORRUPT, PVX_EUNSUP, PVX_ERANGE, PVX_ENOMEM; all name the file.
 * For .cih and .cihx the .mraw beside it is meant.  Close it after an error, too. */
PVX_MUST_CHECK pvx_err cap_raw_open(const char *path, struct cap_raw *r, struct pvx_diag *d);
/* Frame i; img is borrowed until the next call.  PVX_ECORRUPT: it is damaged. */
PVX_MUST_CHECK pvx_err cap_raw_load(struct cap_raw *r, size_t i, struct cap_image *img,
                                    struct pvx_diag *d);
void cap_raw_close(struct cap_raw *r);

/* Inside: what the two readers give each other.  The file is open, path, fd and bytes are set. */
PVX_MUST_CHECK pvx_err cap_cine_read(struct cap_raw *r, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err cap_mraw_read(struct cap_raw *r, struct pvx_diag *d);
/* `size` bytes from `at` on; false: they are not all there. */
bool cap_raw_get(const struct cap_raw *r, uint64_t at, void *to, size_t size);
#endif
