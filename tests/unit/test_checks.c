/* test_checks.c - what the daemon calls a camera by its checks, check after check: named when two say so, taken back when two
 * do not, nothing said twice, nobody accused where it cannot be told. */
#include "../t.h"

#include <cjson/cJSON.h>

#include "daemon/control/checks.h"
#include "tests/lib/must.h"
#include "tests/lib/said.h"

static struct rec_rig rig;

struct found {
    enum rec_check_outcome outcome;
    enum rec_wrong cam2;
    uint64_t mask;
    enum rec_wrong known; /* of cam2, by others */
};

static const char *after(struct dmn_checks *k, const struct found *f)
{
    static struct rec_check_verdict v;
    uint8_t known[REC_MAX_CAMERAS] = {0};
    memset(&v, 0, sizeof v);
    if (rig.n_cameras == 0)
        CHECK(rec_rig_ring(5, 2.2, 64, 48, 8, &rig));
    v.outcome = f->outcome;
    v.n_wrong = f->cam2 != REC_WRONG_NOTHING;
    v.figures.camera[2].wrong = f->cam2;
    v.figures.camera[2].sets = 8;
    v.figures.camera[2].gain = 0.85;
    v.figures.camera[2].blur = 3;
    known[2] = (uint8_t)f->known;
    said[0] = '\0';
    dmn_checks_add(k, &(struct dmn_checks_news){&v, f->mask, known}, &rig, &listener);
    return said;
}

static const struct found right = {REC_CHECK_AGREES, REC_WRONG_NOTHING, UINT64_MAX, 0},
                          gain = {REC_CHECK_NAMED, REC_WRONG_GAIN, UINT64_MAX, 0},
                          blur = {REC_CHECK_NAMED, REC_WRONG_BLURRED, UINT64_MAX, 0},
                          torn = {REC_CHECK_UNTOLD, REC_WRONG_GAIN, UINT64_MAX, 0};

static enum rec_wrong called(const struct dmn_checks *k)
{
    return k->camera[2].figures.wrong;
}

T_CASE(named_by_two_checks_and_taken_back_by_two)
{
    struct dmn_checks k = {.patience = 2};
    bad_ones = 0;
    T_EQ_S(after(&k, &right), "");
    T_EQ_S(after(&k, &gain), "");
    T_EQ_I(called(&k), REC_WRONG_NOTHING);
    T_EQ_S(after(&k, &gain),
           "camera cam2 does not agree with the flame: gain: 0.85 times as bright as the others "
           "say; look at exposure, gain and filter: pyrovox calibrate gain\n");
    T_EQ_I(called(&k), REC_WRONG_GAIN);
    T_EQ_S(after(&k, &gain), "");
    T_EQ_S(after(&k, &right), "");
    T_EQ_I(called(&k), REC_WRONG_GAIN);
    T_EQ_S(after(&k, &right), "camera cam2 agrees with the flame again\n");
    T_EQ_I(called(&k), REC_WRONG_NOTHING);
    T_EQ_I(bad_ones, 1);
    T_EQ_I((long long)k.n, 6);
}

T_CASE(what_comes_and_goes_is_not_said)
{
    struct dmn_checks k = {.patience = 2};
    for (int i = 0; i < 20; i++) {
        T_EQ_S(after(&k, i % 2 ? &right : &gain), "");
        T_EQ_I(called(&k), REC_WRONG_NOTHING);
    }
    for (int i = 0; i < 4; i++) /* wrong, but each time in another way */
        T_EQ_S(after(&k, i % 2 ? &blur : &gain), "");
    T_CONTAINS(after(&k, &blur), "blurred: softer than the others by 3.0 px; focus it");
    T_EQ_S(after(&k, &gain), "");
    T_EQ_I(called(&k), REC_WRONG_BLURRED);
    T_CONTAINS(after(&k, &gain), "gain: 0.85"); /* now it is that */
}

T_CASE(where_it_cannot_be_told_nobody_is_accused)
{
    struct dmn_checks k = {.patience = 2};
    T_EQ_S(after(&k, &torn), "");
    T_CONTAINS(after(&k, &torn), "1 of 5 cameras disagree, and which of them are wrong cannot");
    T_EQ_I(called(&k), REC_WRONG_NOTHING);
    T_EQ_S(after(&k, &torn), "");
    T_EQ_S(after(&k, &right), "");
    T_CONTAINS(after(&k, &right), "can be told again");
    (void)after(&k, &gain);
    (void)after(&k, &gain);
    (void)after(&k, &torn);
    (void)after(&k, &torn);
    T_EQ_I(called(&k), REC_WRONG_GAIN); /* and nobody acquitted */
}

/* What the vote or the drift alarm have said is not said again; a camera that is not there keeps its name. */
T_CASE(nothing_twice)
{
    struct dmn_checks k = {.patience = 1};
    struct found now = gain;
    now.known = REC_WRONG_GAIN;
    T_EQ_S(after(&k, &now), "");
    T_EQ_I(called(&k), REC_WRONG_GAIN);
    T_EQ_S(after(&k, &right), "");
    now.known = REC_WRONG_DISAGREES;
    T_CONTAINS(after(&k, &now), "gain: 0.85");
    now = right;
    now.mask = ~(uint64_t)4;
    T_EQ_S(after(&k, &now), "");
    T_EQ_I(called(&k), REC_WRONG_GAIN);
    T_EQ_S(after(&k, &right), "camera cam2 agrees with the flame again\n");
}

T_CASE(is_written)
{
    struct dmn_checks k = {.patience = 1};
    struct dmn_json j;
    static char text[4000];
    for (int n = 0; n < 2; n++) {
        dmn_json_init(&j, text, sizeof text);
        dmn_json_open(&j, NULL, '{');
        dmn_checks_json(&j, &k, 5);
        dmn_json_open(&j, "camera", '{');
        dmn_checks_camera_json(&j, &k, 2);
        dmn_json_close(&j, '}');
        dmn_json_close(&j, '}');
        T_OK(dmn_json_end(&j) > 0);
        cJSON *o = cJSON_Parse(text), *all = cJSON_GetObjectItem(o, "check");
        cJSON *one = cJSON_GetObjectItem(cJSON_GetObjectItem(o, "camera"), "check");
        T_EQ_S(cJSON_GetStringValue(cJSON_GetObjectItem(all, "outcome")), n ? "named" : "");
        T_EQ_S(cJSON_GetStringValue(cJSON_GetObjectItem(one, "wrong")), n ? "gain" : "");
        T_EQ_I(cJSON_GetNumberValue(cJSON_GetObjectItem(one, "sets")), n ? 8 : 0);
        T_EQ_I(cJSON_GetNumberValue(cJSON_GetObjectItem(all, "checks")), n);
        cJSON_Delete(o);
        (void)after(&k, &gain);
    }
    rec_rig_fini(&rig);
}
