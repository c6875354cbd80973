/* wire.h - one rig and one frame set in the terms of the wire (proto/pvp.h), for what is published and for what is
 * recorded without having been.  Threads: pure. */
#ifndef DMN_WIRE_H
#define DMN_WIRE_H
#include "daemon/pipeline/pipeline.h"
#include "proto/pvp.h"

/* session 0; program: "pyrovoxd". */
void dmn_wire_start(const struct rec_rig *rig, int nch, double fps, const char *program,
                    struct pvp_start *out);
/* The solved set of a slot; session, latency and time of publishing are 0.  voxels: borrowed from the slot's frame. */
void dmn_wire_volume(const struct dmn_slot *s, const struct pvp_grid *grid, struct pvp_volume *out,
                     struct pvp_voxels *voxels);
#endif
