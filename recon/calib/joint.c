/* All cameras and boards together: a robust loss finds the wrong corners, which are left out, and the rest is
 * solved without it.  Lenses that the data do not determine stay at their prior. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/calib/priv.h"

#define APART 3.0  /* residuals together / alone: above it cameras contradict each other */
#define KNOWN 0.01 /* relative standard deviation of a focal length known from one camera */
#define HELD  0.5  /* a number is held when its sigma is more than this share of the prior's */

static bool used(const struct calib *k, const struct view *v)
{
    return v->fate == REC_VIEW_USED && k->placed[v->frame];
}

/* Standard deviation of the residuals of every camera: its value alone, times one factor for all cameras.  The
 * factor is the largest that any camera needs, by its median, which wrong corners do not move.  With a factor of
 * its own for each camera, when no camera fits (they are out of step), the one that happens to fit best would draw
 * the fit to itself more and more.  A camera that needs over four times the median factor gets its own. */
static void rescale(struct calib *k, double *room)
{
    double now[REC_MAX_CAMERAS], over[REC_MAX_CAMERAS];
    size_t cameras = 0;
    for (uint32_t c = 0; c < k->nc; c++) {
        size_t n = 0;
        for (size_t i = 0; i < k->nv; i++) {
            const struct view *v = &k->view[i];
            if (v->camera == c && used(k, v))
                for (size_t s = v->first; s < v->first + v->n; s++)
                    room[n++] = fmin(k->seen[s].far, 1e9);
        }
        now[c] = n > 0 ? k->scale[c] * fmax(pvx_median(room, n) / 1.17741, 1e-6) : k->scale[c];
        if (n > 0)
            over[cameras++] = now[c] / k->alone[c];
    }
    double least = 4 * pvx_median(over, cameras); /* sorts over */
    if (cameras > 0)
        least = fmin(least, over[cameras - 1]);
    for (uint32_t c = 0; c < k->nc; c++)
        now[c] = fmax(now[c], least * k->alone[c]);
    for (size_t i = 0; i < k->nv; i++) {
        const struct view *v = &k->view[i];
        for (size_t s = v->first; s < v->first + v->n; s++)
            k->seen[s].far *= k->scale[v->camera] / now[v->camera];
    }
    memcpy(k->scale, now, k->nc * sizeof *now);
}

/* Marks wrong corners and pictures by the present residuals.  Returns how many changed. */
static size_t joint_judge(struct calib *k, bool pictures)
{
    size_t changed = 0;
    for (size_t i = 0; i < k->nv; i++) {
        struct view *v = &k->view[i];
        size_t wrong = 0;
        if (!used(k, v))
            continue;
        for (size_t s = v->first; s < v->first + v->n; s++) {
            bool now = !(k->seen[s].far < OUTLIER);
            changed += now != k->seen[s].wrong;
            k->seen[s].wrong = now;
            wrong += now;
        }
        if (pictures && (wrong > WRONG_VIEW * (double)v->n || v->n - wrong < LEAST)) {
            v->fate = REC_VIEW_JOINT;
            changed += v->n;
        }
    }
    return changed;
}

/* Frames without a remaining view are no longer placed; a camera may lose its last view. */
static pvx_err still_there(struct calib *k)
{
    size_t n[REC_MAX_CAMERAS] = {0};
    for (size_t f = 0; f < k->nf; f++) {
        bool any = false;
        for (size_t i = k->of_frame[f]; i < k->of_frame[f + 1]; i++)
            if (used(k, &k->view[i])) {
                any = true;
                n[k->view[i].camera]++;
            }
        k->placed[f] = k->placed[f] && any;
    }
    for (uint32_t c = 0; c < k->nc; c++)
        if (n[c] == 0 && !k->pose_held[c]) {
            rec_calib_say(
                k, REC_CALIB_REFUSED, REC_CALIB_UNSEEN, (int)c, REC_NO_FRAME,
                "%s: no view agrees with what the other cameras saw of the same frames; are its "
                "frame numbers theirs?",
                k->in->camera[c].name);
            return pvx_fail(k->d, PVX_EINVAL, "%s", rec_calib_last_refused(k));
        }
    return PVX_OK;
}

