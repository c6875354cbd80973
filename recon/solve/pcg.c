/* pcg.c - "pcg": non-negative regularised least squares by projected preconditioned CG.
 *
 *     f(x) = 1/2 ||W^(1/2) (A x - b)||^2 + lambda/2 ||V^(1/2) L x||^2  ->  min,  x >= 0     (1)
 *     g = A'W(A x - b) + lambda L V L x,   L: smooth.h                                      (2)
 *     V = 1 from a start without knowledge; from a coarser solution V is smaller where it is brighter
 *         than usual: V_q = (c + y_q / y_usual)^(-1/2),  y = sum of the lanes of x - L x / 8  (2a)
 * If an earlier volume predicts the frame (temporal.h), this term replaces the second of (1):
 *     lambda/2 (||V^(1/2) L (x - a xhat)||^2 + nu ||x - xhat||^2)                             (1b)
 * with lambda nu (x - xhat) in g, lambda nu in H and its diagonal.
 * One iteration:
 *     phi = g where x > 0 or g < 0, else 0          (the bound holds where it should)       (3)
 *     d   = -M phi + beta d,  beta = max(0, phi'M(phi - phi_old) / phi_old'M phi_old)       (4)
 *     x   = max(0, x + alpha d),  alpha = -phi'd / d'Hd                                     (5)
 *     M = S S,  S_q^2 = (y_q / y_usual + 0.09)^(1/4) / H_qq                                 (6)
 * H = A'WA + lambda L V L, y of (2a).  The flame's detail is where it is bright, so bright parts take the larger first
 * steps.  The power 1/4 was fitted, and M over cells of several voxels lost (NUMERICS.md, 4).
 * Without clipping in (5) this is plain CG.  With clipping the step is s = alpha (d + e), where e is not 0 only in the
 * clipped columns: A e is added to A d.  f is known after the step.  If it has risen, x goes back along s to the least
 * f there, which is feasible because the set is convex.  So f never rises.  When d is no descent direction, the lane
 * restarts from -M phi.
 * alpha, beta, lambda are per channel.
 * A sharp flame on a large grid goes on with the sum of its channels after some iterations (blend.h).
 * From a coarser solution V and the automatic lambda are renewed some times (renewal.h): r and L x stay.  Between
 * renewals the objective never rises.  The report lists the iterations after which the objective is another one.
 * A frozen objective (impl.h) is (1b) with V, lambda, nu and xhat that the caller gives.
 * Source: CG (Hestenes & Stiefel, J. Res. NBS 49:409, 1952) with Polak-Ribiere restarts inside Bertsekas' projection
 * of the free variables (SIAM J. Control Optim. 20(2):221, 1982); the arrangement is our own.
 * Cost per iteration: A and A' once, some 21 passes over a vector of voxels, one read or write each. */
#include <math.h>
#include <string.h>

#include "recon/solve/blend.h"
#include "recon/solve/bound.h"
#include "recon/solve/card.h"
#include "recon/solve/renewal.h"
#include "recon/solve/selfcal.h"
#include "recon/solve/stop.h"

#define DEFAULT_ITERATIONS 40
#define STILL              1e-7 /* relative change of the objective that counts as no change */
#define REFRESH            64   /* after so many iterations A x is computed anew */

/* ---- the method ---------------------------------------------------------------------------------*/

static void pcg_swap(float **a, float **b)
{
    float *t = *a;
    *a = *b;
    *b = t;
}

#define LANES sizeof(double[4])

/* Computes the second differences of t->x. */
static void smoothness(struct rec_pcg *t)
{
    double sums[3][4];
    rec_pcg_pass(t, REC_PASS_SMOOTHNESS, sums);
    memcpy(t->penalty, sums[0], LANES);
    memcpy(t->norm2, sums[1], LANES);
}
/* Computes the residual and second differences of t->x anew; rwr = r'Wr. */
static void refresh(struct rec_pcg *t, double rwr[4])
{
    rec_card_later(t->pb->a);
    rec_residual(t->pb, t->x, t->r, t->q, rwr);
    smoothness(t);
    rec_bound_raise(t->pb, t->r, t->q, rwr);
}

