/* take.h - a take: the raw frames of a recording in one HDF5 file, or in several when it rolled over: NAME.h5,
 * NAME-0002.h5, ...  daemon/TAKE.md lists every field.  A writer writes one file, the reader reads all as one.
 *
 * The writer appends the pixels to their chunk, then the frame's row, then the set's row.  A commit makes the rows
 * visible.  It uses HDF5's single-writer mode (SWMR), in which the file on the disk is consistent after every
 * write.  Each row has a checksum of itself and of its pixels.  From a file that was cut off, the reader takes the
 * rows whose checksum is right, and reports what it left out.
 *
 * Threads: a writer or reader belongs to one thread at a time, except that any thread may call cap_take_read
 * (libhdf5 has a lock of its own).  libhdf5 allocates in the thread that calls.
 * Errors name the file and the remedy. */
#ifndef CAP_TAKE_H
#define CAP_TAKE_H
#include "capture/sync/frameset.h"

#define CAP_TAKE_FORMAT   1 /* version of the layout */
#define CAP_TAKE_NAME_MAX 64

/* Why frames are not in the take, or are in it without a set. */
enum cap_take_why {
    CAP_TAKE_IN_SET,
    CAP_TAKE_LATE,      /* in the take: came after its set had been closed */
    CAP_TAKE_UNMATCHED, /* in the take: its set was never completed */
    CAP_TAKE_OVERFLOW,  /* in the take: no set struct was free */
    CAP_TAKE_QUEUE,     /* not in it: the disk was slower than the cameras */
    CAP_TAKE_UNFIT,     /* not in it: another size or format than the camera's frames before */
    CAP_TAKE_N_WHY
};
extern const char *const cap_take_why_names[CAP_TAKE_N_WHY];

/* A frame, without its pixels.  Times as in struct cap_frame. */
struct cap_take_row {
    uint64_t id;
    int64_t set; /* number of its set; -1 = in none */
    int64_t t_device_ns, t_arrival_ns, t_arrival_mono_ns, t_exposure_ns;
    double exposure_us, gain; /* NAN = not known */
    uint64_t offset, bytes;   /* JPEG: place in the stream of bytes; else 0 and the image's bytes */
    uint64_t xxh3;            /* XXH3-64 of the pixels as stored */
    uint32_t why;             /* enum cap_take_why */
    uint32_t pad;
    uint64_t check; /* XXH3-64 of the row up to here */
};
struct cap_take_set {
    uint64_t number;
    int64_t t_exposure_ns, spread_ns, t_last_mono_ns;
    uint64_t mask; /* bit per camera of the take */
    uint32_t n, pad;
    uint64_t check; /* XXH3-64 of the row up to here, then of its members */
};
/* Frames of one camera, one after the other, that could not be recorded. */
struct cap_take_gap {
    uint32_t camera, why;
    uint64_t frames, id_first, id_last;
    int64_t set_first, set_last; /* -1 = in none */
    int64_t t_first_ns, t_last_ns;
};

/* One camera of a take.  To the writer: name, uri, settings; the rest by frames and cap_take_about. */
struct cap_take_camera {
    const char *name, *uri;
    const char *serial;   /* "" = not known (cap_health) */
    double temperature_c; /* NAN = not known */
    const char *settings; /* text, a "name: value" on each line */
    enum cap_pixfmt fmt;  /* CAP_FMT_NONE: it has sent no frame */
    int32_t width, height;
    uint8_t yuv; /* enum cap_yuv */
    uint64_t frames;
};
struct cap_take_head {
    const char *rig, *config; /* YAML */
    const char *software;     /* "pyrovoxd 0.1.0" */
    const char *host;
    const char *base; /* folder that relative names in the configuration start at */
    uint64_t session; /* of the daemon, as in its volumes */
    int64_t t_created_ns;
    int64_t t_began_ns; /* t_created_ns of the first file; 0 = this is it, or not known */
    double fps;         /* nominal */
    uint32_t n_cameras;
    const struct cap_take_camera *camera; /* [n_cameras] */
};

/* ---- writing ---- */

typedef struct cap_take_writer cap_take_writer;
/* A new file; its folders are made.  Errors: PVX_EBUSY (it exists), PVX_EPERM, PVX_ENOSPC, PVX_EIO. */
PVX_MUST_CHECK pvx_err cap_take_create(const char *path, const struct cap_take_head *head,
                                       cap_take_writer **out, struct pvx_diag *d);
