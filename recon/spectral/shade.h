/* shade.h - what soot takes from its own light on the way to the cameras, by the soot that was found.
 *
 *     tau_q(x) = mean over cameras c of exp(-k_q D_c(x)),   D_c = integral of f from x to camera c     (1)
 *     e_q := e_q / tau_q,   solved again for T and f, until f no longer changes                        (2)
 * k_q kappa over f at the channel's mean wavelength (soot.h (2)), f volume fraction.  A volume that was reconstructed without
 * absorption is, near enough, the emission times the mean of what reaches the cameras.  Blue is absorbed more than red, so without
 * (2) hidden soot looks colder.
 * This is of first order: it takes each camera's share of a voxel as the same.  Measured up to k D of 0.6 (NUMERICS.md, 22).
 * D_c is a midpoint sum in steps of a voxel, f trilinear between centres and 0 outside.
 * Source: Beer and Lambert's law; the mean over views is our own.
 * Threads: pure.  Cost: voxels x cameras x voxels along the box, some 5 ns each. */
#ifndef REC_SHADE_H
#define REC_SHADE_H
#include "recon/geom/rig.h"
#include "recon/spectral/soot.h"

#define REC_SHADE_LEAST  0.05 /* of tau: less is not believed */
#define REC_SHADE_ROUNDS 4

/* k_q [1/m] of a spectral calibration: by the mean of c2 / l of soot at 1800 K. */
void rec_shade_kappa(const struct rec_spectral *s, const struct rec_soot_params *p, double k[3]);
/* Where the cameras are, for (1). */
struct rec_shade {
    struct rec_grid grid;
    size_t n;
    struct rec_shade_eye {
        double at[3];  /* centre, or direction towards it */
        bool from_far; /* a telecentric camera */
    } eye[REC_MAX_CAMERAS];
    double k[3];
};
void rec_shade_init(struct rec_shade *s, const struct rec_rig *rig, const struct rec_grid *grid,
                    const double k[3]);
/* (1) at the centre of voxel `index`; f [n2][n1][n0], what is not above 0 counts as 0. */
void rec_shade_at(const struct rec_shade *s, const float *f, int32_t index, double tau[3]);
#endif
