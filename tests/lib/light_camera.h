/* light_camera.h - a camera with faults, in its own words: samples of what it is shown.
 *
 *     light = gain * vignetting(x, y) * (1 + 0.02 prnu(x, y)) * radiance + pedestal,  + noise,
 *     sample = full * curve(light),  curve(l) = (1 - bend) l + bend sqrt(l)
 * Nothing of it is Pyrovox's code but the random numbers. */
#ifndef LIGHT_CAMERA_H
#define LIGHT_CAMERA_H
#include <math.h>
#include <stdint.h>

#include "tests/lib/normal.h"

struct light_camera {
    int w, h;
    double gain, bend, pedestal, read, shot; /* variance read^2 + shot * light above the pedestal */
    double corner;                           /* vignetting there; 1 = none */
    unsigned full;
    int hot_x, hot_y, dead_x, dead_y; /* -1: none */
    uint64_t seed;
};

static inline double light_sensitivity(const struct light_camera *c, int x, int y)
{
    double u = 2.0 * (x + 0.5) / c->w - 1, v = 2.0 * (y + 0.5) / c->h - 1;
    uint64_t s = c->seed * 0x9E3779B97F4A7C15u + (uint64_t)(y * c->w + x) * 0xD1B54A32D192ED03u + 1;
    pvx_random(&s);
    return (1 - (1 - c->corner) * (u * u + v * v) / 2) * (1 + 0.02 * (2 * pvx_uniform(&s) - 1));
}

static inline double light_curve(const struct light_camera *c, double l)
{
    return (1 - c->bend) * l + c->bend * sqrt(l > 0 ? l : 0);
}

static inline unsigned light_sample(const struct light_camera *c, int x, int y, double radiance,
                                    uint64_t *state)
{
    double l = c->gain * light_sensitivity(c, x, y) * radiance;
    if (x == c->dead_x && y == c->dead_y)
        l = 0;
    l += c->pedestal + sqrt(c->read * c->read + c->shot * fmax(l, 0)) * normal_deviate(state);
    if (x == c->hot_x && y == c->hot_y)
        l += 0.3;
    double s = c->full * light_curve(c, l) + 0.5;
    return s < 0 ? 0 : s > c->full ? c->full : (unsigned)s;
}
#endif
