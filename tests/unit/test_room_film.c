/* test_room_film.c - a flame in its room as the commands show it: side by side, and once round as a film. */
#include "tests/t.h"

#include "base/mem.h"
#include "capture/files/imgio.h"
#include "daemon/cli/pictures/room_film.h"
#include "daemon/cli/pictures/strip.h"
#include "tests/lib/plugins.h"
#include "tests/lib/scratch.h"

enum { W = 36, H = 24, VIEWS = 4 };
static const struct rec_grid grid = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {8, 8, 8}, REC_TRILINEAR};

static float *flame(int nch)
{
    float *v = pvx_calloc(512 * (size_t)nch, sizeof *v);
    T_OK(v != NULL);
    for (size_t i = 0; i < 512; i++)
        for (int c = 0; c < nch; c++)
            if (i % 8 > 1 && i % 8 < 6 && i / 8 % 8 > 1 && i / 8 % 8 < 6 && i / 64 > 0)
                v[i * (size_t)nch + (size_t)c] = (float)(2 - 0.5 * c);
    return v;
}

static double byte_of(double v)
{
    return rint(255 * pow(fmin(1, v), 1 / 2.2));
}

static bool stop_after_two(void *ctx, double done)
{
    *(int *)ctx += 1;
    return done < 0.49;
}

/* Frame v of the film is the view at v / VIEWS of the circle, exposed; stopped, it has what there was. */
T_CASE(film_is_the_views)
{
    struct pvx_diag d = {""};
    float *v = flame(3), image[W * H * 3];
    struct dmn_room_film p = dmn_room_film_defaults;
    p.views = VIEWS;
    p.width = W;
    p.height = H;
    T_EQ_I(dmn_room_film_save(&grid, v, 3, &p, NULL, at("room.apng"), &d), PVX_OK);
    rec_room *room;
    double factor;
    T_EQ_I(dmn_room_of(&grid, v, 3, NULL, &room), PVX_OK);
    T_EQ_I(dmn_room_exposure(&grid, v, 3, NULL, &factor), PVX_OK);
    cap_video *film;
    struct cap_image img;
    T_EQ_I(cap_video_open(at("room.apng"), &film, NULL, &d), PVX_OK);
    for (int k = 0; k < VIEWS; k++) {
        struct rec_camera c;
        rec_room_camera(room, k * 1.5707963267948966, 0.3490658503988659, W, H, &c);
        T_EQ_I(rec_room_render(room, &c, 2, image), PVX_OK);
        T_EQ_I(cap_video_next(film, &img, NULL, &d), PVX_OK);
        for (int i = 0; i < W * H * 3; i++)
            T_NEAR(((const uint8_t *)img.data)[i], byte_of(factor * image[i]), 1);
    }
    T_EQ_I(cap_video_next(film, &img, NULL, &d), PVX_ECLOSED);
    cap_video_close(&film);
    int calls = 0;
    p.progress = stop_after_two;
    p.ctx = &calls;
    T_EQ_I(dmn_room_film_save(&grid, v, 3, &p, NULL, at("cut.apng"), &d), PVX_ECANCELED);
    T_EQ_I(calls, 2);
    T_EQ_I(cap_video_open(at("cut.apng"), &film, NULL, &d), PVX_OK);
    for (int k = 0; k < 2; k++)
        T_EQ_I(cap_video_next(film, &img, NULL, &d), PVX_OK);
    T_EQ_I(cap_video_next(film, &img, NULL, &d), PVX_ECLOSED);
    cap_video_close(&film);
    p.views = 0;
    T_EQ_I(dmn_room_film_save(&grid, v, 3, &p, NULL, at("no.apng"), &d), PVX_EINVAL);
    rec_room_free(&room);
    free(v);
}

/* A strip of one channel has the same exposure; a dark volume gives a dark picture, not an error. */
T_CASE(strip_in_the_room)
{
    struct pvx_diag d = {""};
    struct dmn_strip_params p = dmn_strip_defaults;
    p.width = W;
    p.height = H;
    p.views = 2;
    p.deg1 = 180;
    p.room = true;
    for (int dark = 0; dark < 2; dark++) {
        float *v = flame(1), image[W * H];
        if (dark)
            memset(v, 0, 512 * sizeof *v);
        T_EQ_I(dmn_strip_save(&grid, v, 1, &p, NULL, at("strip.png"), &d), PVX_OK);
        struct cap_loaded l;
        T_EQ_I(cap_image_load(at("strip.png"), &l, &d), PVX_OK);
        T_OK(l.img.width == 2 * W && l.img.height == H);
        rec_room *room;
        double factor;
        struct rec_camera c;
        T_EQ_I(dmn_room_of(&grid, v, 1, NULL, &room), PVX_OK);
        T_EQ_I(dmn_room_exposure(&grid, v, 1, NULL, &factor), PVX_OK);
        rec_room_camera(room, 3.141592653589793, p.elevation_deg / 57.29577951308232, W, H, &c);
        T_EQ_I(rec_room_render(room, &c, p.sub, image), PVX_OK);
        int seen = 0;
        for (int i = 0; i < W * H; i++) {
            int got = ((const uint8_t *)l.img.data)[i / W * 2 * W + W + i % W];
            T_NEAR(got, byte_of(factor * image[i]), 1);
            seen += got > 20;
        }
        T_OK(dark ? seen == 0 : seen > W * H / 2);
        rec_room_free(&room);
        cap_loaded_free(&l);
        free(v);
    }
}

T_MAIN((scratch_new(), plugins_of_this_build()), scratch_remove())
