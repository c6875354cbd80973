#include "capture/sync/clockfit.h"

#include <math.h>

#include "base/clock.h"
#include "capture/sync/envelope.h"

#define GOOD_DRIFT 50e-6 /* uncertainty of the drift below which the fit is good */
#define FEWEST     3
#define STALE_NS   (10 * PVX_NS_PER_S)
#define UNFIT_NS   100e3 /* a reading off by more than this and the bounds: the clock was changed */
#define GRAIN_NS   1000  /* added to every bound */

void cap_clockfit_forget(struct cap_clockfit *f)
{
    f->n = f->head = 0;
    f->good = false;
}

double cap_clockfit_at(const struct cap_clockfit *f, int64_t x)
{
    return f->diff_ns + f->drift * ((double)x - f->at);
}

bool cap_clockfit_holds(const struct cap_clockfit *f, int64_t x)
{
    return f->good && x - f->newest < STALE_NS;
}

/* (1) */
static void clockfit_fit(struct cap_clockfit *f)
{
    double weight = 0, mx = 0, my = 0, sxx = 0, sxy = 0;
    for (int i = 0; i < f->n; i++) {
        const struct cap_clockfit_reading *r = &f->reading[i];
        double w = 1 / (r->bound_ns * r->bound_ns);
        weight += w;
        mx += w * (double)r->x;
        my += w * r->y;
    }
    mx /= weight;
    my /= weight;
    for (int i = 0; i < f->n; i++) {
        const struct cap_clockfit_reading *r = &f->reading[i];
        double w = 1 / (r->bound_ns * r->bound_ns), x = (double)r->x - mx;
        sxx += w * x * x;
        sxy += w * x * (r->y - my);
    }
    f->at = mx;
    f->diff_ns = my;
    f->bound_ns = 1 / sqrt(weight);
    f->drift_bound = sxx > 0 ? 1 / sqrt(sxx) : INFINITY;
    f->drift = sxx > 0 ? fmin(fmax(sxy / sxx, -CAP_DRIFT_MAX), CAP_DRIFT_MAX) : 0;
    f->good = f->n >= FEWEST && f->drift_bound < GOOD_DRIFT;
}

void cap_clockfit_add(struct cap_clockfit *f, int64_t x, double y, double bound_ns)
{
    double most =
        UNFIT_NS + 3 * (bound_ns + f->bound_ns) + 3 * f->drift_bound * (double)(x - f->newest);
    if (f->good && fabs(y - cap_clockfit_at(f, x)) > most)
        cap_clockfit_forget(f);
    f->reading[f->head] = (struct cap_clockfit_reading){x, y, bound_ns + GRAIN_NS};
    f->head = (f->head + 1) % CAP_CLOCKFIT_READINGS;
    if (f->n < CAP_CLOCKFIT_READINGS)
        f->n++;
    f->newest = x;
    clockfit_fit(f);
}
