/* board_judge.h - how well corners are found, against the truth of many pictures. */
#ifndef TESTS_BOARD_JUDGE_H
#define TESTS_BOARD_JUDGE_H
#include "recon/board/detect.h"
#include "tests/lib/board_picture.h"

struct board_judged {
    size_t visible, found, strays;   /* corners; strays: off by more than half a pixel */
    double bias[2], sigma[2], worst; /* px */
    double chi2;                     /* mean of e' C^-1 e / 2: 1 where the covariance is right */
};

/* Adds what the detector makes of this shot, as a picture of 8 bits or floats. */
void board_judge(struct board_judged *j, const struct rec_board *b, rec_board_detector *det,
                 const struct board_shot *s, bool floats);
/* Sums to means; once, at the end. */
void board_judged(struct board_judged *j);
#endif