/* Value of (1) per lane. */
static void pcg_value(const struct rec_pcg *t, const double rwr[4], double f[4])
{
    for (int l = 0; l < 4; l++)
        f[l] = 0.5 * rwr[l] + 0.5 * t->lambda[l] * t->penalty[l];
}
/* Whether the objective of some lane has risen. */
static bool risen(const rec_problem *pb, const double now[4], const double before[4])
{
    bool rose = false;
    for (int l = 0; l < pb->nch; l++)
        rose = rose || now[l] > before[l];
    return rose;
}

/* The weights, the prediction and d = 0 before the first iteration. */
static void pcg_begin(struct rec_pcg *t)
{
    rec_problem *pb = t->pb;
    for (int l = 0; l < 4; l++)
        t->mu[l] = 1;
    rec_smooth_init(&t->smooth, &pb->a->S->grid);
    if (pb->frozen != NULL) { /* V and the neighbours are there */
        memcpy(t->lambda, pb->frozen->lambda, sizeof t->lambda);
        memcpy(t->nu, pb->frozen->nu, sizeof t->nu);
        t->expect = pb->frozen->expect;
        t->lhat = pb->frozen->lhat;
        memset(t->d, 0, (size_t)pb->a->n * (size_t)pb->cs * sizeof *t->d);
        return;
    }
    memcpy(t->lambda, pb->lambda, sizeof t->lambda);
    memcpy(t->nu, pb->nu, sizeof t->nu);
    rec_pcg_pass(t, REC_PASS_BEGIN, NULL); /* L; V = 1; d = 0 */
    if (t->expect != NULL)
        rec_pcg_pass(t, REC_PASS_EXPECTED, NULL);
}

/* What frozen solves after this one are given. */
static void pcg_tell(const struct rec_pcg *t, const double rwr[4], struct rec_ended *out)
{
    memcpy(out->lambda, t->lambda, sizeof out->lambda);
    memcpy(out->penalty, t->penalty, sizeof out->penalty);
    memcpy(out->rwr, rwr, sizeof out->rwr);
}

/* ---- a solve ------------------------------------------------------------------------------------*/

struct pcg_run {
    struct rec_pcg t;
    struct rec_renewal renewal;
    struct rec_stopper stop;
    double gamma[4], rwr[4], f[4];
    double of_phi[2][4]; /* phi'M phi, phi'M phi_old */
    double down[1][4];   /* d'phi */
    double bend[2][4];   /* q'Wq, d'L V L d */
    bool has_phi, has_d; /* ahead: phi and phi_old, d are those that come next, with their sums */
};

/* To wait for a card costs more than to throw a product away.  So what nearly always follows begins there before the
 * host has decided that it does, and shares the wait. */
static bool pcg_is_ahead(const struct pcg_run *s)
{
    return rec_card_of(s->t.pb->a) != NULL;
}

/* Gradient of t->x by one of the two passes for it. */
static void differentiate(struct pcg_run *s, enum rec_pcg_pass gradient)
{
    pcg_swap(&s->t.phi, &s->t.phi_old);
    rec_pcg_pass(&s->t, gradient, s->of_phi);
}

/* d of (4).  Ahead: also its curvature, whether d stays or not. */
static void pcg_direct(struct pcg_run *s)
{
    struct rec_pcg *t = &s->t;
    rec_card_later(t->pb->a);
    rec_pcg_pass(t, REC_PASS_DIRECTION, s->down);
    if (pcg_is_ahead(s))
        rec_pcg_pass(t, REC_PASS_CURVATURE, s->bend);
}

