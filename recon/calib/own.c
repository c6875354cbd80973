/* What a camera's own views alone tell about its lens: their information, each view with a board pose of its own,
 * that pose eliminated (Schur complement).  Views of other cameras, and their times, have no influence. */
#include <math.h>
#include <string.h>

#include "recon/board/homography.h"
#include "recon/calib/model.h"
#include "recon/calib/priv.h"
#include "recon/geom/spd.h"

#define L REC_LENS

struct information {
    double lens[L][L], cross[L][6], pose[36];
};

/* A row of derivatives with respect to lens and pose. */
static void own_add(struct information *s, const double *row)
{
    for (int i = 0; i < L; i++) {
        for (int j = 0; j < L; j++)
            s->lens[i][j] += row[i] * row[j];
        for (int j = 0; j < 6; j++)
            s->cross[i][j] += row[i] * row[L + j];
    }
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++)
            s->pose[6 * i + j] += row[L + i] * row[L + j];
}

static void own_corner(const struct calib *k, const struct view *v, const struct seen *p,
                       struct information *s)
{
    double X[3], Z[3], uv[2], d[2][L + 6];
    rec_calib_point(k, v, p, X);
    const struct rec_model m = rec_calib_model(k, v->camera, k->lens[v->camera]);
    if (!rec_model_see(&m, v->pose[0], X, Z, uv, d[0], NULL))
        return;
    for (int i = 0; i < L + 6; i++) { /* whitened */
        d[1][i] = (p->W[1] * d[0][i] + p->W[2] * d[1][i]) / k->alone[v->camera];
        d[0][i] = p->W[0] * d[0][i] / k->alone[v->camera];
    }
    own_add(s, d[0]);
    own_add(s, d[1]);
}

double rec_calib_own_focal(const struct calib *k, uint32_t c)
{
    double A[L * L] = {0}, e[L] = {1}, believed[L];
    rec_calib_beliefs(k, c, believed);
    for (int i = 0; i < L; i++)
        A[L * i + i] = 1 / (believed[i] * believed[i]);
    for (size_t i = 0; i < k->nv; i++) {
        const struct view *v = &k->view[i];
        struct information s = {0};
        if (v->camera != c || v->fate != REC_VIEW_USED || v->n_poses == 0)
            continue;
        for (size_t j = v->first; j < v->first + v->n; j++)
            if (!k->seen[j].wrong)
                own_corner(k, v, &k->seen[j], &s);
        rec_calib_invert6(s.pose);
        for (int a = 0; a < L; a++)
            for (int b = 0; b < L; b++) {
                A[L * a + b] += s.lens[a][b];
                for (int p = 0; p < 36; p++)
                    A[L * a + b] -= s.cross[a][p / 6] * s.pose[p] * s.cross[b][p % 6];
            }
    }
    return rec_spd_solve(A, e, L) ? sqrt(fmax(0, e[0])) / k->lens[c][REC_FX] : INFINITY;
}
