/* bench_board.c - corners of boards: found, bias, sigma, and what it costs, against pictures with known truth. */
#include <stdio.h>
#include <stdlib.h>

#include "recon/board/spec.h"
#include "tests/lib/board_judge.h"

int main(int argc, char **argv)
{
    static const char *const boards[] = {"charuco:8x11:0.03:0.022",
                                         "charuco:8x11:0.03:0.022:inverted:two-sided",
                                         "aprilgrid:6x6:0.03:0.009", "chessboard:9x6:0.025"};
    static const double tilts[] = {0, 30, 60}, sides[] = {12, 20, 30}, blurs[] = {0.5, 1, 2};
    int shots = argc > 1 ? atoi(argv[1]) : 4;
    const char *only = argc > 2 ? argv[2] : NULL;
    board_module_here();
    printf("%-44s %4s %4s %4s | %6s %6s | %13s | %13s | %5s %6s %s\n", "board", "side", "tilt",
           "blur", "found", "stray", "bias px", "sigma px", "worst", "chi2", "ms");
    for (size_t k = 0; k < 4; k++) {
        struct rec_board b;
        rec_board_detector *det;
        struct pvx_diag d = {""};
        if (rec_board_parse(boards[k], &b, &d) != PVX_OK ||
            rec_board_detector_new(&b, &det, &d) != PVX_OK) {
            printf("%s\n", d.text);
            return 77;
        }
        for (int c = 0; c < 27 && (only == NULL || atoi(only) == (int)k); c++) {
            if (argc > 3 && atoi(argv[3]) != c)
                continue;
            struct board_judged j = {0};
            double side = sides[c / 9], tilt = tilts[c / 3 % 3], blur = blurs[c % 3];
            for (int i = 0; i < shots; i++) {
                struct board_shot s = board_shot_of(&b, b.two_sided && i % 2 ? REC_BACK : REC_FRONT,
                                                    side, tilt, 37 + 50 * i, 11 * i);
                s.blur = blur;
                s.noise = 0.01;
                s.k[0] = -0.2;
                s.k[1] = 0.05;
                s.seed = (uint64_t)i + 1;
                board_judge(&j, &b, det, &s, i % 2);
            }
            board_judged(&j);
            printf("%-44s %4.0f %4.0f %4.1f | %6.3f %6zu | %6.3f %6.3f | %6.3f %6.3f | %5.2f %6.2f "
                   "%.1f ",
                   boards[k], side, tilt, blur, (double)j.found / (double)j.visible, j.strays,
                   j.bias[0], j.bias[1], j.sigma[0], j.sigma[1], j.worst, j.chi2, 1e3 * j.seconds);
            for (int o = 1; o < REC_N_SIGHTS; o++)
                if (j.outcome[o] > 0)
                    printf(" %s: %d", rec_sight_name(o), j.outcome[o]);
            printf("\n");
            fflush(stdout);
        }
        rec_board_detector_free(&det);
    }
    return 0;
}
