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
/* Successive frames of one camera that could not be recorded. */
struct cap_take_gap {
    uint32_t camera, why;
    uint64_t frames, id_first, id_last;
    int64_t set_first, set_last; /* -1 = in none */
    int64_t t_first_ns, t_last_ns;
};

/* A take that triggers began (ring.h) also names these triggers, the first first. */
#define CAP_TAKE_TRIGGER_MAX 48
struct cap_take_trigger {
    char name[CAP_TAKE_TRIGGER_MAX];
    int64_t t_ns;               /* its instant, UTC */
    int64_t set;                /* the set that it is about; -1 = none */
    int64_t latency_ns;         /* from the instant to the order; -1 = not of a set */
    int64_t t_from_ns, t_to_ns; /* exposures that it asks for */
};
/* Frames of one camera that such a take should have and has not: those that capture never delivered too. */
#define CAP_TAKE_LOST_MAX 24
struct cap_take_lost {
    uint32_t camera, pad;
    char why[CAP_TAKE_LOST_MAX]; /* a name of cap_count_defs, or one of ring.h */
    uint64_t frames;
    uint64_t id_first, id_last;    /* 0 0 = not numbered */
    int64_t t_first_ns, t_last_ns; /* exposures of the frames around them */
};

/* One camera of a take.  The writer gets name, uri and settings here, the rest from frames and cap_take_about. */
struct cap_take_camera {
    const char *name, *uri;
    const char *serial;   /* "" = not known (cap_health) */
    double temperature_c; /* NAN = not known */
    const char *settings; /* text, one "name: value" per line */
    enum cap_pixfmt fmt;  /* CAP_FMT_NONE: it has sent no frame */
    int32_t width, height;
    uint8_t yuv; /* enum cap_yuv */
    uint64_t frames;
};
struct cap_take_head {
    const char *rig, *config; /* YAML */
    const char *software;     /* "pyrovoxd 0.1.0" */
    const char *host;
    const char *base; /* folder of relative names in the configuration */
    uint64_t session; /* of the daemon, as in its volumes */
    int64_t t_created_ns;
    int64_t t_began_ns; /* t_created_ns of the first file; 0 = this is it, or not known */
    double fps;         /* nominal */
    bool triggered;     /* it has the tables of triggers and of lost frames */
    uint32_t n_cameras;
    const struct cap_take_camera *camera; /* [n_cameras] */
};

/* ---- writing ---- */

typedef struct cap_take_writer cap_take_writer;
/* Makes a new file and its folders.  Errors: PVX_EBUSY (it exists), PVX_EPERM, PVX_ENOSPC, PVX_EIO. */
PVX_MUST_CHECK pvx_err cap_take_create(const char *path, const struct cap_take_head *head,
                                       cap_take_writer **out, struct pvx_diag *d);
/* Writes all frames of a set, then its row.  Frames that do not fit their camera are left out (a gap UNFIT), and
 * the set is recorded without them. */
PVX_MUST_CHECK pvx_err cap_take_put_set(cap_take_writer *w, const struct cap_set *s,
                                        struct pvx_diag *d);
PVX_MUST_CHECK pvx_err cap_take_put_stray(cap_take_writer *w, const struct cap_frame *f,
                                          enum cap_take_why why, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err cap_take_put_gap(cap_take_writer *w, const struct cap_take_gap *g,
                                        struct pvx_diag *d);
/* Only for a take whose head says `triggered`. */
PVX_MUST_CHECK pvx_err cap_take_put_trigger(cap_take_writer *w, const struct cap_take_trigger *t,
                                            struct pvx_diag *d);
PVX_MUST_CHECK pvx_err cap_take_put_lost(cap_take_writer *w, const struct cap_take_lost *l,
                                         struct pvx_diag *d);
/* What is now known of a camera.  It is written with the camera's first frame, and again when the file is closed.
 * "" and NAN keep the value that is known. */
void cap_take_about(cap_take_writer *w, uint32_t camera, const char *serial, double temperature_c);
/* From now on everything that was put is in the file, whatever happens to this process. */
PVX_MUST_CHECK pvx_err cap_take_commit(cap_take_writer *w, struct pvx_diag *d);
/* When this file is closed, mark in it that the recording goes on in another file. */
void cap_take_goes_on(cap_take_writer *w);
/* Closes the file.  PVX_OK: the take is whole.  The writer is freed in any case. */
pvx_err cap_take_close(cap_take_writer **w, struct pvx_diag *d);
uint64_t cap_take_bytes(const cap_take_writer *w); /* of pixels, so far */

/* ---- reading ---- */

typedef struct cap_take cap_take;
/* Reads everything except the pixels, from NAME.h5 and the files beside it in which that recording went on (of a
 * link: beside its target).  A file is left out and noted if it is missing, damaged or of another recording (another
 * session, rig or cameras, or sets that do not go on).  This holds for NAME.h5 too, if it is damaged and others can
 * be read.  The files after it are still read.  NAME-0002.h5 is read as that file alone.
 * If one file has pictures of a camera in another size or format than before, its sets are without that camera.
 * Errors: PVX_ENOENT, PVX_EFORMAT (not a take, or too damaged to read anything), PVX_EVERSION, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err cap_take_open(const char *path, cap_take **out, struct pvx_diag *d);
void cap_take_free(cap_take **t);

struct cap_take_info {
    struct cap_take_head head; /* strings belong to the take */
    uint64_t sets, gaps;
    uint64_t triggers, lost; /* rows, of the first file */
    bool closed; /* the last file ended in order; else it was cut off, or is being recorded */
    /* Sets with a row but without all that it refers to, and set numbers between two files if one is missing. */
    uint64_t sets_lost;
    uint64_t pieces; /* files */
    uint64_t notes;  /* lines of text about what is not as it was recorded */
};
struct cap_take_piece {
    const char *path;
    uint64_t first, sets; /* its first set and number of sets, in the take */
    bool closed;
};
struct cap_take_piece cap_take_piece(const cap_take *t, uint64_t k);
const char *cap_take_note(const cap_take *t, uint64_t k);
const struct cap_take_info *cap_take_info(const cap_take *t);
int cap_take_find(const cap_take *t, const char *camera); /* -1 = none of this name */
/* Set k < sets; member[n_cameras] = row in the camera's list, -1 = missing. */
const struct cap_take_set *cap_take_set(const cap_take *t, uint64_t k, const int64_t **member);
/* The index k of the set with this number; -1 = there is none, or it is lost. */
int64_t cap_take_find_set(const cap_take *t, int64_t number);
const struct cap_take_row *cap_take_row(const cap_take *t, uint32_t camera, uint64_t row);
const struct cap_take_gap *cap_take_gap(const cap_take *t, uint64_t k);
const struct cap_take_trigger *cap_take_trigger(const cap_take *t, uint64_t k);
const struct cap_take_lost *cap_take_lost(const cap_take *t, uint64_t k);
/* Bytes of the largest frame of a camera: the room that cap_take_read needs. */
size_t cap_take_frame_max(const cap_take *t, uint32_t camera);
/* From now on only frames of the sets [first, end) will be read.  Frees, file by file, what only other sets need. */
void cap_take_only(cap_take *t, uint64_t first, uint64_t end);
/* Reads the pixels of a frame into mem; *img describes them.  PVX_ECORRUPT: they are not what was recorded (cut off,
 * or damaged). */
PVX_MUST_CHECK pvx_err cap_take_read(const cap_take *t, uint32_t camera, uint64_t row, void *mem,
                                     size_t size, struct cap_image *img, struct pvx_diag *d);
#endif
