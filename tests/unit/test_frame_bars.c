/* test_frame_bars.c - error bars of a frame (recon/frame/bars.h): they hold the truth and are not much larger than the errors,
 * (1) of the header holds, the volume keeps its bits, threads change none, and what frames have: few cameras, mosaics,
 * grey, nothing at all, saturated pixels, another solver. */
#include <math.h>

#include "tests/lib/bars.h"
#include "tests/lib/slot.h"

/* A frame of scene s and its bars. */
struct case_ {
    rec_frame *f;
    rec_bars *b;
    struct rec_bars_view v;
    struct rec_sparse x;
};
static void case_new(struct case_ *k, const struct scene *s, const struct rec_frame_params *p,
                     uint32_t K)
{
    T_EQ_I(rec_frame_alone(s->S, &s->rig, p, s->pool, &k->f, NULL), PVX_OK);
    T_EQ_I(rec_bars_new(s->S, p->nch, K, &k->b, NULL), PVX_OK);
}
static void case_solve(struct case_ *k)
{
    rec_frame_carve(k->f);
    T_EQ_I(rec_frame_solve(k->f, 0, NULL), PVX_OK);
    rec_frame_volume(k->f, &k->x);
    T_EQ_I(rec_frame_bars(k->f, k->b, 1, &k->v), PVX_OK);
}
static void case_free(struct case_ *k)
{
    rec_bars_free(&k->b);
    rec_frame_free(&k->f);
}

/* (1) of bars.h: no sum of squares of modes is larger than sd^2, and somewhere it is nearly that; all is finite. */
static void consistent(const struct case_ *k)
{
    size_t cs = (size_t)k->v.cs, vector = (size_t)k->v.n * cs;
    double most = 0;
    T_OK(k->v.sd != NULL && k->v.n == k->x.n && k->v.n_modes >= 4);
    for (size_t i = 0; i < vector; i++) {
        double sum = 0, sd2 = (double)k->v.sd[i] * k->v.sd[i];
        for (uint32_t m = 0; m < k->v.n_modes; m++)
            sum += (double)k->v.modes[m * vector + i] * k->v.modes[m * vector + i];
        T_OK(isfinite(k->v.sd[i]) && sum <= sd2 * 1.0001);
        most = fmax(most, sd2 > 0 ? sum / sd2 : 0);
        if (cs == 4 && i % cs == 3)
            T_OK(k->v.sd[i] == 0);
    }
    T_OK(most > 0.99);
}

T_CASE(bars_hold_the_truth)
{
    static const struct {
        size_t cameras;
        int nch;
        double noise;
        uint32_t K, solves;
    } of[] = {
        {8, 3, 0.01, 16, 12}, {8, 1, 0.01, 16, 12}, {6, 3, 0.02, 8, 8}, {12, 3, 0.01, 16, 12}};
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct scene s;
        struct case_ k;
        double over;
        struct rec_frame_params p = bars_params(of[i].nch);
        scene_new(&s, of[i].cameras, 80, 32, 1, 2);
        case_new(&k, &s, &p, of[i].K);
        bars_shoot(&s, k.f, of[i].noise);
        case_solve(&k);
        consistent(&k);
        double held = bars_covered(&s, k.f, &k.v, &over);
        T_OK(held > 90);
        T_OK(over < 8); /* no bar holds everything by being huge */
        T_EQ_I(k.v.doubt & ~(uint32_t)(REC_BARS_BLURRED | REC_BARS_FINE), 0);
        T_EQ_I(k.v.solves, of[i].solves);
        case_free(&k);
        scene_free(&s);
    }
}

/* Error of the whole light over its bar, by (2) of bars.h, and that bar over the light; of the first channel. */
static double whole(const struct scene *s, const struct case_ *k, double *bar)
{
    size_t cs = (size_t)k->v.cs, vector = (size_t)k->v.n * cs;
    double error = 0, light = 0, var = 0;
    for (size_t i = 0; i < s->voxels; i++)
        light += s->truth[i * 3];
    for (size_t i = 0; i < vector; i += cs) {
        error += (double)k->x.value[i];
        var += (double)k->v.sd[i] * k->v.sd[i];
    }
    for (uint32_t m = 0; m < k->v.n_modes; m++) {
        double sum = 0;
        for (size_t i = m * vector; i < (m + 1) * vector; i += cs) {
            sum += (double)k->v.modes[i];
            var -= (double)k->v.modes[i] * k->v.modes[i];
        }
        var += sum * sum;
    }
    *bar = sqrt(var) / light;
    return (error - light) / sqrt(var);
}

