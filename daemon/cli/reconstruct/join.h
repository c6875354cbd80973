/* join.h - the parts of a recording, joined into OUT and told about. */
#ifndef RECONSTRUCT_JOIN_H
#define RECONSTRUCT_JOIN_H
#include <stdbool.h>
#include "base/err.h"

/* Joins what is done, and prints a table of the parts, what is missing, when those that run will have done it, and how far
 * volumes of two parts that lean on their neighbours differ at the seams.  Exit code: 0 nothing is missing, 1 something is, or
 * it failed (printed). */
int reconstruct_join(const char *out);
/* Parts of it were begun. */
bool reconstruct_join_has_job(const char *out);
/* All parts are done; looks at those after part i first: of an array's tasks they end last. */
bool reconstruct_join_is_due(const char *out, unsigned i);
#endif
