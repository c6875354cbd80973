/* wire.h - a rig and a frame set as messages of the wire (proto/pvp.h), for publishing and for recording without
 * publishing.  Threads: pure. */
#ifndef DMN_WIRE_H
#define DMN_WIRE_H
#include "daemon/pipeline/pipeline.h"
#include "proto/pvp.h"

/* Sets session to 0.  program: for example "pyrovoxd". */
void dmn_wire_start(const struct rec_rig *rig, int nch, double fps, const char *program,
                    struct pvp_start *out);
/* The solved set of a slot; session, latency and time of publishing are 0.  voxels: borrowed from the slot's frame. */
void dmn_wire_volume(const struct dmn_slot *s, const struct pvp_grid *grid, struct pvp_volume *out,
                     struct pvp_voxels *voxels);
/* The standard deviations of its voxels, and bits of enum pvp_doubt; false: it has no error bars. */
bool dmn_wire_bars(const struct dmn_slot *s, struct pvp_voxels *sd, uint32_t *doubt);
#endif
