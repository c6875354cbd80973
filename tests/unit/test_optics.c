/* Each thing that can be wrong with lens and sensor, against its equation in the header, written down once more in
 * doubles and in the plainest way. */
#include "capture/gevsim/optics.h"

#include <math.h>

#include "tests/t.h"

#define W   40
#define H   30
#define NCH 3
#define N   (W * H * NCH)

static const struct cap_optics_shape shape = {W, H, NCH, 7};
static float flame[N], got[N], scratch[N];

/* Smooth, dark at the edges, each channel another. */
static double f(double x, double y, int ch)
{
    double a = (x - 18 - ch) / 4, b = (y - 14) / 3;
    return (0.8 - 0.2 * ch) * exp(-0.5 * (a * a + b * b));
}

static void see(const struct cap_optics *o)
{
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++)
            for (int ch = 0; ch < NCH; ch++)
                flame[(y * W + x) * NCH + ch] = (float)f(x, y, ch);
    memcpy(got, flame, sizeof got);
    cap_optics_apply(o, &shape, got, scratch);
}

static double at(const float *image, int x, int y, int ch)
{
    return (double)image[(y * W + x) * NCH + ch];
}

/* Largest difference from want(x, y, ch). */
static double off(double (*want)(int x, int y, int ch))
{
    double worst = 0;
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++)
            for (int ch = 0; ch < NCH; ch++)
                worst = fmax(worst, fabs(at(got, x, y, ch) - want(x, y, ch)));
    return worst;
}

static double as_it_is(int x, int y, int ch)
{
    return at(flame, x, y, ch);
}
T_CASE(nothing_wrong_changes_nothing)
{
    see(&cap_optics_none);
    T_LE(off(as_it_is), 0);
}

static double whole(int x, int y, int ch)
{
    return x < 5 || y >= H - 3 ? 0 : at(flame, x - 5, y + 3, ch);
}
static double part(int x, int y, int ch)
{
    return f(x + 2.25, y - 0.5, ch);
}
static double nothing(int x, int y, int ch)
{
    (void)x, (void)y, (void)ch;
    return 0;
}
T_CASE(shift_goes_right_and_down)
{
    struct cap_optics o = cap_optics_none;
    o.shift[0] = 5;
    o.shift[1] = -3;
    see(&o);
    T_LE(off(whole), 0); /* whole pixels are copies */
    o.shift[0] = -2.25;
    o.shift[1] = 0.5;
    see(&o);
    T_LE(off(part),
         0.006); /* the cubic's error: third derivative of the narrow side, 1/3^3, over 2 x 24 */
    o.shift[0] = CAP_OPTICS_SHIFT_MAX;
    see(&o);
    T_LE(off(nothing), 0);
}

static double mirrored(int x, int y, int ch)
{
    return at(flame, W - 1 - x, y, ch);
}
T_CASE(mirror_is_left_to_right)
{
    struct cap_optics o = cap_optics_none;
    o.mirrored = true;
    see(&o);
    T_LE(off(mirrored), 0);
}

/* Gaussians add their variances. */
static double blurred(int x, int y, int ch)
{
    double a = (x - 18.0 - ch) * (x - 18.0 - ch) / (16 + 2.25),
           b = (y - 14.0) * (y - 14.0) / (9 + 2.25);
    return (0.8 - 0.2 * ch) * 4 * 3 / sqrt((16 + 2.25) * (9 + 2.25)) * exp(-0.5 * (a + b));
}
T_CASE(blur_is_a_gaussian)
{
    struct cap_optics o = cap_optics_none;
    o.blur = 1.5;
    see(&o);
    T_LE(off(blurred), 1e-3);     /* cut at 4 sigma and at the picture's edge */
    o.blur = CAP_OPTICS_BLUR_MAX; /* wider than the picture: it ends, and is dim */
    see(&o);
    T_LE(at(got, 18, 14, 0), 0.05);
}

static double scale_of;
static double scaled(int x, int y, int ch)
{
    return scale_of * at(flame, x, y, ch);
}
T_CASE(gain_and_exposure_multiply)
{
    struct cap_optics o = cap_optics_none;
    o.gain = 0.5;
    o.exposure = 8;
    scale_of = 4;
    see(&o);
    T_LE(off(scaled), 1e-6);
    T_LE(1, at(got, 18, 14, 0)); /* clipping is for the caller, after the noise */
}

T_CASE(vignetting_is_cos4_to_the_corner)
{
    struct cap_optics o = cap_optics_none;
    o.vignetting = 0.6;
    see(&o);
    double tan_corner = tan(acos(pow(1 - 0.6, 0.25))), worst = 0;
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++) {
            double rho = hypot(x + 0.5 - W / 2.0, y + 0.5 - H / 2.0) / hypot(W / 2.0, H / 2.0);
            double fall = pow(cos(atan(rho * tan_corner)), 4);
            worst = fmax(worst, fabs(at(got, x, y, 1) - fall * at(flame, x, y, 1)));
        }
    T_LE(worst, 1e-6);
    o.flood = true; /* even light, that no corner is dark in */
    see(&o);
    for (int k = 0; k < N; k++)
        T_LE(1, got[k]);
}

