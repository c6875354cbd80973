/* bench_room.c - a flame in its virtual room (paper, Figure 9): ms to light the room, once for a volume, and ms of a
 * view of 640x480 with 2 x 2 rays a pixel; 2 threads, best of three. */
#include "base.h"

#include "base/mem.h"
#include "recon/view/flame.h"
#include "recon/view/room.h"

enum { W = 640, H = 480 };

static void measure(FILE *csv, int side, enum rec_basis basis, pvx_pool *pool, float *image)
{
    struct rec_grid g = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {side, side, side}, basis};
    struct rec_flame flame;
    struct rec_flame_pose pose;
    float *v = must_floats(rec_grid_count(&g) * 3);
    rec_flame_init(&flame, &g, 1);
    rec_flame_at(&flame, 0.3, &pose);
    rec_flame_voxels(&pose, &g, 0, side, v);
    size_t lit = 0;
    for (size_t i = 0; i < rec_grid_count(&g); i++) {
        if (v[3 * i] < 0.01f) /* the tails of a Gaussian are no flame */
            memset(v + 3 * i, 0, 3 * sizeof *v);
        lit += v[3 * i] > 0;
    }
    rec_room *room;
    struct rec_camera c;
    int64_t best[2] = {INT64_MAX, INT64_MAX};
    CHECK(rec_room_new(g.min, g.max, pool, &room));
    rec_room_camera(room, 0, 0.35, W, H, &c);
    for (int k = 0; k < 3; k++) {
        int64_t t0 = pvx_now_mono();
        CHECK(rec_room_light(room, &g, v, 3));
        int64_t t1 = pvx_now_mono();
        CHECK(rec_room_render(room, &c, 2, image));
        int64_t t2 = pvx_now_mono();
        best[0] = t1 - t0 < best[0] ? t1 - t0 : best[0];
        best[1] = t2 - t1 < best[1] ? t2 - t1 : best[1];
    }
    bench_row(csv, "%d,%s,%zu,%.0f,%.0f", side, rec_basis_name(basis), lit, ms(best[0]),
              ms(best[1]));
    rec_room_free(&room);
    free(v);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    float *image = must_floats((size_t)W * H * 3);
    printf("\nthe ring's flame in its room, 640x480, 2 x 2 rays a pixel, 2 threads\n");
    FILE *csv = bench_csv(argc, argv, "room", "side,basis,voxels,light_ms,view_ms");
    for (int side = 64; side <= 128; side *= 2) {
        measure(csv, side, REC_BOX, pool, image);
        measure(csv, side, REC_TRILINEAR, pool, image);
    }
    fclose(csv);
    free(image);
    pvx_pool_free(&pool);
    return 0;
}
