#include "capture/sync/envelope.h"

#include <math.h>

#include "base/clock.h"

#define BUCKET_NS   PVX_NS_PER_S
#define EARLY_DRIFT 150e-6 /* a larger early drift comes from a few seconds of a busy network */
#define ABOVE_NS    (5.0 * (double)PVX_NS_PER_MS) /* the line no longer holds if ... */
#define ABOVE_RUN   3 /* ... this many buckets in a row lie this far above it */

double cap_envelope_at(const struct cap_envelope *e, int64_t x)
{
    return e->offset_ns + e->drift * (double)x;
}

void cap_envelope_begin(struct cap_envelope *e, int64_t x, double y)
{
    e->offset_ns = isfinite(y) ? y - e->drift * (double)x : 0;
    e->n = e->head = e->above = 0;
    e->until = x + BUCKET_NS;
    e->current = (struct cap_envelope_bucket){x, y};
}

/* Lower side of the convex hull of the buckets, and its edge over their mean time. */
static void envelope_fit(struct cap_envelope *e)
{
    double x[CAP_ENVELOPE_BUCKETS] = {0}, y[CAP_ENVELOPE_BUCKETS] = {0}, mean = 0;
    int hull = 0;
    for (int i = 0; i < e->n; i++) {
        const struct cap_envelope_bucket *b =
            &e->bucket[(e->head - e->n + i + CAP_ENVELOPE_BUCKETS) % CAP_ENVELOPE_BUCKETS];
        double px = (double)b->x, py = b->y;
        mean += px / e->n;
        while (hull >= 2 && (y[hull - 1] - y[hull - 2]) * (px - x[hull - 2]) >=
                                (py - y[hull - 2]) * (x[hull - 1] - x[hull - 2]))
            hull--;
        x[hull] = px;
        y[hull++] = py;
    }
    int k = 1;
    while (k < hull - 1 && x[k] < mean)
        k++;
    double slope = x[k] > x[k - 1] ? (y[k] - y[k - 1]) / (x[k] - x[k - 1]) : 0;
    double most = e->n < CAP_ENVELOPE_KNOWN ? EARLY_DRIFT : CAP_DRIFT_MAX;
    e->drift = fmin(fmax(slope, -most), most);
    e->offset_ns = INFINITY; /* the line lies below all buckets, also with a clamped drift */
    for (int i = 0; i < hull; i++)
        e->offset_ns = fmin(e->offset_ns, y[i] - e->drift * x[i]);
    e->offset_ns -= fmax(cap_envelope_at(e, e->current.x) - e->current.y, 0);
    e->excess_ns = 0;
    for (int i = 0; i < e->n; i++)
        e->excess_ns += (e->bucket[i].y - cap_envelope_at(e, e->bucket[i].x)) / e->n;
}

/* Keep the current bucket.  If it is the ABOVE_RUN-th in a row above the line, begin the envelope again and return
 * how far above the line it is; else return 0. */
static double keep_bucket(struct cap_envelope *e)
{
    double by = e->current.y - cap_envelope_at(e, e->current.x);
    e->above = e->n >= CAP_ENVELOPE_LINE && by > ABOVE_NS ? e->above + 1 : 0;
    if (e->above == ABOVE_RUN)
        cap_envelope_begin(e, e->current.x, e->current.y);
    else
        by = 0;
    e->bucket[e->head] = e->current;
    e->head = (e->head + 1) % CAP_ENVELOPE_BUCKETS;
    if (e->n < CAP_ENVELOPE_BUCKETS)
        e->n++;
    return by;
}

bool cap_envelope_add(struct cap_envelope *e, int64_t x, double y, double *above_ns)
{
    bool full = x >= e->until;
    *above_ns = full && isfinite(e->current.y) ? keep_bucket(e) : 0;
    if (full)
        e->until = x + BUCKET_NS;
    if (full || y < e->current.y)
        e->current = (struct cap_envelope_bucket){x, y};
    if (full && e->n >= CAP_ENVELOPE_LINE)
        envelope_fit(e);
    double below = cap_envelope_at(e, x) - y;
    if (below > 0)
        e->offset_ns -= below;
    return full || below > 0;
}
