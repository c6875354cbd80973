/* reel.h - the recorded frames of one camera, whatever holds them: numbered pictures, TIFF files of several pages, or a
 * film.
 *
 *   what cap_sequence_find takes: a folder, a pattern, a glob or one image
 *   a TIFF file of several pages: every page is a frame; of a folder of them, the pages of all, one file after
 *                        another.  A file without a number comes first, and the others' names must begin as its own
 *                        (REC.tif, REC@0001.tif).  No number may be missing
 *   a film, or a folder with one film in it; a .cine, or a .mraw with its header, is one, too (raw.h)
 * Ownership: the struct is the caller's.  Threads: one at a time per reel. */
#ifndef CAP_REEL_H
#define CAP_REEL_H
#include "capture/files/imgio.h"
#include "capture/files/raw.h"

/* Frames of the last two have times: a film's own, and those from the trigger on of a high-speed camera. */
enum cap_reel_kind { CAP_REEL_PICTURES, CAP_REEL_PAGES, CAP_REEL_FILM, CAP_REEL_RAW };

struct cap_reel {
    enum cap_reel_kind kind;
    size_t n; /* frames; 0: no reel */
    struct cap_reel_frame {
        int64_t
            at; /* number of the picture; of a page, from 0; where frames have times, the time, ns */
        uint32_t file, page; /* the page counts from 0 in its file */
    } * frame;               /* [n] ascending, no two of one number or time */
    int64_t begin;           /* with pages: number of the first file; -1: not known */
    size_t files;
    char **path; /* [files] */
    size_t
        other; /* the first JPEG picture where frame 0 is of another type, or the other way; 0: none */
    char *said;       /* what is left out of it, or odd: as in said.h; NULL: nothing */
    cap_video *video; /* open at: */
    size_t next;
    struct cap_image held; /* a film's frame that was read too early; data NULL: none */
    struct cap_raw raw;    /* of a high-speed camera */
};

#define CAP_REEL_NAME 4400

/* Owner: caller, cap_reel_close, after an error too.  Errors: as cap_sequence_find; PVX_EINVAL: several films, a film
 * beside pictures, pages whose place is not known; those of reading. */
PVX_MUST_CHECK pvx_err cap_reel_open(const char *name, struct cap_reel *r, struct pvx_diag *d);
/* Find what a folder has for a camera: DIR/<camera>/, DIR/<camera>.(mp4|avi|mkv|mov|cine|mraw) or DIR/<camera>.(tif|tiff).
 * *path: owner: caller, free().  PVX_ENOENT: nothing.  PVX_EINVAL: two, and the error names both. */
PVX_MUST_CHECK pvx_err cap_reel_of(const char *dir, const char *camera, char **path,
                                   struct pvx_diag *d);
/* Load frame i.  The picture of a film, also of a high-speed camera, has no memory of its own (mem NULL): it is lent until the next call.  In a film
 * going back means reading it again from its begin. */
PVX_MUST_CHECK pvx_err cap_reel_load(struct cap_reel *r, size_t i, struct cap_loaded *out,
                                     struct pvx_diag *d);
/* Name of frame i for messages: its file, and the page or time in it. */
const char *cap_reel_name(const struct cap_reel *r, size_t i, char room[CAP_REEL_NAME]);
/* Its usual step from frame to frame, ns or numbers; gaps do not count.  0: of fewer than two frames. */
double cap_reel_step(const struct cap_reel *r);
void cap_reel_close(struct cap_reel *r);
/* Whether its frames have times. */
bool cap_reel_timed(const struct cap_reel *r);
#endif
