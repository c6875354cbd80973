/* test_metrics.c - known distances. */
#include "../t.h"

#include "recon/view/metrics.h"
#include "tests/lib/likeness.h"

T_CASE(rel_l2)
{
    float a[2] = {3, 0}, b[2] = {0, 4}, z[2] = {0, 0};
    T_NEAR(rec_rel_l2(a, b, 2), 5.0 / 4, 1e-12);
    T_NEAR(rec_rel_l2(b, b, 2), 0, 0);
    T_NEAR(rec_rel_l2(z, z, 2), 0, 0);
    T_NEAR(rec_rel_l2(a, z, 2), 1e9, 0);
}

T_CASE(mean_abs)
{
    float a[4] = {0, 1, 0.5f, 0.5f}, b[4] = {0.1f, 0.9f, 0.5f, 0.5f};
    T_NEAR(image_mean_abs_255(a, b, 4), 255 * 0.05, 1e-5);
    T_NEAR(image_mean_abs_255(a, b, 0), 0, 0);
}
