/* mesh_file.h - the bytes of a mesh file, read once from the first to the last, and the triangles found in them.
 *
 * Every read goes through a function of this header; none goes past `end`.
 * Threads: a file belongs to one. */
#ifndef REC_MESH_FILE_H
#define REC_MESH_FILE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

struct rec_mesh_file {
    const char *start, *at, *end;
    bool counted; /* `at` has no line: bytes are counted in messages */
    double scale;
    double *corner; /* [n][3][3] in metres, of the first REC_MESH_MAX; owner: who opened the file */
    size_t n, room;
    struct pvx_diag *d;
};

struct rec_word { /* NULL: no more on the line */
    const char *at;
    size_t len;
};

/* The next word of the line, or of the file. */
struct rec_word rec_mesh_word(struct rec_mesh_file *f);
struct rec_word rec_mesh_word_below(struct rec_mesh_file *f);
bool rec_word_is(struct rec_word w, const char *text); /* capitals or not */

/* A number is the whole word; `single`: rounded to float, as a binary file has it.  Also nan and inf. */
bool rec_word_number(struct rec_word w, bool single, double *out);

/* Behind the end of the line, whatever stands before it; to the next word, wherever it stands. */
void rec_mesh_skip_line(struct rec_mesh_file *f);
void rec_mesh_skip_space(struct rec_mesh_file *f);

/* The next n bytes; NULL, and nothing is taken, where fewer are left. */
const uint8_t *rec_mesh_bytes(struct rec_mesh_file *f, size_t n);

/* A little- or big-endian number of up to four bytes. */
uint32_t rec_mesh_u32(const uint8_t *p, size_t bytes, bool big);
float rec_mesh_f32(const uint8_t *p, bool big);

/* One more triangle, in the file's unit.  Beyond REC_MESH_MAX it is only counted.  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_mesh_put(struct rec_mesh_file *f, const double *a, const double *b,
                                    const double *c);

/* PVX_EFORMAT: where in the file, `what`, remedy. */
PVX_MUST_CHECK pvx_err rec_mesh_bad(const struct rec_mesh_file *f, const char *what);

/* All triangles of a file.  PVX_EFORMAT, PVX_EINVAL, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_mesh_stl(struct rec_mesh_file *f);
PVX_MUST_CHECK pvx_err rec_mesh_ply(struct rec_mesh_file *f);
#endif
