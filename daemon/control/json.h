/* json.h - writes JSON into a buffer of fixed size, so that the frame path can report itself
 * without allocating.
 *
 *   struct dmn_json j; dmn_json_init(&j, buf, sizeof buf);
 *   dmn_json_open(&j, NULL, '{'); dmn_json_int(&j, "sets", 3); dmn_json_close(&j, '}');
 * `key` is NULL inside arrays and at the top.  Numbers that are not finite become null.  If the text
 * does not fit, dmn_json_end says so, and the text is then not valid JSON.
 * dmn_json_print is for programs that print: it finds the size by itself. */
#ifndef DMN_JSON_H
#define DMN_JSON_H
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include "base/err.h"

struct dmn_json {
    char *text;
    size_t size, len;
    bool full, comma;
};
void dmn_json_init(struct dmn_json *j, char *text, size_t size);
void dmn_json_open(struct dmn_json *j, const char *key, char bracket); /* '{' or '[' */
void dmn_json_close(struct dmn_json *j, char bracket);                 /* '}' or ']' */
void dmn_json_int(struct dmn_json *j, const char *key, long long v);
void dmn_json_num(struct dmn_json *j, const char *key, double v);
/* With so many digits that the same double is read back. */
void dmn_json_exact(struct dmn_json *j, const char *key, double v);
void dmn_json_bool(struct dmn_json *j, const char *key, bool v);
/* Control characters, quotes and bytes that are not UTF-8 are escaped or replaced. */
void dmn_json_str(struct dmn_json *j, const char *key, const char *v);
/* Bytes of the UTF-8 sequence at s, which ends with a 0; 0 when it is none. */
size_t dmn_utf8(const char *s);
/* Length of the text; 0 when the buffer was too small. */
size_t dmn_json_end(struct dmn_json *j);

/* Print on f what fill puts, and a newline.  fill is called again with more room (to 64 MiB) until all of it
 * fits.  Errors: PVX_ENOMEM; PVX_ERANGE: more than 64 MiB; those of writing to f. */
PVX_MUST_CHECK pvx_err dmn_json_print(FILE *f, void (*fill)(struct dmn_json *j, const void *what),
                                      const void *what, struct pvx_diag *d);

#endif
