#include "recon/board/board.h"

#include <math.h>

uint32_t rec_board_corners(const struct rec_board *b)
{
    switch (b->kind) {
    case REC_CHARUCO: return (uint32_t)((b->cols - 1) * (b->rows - 1));
    case REC_CHESSBOARD: return (uint32_t)(b->cols * b->rows);
    default: return (uint32_t)(4 * b->cols * b->rows);
    }
}

void rec_board_point(const struct rec_board *b, enum rec_board_face face, uint32_t id,
                     double xyz[3])
{
    uint32_t across = (uint32_t)(b->kind == REC_CHARUCO      ? b->cols - 1
                                 : b->kind == REC_CHESSBOARD ? b->cols
                                                             : 2 * b->cols);
    uint32_t i[2] = {id % across, id / across};
    for (int a = 0; a < 2; a++)
        xyz[a] = b->kind == REC_APRILGRID
                     ? i[a] / 2 * (b->square + b->marker) + i[a] % 2 * b->square
                     : i[a] * b->square;
    xyz[2] = face == REC_BACK && !isnan(b->thickness) ? b->thickness : 0;
}
