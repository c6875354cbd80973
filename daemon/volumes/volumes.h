/* volumes.h - recordings of volumes: one writer and one reader for all formats.
 *
 * A volume here has the form that it has on the wire: bricks of PVP_BRICK^3 voxels (PROTOCOL.md), only those with
 * flame, ids ascending.  Inside a brick x is fastest and the channel innermost; voxels outside the grid are 0.
 * So no format needs a dense copy unless its file is dense.
 * Threads: a writer or a reader belongs to one thread at a time. */
#ifndef VOL_VOLUMES_H
#define VOL_VOLUMES_H
#include <string.h>

#include "proto/pvp.h"

enum vol_format { VOL_NPY, VOL_HDF5, VOL_VDB, VOL_NVDB, VOL_FORMATS };
extern const char *const vol_format_names[VOL_FORMATS]; /* "npy", "hdf5", "vdb", "nvdb" */
/* What is not emission: one channel, 0 where there is none.  A .vdb of temperatures has a density of 1 there. */
#define VOL_UNITS_KELVIN  "K"
#define VOL_UNITS_SOOT    "ppm"
#define VOL_UNITS_DENSITY "1"
static inline bool vol_is_emission(const char *units)
{
    return strcmp(units, VOL_UNITS_KELVIN) != 0 && strcmp(units, VOL_UNITS_SOOT) != 0 &&
           strcmp(units, VOL_UNITS_DENSITY) != 0;
}
/* Ends in .h5 or .hdf5. */
bool vol_hdf5_name(const char *path);

/* What a whole recording has in common.  Texts are borrowed. */
struct vol_head {
    struct pvp_start start;
    const char *rig;    /* rig.yaml as it was in effect, NULL = not known */
    const char *config; /* all keys of pyrovoxd.yaml, NULL = not known */
};

/* Error bars.  With modes d_k, the covariance of a channel's voxels is sum_k d_k d_k' + diag(t^2), where
 * t^2 = sd^2 - sum_k d_k^2 (0 if that is below 0).  All of 0: there are none.
 * A recording takes twice as many modes as its first set with any has, and 32 in any case. */
struct vol_bars {
    const float *sd;    /* [n_bricks][8^3][channels], one standard deviation; NULL: no bars */
    uint32_t n_modes;   /* 0: not known, so that sums over voxels have no bar */
    const float *modes; /* [n_modes][n_bricks][8^3][channels] */
    uint32_t doubt;     /* bits of enum pvp_doubt: why the bars may be too small */
    bool damaged;       /* there was more, which is damaged (vol_reader_spare) */
};
#define VOL_MODES_MAX 256u

struct vol_volume {
    struct pvp_volume v;
    enum pvp_sample sample; /* as on the wire */
    bool clamped;           /* PVP_FLAG_CLAMPED */
    uint32_t n_bricks;
    const uint32_t *ids; /* [n_bricks] */
    const float *brick;  /* [n_bricks][8^3][channels] */
    struct vol_bars bars;
    const float *
        kelvin; /* [n_bricks][8^3] a grid `temperature` of a .vdb, 0: none there; NULL: no such grid */
};

/* Sets that are missing: between two volumes, or before a session's first. */
enum vol_gap_why {
    VOL_GAP_LOST,       /* messages lost on the way here, or never published */
    VOL_GAP_QUEUE,      /* the writer was slower than the volumes */
    VOL_GAP_UNREADABLE, /* arrived, but damaged */
    VOL_GAP_UNSOLVED,   /* not solved yet: of a recording that is made in parts (join.h) */
    VOL_GAPS
};
extern const char *const vol_gap_names[VOL_GAPS]; /* "lost", "queue", "unreadable", "unsolved" */
struct vol_gap {
    enum vol_gap_why why;
    uint64_t set_first, set_last; /* both missing */
    uint64_t volumes;             /* how many of them are known to be missing; 0 = not known */
};

struct vol_options {
    bool split;    /* vdb, nvdb: three grids red, green, blue instead of one of vectors */
    bool y_up;     /* vdb, nvdb: y points up */
    double unit_m; /* vdb, nvdb: metres in the file's unit of length; 0 = 1 */
    double fps;    /* vdb, nvdb: frames per second of the numbered files; 0 = one file per set */
    uint64_t keep_free_bytes; /* end before the disk has less */
};

typedef struct vol_writer vol_writer;
/* Checks that a recording could begin there, as vol_writer_open does, but before there is a head. */
PVX_MUST_CHECK pvx_err vol_writer_check(enum vol_format f, const char *path, struct pvx_diag *d);
/* `path`: a file (hdf5), a folder to make (npy, vdb, nvdb).  Nothing is overwritten.
 * Errors: PVX_EBUSY (is there already), PVX_ENOENT, PVX_EPERM, PVX_ENOSPC, PVX_EUNSUP (the module or package
 * is not installed: names it); the diag names the file. */
PVX_MUST_CHECK pvx_err vol_writer_open(enum vol_format f, const char *path,
                                       const struct vol_head *head, const struct vol_options *o,
                                       vol_writer **out, struct pvx_diag *d);
/* PVX_ERANGE: another grid than the head's.  After PVX_ENOSPC or PVX_EIO nothing more can be put; close keeps what
 * was written before. */
PVX_MUST_CHECK pvx_err vol_writer_put(vol_writer *w, const struct vol_volume *v,
                                      struct pvx_diag *d);
PVX_MUST_CHECK pvx_err vol_writer_gap(vol_writer *w, const struct vol_gap *g, struct pvx_diag *d);
/* Whether a value of v is beyond what the format holds: +-65504 in a .vdb.  It is written as that, and the volume is
 * marked as clamped. */
