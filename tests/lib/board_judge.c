#include "tests/lib/board_judge.h"

#include <math.h>
#include <stdlib.h>

void board_judge(struct board_judged *j, const struct rec_board *b, rec_board_detector *det,
                 const struct board_shot *s, bool floats)
{
    size_t n = (size_t)s->width * (size_t)s->height;
    float *level = calloc(n, sizeof *level);
    uint8_t *bytes = calloc(n, 1);
    struct rec_board_sight sight;
    board_picture(b, s, level);
    for (size_t i = 0; i < n; i++)
        bytes[i] = (uint8_t)lrint(255 * fmin(1, fmax(0, level[i])));
    struct rec_board_picture p = {floats ? (const void *)level : bytes, s->width, s->height,
                                  s->width * (floats ? 4 : 1), floats};
    if (rec_board_detect(det, &p, &sight) != PVX_OK)
        abort();
    size_t at = 0;
    for (uint32_t id = 0; id < rec_board_corners(b); id++) {
        double xy[2];
        bool visible = board_truth(b, s, id, xy);
        while (at < sight.view.n && sight.view.corner[at].id < id)
            at++;
        bool found = at < sight.view.n && sight.view.corner[at].id == id;
        j->visible += visible;
        j->found += found && visible;
        if (!found)
            continue;
        const struct rec_board_corner *c = &sight.view.corner[at];
        double e[2] = {c->x - xy[0], c->y - xy[1]}, far = hypot(e[0], e[1]);
        if (sight.view.face != board_face(b, s) || !(far < 0.5)) {
            j->strays++;
            continue;
        }
        double det2 = c->cov[0] * c->cov[2] - c->cov[1] * c->cov[1];
        for (int a = 0; a < 2; a++) {
            j->bias[a] += e[a];
            j->sigma[a] += e[a] * e[a];
        }
        j->worst = fmax(j->worst, far);
        j->chi2 +=
            (e[0] * e[0] * c->cov[2] - 2 * e[0] * e[1] * c->cov[1] + e[1] * e[1] * c->cov[0]) /
            det2 / 2;
    }
    free(level);
    free(bytes);
}

void board_judged(struct board_judged *j)
{
    double n = fmax(1, (double)j->found);
    for (int a = 0; a < 2; a++) {
        j->bias[a] /= n;
        j->sigma[a] = sqrt(fmax(0, j->sigma[a] / n - j->bias[a] * j->bias[a]));
    }
    j->chi2 /= n;
}
