/* join.h - join the parts of a recording into OUT, and print their progress. */
#ifndef RECONSTRUCT_JOIN_H
#define RECONSTRUCT_JOIN_H
#include <stdbool.h>
#include "base/err.h"

/* Joins the parts that are done.  Prints a table of the parts, the missing sets, the time that running parts still
 * need, and how far volumes of two parts differ where they meet (--start warm, --temporal).  Exit code: 0 nothing is
 * missing, 1 sets are missing or it failed (printed). */
int reconstruct_join(const char *out);
/* Whether parts of OUT were begun. */
bool reconstruct_join_has_job(const char *out);
/* Whether all parts are done.  Looks first at those after part i, which end last in a job array. */
bool reconstruct_join_is_due(const char *out, unsigned i);
#endif
