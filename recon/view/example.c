/* A flame from its pictures: rendered in four cameras, and reconstructed.  A program with its own pictures does the
 * same from rec_frame_alone on.
 *
 *     cc example.c $(pkg-config --cflags --libs pyrovox-recon) -lm -o example && ./example */
#include <math.h>
#include <recon/frame/frame.h>
#include <recon/view/render.h>
#include <stdio.h>

int main(void)
{
    static float flame[24 * 24 * 24]; /* emission per metre, of a ball of gas */
    struct pvx_diag why = {""};
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_sysmat_params bins = {1, 0}; /* a pixel is a bin */
    struct rec_rig rig;
    rec_sysmat *S = NULL;
    rec_frame *frame = NULL;
    struct rec_sparse made;
    double miss = 0;
    p.nch = 1;
    for (int i = 0; i < 24 * 24 * 24; i++)
        flame[i] = expf(-hypotf(hypotf(i % 24 - 11.5F, i / 24 % 24 - 11.5F), i / 576 - 11.5F) / 4);
    pvx_err e =
        rec_rig_ring(4, 2.4, 48, 36, 24, &rig); /* or rec_rig_load("rig.yaml", &rig, &why) */
    PVX_THEN(e, rec_sysmat_build(&rig, &bins, NULL, NULL, NULL, &S, &why));
    PVX_THEN(e, rec_frame_alone(S, &rig, &p, NULL, &frame, &why));
    for (size_t c = 0; c < rig.n_cameras && e == PVX_OK; c++) {
        e = rec_render(&rig.grid, flame, 1, &(struct rec_eye){.camera = &rig.cameras[c], .sub = 2},
                       NULL, rec_frame_input(frame, c));
        rec_frame_camera(frame, c)->present = true;
    }
    if (e == PVX_OK) {
        rec_frame_carve(frame);
        e = rec_frame_solve(frame, 0, NULL);
    }
    if (e != PVX_OK)
        return fprintf(stderr, "%s\n", pvx_diag_text(&why, e)), 1;
    rec_frame_volume(frame, &made);
    for (int i = 0; i < made.n; i++)
        miss += fabsf(made.value[i] - flame[made.index[i]]) / made.n;
    printf("%d voxels, mean error %.3f\n", made.n, miss);
    rec_frame_free(&frame);
    rec_sysmat_free(&S);
    rec_rig_fini(&rig);
    return 0;
}
