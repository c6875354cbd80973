/* test_votes.c - what is said of cameras that are left out, counted and written, set after set. */
#include "../t.h"

#include "tests/lib/must.h"
#include "tests/lib/said.h"

static struct rec_rig rig;

/* One more set of this state, camera 2 out for this or believed; what is said of it. */
static const char *after(struct dmn_votes *v, enum rec_vote_state state, enum rec_wrong why)
{
    struct rec_verdict set = {.state = state, .out = why != REC_WRONG_NOTHING ? 4 : 0};
    set.why[2] = (uint8_t)why;
    said[0] = '\0';
    if (rig.n_cameras == 0)
        CHECK(rec_rig_ring(5, 2.2, 64, 48, 8, &rig));
    dmn_votes_add(v, &set, &rig, &listener);
    return said;
}

T_CASE(says_what_changes_and_no_more)
{
    struct dmn_votes v = {0};
    bad_ones = 0;
    T_EQ_S(after(&v, REC_VOTE_AGREE, REC_WRONG_NOTHING), "");
    T_CONTAINS(after(&v, REC_VOTE_OUT, REC_WRONG_DISAGREES),
               "camera cam2 is left out, it contradicts the others: disagrees; compare it");
    T_EQ_S(after(&v, REC_VOTE_OUT, REC_WRONG_DISAGREES), "");
    T_CONTAINS(after(&v, REC_VOTE_OUT, REC_WRONG_GAIN),
               "gain; look at exposure"); /* now it is clear */
    T_EQ_S(after(&v, REC_VOTE_OUT, REC_WRONG_DISAGREES), "");
    T_EQ_S(after(&v, REC_VOTE_DARK, REC_WRONG_NOTHING), ""); /* no flame: nothing to judge by */
    T_EQ_I(v.out, 4);
    T_EQ_S(after(&v, REC_VOTE_AGREE, REC_WRONG_NOTHING),
           "camera cam2 agrees with the others again and is back\n");
    T_CONTAINS(after(&v, REC_VOTE_TORN, REC_WRONG_NOTHING), "cannot be told");
    T_EQ_S(after(&v, REC_VOTE_TORN, REC_WRONG_NOTHING), "");
    T_EQ_S(after(&v, REC_VOTE_AGREE, REC_WRONG_NOTHING), "the cameras agree again\n");
    T_CONTAINS(after(&v, REC_VOTE_FEW, REC_WRONG_NOTHING), "fewer than four cameras");
    T_EQ_S(after(&v, REC_VOTE_FEW, REC_WRONG_NOTHING), "");
    T_EQ_S(after(&v, REC_VOTE_NONE, REC_WRONG_NOTHING), "");
    T_EQ_I(bad_ones, 3);
    T_EQ_I(v.left_out[2][REC_WRONG_DISAGREES], 3);
    T_EQ_I(v.left_out[2][REC_WRONG_GAIN], 1);
    T_EQ_I(v.torn, 2);
}

T_CASE(what_comes_and_goes_is_not_said)
{
    struct dmn_votes v = {.patience = 4};
    for (int k = 0; k < 20; k++)
        T_EQ_S(after(&v, k % 2 ? REC_VOTE_TORN : REC_VOTE_AGREE, REC_WRONG_NOTHING), "");
    T_EQ_I(v.torn, 10);
    for (int k = 0; k < 2; k++)
        T_EQ_S(after(&v, REC_VOTE_TORN, REC_WRONG_NOTHING), "");
    T_CONTAINS(after(&v, REC_VOTE_TORN, REC_WRONG_NOTHING), "cannot be told");
    for (int k = 0; k < 3; k++)
        T_EQ_S(after(&v, REC_VOTE_AGREE, REC_WRONG_NOTHING), "");
    T_EQ_S(after(&v, REC_VOTE_AGREE, REC_WRONG_NOTHING), "the cameras agree again\n");
}

T_CASE(is_written)
{
    struct dmn_votes v = {0};
    struct dmn_json j;
    char text[1000];
    (void)after(&v, REC_VOTE_OUT, REC_WRONG_DARK);
    dmn_json_init(&j, text, sizeof text);
    dmn_json_open(&j, NULL, '{');
    dmn_votes_camera_json(&j, &v, 2);
    dmn_json_close(&j, '}');
    T_OK(dmn_json_end(&j) > 0);
    cJSON *o = cJSON_Parse(text), *k = cJSON_GetObjectItem(o, "vote");
    T_OK(cJSON_IsTrue(cJSON_GetObjectItem(k, "out")));
    const char *why = cJSON_GetStringValue(cJSON_GetObjectItem(k, "why"));
    T_EQ_S(why != NULL ? why : "", "dark");
    T_EQ_I(cJSON_GetNumberValue(cJSON_GetObjectItem(k, "sets")), 1);
    T_EQ_I(cJSON_GetNumberValue(cJSON_GetObjectItem(cJSON_GetObjectItem(k, "causes"), "dark")), 1);
    cJSON_Delete(o);
    rec_rig_fini(&rig);
}
