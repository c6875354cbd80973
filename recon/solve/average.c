#include "recon/solve/average.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define CHANCE 4.9 /* standard deviations that happen once in 10^6 */
#define TWICE  2   /* blocks in a row that say that a camera was touched */

enum { GAIN, SHIFT, KINDS };
static const double least[KINDS] = {REC_SELFCAL_GAIN_LEAST, REC_SELFCAL_SHIFT_LEAST};
static const double touched[KINDS] = {REC_AVERAGE_TOUCHED_GAIN, REC_AVERAGE_TOUCHED_SHIFT};

/* Gain or shift of one camera in one block; a gain has only the first numbers. */
struct sum {
    double w, z[2], within[3]; /* sums of w, w z, w C (uu, uv, vv) */
};

struct mean {
    double n, z[2]; /* n of (1) */
    double C[3];    /* of z, and that of a block: */
    double V[3];
};

struct eye { /* a camera */
    struct mean mean[KINDS];
    double J[2][3]; /* of its last estimate */
    unsigned odd;   /* blocks in a row beyond chance */
    double far;     /* how far the last one is, in units of `touched` */
    uint32_t touched;
};

struct rec_average {
    pthread_mutex_t lock;
    size_t cameras;
    int32_t binning;
    uint32_t block, blocks;
    enum rec_selfcal_how how; /* of the next set, once there is a mean */
    bool recording;           /* learning: `begin` is what the round corrects by */
    struct rec_selfcal_given begin;
    uint32_t in_block;     /* sets of the open block */
    size_t at, used, full; /* the open block; those in use; those that count */
    bool any[KINDS], known;
    double test[KINDS];
    struct eye *eye;          /* [cameras] */
    struct sum (*sum)[KINDS]; /* [blocks][cameras] */
};

static struct sum *sum_of(const rec_average *a, size_t block, size_t c)
{
    return a->sum[block * a->cameras + c];
}

pvx_err rec_average_new(size_t cameras, int32_t binning, uint32_t block, uint32_t blocks,
                        rec_average **out)
{
    rec_average *a = *out = pvx_calloc(1, sizeof *a);
    if (a == NULL)
        return PVX_ENOMEM;
    pthread_mutex_init(&a->lock, NULL);
    a->cameras = cameras;
    a->binning = binning;
    a->block = block;
    a->blocks = blocks;
    a->how = REC_SELFCAL_GIVEN;
    a->eye = pvx_calloc(cameras, sizeof *a->eye);
    a->sum = pvx_calloc(cameras * blocks, sizeof *a->sum);
    if (a->eye != NULL && a->sum != NULL)
        return PVX_OK;
    rec_average_free(out);
    return PVX_ENOMEM;
}

void rec_average_free(rec_average **ap)
{
    rec_average *a = *ap;
    if (a == NULL)
        return;
    pthread_mutex_destroy(&a->lock);
    free(a->eye);
    free(a->sum);
    PVX_FREE(*ap);
}

/* ---- statistics ---------------------------------------------------------------------------------- */

static double trace(const double C[3])
{
    return C[0] + C[2];
}

/* x' C^-1 x; of gains only C[0] counts. */
static double distance2(int kind, const double x[2], const double C[3])
{
    double det = C[0] * C[2] - C[1] * C[1];
    if (kind == GAIN)
        return C[0] > 0 ? x[0] * x[0] / C[0] : 0;
    return det > 0 ? (x[0] * x[0] * C[2] - 2 * x[0] * x[1] * C[1] + x[1] * x[1] * C[0]) / det : 0;
}

/* (2). */
static double chi2_of(int kind, double t2, double v)
{
    double of_gain = (8 * v + 1) / (8 * v + 3);
    return log1p(t2 / v) * (kind == GAIN ? v * of_gain * of_gain : v - 1);
}

/* Chi square of f degrees as a normal deviate (Wilson & Hilferty, Proc. Nat. Acad. Sci. 17:684, 1931). */
static double deviate_of(double q, double f)
{
    double a = 2 / (9 * f);
    return (cbrt(q / f) - (1 - a)) / sqrt(a);
}

