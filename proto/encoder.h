/* encoder.h - shared by the files that write messages (private to proto). */
#ifndef PVP_ENCODER_H
#define PVP_ENCODER_H
#include <zstd.h>

#include "proto/fields.h"

#define WIRE_TYPES 32 /* types 100 to 3200 have a count */

struct pvp_encoder {
    struct pvp_grid grid;
    enum pvp_sample sample;
    enum pvp_compress comp;
    uint32_t nb[3], bricks;
    uint64_t session;
    uint64_t sent[WIRE_TYPES]; /* messages so far by type: the type sequence */
    uint8_t *msg;              /* the message under construction */
    size_t msg_size;
    uint8_t *raw; /* payload before compression; without compression it is built in msg */
    size_t raw_size;
    uint64_t *marked; /* bit per brick: has an active voxel; all 0 between calls */
    uint32_t *slot;   /* place of a marked brick in the payload */
    void *lz4;
    ZSTD_CCtx *zstd;
};

/* The message of a volume or of bars; h: its type and sequence. */
PVX_MUST_CHECK pvx_err pvp_encode_bricks(struct pvp_encoder *e, struct pvp_header h,
                                         const struct pvp_volume *v, uint32_t doubt,
                                         const struct pvp_voxels *x, const void **msg, size_t *len);

/* Puts the header in front of h.body bytes that are already in place; counts the message. */
void pvp_finish(struct pvp_encoder *e, struct pvp_header h, const void **msg, size_t *len);
#endif