/* S: light that noise makes, which no picture has, and gains whose mean is wrong.  Without it the error is up to 8 bars. */
T_CASE(the_whole_light)
{
    static const double noise[] = {0.01, 0.03};
    for (size_t i = 0; i < sizeof noise / sizeof *noise; i++)
        for (int wrong = 0; wrong < 2; wrong++) {
            struct scene s;
            struct case_ k;
            struct rec_frame_params p = bars_params(3);
            double z2 = 0, bar = 0;
            scene_new(&s, 8, 80, 32, 1, 2);
            case_new(&k, &s, &p, 8);
            for (int draw = 0; draw < 12; draw++) {
                scene_shoot(&s, k.f, noise[i]);
                for (size_t c = 0; c < s.rig.n_cameras; c++) {
                    size_t n = s.S->row0[c + 1] - s.S->row0[c];
                    float gain = wrong ? (float)exp(0.08 * t_normal()) : 1;
                    for (size_t r = 0; r < n * 4; r++)
                        rec_frame_input(k.f, c)[r] *= gain;
                }
                case_solve(&k);
                double z = whole(&s, &k, &bar);
                z2 += z * z / 12;
                T_OK(bar < 0.06);
            }
            T_OK(z2 < 2.5);
            case_free(&k);
            scene_free(&s);
        }
}

/* Length of the first mode, T, over that of the volume. */
static double texture(const struct case_ *k)
{
    size_t vector = (size_t)k->v.n * (size_t)k->v.cs;
    const float *d = k->v.modes;
    double d2 = 0, x2 = 0;
    for (size_t i = 0; i < vector; i++) {
        d2 += (double)d[i] * d[i];
        x2 += (double)k->x.value[i] * k->x.value[i];
    }
    return sqrt(d2 / x2);
}

/* (5) of bars.h: more detail is lost in more noise and to fewer cameras, of a single channel too. */
T_CASE(texture_that_is_lost)
{
    double lost[2][3] = {{0}};
    for (int grey = 0; grey < 2; grey++)
        for (int i = 0; i < 3; i++) {
            struct scene s;
            struct case_ k;
            struct rec_frame_params p = bars_params(grey ? 1 : 3);
            p.trust_all = true;
            scene_new(&s, 8, 64, 24, 1, 2);
            case_new(&k, &s, &p, 4);
            bars_shoot(&s, k.f, i == 1 ? 0.05 : 0.005);
            for (size_t c = 0; c < 8 && i == 2; c += 2)
                rec_frame_camera(k.f, c)->present = false;
            case_solve(&k);
            consistent(&k);
            lost[grey][i] = texture(&k);
            case_free(&k);
            scene_free(&s);
        }
    for (int grey = 0; grey < 2; grey++) {
        T_OK(lost[grey][0] > 0);
        T_OK(lost[grey][1] > 1.5 * lost[grey][0]);
        T_OK(lost[grey][2] > 1.5 * lost[grey][0]);
    }
}

/* The same bits for any number of threads, for the same seed, and no bit of the volume changes. */
T_CASE(bits)
{
    struct scene s;
    struct case_ k[3];
    struct rec_frame_params p = bars_params(3);
    scene_new(&s, 6, 80, 32, 1, 3);
    pvx_pool *pool = s.pool;
    for (int i = 0; i < 3; i++) {
        s.pool = i == 1 ? NULL : pool;
        case_new(&k[i], &s, &p, 8);
        t_state = 5;
        scene_shoot(&s, k[i].f, 0.01);
        rec_frame_carve(k[i].f);
        T_EQ_I(rec_frame_solve(k[i].f, 0, NULL), PVX_OK);
        rec_frame_volume(k[i].f, &k[i].x);
        if (i < 2)
            T_EQ_I(rec_frame_bars(k[i].f, k[i].b, 9, &k[i].v), PVX_OK);
    }
    s.pool = pool;
    size_t bytes = (size_t)k[0].x.n * 4 * sizeof(float);
    T_EQ_I(k[0].x.n, k[1].x.n);
    T_OK(memcmp(k[0].x.value, k[2].x.value, bytes) == 0);
    T_OK(memcmp(k[0].v.sd, k[1].v.sd, bytes) == 0);
    T_OK(memcmp(k[0].v.modes, k[1].v.modes, k[0].v.n_modes * bytes) == 0);
    float *sd = pvx_calloc(1, bytes);
    memcpy(sd, k[0].v.sd, bytes);
    T_EQ_I(rec_frame_bars(k[0].f, k[0].b, 9, &k[0].v), PVX_OK); /* once more */
    T_OK(memcmp(sd, k[0].v.sd, bytes) == 0);
    T_EQ_I(rec_frame_bars(k[0].f, k[0].b, 10, &k[0].v), PVX_OK);
    T_OK(memcmp(sd, k[0].v.sd, bytes) != 0);
    free(sd);
    for (int i = 0; i < 3; i++)
        case_free(&k[i]);
    scene_free(&s);
}