bool vol_beyond(enum vol_format f, const struct vol_volume *v);
#define VOL_CLAMPED_SAID                                                                           \
    "pyrovox: %llu volumes have values beyond 65504, the most that a .vdb holds, and are clamped " \
    "there; npy, hdf5 and nvdb keep them\n"
/* on: volumes come faster than they are written, so compress less rather than lose some. */
void vol_writer_hurry(vol_writer *w, bool on);
uint64_t vol_writer_bytes(const vol_writer *w); /* on disk, so far */
/* Finishes the file.  Frees *w, whatever is returned. */
pvx_err vol_writer_close(vol_writer **w, struct pvx_diag *d);

typedef struct vol_reader vol_reader;
/* The format follows from the file or folder.  A recording that is cut off or still being written is read as far
 * as it is whole; then vol_reader_cut is true.
 * Errors: PVX_ENOENT, PVX_EFORMAT, PVX_EVERSION (of a later version), PVX_ECORRUPT, PVX_EUNSUP. */
PVX_MUST_CHECK pvx_err vol_reader_open(const char *path, vol_reader **out, struct pvx_diag *d);
/* The amounts of soot [ppm] of a recording of temperatures (thermal.h), which vol_reader_open gives as kelvin.
 * PVX_EFORMAT: it is none; PVX_EINVAL: it does not know them. */
PVX_MUST_CHECK pvx_err vol_reader_open_soot(const char *path, vol_reader **out, struct pvx_diag *d);
/* PVX_EINVAL: its volumes are not emission (vol_head.start.units). */
PVX_MUST_CHECK pvx_err vol_reader_emission(const vol_reader *r, const char *path,
                                           struct pvx_diag *d);
enum vol_format vol_reader_format(const vol_reader *r);
const struct vol_head *vol_reader_head(const vol_reader *r);
uint64_t vol_reader_count(const vol_reader *r);
bool vol_reader_cut(const vol_reader *r);
/* Whether volumes come with the modes of their bars, which take n_modes times the memory of the volume.  At first they do
 * not: then n_modes is 0. */
void vol_reader_modes(vol_reader *r, bool on);
/* From now on volumes whose bars alone are damaged come without them, or without their modes, and bars.damaged says so;
 * the count is taken anew.  At first such a volume is damaged as a whole.  Not of .vdb and .nvdb. */
void vol_reader_spare(vol_reader *r);
/* Volume k in the order of the recording; borrowed until the next call.  PVX_ECORRUPT: damaged, or not finite. */
PVX_MUST_CHECK pvx_err vol_reader_get(vol_reader *r, uint64_t k, struct vol_volume *out,
                                      struct pvx_diag *d);
/* Gaps, in order; NULL at the end. */
const struct vol_gap *vol_reader_gap(const vol_reader *r, uint64_t k);
/* Number of sets still to come: of a recording in parts, those that no part has (join.h). */
uint64_t vol_reader_unsolved(const vol_reader *r);
void vol_reader_close(vol_reader **r);

/* Whether a volume that cannot be read is damaged, so that `repair` leaves it out.  PVX_ENOENT: a .npy without its
 * .json. */
static inline bool vol_damaged(pvx_err e)
{
    return e == PVX_ECORRUPT || e == PVX_EFORMAT || e == PVX_ENOENT;
}
/* Finishes a folder (npy, vdb, nvdb) that was cut off, in place: damaged files are renamed to FILE.cut-off, and the
 * list of the others is made anew and closed.  Where only the error bars of a .npy are damaged, only they are renamed. */
struct vol_repaired {
    uint64_t good, bad; /* files */
    uint64_t bare;      /* of the good ones, those that lost their bars now, or some of them */
    bool done;          /* there was something to do */
};
PVX_MUST_CHECK pvx_err vol_repair_folder(const char *dir, struct vol_repaired *out,
                                         struct pvx_diag *d);

/* --- what a format gives to the dispatcher (writer.c, reader.c) --- */
struct vol_writer_ops {
    pvx_err (*check)(const char *path, struct pvx_diag *d);
    pvx_err (*open)(void **self, const char *path, const struct vol_head *head,
                    const struct vol_options *o, struct pvx_diag *d);
    pvx_err (*put)(void *self, const struct vol_volume *v, struct pvx_diag *d);
    pvx_err (*gap)(void *self, const struct vol_gap *g, struct pvx_diag *d);
    void (*hurry)(void *self, bool on); /* may be NULL */
    uint64_t (*bytes)(const void *self);
    pvx_err (*close)(void *self, struct pvx_diag *d); /* frees self */
};
struct vol_reader_ops {
    bool (*is)(const char *path); /* cheap: by name and first bytes */
    pvx_err (*open)(void **self, const char *path, struct vol_head *head, uint64_t *count,
                    bool *cut, struct pvx_diag *d);
    pvx_err (*get)(void *self, uint64_t k, struct vol_volume *out, struct pvx_diag *d);
    const struct vol_gap *(*gap)(const void *self, uint64_t k);
    void (*modes)(void *self, bool on);                    /* may be NULL: the format has none */
    void (*spare)(void *self, uint64_t *count, bool *cut); /* may be NULL */
    void (*close)(void *self);
};
struct cJSON;
/* Add a gap to the list in recording.json, with all digits of its numbers. */
void vol_npy_put_gap(struct cJSON *list, const struct vol_gap *g);
extern const struct vol_writer_ops vol_npy_writer, vol_hdf5_writer, vol_vdb_writer, vol_nvdb_writer;
extern const struct vol_reader_ops vol_npy_reader, vol_hdf5_reader, vol_joined_reader,
    vol_kelvin_reader, vol_soot_reader, vol_vdb_reader, vol_nvdb_reader;
#endif