/* chi^2 per degree of freedom, over the used corners. */
static void joint_weigh(struct calib *k)
{
    double sum = 0, n = 0, free = 0;
    for (size_t i = 0; i < k->nv; i++)
        for (size_t s = k->view[i].first; s < k->view[i].first + k->view[i].n; s++)
            if (used(k, &k->view[i]) && !k->seen[s].wrong) {
                sum += k->seen[s].far * k->seen[s].far;
                n += 2;
            }
    for (size_t f = 0; f < k->nf; f++)
        free += k->placed[f] ? 6 : 0;
    for (size_t c = 0; c < k->nc; c++) {
        free += k->pose_held[c] ? 0 : 6;
        for (int i = 0; i < REC_LENS; i++)
            free += (k->lens_held[c] >> i & 1) == 0;
    }
    k->chi2 = n > free ? sum / (n - free) : 1;
}

/* Fixes parameter `at`: cov becomes the covariance of the others, given it. */
static void joint_condition(double *cov, size_t N, size_t at)
{
    double over = cov[at * N + at] > 0 ? 1 / cov[at * N + at] : 0;
    for (size_t i = 0; i < N; i++)
        for (size_t j = 0; j < N; j++)
            if (i != at && j != at)
                cov[i * N + j] -= cov[i * N + at] * cov[at * N + j] * over;
    for (size_t i = 0; i < N; i++)
        cov[i * N + at] = cov[at * N + i] = 0;
}

/* Numbers of the lens that the data leave nearly as uncertain as the prior return to the prior.  The last term of
 * the radial series comes first, since the others are better determined without it. */
static bool joint_hold(struct calib *k, double *cov)
{
    static const int order[REC_LENS] = {REC_K3, REC_K2, REC_K1, REC_P1, REC_P2,
                                        REC_CX, REC_CY, REC_FX, REC_FY};
    size_t N = k->nc * (REC_LENS + 6);
    bool any = false;
    for (size_t c = 0; c < k->nc; c++) {
        double believed[REC_LENS];
        struct rec_calib_of_camera *o = &k->out->camera[c];
        rec_calib_beliefs(k, c, believed);
        for (int j = 0; j < REC_LENS; j++) {
            int i = order[j];
            size_t at = c * (REC_LENS + 6) + (size_t)i;
            o->sigma[i] = sqrt(fmax(0, cov[at * N + at]));
            bool with = i == REC_FY && (o->held >> REC_FX & 1) != 0; /* pixels are square */
            if ((k->in->camera[c].hold & REC_HOLD_LENS) != 0 || k->own_lens[c] ||
                !(o->sigma[i] > HELD * believed[i] || with))
                continue;
            o->held |= 1u << i;
            k->lens_held[c] |= 1u << i;
            k->lens[c][i] = k->believed[c][i];
            joint_condition(cov, N, at);
            any = true;
        }
        for (int i = 0; i < REC_LENS; i++) { /* now that others are held */
            size_t at = c * (REC_LENS + 6) + (size_t)i;
            if ((o->held >> i & 1) == 0)
                o->sigma[i] = sqrt(fmax(0, cov[at * N + at]));
        }
    }
    return any;
}

/* (1) takes the errors of a view's corners to be independent.  If they are not (cameras out of step, a lens of
 * another model), a view tells less than its number of corners suggests.  Then the camera's scale grows by the
 * excess in shift, growth and turn of whole views. */
static void joint_correlate(struct calib *k)
{
    for (uint32_t c = 0; c < k->nc; c++) {
        double sum = 0, n = 0;
        for (size_t i = 0; i < k->nv; i++) {
            const struct view *v = &k->view[i];
            if (v->camera != c || !used(k, v))
                continue;
            struct drift d = rec_calib_drift(k, v, false);
            double noise =
                0.5 * rec_calib_rms(k, v) * rec_calib_rms(k, v) / d.corners; /* of one mean */
            for (int j = 0; j < 4; j++)
                sum += fmin(d.m[j] * d.m[j] / noise, d.corners);
            n += 4;
        }
        if (n > 0 && sum > n)
            k->scale[c] *= sqrt(sum / n);
    }
}