/* Whether block b counts: it is full, and none of `without`. */
static bool counts(const rec_average *a, size_t b, const size_t without[TWICE])
{
    return b != a->at && (without == NULL || (b != without[0] && b != without[1]));
}

/* (1) over the blocks that count. */
static struct mean average_mean(const rec_average *a, size_t c, int kind,
                                const size_t without[TWICE])
{
    struct mean m = {0};
    double w = 0, w2 = 0, within[3] = {0}, V[3] = {0};
    for (size_t b = 0; b < a->used; b++) {
        const struct sum *s = &sum_of(a, b, c)[kind];
        if (!counts(a, b, without) || !(s->w > 0))
            continue;
        w += s->w;
        w2 += s->w * s->w;
        for (int i = 0; i < 2; i++)
            m.z[i] += s->z[i];
        for (int i = 0; i < 3; i++)
            within[i] += s->within[i];
    }
    if (!(w > 0))
        return m;
    m.n = w * w / w2;
    for (int i = 0; i < 2; i++)
        m.z[i] /= w;
    for (size_t b = 0; b < a->used && m.n > 1; b++) {
        const struct sum *s = &sum_of(a, b, c)[kind];
        if (!counts(a, b, without) || !(s->w > 0))
            continue;
        double u = s->z[0] / s->w - m.z[0], v = s->z[1] / s->w - m.z[1];
        V[0] += s->w * u * u / w * m.n / (m.n - 1);
        V[1] += s->w * u * v / w * m.n / (m.n - 1);
        V[2] += s->w * v * v / w * m.n / (m.n - 1);
    }
    for (int i = 0; i < 3; i++)
        within[i] /= w * a->block;
    memcpy(m.V, trace(within) > trace(V) ? within : V, sizeof m.V);
    for (int i = 0; i < 3; i++)
        m.C[i] = m.V[i] / m.n;
    return m;
}

/* Whether the mean of a camera counts. */
static bool eye_known(const struct eye *e, int kind)
{
    return e->mean[kind].n >= REC_AVERAGE_LEAST - 0.5;
}

/* Test and size (8) of all cameras; what is applied. */
static void average_judge(rec_average *a, int kind)
{
    double q = 0, f = kind == GAIN ? -1 : -3, known = 0, t2 = 0;
    for (size_t c = 0; c < a->cameras; c++) {
        const struct mean *m = &a->eye[c].mean[kind];
        double det = m->C[0] * m->C[2] - m->C[1] * m->C[1];
        if (!eye_known(&a->eye[c], kind) || !(kind == GAIN ? m->C[0] > 0 : det > 0))
            continue;
        double one = distance2(kind, m->z, m->C);
        q += chi2_of(kind, one, m->n - 1);
        f += 1 + kind;
        t2 += one;
        known += kind == GAIN ? 1 / m->C[0] : 0.5 * trace(m->C) / det;
    }
    double size = known > 0 ? sqrt((1 + kind) * t2 / known) : 0;
    a->test[kind] = f > 0 ? deviate_of(q, f) : 0;
    a->any[kind] =
        f > 0 && (a->any[kind] ? size > 0.5 * least[kind]
                               : size > least[kind] && a->test[kind] > REC_AVERAGE_SIGMAS);
}

/* Takes out of the means what no picture shows. */
static void average_anchor(rec_average *a)
{
    struct rec_selfcal_place p[REC_MAX_CAMERAS];
    for (size_t c = 0; c < a->cameras; c++) {
        const struct eye *e = &a->eye[c];
        p[c].in[GAIN] = eye_known(e, GAIN);
        p[c].in[SHIFT] = eye_known(e, SHIFT);
        p[c].gain = exp(e->mean[GAIN].z[0]);
        memcpy(p[c].shift, e->mean[SHIFT].z, sizeof p[c].shift);
        memcpy(p[c].J, e->J, sizeof p[c].J);
    }
    rec_selfcal_anchor(p, a->cameras);
    for (size_t c = 0; c < a->cameras; c++) {
        a->eye[c].mean[GAIN].z[0] = log(p[c].gain);
        memcpy(a->eye[c].mean[SHIFT].z, p[c].shift, sizeof p[c].shift);
    }
}