/* All frames of a set, then its row.  Frames that do not fit their camera are left out (a gap UNFIT),
 * the set is then recorded without them. */
PVX_MUST_CHECK pvx_err cap_take_put_set(cap_take_writer *w, const struct cap_set *s,
                                        struct pvx_diag *d);
PVX_MUST_CHECK pvx_err cap_take_put_stray(cap_take_writer *w, const struct cap_frame *f,
                                          enum cap_take_why why, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err cap_take_put_gap(cap_take_writer *w, const struct cap_take_gap *g,
                                        struct pvx_diag *d);
/* What camera c says of itself by now; kept until the file is closed, and written with its first frame and then.
 * "" and NAN leave what is known. */
void cap_take_about(cap_take_writer *w, uint32_t camera, const char *serial, double temperature_c);
/* What was put is in the file from now on, whatever becomes of this process. */
PVX_MUST_CHECK pvx_err cap_take_commit(cap_take_writer *w, struct pvx_diag *d);
/* The recording goes on in another file, says this one from its close on. */
void cap_take_goes_on(cap_take_writer *w);
/* Closes; the take is whole if this says PVX_OK.  The writer is gone in each case. */
pvx_err cap_take_close(cap_take_writer **w, struct pvx_diag *d);
uint64_t cap_take_bytes(const cap_take_writer *w); /* of pixels, so far */

/* ---- reading ---- */

typedef struct cap_take cap_take;
/* Reads everything but the pixels: of NAME.h5, and of the files beside it (where it is a link: beside what it leads to) in
 * which that recording went on.  What is missing, damaged or not of it (another session, rig or cameras, sets that do not go
 * on) is left out and noted, also NAME.h5 itself where it is damaged and others can be read; what follows is read.
 * NAME-0002.h5 is that file alone.  A camera of which one file has pictures of another size or format than those before it
 * is left out of the sets there.
 * Errors: PVX_ENOENT, PVX_EFORMAT (not a take, or damaged so that nothing can be had), PVX_EVERSION, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err cap_take_open(const char *path, cap_take **out, struct pvx_diag *d);
void cap_take_free(cap_take **t);

struct cap_take_info {
    struct cap_take_head head; /* strings belong to the take */
    uint64_t sets, gaps;
    bool closed; /* the last file ended in order; else it was cut off, or is being recorded */
    /* Rows of sets that are there, but not all they refer to; and numbers between two files where one is missing. */
    uint64_t sets_lost;
    uint64_t pieces; /* files */
    uint64_t notes;  /* what is not as it was recorded, for people: a line each */
};
struct cap_take_piece {
    const char *path;
    uint64_t first, sets; /* of the take's */
    bool closed;
};
struct cap_take_piece cap_take_piece(const cap_take *t, uint64_t k);
const char *cap_take_note(const cap_take *t, uint64_t k);
const struct cap_take_info *cap_take_info(const cap_take *t);
int cap_take_find(const cap_take *t, const char *camera); /* -1 = none of this name */
/* Set k < sets; member[n_cameras] = row in the camera's list, -1 = missing. */
const struct cap_take_set *cap_take_set(const cap_take *t, uint64_t k, const int64_t **member);
/* The k of the set with this number; -1 = there is none, or it is lost. */
int64_t cap_take_find_set(const cap_take *t, int64_t number);
const struct cap_take_row *cap_take_row(const cap_take *t, uint32_t camera, uint64_t row);
const struct cap_take_gap *cap_take_gap(const cap_take *t, uint64_t k);
/* Bytes of the largest frame of a camera: the room that cap_take_read needs. */
size_t cap_take_frame_max(const cap_take *t, uint32_t camera);
/* From now on frames of the sets [first, end) are asked for only: what others need is let go, file by file. */
void cap_take_only(cap_take *t, uint64_t first, uint64_t end);
/* Pixels of a frame into mem, and the image that they are.  PVX_ECORRUPT: not what was recorded (cut
 * off, or damaged). */
PVX_MUST_CHECK pvx_err cap_take_read(const cap_take *t, uint32_t camera, uint64_t row, void *mem,
                                     size_t size, struct cap_image *img, struct pvx_diag *d);
#endif
