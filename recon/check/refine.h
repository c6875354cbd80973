/* refine.h - the poses of a rig corrected by a flame.
 *
 *     repeat: d_c = displacements of camera c against the volume of the others      (shift.h, check.h)
 *             camera c += 0.7 of the pose that explains them, all cameras at once   (posefit.h)
 *             the similarity that no picture shows is removed                    (gauge.h)
 * on two thirds of the frame sets.  The last third, which was not used for the fit, judges: the residual of views
 * that were left out,
 *     E = ( mean_c || b_c - alpha p_c ||^2 / || b_c ||^2 )^(1/2)                                        (1)
 * A round that does not lower E is undone and ends the refinement.  A rig is accepted when E is at least
 * REC_REFINE_GAIN lower than at the start.
 * A camera that is far off (rec_check_run) takes part in no volume of the first round, which corrects it.  Cameras
 * that are dark, flooded, mirrored or late are refused, since a pose cannot mend them.
 * Where all cameras stand in a line, the direction from which each looks and its distance only change depths, which
 * such cameras hardly see.  Then these are held.
 * Sources: B. Wieneke, Exp. Fluids 45:549-556, 2008 (volume self-calibration, disparities added up over sets); C.
 * Bruecker, D. Hess, B. Watz, Optics 1:113-129, 2020 (reprojections of the reconstruction).  New here: the camera has
 * no part in the volume.
 * Threads: as rec_check. */
#ifndef REC_REFINE_H
#define REC_REFINE_H
#include "recon/check/judge.h"

#define REC_REFINE_ROUNDS 5
#define REC_REFINE_SETS   6
#define REC_REFINE_GAIN   0.01 /* share of E */

struct rec_refine_report {
    bool accepted;
    uint32_t rounds, best;               /* rounds done; number of the best round */
    size_t fitted, held_out;             /* sets */
    double error[REC_REFINE_ROUNDS + 1]; /* E; [0]: of the given rig */
    double moved[REC_REFINE_ROUNDS + 1]; /* raw pixels rms, of that round alone */
    double px[REC_MAX_CAMERAS], all_px; /* raw pixels: of each camera, of all, from first to best */
    unsigned held[REC_MAX_CAMERAS];     /* posefit.h */
    bool in_line;
};

/* rig in: the start; out: the best one if it is accepted, else unchanged.  Errors: those of rec_check_run;
 * PVX_EINVAL + diag: fewer than REC_REFINE_SETS sets, or a camera whose fault is not its pose. */
PVX_MUST_CHECK pvx_err rec_refine(struct rec_rig *rig, const struct rec_unseen_params *p,
                                  pvx_pool *pool, const struct rec_check_source *s,
                                  struct rec_refine_report *out, struct pvx_diag *d);
/* All lenses lie within a twentieth of the row's length of one line. */
bool rec_rig_in_line(const struct rec_rig *rig);

#endif