/* ---- blocks --------------------------------------------------------------------------------------- */

static void forget(rec_average *a, size_t block, size_t c)
{
    memset(sum_of(a, block, c), 0, KINDS * sizeof(struct sum));
}

/* How far the block at hand has a camera from the mean of the blocks before, in units of `touched`; 0: by chance. */
static double average_far(const rec_average *a, size_t c, size_t block, size_t before)
{
    const size_t without[TWICE] = {block, a->eye[c].odd > 0 ? before : block};
    double most = 0;
    for (int kind = 0; kind < KINDS; kind++) {
        struct mean m = average_mean(a, c, kind, without);
        const struct sum *s = &sum_of(a, block, c)[kind];
        if (m.n < REC_AVERAGE_LEAST - 0.5 || !(s->w > 0))
            continue;
        double x[2] = {s->z[0] / s->w - m.z[0], s->z[1] / s->w - m.z[1]}, V[3];
        for (int i = 0; i < 3; i++)
            V[i] = m.V[i] * (1 + 1 / m.n);
        double q = chi2_of(kind, distance2(kind, x, V), m.n - 1);
        double far = hypot(x[0], kind == GAIN ? 0 : x[1]) / touched[kind];
        most = far > 1 && deviate_of(q, 1 + kind) > CHANCE ? fmax(most, far) : most;
    }
    return most;
}

static void average_look_for_touched(rec_average *a, size_t block)
{
    size_t worst = a->cameras, before = (block + a->blocks - 1) % a->blocks;
    for (size_t c = 0; c < a->cameras; c++) {
        struct eye *e = &a->eye[c];
        e->far = average_far(a, c, block, before);
        e->odd = e->far > 0 ? e->odd + 1 : 0;
        if (e->odd >= TWICE && (worst == a->cameras || e->far > a->eye[worst].far))
            worst = c;
    }
    if (worst == a->cameras)
        return;
    a->eye[worst].touched++;
    for (size_t c = 0; c < a->cameras; c++) {
        a->eye[c].odd = 0;
        for (size_t b = 0; b < a->used; b++)
            if ((b == block || b == before) != (c == worst))
                forget(a, b, c);
    }
}

/* The open block is full. */
static void average_close(rec_average *a)
{
    size_t block = a->at;
    a->in_block = 0;
    a->at = (a->at + 1) % a->blocks;
    a->used = a->used > block + 1 ? a->used : block + 1;
    a->full += a->full < a->blocks - 1;
    for (size_t c = 0; c < a->cameras; c++)
        forget(a, a->at, c);
    if (!a->recording)
        average_look_for_touched(a, block);
    for (size_t c = 0; c < a->cameras; c++)
        for (int kind = 0; kind < KINDS; kind++)
            a->eye[c].mean[kind] = average_mean(a, c, kind, NULL);
    average_anchor(a);
    a->known = false;
    for (size_t c = 0; c < a->cameras; c++)
        a->known |= eye_known(&a->eye[c], GAIN);
    for (int kind = 0; kind < KINDS; kind++)
        average_judge(a, kind);
}

static void sum_add(struct sum *s, int kind, const struct rec_selfcal_look *l)
{
    const double C[3] = {kind == GAIN ? l->gain_var : l->var[0], kind == GAIN ? 0 : l->var[1],
                         kind == GAIN ? 0 : l->var[2]};
    double w = 1 / (trace(C) / (1 + kind) + least[kind] * least[kind]);
    if (!isfinite(trace(C)))
        return;
    s->w += w;
    s->z[0] += w * (kind == GAIN ? l->log_gain : l->shift[0]);
    s->z[1] += w * (kind == GAIN ? 0 : l->shift[1]);
    for (int i = 0; i < 3; i++)
        s->within[i] += w * C[i];
}