T_CASE(nothing_overflows)
{
    struct cap_optics o = cap_optics_none;
    o.flood = true;
    o.gain = o.exposure = 1000;
    o.response = 10;
    see(&o);
    T_OK(isfinite(got[0]) && got[0] >= 1e30f * 0.999f);
}

static double gamma_of(int x, int y, int ch)
{
    return 0.1 + pow(2 * at(flame, x, y, ch), 0.45);
}
T_CASE(response_is_before_the_pedestal)
{
    struct cap_optics o = cap_optics_none;
    o.gain = 2;
    o.response = 0.45;
    o.pedestal = 0.1;
    see(&o);
    T_LE(off(gamma_of), 1e-6);
}

static double pedestal(int x, int y, int ch)
{
    (void)x, (void)y, (void)ch;
    return 0.02;
}
T_CASE(cap_leaves_the_pedestal_and_wins)
{
    struct cap_optics o = cap_optics_none;
    o.cap = o.flood = true;
    o.flat = 2;
    o.background = 0.5;
    o.gain = 3;
    o.pedestal = 0.02;
    see(&o);
    T_LE(off(pedestal), 1e-7);
    o = cap_optics_none;
    o.empty = true;
    o.pedestal = 0.02;
    see(&o);
    T_LE(off(pedestal), 1e-7);
}

static int hot_pixels(double share, bool *is)
{
    struct cap_optics o = cap_optics_none;
    int n = 0;
    o.hot = share;
    o.cap = true;
    see(&o);
    for (int k = 0; k < W * H; k++) {
        float v = got[NCH * k];
        is[k] = v > 0;
        n += is[k];
        T_OK(v == 0 || (v >= 0.2f && v <= 1));
        T_OK(v == got[NCH * k + 1] && v == got[NCH * k + 2]);
    }
    return n;
}
T_CASE(hot_pixels_stay_where_they_are)
{
    static bool few[W * H], many[W * H];
    int a = hot_pixels(0.02, few), b = hot_pixels(0.2, many);
    T_NEAR(a, 0.02 * W * H, 4 * sqrt(0.02 * W * H));
    T_NEAR(b, 0.2 * W * H, 4 * sqrt(0.2 * W * H));
    for (int k = 0; k < W * H; k++)
        T_OK(!few[k] || many[k]);
    T_EQ_I(hot_pixels(1, few), W * H);
}

static double mean(int x0, int x1)
{
    double sum = 0;
    for (int y = 0; y < H; y++)
        for (int x = x0; x < x1; x++)
            sum += at(got, x, y, 0);
    return sum / H / (x1 - x0);
}
T_CASE(four_places_of_the_flat_are_even)
{
    static double sum[N];
    struct cap_optics o = cap_optics_none;
    for (int place = 1; place <= 4; place++) {
        o.flat = place;
        see(&o);
        T_NEAR(mean(0, W), 0.5, 1e-6);
        double tilt = 0.05 * (1 - 1.0 / W) * cos(M_PI / 2 * (place - 1));
        T_NEAR(at(got, W - 1, 0, 2) - at(got, 0, 0, 2), 2 * tilt, 1e-6);
        for (int k = 0; k < N; k++)
            sum[k] += got[k] / 4;
    }
    for (int k = 0; k < N; k++)
        T_NEAR(sum[k], 0.5, 1e-6);
    o.flat = 5;
    see(&o);
    T_NEAR(at(got, W - 1, 0, 0) - at(got, 0, 0, 0), 0.1 * (1 - 1.0 / W) * cos(M_PI / 4), 1e-6);
}

/* Uneven, faint, the same for the same seed, and it moves with the camera. */
T_CASE(background_is_there_and_moves)
{
    static float still[N];
    struct cap_optics o = cap_optics_none;
    o.empty = true;
    o.background = 0.04;
    see(&o);
    memcpy(still, got, sizeof still);
    double lo = 1, hi = 0;
    for (int k = 0; k < N; k++) {
        lo = fmin(lo, (double)got[k]);
        hi = fmax(hi, (double)got[k]);
    }
    T_LE(0.2 * 0.04 - 1e-6, lo);
    T_LE(hi, 0.04 + 1e-6);
    T_LE(0.01, hi - lo);
    o.shift[0] = 6;
    see(&o);
    for (int x = 6; x < W; x++)
        T_NEAR(at(got, x, 9, 0), at(still, x - 6, 9, 0), 1e-6);
    o.shift[0] = 0;
    o.empty = false; /* behind the flame */
    see(&o);
    T_NEAR(at(got, 18, 14, 0), at(flame, 18, 14, 0) + at(still, 18, 14, 0), 1e-6);
}
