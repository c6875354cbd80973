/* arg.h - options of the commands: one table with a row for each option, and reading the values of options.
 *
 * A row has the option's name, the place of its value, the limits of the value, and the text for --help.
 * A command gives its rows to cli_parse, which makes the options of argp from them.  Its argp parser gives all
 * options that are not its own to cli_row:
 *
 *     #define AT(field) CLI_AT(struct render_options, field)
 *     static const struct cli_row rows[] = {
 *         {"fps", "N", AT(fps), 1, 100, "pictures a second (default 15)"},
 *         {"q|quiet", NULL, AT(quiet), 0, 0, "no progress"}, // -q or --quiet
 *         {0}};
 *
 * The functions below read `text`, the value of option --name.  A wrong value ends the program as
 * argp_error does: the message says what the value should be, and the exit code is 2.  Limits are inclusive. */
#ifndef CLI_ARG_H
#define CLI_ARG_H
#include <argp.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "capture/pixel/image.h"

enum cli_type {
    CLI_OWN, /* the command reads it: `at` is the key that its parser sees */
    CLI_BOOL,
    CLI_TEXT, /* borrowed from argv */
    CLI_INT,
    CLI_UINT,
    CLI_INT64,
    CLI_FLOAT,
    CLI_DOUBLE,
    CLI_PIXFMT
};

struct cli_row {
    const char *name; /* NULL: `help` is the heading of the rows that follow */
    const char *arg;  /* the value as --help shows it; NULL: none.  "=X": it may be left out */
    size_t at;        /* place of the value in the command's struct */
    enum cli_type
        type; /* of that place.  CLI_BOOL becomes true, or whether the second word was given */
    double lo,
        hi; /* limits of a number.  Both 0: `arg` lists words, "a|b|c"; the value is the word's place */
    const char *help;
};
/* A field of the command's struct: its place and type. */
#define CLI_AT(T, field) \
    offsetof(T, field),          \
        _Generic(((T *)0)->field, bool \
                 : CLI_BOOL, const char * \
                 : CLI_TEXT, int32_t \
                 : CLI_INT, uint32_t \
                 : CLI_UINT, int64_t \
                 : CLI_INT64, float \
                 : CLI_FLOAT, double \
                 : CLI_DOUBLE)
#define CLI_KEY(key) (key), CLI_OWN

/* Whether all options are wanted: argv has --help-all, which becomes --help.  Otherwise --help lists only those of
 * `first`, separated by spaces, and --help-all.  To be called before the rows are used. */
bool cli_help_all(int argc, char **argv, const char *first);
/* Make the options of argp from the rows, in `room` for as many.  The table ends with an empty row.  The rows before
 * the first heading are group 0, those below headings are 2, 3 and so on.  Group 1 is for an argp child. */
const struct argp_option *cli_rows(const struct cli_row *rows, struct argp_option *room);
/* Store the value of option `key` in the struct `out`.  ARGP_ERR_UNKNOWN: no row has this key. */
error_t cli_row(const struct cli_row *rows, int key, const char *text, struct argp_state *st,
                void *out);
/* argp_parse with the options of the rows, at most 63, and all else of `like`, into the struct `out`. */
void cli_parse(const struct cli_row *rows, const struct argp *like, unsigned flags, int argc,
               char **argv, void *out);

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
/* Place of the word in `words`, "a|b|c". */
int cli_arg_word(struct argp_state *st, const char *name, const char *text, const char *words);
/* Take a command's only argument.  A second one is an error, whose message says `what` the argument is. */
void cli_arg_one(struct argp_state *st, const char *what, const char *text, const char **out);
/* --pixel-format NAME. */
enum cap_pixfmt cli_arg_pixfmt(struct argp_state *st, const char *text);

#endif