/* Cameras that are not there are none to leave out; below four there is a doubt. */
T_CASE(cameras_that_are_missing)
{
    struct scene s;
    struct case_ k;
    struct rec_frame_params p = bars_params(3);
    p.trust_all = true;
    scene_new(&s, 5, 64, 24, 1, 2);
    for (uint32_t gone = 0; gone < 4; gone++) {
        case_new(&k, &s, &p, 10);
        scene_shoot(&s, k.f, 0.01);
        for (size_t c = 0; c < gone; c++)
            rec_frame_camera(k.f, c)->present = false;
        case_solve(&k);
        consistent(&k);
        T_EQ_I(k.v.doubt & REC_BARS_FEW_CAMERAS, gone < 1 ? 0 : REC_BARS_FEW_CAMERAS);
        T_EQ_I(k.v.solves, gone < 2 ? 5 - gone + 4 : 10); /* J and D, or D alone */
        case_free(&k);
    }
    scene_free(&s);
}

/* Pixels of a Bayer filter; pixels at full scale, as bounds and left out. */
T_CASE(mosaics_and_saturated_pixels)
{
    struct scene s;
    scene_new(&s, 6, 80, 32, 1, 2);
    for (int i = 0; i < 3; i++) {
        struct case_ k;
        struct rec_frame_params p = bars_params(3);
        double over;
        if (i > 0)
            p.photo.saturation = 0.5f;
        p.at_least = i == 1;
        case_new(&k, &s, &p, 12);
        scene_shoot(&s, k.f, 0.01);
        if (i == 0)
            scene_filter(&s, k.f);
        else
            for (size_t c = 0; c < s.rig.n_cameras; c++)
                for (size_t r = 0; r < (s.S->row0[c + 1] - s.S->row0[c]) * 4; r++)
                    rec_frame_input(k.f, c)[r] = fminf(rec_frame_input(k.f, c)[r], 0.5f);
        case_solve(&k);
        T_OK(i == 0 || rec_frame_get_report(k.f)->saturated > 0);
        consistent(&k);
        T_OK(bars_covered(&s, k.f, &k.v, &over) > 80);
        case_free(&k);
    }
    scene_free(&s);
}

/* With the volume before as a prediction the bars are smaller than without it, where it is trusted. */
T_CASE(a_prediction)
{
    struct scene s;
    struct case_ k;
    struct rec_frame_params p = bars_params(3);
    float *before;
    struct rec_sparse v;
    double over;
    p.temporal = true;
    scene_new(&s, 6, 80, 32, 1, 2);
    case_new(&k, &s, &p, 8);
    scene_shoot(&s, k.f, 0.05);
    case_solve(&k);
    v = k.x;
    before = pvx_calloc((size_t)v.n * 4, sizeof *before);
    int32_t *index = pvx_calloc((size_t)v.n, sizeof *index);
    memcpy(before, v.value, (size_t)v.n * 4 * sizeof *before);
    memcpy(index, v.index, (size_t)v.n * sizeof *index);
    v.value = before;
    v.index = index;
    scene_shoot(&s, k.f, 0.05);
    rec_frame_carve(k.f);
    T_EQ_I(rec_frame_solve(k.f, 0, &v), PVX_OK);
    rec_frame_volume(k.f, &k.x);
    T_OK(rec_frame_get_report(k.f)->temporal > 0);
    T_EQ_I(rec_frame_bars(k.f, k.b, 2, &k.v), PVX_OK);
    consistent(&k);
    T_OK(bars_covered(&s, k.f, &k.v, &over) > 80);
    free(before);
    free(index);
    case_free(&k);
    scene_free(&s);
}

T_CASE(nothing_to_tell)
{
    struct scene s;
    struct case_ k;
    struct pvx_diag d = {""};
    rec_bars *b;
    struct rec_frame_params p = bars_params(3);
    scene_new(&s, 4, 40, 12, 1, 2);
    T_EQ_I(rec_bars_new(s.S, 3, 1, &b, &d), PVX_EINVAL);
    T_OK(b == NULL && strstr(d.text, "want 4 to 64") != NULL);
    T_EQ_I(rec_bars_new(s.S, 3, 65, &b, &d), PVX_EINVAL);
    case_new(&k, &s, &p, 4);
    rec_frame_reset(k.f); /* no camera */
    case_solve(&k);
    T_OK(k.v.sd == NULL && k.v.n_modes == 0);
    for (size_t c = 0; c < 4; c++) { /* all dark */
        memset(rec_frame_input(k.f, c), 0, (s.S->row0[c + 1] - s.S->row0[c]) * 4 * sizeof(float));
        rec_frame_camera(k.f, c)->present = true;
    }
    case_solve(&k);
    T_OK(k.v.sd == NULL);
    case_free(&k);
    p.solve.solver = "sirt";
    case_new(&k, &s, &p, 4);
    scene_shoot(&s, k.f, 0.01);
    rec_frame_carve(k.f);
    T_EQ_I(rec_frame_solve(k.f, 0, NULL), PVX_OK);
    T_EQ_I(rec_frame_bars(k.f, k.b, 1, &k.v), PVX_EUNSUP);
    case_free(&k);
    scene_free(&s);
}
