/* card.h - a frame set on a graphics card (recon/opencl), and the way back to the processors.
 *
 * With a card, carver, solver and systems have its objects, unless the parameters need the processors
 * (rec_frame_card_why_not).  Raw pixels are unpacked and judged on the card.  What comes of it is copied to the slot,
 * for the vote, for previews and reports, and for a card that fails later: the slot is as if all had been done here, to
 * the bit.  Other pixels are judged here, and go up.  The vote is here.
 * A set that the card cannot carve is carved here.  If the card fails in the solve, the set's columns are here already:
 * it is restricted and solved here.  Its volume is then to the bit that of the processors.
 * Threads: as frame.h.  Private to recon/frame. */
#ifndef REC_FRAME_CARD_H
#define REC_FRAME_CARD_H
#include "recon/frame/impl.h"

/* The matrix on the card, and the room for columns; the solver's vectors, for sets of this carver; a slot's systems.
 * Nothing without a card.  Errors: PVX_ENOMEM, PVX_ENODEV. */
PVX_MUST_CHECK pvx_err rec_card_carver(rec_carver *k, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err rec_card_solver(rec_solver *s, const rec_carver *k, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err rec_card_systems(rec_systems *y, const rec_carver *k, struct pvx_diag *d);
void rec_card_carver_fini(rec_carver *k);
void rec_card_solver_fini(rec_solver *s);
void rec_card_systems_fini(rec_systems *y);

/* Raw pixels that wait for the card are binned here.  Nothing to do: there are none. */
void rec_card_bin_here(rec_frame *f);
/* Photometry of raw pixels on the card, with the carver's rec_photo_images; fills b, weights, silhouettes and stats.
 * false: it has to be done here. */
bool rec_card_photo(rec_frame *f);

/* Carves and restricts on the card; then f->sub->card is set.  false: it has to be done here. */
bool rec_card_carve(rec_frame *f, const uint8_t *const *lit, struct rec_hull_kept *kept);

/* A solve on the card begins: the name of its x, which is the earlier volume, or anything with NULL.  NULL: it has to
 * be done here. */
float *rec_card_begin(rec_frame *f, const struct rec_solve_params *p,
                      const struct rec_sparse *previous);
/* Its end: the volume to f->x.  false: it has to be done here. */
bool rec_card_end(rec_frame *f, pvx_err e);
/* Restricts the carved columns here. */
void rec_card_leave(rec_frame *f);

#endif
