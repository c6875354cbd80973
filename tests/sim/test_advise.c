/* test_advise.c - `pyrovox advise` on some of the random scenes whose needs are known. */
#include "../t.h"

#include "tests/bench/advise_scenes.h"

static pvx_pool *pool;

static void right(long number)
{
    static struct advise_scene s;
    static struct advice a;
    struct pvx_diag d = {""};
    bool found[ADVISE_TERMS], needed[ADVISE_TERMS];
    advise_scene_new(&s, (uint64_t)(number + (1L << 40)), number >= 0, pool);
    s.sets.params.voxels = 24; /* less than is usual, and enough here */
    T_EQ_I(advise_terms(&s.sets, &a, &d), PVX_OK);
    advise_verdict(&s, &a, needed, found);
    for (int k = 0; k < ADVISE_TERMS; k++)
        T_CHECK_(needed[k] == found[k], "scene %ld, %s: needed %d, found %d", number,
                 advise_term_names[k], needed[k], found[k]);
    if (s.needs.gain)
        T_EQ_I(a.gain.worst, s.which);
    advise_scene_free(&s);
}

/* Pictures that are clipped at 12 bits of 16 are dark for 16 bits, but not too dark. */
T_CASE(clipped_pictures_need_no_more_light)
{
    static struct flame_sets s;
    static struct advice a;
    a.brightest = 0.06;
    s.depth = (struct cap_depth){.top = 4094, .n = 9};
    T_EQ_S(advise_exposure(&s, &a), "raise");
    s.depth.top = 4095;
    T_EQ_S(advise_exposure(&s, &a), "fine");
    T_OK(advise_first(&s, &a) == NULL);
    a.gain.on = true;
    T_CONTAINS(advise_first(&s, &a), "first correct the gains");
    a.saturated = 0.06;
    T_EQ_S(advise_exposure(&s, &a), "lower");
    T_CONTAINS(advise_first(&s, &a), "first expose a quarter as long");
}

T_CASE(a_black_level_and_a_body)
{
    T_NOT_UNDER_TSAN();
    right(-28);
}
T_CASE(a_flame_that_absorbs)
{
    T_NOT_UNDER_SANITIZERS();
    right(-32);
}
T_CASE(a_camera_of_another_gain_and_a_black_level)
{
    T_NOT_UNDER_SANITIZERS();
    T_ONLY_LONG(); /* the black level is in the first scene, the gain in the last */
    right(-35);
}

T_CASE(pictures_that_are_a_power_of_the_light)
{
    T_NOT_UNDER_SANITIZERS();
    right(376); /* a camera of another gain besides; a ring */
}

T_MAIN(if (pvx_pool_new(2, "test", &pool) != PVX_OK) return 2, pvx_pool_free(&pool))
