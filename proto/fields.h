/* fields.h - the fields of the messages in their order, and what else encoder and decoder both ask (private
 * to proto). */
#ifndef PVP_FIELDS_H
#define PVP_FIELDS_H
#include "proto/pvp.h"
#include "proto/wire.h"

/* Bytes of one sample. */
size_t pvp_sample_size(enum pvp_sample s);

/* What a volume message says of its bricks. */
struct pvp_payload {
    uint32_t description; /* bytes before the brick ids */
    uint32_t sample, comp, side, n_bricks;
    uint64_t raw_len, stored;
};
/* Written or read, as w does.  The header: all of it behind the first four bytes; *body as it stands there. */
void pvp_header_fields(struct wire *w, struct pvp_header *h, uint64_t *body);
void pvp_start_fields(struct wire *w,
                      struct pvp_start *s); /* but the session, which is the header's */
void pvp_volume_fields(struct wire *w, struct pvp_volume *v, struct pvp_payload *p);

/* Header of a message that must be of `type`; *in = its body. */
PVX_MUST_CHECK pvx_err pvp_open_body(const void *msg, size_t len, enum pvp_type type,
                                     struct pvp_header *h, struct wire *in, struct pvx_diag *d);
#endif