/* Sets d and alpha; false: no lane can move any more. */
static bool line_search(struct pcg_run *s)
{
    struct rec_pcg *t = &s->t;
    double keep[4];
    bool again = false, moving = false;

    if (!s->has_d)
        pcg_direct(s);
    s->has_d = false;
    for (int l = 0; l < 4; l++) {
        bool restart = t->beta[l] != 0 && s->down[0][l] >= -1e-3 * s->gamma[l];
        again = again || restart;
        keep[l] = restart ? 0 : 1;
    }
    if (again) { /* d = keep d - (1 - keep) M phi: the other lanes stay as they are */
        for (int l = 0; l < 4; l++) {
            t->beta[l] = keep[l];
            t->mu[l] = 1 - keep[l];
        }
        pcg_direct(s);
        for (int l = 0; l < 4; l++)
            t->mu[l] = 1;
    }

    if (!pcg_is_ahead(s)) /* q = A d; q'Wq, d'L V L d */
        rec_pcg_pass(t, REC_PASS_CURVATURE, s->bend);
    rec_bound_curvature(t->pb, t->q, s->bend[0]);
    for (int l = 0; l < 4; l++) {
        double curve = s->bend[0][l] + t->lambda[l] * s->bend[1][l];
        double alpha = curve > 0 && s->down[0][l] < 0 ? -s->down[0][l] / curve : 0;
        t->alpha[l] = isfinite((float)alpha) ? alpha : 0;
        moving = moving || t->alpha[l] > 0;
    }
    return moving;
}

/* M and phi of t->x, whose residual and second differences are known.  Ahead: also d. */
static void pcg_from_here(struct pcg_run *s, enum rec_pcg_pass gradient)
{
    rec_pcg_pass(&s->t, REC_PASS_SCALE, NULL);
    rec_card_later(s->t.pb->a);
    differentiate(s, gradient); /* phi of (3), phi'M phi */
    s->has_d = pcg_is_ahead(s);
    if (s->has_d)
        pcg_direct(s);
    memcpy(s->gamma, s->of_phi[0], LANES);
}

/* r, lx, V, M, phi and f of the first x. */
static void pcg_start(struct pcg_run *s)
{
    struct rec_pcg *t = &s->t;
    rec_problem *pb = t->pb;
    const bool fits = pb->start == REC_START_FITS && pb->frozen == NULL;
    double of_x[2][4], lit[4];
    rec_start_residual(pb, t->x, s->rwr); /* r = A x - b, q = W r */
    rec_bound_raise(pb, t->r, t->q, s->rwr);
    rec_card_later(pb->a);
    rec_pcg_pass(t, REC_PASS_SMOOTHNESS, of_x); /* lx = V L x */
    if (fits)
        rec_renewal_stiffen(t, lit); /* V, lx from x */
    pcg_from_here(s, REC_PASS_GRADIENT);
    if (!fits)
        memcpy(t->penalty, of_x[0], LANES);
    memcpy(t->norm2, of_x[1], LANES);
    pcg_value(t, s->rwr, s->f);
}

/* V and lambda from x; f, M and phi of the new objective. */
static void pcg_renew(struct pcg_run *s, struct rec_solve_report *out)
{
    struct rec_pcg *t = &s->t;
    rec_problem *pb = t->pb;
    bool other = rec_selfcal_due(pb, s->renewal.done) && rec_selfcal_estimate(pb, t->r);
    if (other) { /* b and r are others */
        rec_selfcal_apply(pb);
        refresh(t, s->rwr);
    }
    rec_renewal_take(&s->renewal, t, s->rwr, out); /* V and lambda from x */
    pcg_from_here(s, other ? REC_PASS_GRADIENT : REC_PASS_REGRADIENT);
    pcg_value(t, s->rwr, s->f);
    rec_stop_anew(&s->stop, rec_lanes_total(s->f), s->renewal.restless);
}

/* r, q = W r, lx of the new x from the step.  Ahead: also phi. */
static void pcg_follow(struct pcg_run *s)
{
    struct rec_pcg *t = &s->t;
    double sums[3][4];
    rec_card_later(t->pb->a);
    rec_pcg_pass(t, REC_PASS_RESIDUAL, sums);
    s->has_phi = pcg_is_ahead(s);
    if (s->has_phi)
        differentiate(s, REC_PASS_GRADIENT);
    memcpy(s->rwr, sums[0], LANES);
    memcpy(t->penalty, sums[1], LANES);
    memcpy(t->norm2, sums[2], LANES);
    rec_bound_raise(t->pb, t->r, t->q, s->rwr);
}

