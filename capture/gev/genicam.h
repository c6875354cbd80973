/* genicam.h - checks that a camera's GenICam file can be evaluated (private to the aravis: files).
 *
 * The file describes features as nodes that refer to each other.  To read a node's value, Aravis 0.8.26 reads the
 * nodes that it refers to, by recursion without a limit.  A node that refers to itself, directly or through
 * others, would use up the stack and end the process.
 * Threads: any. */
#ifndef CAP_ARAVIS_GENICAM_H
#define CAP_ARAVIS_GENICAM_H
#include <stdbool.h>
#include <stddef.h>

#define ARAVIS_GENICAM_LEVELS 200 /* of references below a node; real files have some 20 */

/* True: no node's value needs more levels than that.  Else `node` gets the name of a node that does; "" = it has no
 * name.  A file that is not XML has no nodes. */
bool aravis_genicam_ends(const char *xml, size_t len, char *node, size_t size);
#endif