/* Residuals together / alone, median over cameras. */
static double joint_apart(const struct calib *k)
{
    double over[REC_MAX_CAMERAS];
    for (size_t c = 0; c < k->nc; c++)
        over[c] = k->scale[c] / k->alone[c];
    return pvx_median(over, k->nc);
}

/* Pictures of different instants: a joint fit would distort the lenses to hide it.  So lenses that a camera
 * determines by itself keep those values. */
static void own_lenses(struct calib *k, const double *focal, const double (*lens)[REC_LENS])
{
    size_t n = 0;
    for (size_t c = 0; c < k->nc; c++) {
        if (!(focal[c] < KNOWN))
            continue;
        memcpy(k->lens[c], lens[c], sizeof k->lens[c]);
        k->lens_held[c] = (1u << REC_LENS) - 1;
        k->own_lens[c] = true;
        n++;
    }
    if (n > 0)
        rec_calib_say(
            k, REC_CALIB_NOTE, REC_CALIB_HELD, -1, REC_NO_FRAME,
            "together the cameras fit %.0f times worse than alone: the lenses of %zu stay as "
            "each found its own, and count as exact in what is expected of the volume",
            joint_apart(k), n);
}

/* The errors cannot be estimated: return the reason if the residuals show one, else e. */
static pvx_err rather(struct calib *k, pvx_err e)
{
    PVX_TRY(rec_calib_suspect(k));
    if (!rec_calib_says(k->out, REC_CALIB_REFUSED, -1))
        return e;
    if (k->d != NULL) /* the first text stays */
        k->d->text[0] = '\0';
    return pvx_fail(k->d, PVX_EINVAL, "%s", rec_calib_last_refused(k));
}

pvx_err rec_calib_together(struct calib *k, double *cov)
{
    double lens[REC_MAX_CAMERAS][REC_LENS], focal[REC_MAX_CAMERAS] = {0};
    double *room = pvx_calloc(k->ns, sizeof *room);
    struct adjust a = {.robust = true, .max_iterations = 50};
    pvx_err e = room != NULL ? PVX_OK : PVX_ENOMEM;
    size_t changed = 1;
    memcpy(k->alone, k->scale, sizeof k->alone);
    memcpy(lens, k->lens, k->nc * sizeof *lens);
    for (uint32_t c = 0; c < k->nc; c++)
        focal[c] = rec_calib_own_focal(k, c);
    rec_calib_measure_all(k);
    for (size_t i = 0; i < k->ns; i++) /* behind a camera at the start: no step can mend that */
        k->seen[i].wrong |= isinf(k->seen[i].far);
    if (room != NULL)
        rescale(k, room); /* the start is coarse: at first every corner counts as near */
    for (int round = 0; round < 6 && e == PVX_OK && changed > 0; round++) {
        a.robust = round < 2;
        e = rec_calib_adjust(k, &a);
        rec_calib_measure_all(k);
        rescale(k, room);
        if (round == 0 && joint_apart(k) > APART)
            own_lenses(k, focal, (const double(*)[REC_LENS])lens);
        changed = joint_judge(k, round > 0);
        if (e == PVX_OK)
            e = still_there(k);
        if (round == 0)
            changed++; /* pictures are judged from the second round on */
    }
    free(room);
    a.robust = false;
    if (e == PVX_OK)
        e = rec_calib_adjust(k, &a);
    double kept[REC_MAX_CAMERAS];
    memcpy(kept, k->scale, sizeof kept);
    rec_calib_measure_all(k);
    joint_weigh(k);
    joint_correlate(k);
    if (e == PVX_OK)
        e = rec_calib_covariance(k, cov);
    if (e != PVX_OK && e != PVX_ENOMEM)
        e = rather(k, e);
    memcpy(k->scale, kept, sizeof kept);
    if (e == PVX_OK && joint_hold(k, cov)) {
        e = rec_calib_adjust(k, &a);
        rec_calib_measure_all(k);
        joint_weigh(k);
    }
    size_t N = k->nc * (REC_LENS + 6);
    for (size_t i = 0; i < N * N; i++)
        cov[i] *= k->chi2;
    for (size_t c = 0; c < k->nc; c++)
        for (int i = 0; i < REC_LENS; i++)
            k->out->camera[c].sigma[i] *= sqrt(k->chi2);
    return e;
}
