/* arg.h - values of options, for the parsers of argp.
 *
 * Each reads `text`, the value of option --name, or ends the program as argp_error does: with what
 * the value should be, and exit code 2.  Limits are inclusive. */
#ifndef CLI_ARG_H
#define CLI_ARG_H
#include <argp.h>
#include <stdint.h>
#include "capture/pixel/image.h"
#include "capture/pixel/transfer.h"

void cli_arg_int(struct argp_state *st, const char *name, const char *text, int64_t lo, int64_t hi,
                 int64_t *out);
int64_t cli_arg_whole(struct argp_state *st, const char *name, const char *text, int64_t lo,
                      int64_t hi);
double cli_arg_double(struct argp_state *st, const char *name, const char *text, double lo,
                      double hi);
/* "640x480": pixels across and down, lo to hi each. */
void cli_arg_size(struct argp_state *st, const char *name, const char *text, int32_t lo, int32_t hi,
                  int32_t *width, int32_t *height);
/* Number of the word; words end with NULL. */
int cli_arg_choice(struct argp_state *st, const char *name, const char *text,
                   const char *const *words);
/* A command's only argument; `what` it is is said when there is a second. */
void cli_arg_one(struct argp_state *st, const char *what, const char *text, const char **out);
/* --pixel-format NAME, --transfer auto|linear|srgb|bt709. */
enum cap_pixfmt cli_arg_pixfmt(struct argp_state *st, const char *text);
enum cap_transfer cli_arg_transfer(struct argp_state *st, const char *text);

#endif
