/* relay.h - a message passed on to a client that cannot read all formats that the daemon may send.
 *
 * Only a volume's payload is packed anew, as LZ4, or uncompressed if LZ4 is not smaller.  Its samples keep the same
 * bits, and every other byte of the message is passed on, also those of a later minor version.
 * Threads: one at a time.  Cost: unpacking and packing one payload; nothing for a message that needs neither. */
#ifndef PVP_RELAY_H
#define PVP_RELAY_H
#include "proto/pvp.h"

typedef struct pvp_relay pvp_relay;
PVX_MUST_CHECK pvx_err pvp_relay_new(pvp_relay **out);
void pvp_relay_free(pvp_relay **r);
/* Passes on a volume, or bars, without Zstandard; `small`: an uncompressed one also becomes LZ4.  *out is `msg` itself, or
 * borrowed until the next call.  Errors: as pvp_decode_volume and pvp_volume_payload. */
PVX_MUST_CHECK pvx_err pvp_relay_volume(pvp_relay *r, const void *msg, size_t len, bool small,
                                        const void **out, size_t *out_len, struct pvx_diag *d);
#endif
