/* demo_view.h - run `pyrovox view` beside a demo: start it, read its address, and end it with the demo. */
#ifndef DEMO_VIEW_H
#define DEMO_VIEW_H
#include <sys/types.h>
#include "base/err.h"

struct demo_view {
    pid_t pid; /* 0: not running */
    char url[160];
};
/* bin: folder of the programs.  log: file for its messages.  Opens the page if there is a desktop.  Errors:
 * PVX_EIO (it did not start: the log says why), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err demo_view_start(struct demo_view *v, const char *bin, const char *endpoint,
                                       const char *log, struct pvx_diag *d);
void demo_view_stop(struct demo_view *v);
#endif
