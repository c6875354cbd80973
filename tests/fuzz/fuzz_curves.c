/* fuzz_curves.c - any bytes as a file of response curves, and of one curve: refused in one line, or curves that are finite, and a
 * response that integrates to something finite. */
#include <math.h>
#include <string.h>

#include "recon/spectral/curves.h"
#include "recon/spectral/planck.h"
#include "tests/fuzz/fuzz.h"

static struct rec_curve curve;

static bool read_as(const uint8_t *data, size_t size, int columns)
{
    struct pvx_diag d = {""};
    if (rec_curve_parse((const char *)data, size, "c.csv", columns, &curve, &d) == PVX_OK)
        return true;
    MUST(strncmp(d.text, "c.csv:", 6) == 0 && strchr(d.text, '\n') == NULL);
    return false;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct rec_curve filter;
    struct rec_spectral s = {0};
    struct pvx_diag d = {""};
    bool one = read_as(data, size, 1);
    if (one) {
        filter = curve;
        MUST(rec_curve_at(&filter, 0, filter.nm[0], -1) >= 0);
    }
    if (read_as(data, size, 3)) {
        fuzz_taken++;
        if (rec_curve_response(&curve, NULL, size % 2 == 0, &s, &d) != PVX_OK) {
            MUST(d.text[0] != '\0');
            return 0;
        }
        MUST(s.n >= 2 && s.n <= REC_SPECTRAL_MAX);
        for (int q = 0; q < 3; q++) {
            double slope, v = rec_planck_channel(&s, q, 1500, NULL, NULL, &slope);
            MUST(isfinite(v) && isfinite(slope) && v >= 0 && slope <= 0);
        }
    }
    fuzz_taken += one;
    return 0;
}
