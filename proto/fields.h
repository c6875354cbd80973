/* fields.h - the fields of the messages in their order, and other parts that encoder and decoder share (private
 * to proto). */
#ifndef PVP_FIELDS_H
#define PVP_FIELDS_H
#include "proto/pvp.h"
#include "proto/wire.h"

/* Bytes of one sample. */
size_t pvp_sample_size(enum pvp_sample s);

/* The description of the bricks in a volume message. */
struct pvp_payload {
    uint32_t description; /* bytes before the brick ids */
    uint32_t sample, comp, side, n_bricks;
    uint32_t doubt; /* of bars; 0 in a volume */
    uint64_t raw_len, stored;
};
/* Each function writes or reads, depending on w.  The header: all fields after the first four bytes.  *body:
 * body_length. */
void pvp_header_fields(struct wire *w, struct pvp_header *h, uint64_t *body);
void pvp_grid_fields(struct wire *w, struct pvp_grid *g); /* sides, basis, channels */
void pvp_box_fields(struct wire *w, struct pvp_grid *g);  /* min, max */
void pvp_volume_fields(struct wire *w, struct pvp_volume *v, struct pvp_payload *p);
/* Returns PVX_EFORMAT, with the reason why the grid is not pvp_grid_valid. */
pvx_err pvp_grid_fail(const struct pvp_grid *g, struct pvx_diag *d);

/* A message of any type except start, volume and rig.  `what` is the argument of the type's encode function: the
 * text of status, event and end, the struct of a preview.  PVX_EUNSUP: another type. */
PVX_MUST_CHECK pvx_err pvp_encode(pvp_encoder *e, uint64_t sequence, enum pvp_type type,
                                  const void *what, const void **msg, size_t *len);
/* The result of the decode function of the type.  PVX_EUNSUP: a type that is not known here. */
PVX_MUST_CHECK pvx_err pvp_check(enum pvp_type type, const void *msg, size_t len);

/* The body of a volume or of bars.  *doubt: the field that only bars have. */
PVX_MUST_CHECK pvx_err pvp_decode_bricks(const void *msg, size_t len, enum pvp_type type,
                                         struct pvp_view *out, uint32_t *doubt, struct pvx_diag *d);

/* Header of a message that must be of `type`; *in = its body. */
PVX_MUST_CHECK pvx_err pvp_open_body(const void *msg, size_t len, enum pvp_type type,
                                     struct pvp_header *h, struct wire *in, struct pvx_diag *d);
#endif