/* Moves x, r, q, lx one step further; t->next is then the former x.  anew: r and lx from x alone. */
static void pcg_advance(struct pcg_run *s, bool anew)
{
    struct rec_pcg *t = &s->t;
    double moved[3][4];
    rec_card_later(t->pb->a);
    rec_pcg_pass(t, REC_PASS_STEP, moved);
    if (t->any_clipped && !anew)
        rec_pcg_pass(t, REC_PASS_CLIPPED, NULL);
    pcg_swap(&t->x, &t->next);
    s->has_phi = false;
    if (anew)
        refresh(t, s->rwr);
    else
        pcg_follow(s);
    memcpy(t->moved2, moved[0], LANES);
}

/* If f of some lane rose in the step from t->next to t->x, moves x to the least f along that step:
 *   f(t) = f0 + t phi's + t^2 (f1 - f0 - phi's). */
static void go_back(struct pcg_run *s, const double f1[4])
{
    struct rec_pcg *t = &s->t;
    const double *f0 = s->f;
    double down[3][4];
    if (s->has_phi) /* phi is that of the former x again */
        pcg_swap(&t->phi, &t->phi_old);
    s->has_phi = false;
    pcg_swap(&t->x, &t->next);
    rec_pcg_pass(t, REC_PASS_SLOPE, down);
    for (int l = 0; l < 4; l++) {
        double bend = f1[l] - f0[l] - down[0][l];
        double best = bend > 0 && down[0][l] < 0 ? -down[0][l] / (2 * bend) : 0;
        t->back[l] = f1[l] <= f0[l] ? 1 : fmin(best, 1);
        t->moved2[l] *= t->back[l] * t->back[l];
    }
    rec_pcg_pass(t, REC_PASS_RETREAT, NULL);
    pcg_swap(&t->x, &t->next);
    refresh(t, s->rwr);
}

/* x one iteration further; false: no lane can move any more. */
static bool pcg_iterate(struct pcg_run *s)
{
    struct rec_pcg *t = &s->t;
    const int most_tries =
        t->pb->in.least != NULL ? 4 : 1; /* bounds: f is no parabola along a step */
    double now[4];
    if (!line_search(s)) /* d = -M phi + beta d, alpha = -phi'd / d'Hd */
        return false;
    pcg_advance(s, (s->stop.k + 1) % REFRESH == 0); /* x = max(0, x + alpha d), r, q, lx */
    pcg_value(t, s->rwr, now);
    for (int tries = 0; tries < most_tries && risen(t->pb, now, s->f); tries++) {
        go_back(s, now); /* x to the least f on the step's way */
        pcg_value(t, s->rwr, now);
    }
    memcpy(s->f, now, sizeof s->f);
    s->stop.moved = sqrt(rec_lanes_total(t->moved2) / rec_lanes_total(t->norm2));
    return true;
}

/* phi of the new x, and beta. */
static void pcg_turn(struct pcg_run *s)
{
    struct rec_pcg *t = &s->t;
    if (!s->has_phi)
        differentiate(s, REC_PASS_GRADIENT);
    for (int l = 0; l < 4; l++) { /* beta = phi'M(phi - phi_old) / phi_old'M phi_old */
        double beta = s->gamma[l] > 0 ? (s->of_phi[0][l] - s->of_phi[1][l]) / s->gamma[l] : 0;
        t->beta[l] = beta > 0 && isfinite((float)beta) ? beta : 0;
        s->gamma[l] = s->of_phi[0][l];
    }
}

/* Iterates until the stop.  may_blend: or until the channels go on as one (blend.h).  Then it returns how much sooner
 * that stops, else 0. */
