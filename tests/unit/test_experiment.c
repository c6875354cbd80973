/* test_experiment.c - what `pyrovox experiment` measures, on pictures of a few bins: each number can be had by hand. */
#include "../t.h"

#include "daemon/cli/experiment/experiment.h"

/* ---- mean difference ---- */

/* In 1/255 of full scale.  The model shows the first four bins; the second of them is saturated, the fourth shows in
 * blue only.  The picture alone has the fifth; the sixth shows too little (0.4), the last is dark in both. */
enum { BINS = 7 };
static const float picture[BINS][3] = {{10, 20, 30}, {255, 255, 255}, {0, 0, 0}, {7, 0, 1},
                                       {8, 4, 0},    {90, 90, 90},    {1, 1, 1}},
                   model[BINS][3] = {{12, 20, 20}, {100, 100, 100}, {6, 3, 0}, {0, 0.1f, 2},
                                     {0, 0, 0},    {0.4f, 0, 0},    {0, 0, 0}},
                   weight[BINS] = {1, 0, 1, 1, 1, 1, 1};
static const uint8_t lit[BINS] = {1, 1, 0, 1, 1, 0, 0};

static float p[BINS * 4], q[BINS * 4];

static struct experiment_view view(int nch, int cs)
{
    for (int r = 0; r < BINS; r++)
        for (int i = 0; i < cs; i++) { /* what pads a bin counts nowhere */
            p[r * cs + i] = i < nch ? picture[r][i] / 255 : 1;
            q[r * cs + i] = i < nch ? model[r][i] / 255 : 0.5F;
        }
    return (struct experiment_view){
        .rows = BINS, .nch = nch, .cs = cs, .p = p, .q = q, .weight = weight, .lit = lit};
}

T_CASE(difference_in_the_models_silhouette_and_with_the_rim)
{
    const struct experiment_view v = view(3, 4);
    struct experiment_error e;
    experiment_difference(&v, &e);
    T_EQ_I(e.bins, 3); /* first, third and fourth */
    T_EQ_I(e.bins_all, 4);
    T_NEAR(e.inside[0], (2 + 6 + 7) / 3.0, 1e-5);
    T_NEAR(e.inside[1], (0 + 3 + 0.1) / 3, 1e-5);
    T_NEAR(e.inside[2], (10 + 0 + 1) / 3.0, 1e-5);
    T_NEAR(e.all[0], (2 + 6 + 7 + 8) / 4.0, 1e-5);
    T_NEAR(e.all[1], (0 + 3 + 0.1 + 4) / 4, 1e-5);
    T_NEAR(e.all[2], (10 + 0 + 1 + 0) / 4.0, 1e-5);
}

/* Red alone: the fourth bin does not show, and is the picture's. */
T_CASE(difference_of_one_channel)
{
    const struct experiment_view v = view(1, 1);
    struct experiment_error e;
    experiment_difference(&v, &e);
    T_EQ_I(e.bins, 2);
    T_EQ_I(e.bins_all, 4);
    T_NEAR(e.inside[0], (2 + 6) / 2.0, 1e-5);
    T_NEAR(e.all[0], (2 + 6 + 7 + 8) / 4.0, 1e-5);
    T_NEAR(e.inside[1] + e.all[2], 0, 0);
}

T_CASE(difference_where_nothing_shows)
{
    struct experiment_view v = view(3, 4);
    struct experiment_error e;
    v.rows = 0;
    experiment_difference(&v, &e);
    T_NEAR(e.bins + e.bins_all + e.inside[0] + e.all[0], 0, 0);
}

/* ---- ghosts ---- */

T_CASE(ghosts_in_an_unused_view)
{
    const struct experiment_view v = view(1, 1);
    double share, difference;
    experiment_ghosts(&v, &share, &difference);
    T_NEAR(share, (6 + 0.4) / (12 + 100 + 6 + 0.4), 1e-6); /* third and sixth */
    T_NEAR(difference, (2 + 155 + 6 + 7 + 8 + 89.6 + 1) / 7, 1e-4);
}

T_CASE(ghosts_in_a_volume)
{
    const float dense[4][2] = {{1, 2}, {0, 3}, {4, 0}, {0, 0}},
                inside[4][2] = {{0, 1}, {0, 0}, {5, 5}, {1, 0}}, none[4][2] = {{0, 0}};
    T_NEAR(experiment_outside(dense[0], inside[0], 4, 2), 3 / 10.0, 1e-12);
    T_NEAR(experiment_outside(dense[0], none[0], 4, 2), 1, 1e-12);
    T_NEAR(experiment_outside(none[0], inside[0], 4, 2), 0, 1e-12);
}

/* ---- choices of views ---- */

static size_t choices(size_t cameras, size_t views)
{
    const struct experiment x = {.rig.n_cameras = cameras};
    return experiment_choices(&x, views);
}

T_CASE(how_many_choices)
{
    T_EQ_I(choices(5, 3), 10);
    T_EQ_I(choices(5, 4), 5);
    T_EQ_I(choices(7, 3), 35); /* all */
    T_EQ_I(choices(7, 4), 35);
    T_EQ_I(choices(8, 3), 35); /* of 56 */
    T_EQ_I(choices(8, 7), 8);
    T_EQ_I(choices(64, 7), 35); /* of 6e8 */
}

T_CASE(all_choices_in_their_order)
{
    static const uint64_t of_5[10] = {7, 11, 19, 13, 21, 25, 14, 22, 26, 28};
    const struct experiment x = {.rig.n_cameras = 5};
    for (size_t k = 0; k < 10; k++)
        T_EQ_I(experiment_choice(&x, 3, k), of_5[k]);
}

/* Each has as many views as were asked for, no two are the same, and the first and the last are there. */
T_CASE(choices_differ_and_are_spread)
{
    for (size_t n = 4; n <= 64; n += n < 12 ? 1 : 13)
        for (size_t views = EXPERIMENT_VIEWS_MIN; views <= EXPERIMENT_VIEWS_MAX && views < n;
             views++) {
            const struct experiment x = {.rig.n_cameras = n};
            uint64_t seen[EXPERIMENT_CHOICES] = {0}, first = ((uint64_t)1 << views) - 1;
            size_t all = experiment_choices(&x, views);
            T_OK(all > 0 && all <= EXPERIMENT_CHOICES);
            if (all == 0 || all > EXPERIMENT_CHOICES)
                return;
            for (size_t k = 0; k < all; k++) {
                seen[k] = experiment_choice(&x, views, k);
                T_EQ_I(__builtin_popcountll(seen[k]), views);
                T_OK(n == 64 || seen[k] >> n == 0);
                for (size_t i = 0; i < k; i++)
                    T_OK(seen[i] != seen[k]);
            }
            T_OK(seen[0] == first);
            T_OK(seen[all - 1] == first << (n - views));
        }
}
