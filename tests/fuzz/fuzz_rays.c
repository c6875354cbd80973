/* fuzz_rays.c - any bytes as a file of 4 x 3 rays or bundles.
 * Refused in one line, or rays that project somewhere finite. */
#include <math.h>
#include <string.h>

#include "recon/geom/ray_table.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct pvx_diag d = {""};
    struct rec_ray_table *t;
    pvx_err e = rec_ray_table_parse((const char *)data, size, 4, 3, &t, &d);
    if (e != PVX_OK) {
        MUST(t == NULL && strchr(d.text, '\n') == NULL);
        MUST(e == PVX_ENOMEM || d.text[0] != '\0');
        return 0;
    }
    fuzz_taken++;
    for (int i = 0; i < 12; i++) {
        double line[4], xy[2];
        if (!rec_ray_table_at(t, i % 4, i / 4, line, NULL))
            continue;
        for (int32_t k = 0; k < t->rays && t->off != NULL; k++) {
            double one[4];
            MUST(rec_ray_table_one(t, i % 4, i / 4, k, one) && isfinite(one[0] + one[2]));
        }
        const double X[3] = {line[0] + 2 * line[2], line[1] + 2 * line[3], 2};
        if (rec_ray_table_find(t, X, xy))
            MUST(isfinite(xy[0]) && isfinite(xy[1]));
    }
    MUST(isfinite(rec_ray_table_disc(t, (const double[2]){0, 2})));
    rec_ray_table_free(t);
    return 0;
}