static double pcg_until(struct pcg_run *s, bool may_blend, struct rec_solve_report *out)
{
    struct rec_pcg *t = &s->t;
    struct rec_stopper *stop = &s->stop;
    for (bool on = rec_stop_next(stop); on;) {
        if (!pcg_iterate(s)) {
            out->status = REC_CONVERGED;
            break;
        }
        on = !rec_stop_after(stop, t->x, rec_lanes_total(s->f), rec_lanes_total(s->rwr)) &&
             rec_stop_next(stop);
        if (!on)
            break;
        bool due = rec_renewal_due(&s->renewal, stop->k, stop->moved) && !rec_late(stop->p);
        if (may_blend && stop->k >= REC_BLEND_AFTER) {
            double sooner = rec_blend_helps(t, stop, s->renewal.done);
            may_blend = false;
            if (sooner > 0) {
                if (due)
                    rec_renewal_take(&s->renewal, t, s->rwr, out);
                return sooner;
            }
        }
        pcg_turn(s);
        if (due)
            pcg_renew(s, out);
    }
    return 0;
}

/* Solves the channels as one to the stop, and gives all of them the result. */
static void pcg_blend(struct pcg_run *all, double sooner, float *x, struct rec_solve_report *out)
{
    struct rec_pcg *t = &all->t;
    struct rec_solve_params quiet = *all->stop.p;
    struct pcg_run one = *all;
    if (t->x != x) {
        rec_copy_x(t->pb, x, t->x);
        t->next = t->x;
        t->x = x;
    }
    rec_blend_begin(t, &one.t, one.rwr);
    quiet.trace = NULL; /* it knows iterates of all channels */
    one.stop.p = &quiet;
    one.stop.pb = one.t.pb;
    one.stop.still *= sooner;
    one.stop.gain *= sooner;
    one.renewal.patient = true;
    smoothness(&one.t);
    pcg_from_here(&one, REC_PASS_GRADIENT);
    pcg_value(&one.t, one.rwr, one.f);
    rec_stop_anew(&one.stop, rec_lanes_total(one.f), false);
    (void)pcg_until(&one, false, out);
    rec_blend_end(t, &one.t);
    out->blended = one.stop.k - all->stop.k;
    refresh(t, all->rwr);
    pcg_value(t, all->rwr, all->f);
    out->objective = rec_lanes_total(all->f);
}

void rec_solve_pcg(rec_problem *pb, const struct rec_solve_params *p, float *x,
                   struct rec_solve_report *out)
{
    const bool auto_stop = p->stop == REC_STOP_AUTO;
    const struct rec_stop_own own = {.most = DEFAULT_ITERATIONS,
                                     .blind = DEFAULT_ITERATIONS,
                                     .gain = auto_stop ? 0.5 * (double)p->tolerance : STILL,
                                     .still = auto_stop ? (double)p->tolerance : 0};
    struct rec_pcg_passes table;
    struct pcg_run s = {.t = rec_pcg_of(pb, x, &table)};
    struct rec_pcg *t = &s.t;

    rec_pcg_passes_init(&table, pb->a->k->cpu);
    rec_problem_weigh(pb, p->lambda); /* lambda, diag(A'WA) */
    pcg_begin(t);
    pcg_start(&s);
    out->objective = rec_lanes_total(s.f);
    rec_renewal_begin(&s.renewal, pb);
    rec_stop_begin(&s.stop, pb, &own, p, out);
    bool may_blend =
        auto_stop && pb->start == REC_START_FITS && pb->frozen == NULL && p->blend != REC_BLEND_OFF;
    double sooner = pcg_until(&s, may_blend, out);
    if (sooner > 0)
        pcg_blend(&s, sooner, x, out);
    if (rec_selfcal_due_last(pb))
        (void)rec_selfcal_estimate(pb, t->r); /* for the next grid */
    for (int l = 0; l < pb->nch; l++)
        out->lambda += t->lambda[l] / pb->nch;
    pcg_tell(t, s.rwr, &pb->ended);
    if (t->x != x)
        rec_copy_x(pb, x, t->x);
    if (rec_stop_end(&s.stop, x))
        return;
    out->residual_norm = sqrt(rec_lanes_total(s.rwr));
    out->solution_norm = sqrt(rec_lanes_total(t->norm2));
    for (int l = 0; l < pb->nch; l++)
        out->misfit2[l] = !pb->in.per_channel   ? s.rwr[l] * pb->nch / pb->m
                          : pb->measured[l] > 0 ? s.rwr[l] / pb->measured[l]
                                                : 0;
}
