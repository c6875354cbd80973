/* host.h - priority of the receiving threads, and socket buffers (private to the aravis: files).
 * A refusal by the host is a warning, not an error. */
#ifndef CAP_ARAVIS_HOST_H
#define CAP_ARAVIS_HOST_H
#include "capture/source/source.h"

void aravis_make_realtime(const struct cap_source_config *c); /* the calling thread */
void aravis_check_room(const struct cap_source_config *c, int asked);
#endif