void rec_average_add(rec_average *a, const struct rec_selfcal_look *look)
{
    pthread_mutex_lock(&a->lock);
    for (size_t c = 0; c < a->cameras && a->how != REC_SELFCAL_FIXED; c++) {
        if (!look[c].known)
            continue;
        for (int kind = 0; kind < KINDS; kind++)
            sum_add(&sum_of(a, a->at, c)[kind], kind, &look[c]);
        memcpy(a->eye[c].J, look[c].J, sizeof a->eye[c].J);
    }
    if (a->how != REC_SELFCAL_FIXED && ++a->in_block == a->block)
        average_close(a);
    pthread_mutex_unlock(&a->lock);
}

/* ---- what came out -------------------------------------------------------------------------------- */

/* What passed, of all cameras. */
static void average_passed(const rec_average *a, struct rec_selfcal_given *out)
{
    *out = (struct rec_selfcal_given){.gain = a->any[GAIN], .shift = a->any[SHIFT]};
    for (size_t c = 0; c < a->cameras; c++) {
        const struct eye *e = &a->eye[c];
        out->camera[c].gain = eye_known(e, GAIN) ? exp(e->mean[GAIN].z[0]) : 1;
        for (int i = 0; i < 2 && eye_known(e, SHIFT); i++)
            out->camera[c].shift[i] = e->mean[SHIFT].z[i];
    }
}

void rec_average_learn(rec_average *a)
{
    pthread_mutex_lock(&a->lock);
    average_passed(a, &a->begin);
    a->how = a->begin.gain || a->begin.shift ? REC_SELFCAL_LEARN : REC_SELFCAL_ALONE;
    a->recording = true;
    a->known = a->any[GAIN] = a->any[SHIFT] = false;
    a->in_block = 0;
    a->at = a->used = a->full = 0;
    memset(a->sum, 0, a->cameras * a->blocks * sizeof *a->sum);
    pthread_mutex_unlock(&a->lock);
}

void rec_average_fix(rec_average *a)
{
    pthread_mutex_lock(&a->lock);
    a->how = a->known ? REC_SELFCAL_FIXED : REC_SELFCAL_ALONE;
    average_passed(a, &a->begin);
    pthread_mutex_unlock(&a->lock);
}

enum rec_selfcal_how rec_average_given(rec_average *a, struct rec_selfcal_given *out)
{
    pthread_mutex_lock(&a->lock);
    enum rec_selfcal_how how = a->recording || a->known ? a->how : REC_SELFCAL_ALONE;
    if (a->recording)
        *out = a->begin;
    else
        average_passed(a, out);
    pthread_mutex_unlock(&a->lock);
    return how;
}

void rec_average_tell(rec_average *a, struct rec_selfcal_report *out)
{
    pthread_mutex_lock(&a->lock);
    *out = (struct rec_selfcal_report){.gain = a->any[GAIN],
                                       .shift = a->any[SHIFT],
                                       .cameras = (uint32_t)a->cameras,
                                       .sets = a->known ? (uint32_t)a->full * a->block : 0};
    memcpy(out->test, a->test, sizeof out->test);
    for (size_t c = 0; c < a->cameras; c++) {
        const struct eye *e = &a->eye[c];
        struct rec_selfcal_camera *to = &out->camera[c];
        to->touched = e->touched;
        to->known = eye_known(e, GAIN);
        if (!to->known)
            continue;
        to->gain = (float)exp(e->mean[GAIN].z[0]);
        to->gain_error = (float)sqrt(e->mean[GAIN].C[0]);
        for (int i = 0; i < 2 && eye_known(e, SHIFT); i++) {
            to->shift[i] = (float)(a->binning * e->mean[SHIFT].z[i]);
            to->shift_error[i] = (float)(a->binning * sqrt(e->mean[SHIFT].C[2 * i]));
        }
    }
    pthread_mutex_unlock(&a->lock);
}
