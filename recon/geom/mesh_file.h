/* mesh_file.h - the bytes of a mesh file, read once from start to end, and the triangles found in them.
 *
 * Every read goes through a function of this header; none goes past `end`.
 * Threads: a file belongs to one thread. */
#ifndef REC_MESH_FILE_H
#define REC_MESH_FILE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

struct rec_mesh_file {
    const char *start, *at, *end;
    bool counted; /* binary: messages give a byte instead of a line */
    double scale;
    double *corner; /* [n][3][3] in metres, of the first REC_MESH_MAX; owner: its opener */
    size_t n, room;
    struct pvx_diag *d;
};

struct rec_word { /* NULL: no more on the line */
    const char *at;
    size_t len;
};

/* The next word of the line; the next word of the file. */
struct rec_word rec_mesh_word(struct rec_mesh_file *f);
struct rec_word rec_mesh_word_below(struct rec_mesh_file *f);
bool rec_word_is(struct rec_word w, const char *text); /* case is ignored */

/* True if the whole word is a number, also nan and inf.  `single`: rounded to float, as in a binary file. */
bool rec_word_number(struct rec_word w, bool single, double *out);

/* Moves behind the end of the line; moves to the next word, on any line. */
void rec_mesh_skip_line(struct rec_mesh_file *f);
void rec_mesh_skip_space(struct rec_mesh_file *f);

/* The next n bytes.  NULL if fewer are left; `at` then stays. */
const uint8_t *rec_mesh_bytes(struct rec_mesh_file *f, size_t n);

/* A little- or big-endian number of up to four bytes. */
uint32_t rec_mesh_u32(const uint8_t *p, size_t bytes, bool big);
float rec_mesh_f32(const uint8_t *p, bool big);

/* Adds a triangle, in the file's unit.  Beyond REC_MESH_MAX triangles are only counted.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_mesh_put(struct rec_mesh_file *f, const double *a, const double *b,
                                    const double *c);

/* Fails with PVX_EFORMAT; the message gives the place in the file, `what` and the remedy. */
PVX_MUST_CHECK pvx_err rec_mesh_bad(const struct rec_mesh_file *f, const char *what);

/* Reads all triangles of a file.  PVX_EFORMAT, PVX_EINVAL, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_mesh_stl(struct rec_mesh_file *f);
PVX_MUST_CHECK pvx_err rec_mesh_ply(struct rec_mesh_file *f);
#endif
