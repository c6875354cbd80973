/* host.h - what the host grants to the threads that receive: priority, and room for packets (private to
 * the aravis: files).  Each is a warning, not an error, when it is refused. */
#ifndef CAP_ARAVIS_HOST_H
#define CAP_ARAVIS_HOST_H
#include "capture/source/source.h"

void aravis_make_realtime(const struct cap_source_config *c); /* the calling thread */
void aravis_check_room(const struct cap_source_config *c, int asked);
#endif
