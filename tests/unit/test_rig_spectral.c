/* test_rig_spectral.c - `spectral:` in rig.yaml: read, written and read again, copied, and what is refused. */
#include <string.h>

#include "recon/geom/rig.h"
#include "tests/t.h"

#define HEAD                                                                  \
    "version: 1\n"                                                            \
    "volume: { min: [-0.5,-0.5,0], max: [0.5,0.5,1], voxels: [8,9,10] }\n"    \
    "cameras:\n"                                                              \
    "  - name: left\n    size: [640, 480]\n    K: [500, 500, 319.5, 239.5]\n" \
    "    R: [1,0,0, 0,1,0, 0,0,1]\n    t: [0, 0, 3]\n"
#define CURVES "  red: [0.1, 0.2, 0.3]\n  green: [0.1, 0.5, 0.1]\n  blue: [1, 0.1, 0]\n"
#define CONSTANTS                      \
    "  constant: [1e-5, 2e-5, 3e-5]\n" \
    "  covariance: [4e-4,1e-4,0, 1e-4,4e-4,0, 0,0,9e-4]\n  absolute: true\n"
#define WHERE "spectral:\n  from: 400\n  step: 50\n"

static pvx_err parse(const char *text, struct rec_rig *r, struct pvx_diag *d)
{
    d->text[0] = '\0';
    return rec_rig_parse(text, strlen(text), "rig.yaml", r, d);
}

T_CASE(read_copied_and_written)
{
    struct rec_rig r, copy, again, none;
    struct pvx_diag d;
    char *text;
    size_t len;
    T_EQ_I(parse(HEAD WHERE CURVES CONSTANTS "  exposure: 0.004\n", &r, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(parse(HEAD, &none, &d), PVX_OK);
    T_OK(none.spectral == NULL && r.spectral != NULL);
    T_OK(rec_rig_hash(&r) == rec_rig_hash(&none)); /* geometry alone */
    T_EQ_I(rec_rig_copy(&r, &copy), PVX_OK);
    T_OK(copy.spectral != r.spectral);
    rec_rig_fini(&r);
    T_EQ_I(copy.spectral->n, 3);
    T_NEAR(copy.spectral->response[2][1], 0.1, 0);
    T_NEAR(copy.spectral->covariance[8], 9e-4, 0);
    T_OK(copy.spectral->absolute && copy.spectral->has_exposure);
    T_EQ_I(rec_rig_format(&copy, &text, &len), PVX_OK);
    T_EQ_I(rec_rig_parse(text, len, "again", &again, &d), PVX_OK);
    T_OK(memcmp(again.spectral, copy.spectral, sizeof *again.spectral) == 0);
    free(text);
    rec_rig_fini(&again);
    rec_rig_fini(&copy);
    rec_rig_fini(&none);
    T_OK(none.spectral == NULL);
}

T_CASE(what_is_refused)
{
    static const struct {
        const char *spectral, *part;
    } bad[] = {
        {"spectral: 3\n", "rig.yaml:9: spectral"},
        {"spectral:\n  from: 400\n", "the key 'step' is missing"},
        {WHERE "  red: [1]\n", "rig.yaml:12: spectral.red: should be a list of 2"},
        {WHERE CURVES "  weight: 3\n" CONSTANTS, "weight"},
        {WHERE "  red: [0.1, 0.2, 0.3]\n  green: [0.1, 0.5]\n  blue: [1, 0.1, 0]\n" CONSTANTS,
         "rig.yaml:13: spectral.green"},
        {WHERE "  red: [0, 0, 0]\n  green: [0.1, 0.5, 0]\n  blue: [1, 0.1, 0]\n" CONSTANTS,
         "the red channel sees nothing"},
        {WHERE "  red: [0.1, 2, 0]\n  green: [0.1, 0.5, 0]\n  blue: [1, 0.1, 0]\n" CONSTANTS,
         "spectral.red: 2 is outside 0..1"},
        {"spectral:\n  from: 1990\n  step: 50\n" CURVES CONSTANTS, "ends at 2090 nm"},
        {"spectral:\n  from: 0.4\n  step: 50\n" CURVES CONSTANTS, "spectral.from"},
        {WHERE CURVES
         "  constant: [1, -1, 1]\n  covariance: [0,0,0,0,0,0,0,0,0]\n  absolute: true\n",
         "spectral.constant: -1 is outside"},
        {WHERE CURVES
         "  constant: [1,1,1]\n  covariance: [1e-4,0,0, 0,-1e-4,0, 0,0,1e-4]\n  absolute: true\n",
         "spectral.covariance: is not the covariance"},
        {WHERE CURVES "  constant: [1,1,1]\n  covariance: [1e-4,2e-4,0, 2e-4,1e-4,0, 0,0,1e-4]\n  "
                      "absolute: true\n",
         "spectral.covariance: is not the covariance"},
        {WHERE CURVES "  constant: [1,1,1]\n  covariance: [0,0,0,0,0,0,0,0,0]\n  absolute: maybe\n",
         "spectral.absolute"},
        {WHERE CURVES CONSTANTS "  exposure: 0\n", "spectral.exposure"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char text[4096];
        struct rec_rig r;
        struct pvx_diag d;
        snprintf(text, sizeof text, "%s%s", HEAD, bad[i].spectral);
        T_OK(parse(text, &r, &d) != PVX_OK);
        T_CONTAINS(d.text, bad[i].part);
        T_CONTAINS(d.text, "rig.yaml:");
        T_OK(r.cameras == NULL && r.spectral == NULL);
    }
}
