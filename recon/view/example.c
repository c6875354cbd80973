/* A flame from its pictures: drawn in four cameras, and made again.  What a program does with pictures of its own is
 * the same from rec_carver_new on.
 *
 *     cc example.c $(pkg-config --cflags --libs pyrovox-recon) -lm -o example && ./example */
#include <math.h>
#include <recon/frame/frame.h>
#include <recon/view/render.h>
#include <stdio.h>

#define TRY(call)                                        \
    if ((e = (call)) != PVX_OK) {                        \
        fprintf(stderr, "%s\n", pvx_diag_text(&why, e)); \
        return 1;                                        \
    }
static float flame[24 * 24 * 24], made[24 * 24 * 24];

int main(void)
{
    struct pvx_diag why = {""};
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_sysmat_params bins = {1, 0}; /* a pixel is a bin */
    struct rec_rig rig;
    struct rec_sparse found;
    rec_sysmat *S;
    rec_carver *carver;
    rec_solver *solver;
    rec_frame *frame;
    double miss = 0, all = 0;
    pvx_err e;
    p.nch = 1;
    TRY(rec_rig_ring(4, 2.4, 48, 36, 24, &rig)) /* or rec_rig_load("rig.yaml", &rig, &why) */
    TRY(rec_sysmat_build(&rig, &bins, NULL, NULL, NULL, &S, &why))
    TRY(rec_carver_new(S, &rig, &p, NULL, &carver, &why))
    TRY(rec_solver_new(S, &p, &solver, &why))
    TRY(rec_frame_new(carver, solver, &frame, &why))
    for (int i = 0; i < 24 * 24 * 24; i++) { /* emission per metre, of a ball of gas */
        double x = i % 24 - 11.5, y = i / 24 % 24 - 11.5, z = i / 576 - 11.5;
        flame[i] = expf(-(float)(x * x + y * y + z * z) / 32);
    }
    for (size_t c = 0; c < rig.n_cameras; c++) {
        TRY(rec_render(&rig.grid, flame, 1, &rig.cameras[c], 2, NULL, rec_frame_input(frame, c)))
        rec_frame_present(frame, c, true);
    }
    rec_frame_carve(frame);
    TRY(rec_frame_solve(frame, 0, NULL))
    rec_frame_volume(frame, &found);
    rec_sparse_to_dense(&found, made);
    for (int i = 0; i < 24 * 24 * 24; i++) {
        miss += (made[i] - flame[i]) * (made[i] - flame[i]);
        all += flame[i] * flame[i];
    }
    printf("%d voxels, error %.3f\n", found.n, sqrt(miss / all));
    rec_frame_free(&frame);
    rec_solver_free(&solver);
    rec_carver_free(&carver);
    rec_sysmat_free(&S);
    rec_rig_fini(&rig);
    return 0;
}
