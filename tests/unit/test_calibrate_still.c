/* What calibrate live decides by: stillness, poses that are known, what joins cameras. */
#include "daemon/cli/calibrate/still.h"

#include "tests/t.h"

enum { CORNERS = 20, CAMERAS = 3 };

struct seen {
    struct rec_board_view view[CAMERAS];
    struct rec_board_corner corner[CAMERAS][CORNERS];
};

/* All corners from `first` on in every camera, moved by (dx, 0), with noise. */
static void see(struct seen *s, uint32_t first, double dx, double noise)
{
    for (uint32_t c = 0; c < CAMERAS; c++) {
        struct rec_board_view *v = &s->view[c];
        *v = (struct rec_board_view){.camera = c, .corner = s->corner[c]};
        for (uint32_t i = first; i < CORNERS; i++)
            v->corner[v->n++] = (struct rec_board_corner){i,
                                                          20.0 * (i % 5) + dx + noise * t_normal(),
                                                          30.0 * (i / 5) + noise * t_normal(),
                                                          {0.01, 0, 0.01}};
    }
}

T_CASE(what_moved_is_told_from_noise)
{
    struct seen a, b;
    see(&a, 0, 0, 0.1);
    see(&b, 0, 0, 0.1);
    T_LE(calibrate_moved(a.view, b.view, CAMERAS, NULL), CALIBRATE_STILL_PX);
    see(&b, 0, 1, 0.1);
    T_LE(CALIBRATE_STILL_PX, calibrate_moved(a.view, b.view, CAMERAS, NULL));
    see(&b, 7, 3, 0); /* other corners: those in common count */
    see(&a, 0, 0, 0);
    T_NEAR(calibrate_moved(a.view, b.view, CAMERAS, NULL), 3, 1e-12);
    const double width[CAMERAS] = {300, 300, 300};
    T_NEAR(calibrate_moved(a.view, b.view, CAMERAS, width), 0.01, 1e-12);
}

/* One camera that sees it badly does not keep the others waiting. */
T_CASE(one_bad_view_has_no_say)
{
    struct seen a, b;
    see(&a, 0, 0, 0.02);
    see(&b, 0, 0, 0.02);
    b.view[2].n = 8;
    for (size_t i = 0; i < 8; i++)
        b.view[2].corner[i].x += 5 * t_normal();
    T_LE(calibrate_moved(a.view, b.view, CAMERAS, NULL), CALIBRATE_STILL_PX);
}

T_CASE(what_cannot_be_compared_has_moved)
{
    struct seen a, b;
    see(&a, 0, 0, 0);
    see(&b, 0, 0, 0);
    for (int c = 0; c < CAMERAS; c++)
        b.view[c].face = REC_BACK;
    T_OK(isinf(calibrate_moved(a.view, b.view, CAMERAS, NULL)));
    see(&b, 0, 0, 0);
    for (int c = 0; c < CAMERAS; c++)
        b.view[c].n = c == 0 ? 5 : 0;
    T_OK(isinf(calibrate_moved(a.view, b.view, CAMERAS, NULL)));
    T_OK(isinf(calibrate_moved(a.view, b.view, 0, NULL)));
}

T_CASE(the_graph_names_what_holds_and_what_lacks)
{
    const uint32_t common[36] = {0, 7, 2, 0, 0, 0, /* 0-1 and 1-2 hold 0 1 2; 3-4; 5 alone */
                                 7, 0, 4, 0, 0, 0, 2, 4, 0, 0, 0, 0, 0, 0, 0,
                                 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0};
    struct calibrate_graph g;
    calibrate_graph(common, 6, &g);
    T_EQ_I(g.n_tree, 3);
    T_OK(g.tree[0].a == 0 && g.tree[0].b == 1 && g.tree[0].common == 7);
    T_OK(g.tree[1].a == 1 && g.tree[1].b == 2 && g.tree[1].common == 4);
    T_OK(g.tree[2].a == 3 && g.tree[2].b == 4 && g.tree[2].common == 1);
    T_EQ_I(g.groups, 3);
    const uint32_t want[6] = {0, 0, 0, 1, 1, 2};
    for (int c = 0; c < 6; c++)
        T_EQ_I(g.group[c], want[c]);
    const uint32_t none[1] = {0};
    calibrate_graph(none, 1, &g);
    T_OK(g.n_tree == 0 && g.groups == 1 && g.group[0] == 0);
}
