/* bench_previews.c - what a subscriber to previews costs the stage that copies them: carve and offer of a set, 20 sets
 * a second, with one subscriber and with none in turns of two seconds. Wanted 1.05. A preview is made of every
 * second set; its thread has the lowest priority, but works while the next sets are carved. */
#include <unistd.h>

#include "curve.h"
#include "daemon/pipeline/previews.h"
#include "proto/clients/sub.h"
#include "tests/lib/scratch.h"

enum { RATE = 20, SETS = 2 * RATE, TURNS = 6 };

struct bed {
    struct dmn_slot slot;
    struct shot shot;
    dmn_previews *previews;
    char endpoint[96];
};

static int by_size(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* All that came; without an answer the sender's queue would fill. */
static uint64_t drain(pvp_sub *sub)
{
    struct pvp_header h;
    const void *msg;
    size_t len;
    uint64_t n = 0;
    while (sub != NULL && pvp_sub_next(sub, 0, &h, &msg, &len, NULL) == PVX_OK)
        n += h.type == PVP_PREVIEW;
    return n;
}

/* ms of each of SETS sets. */
static uint64_t turn(struct bed *b, bool heard, double *took)
{
    pvp_sub *sub = NULL;
    uint64_t came = 0;
    struct dmn_state st = {0};
    if (heard)
        CHECK(pvp_sub_new(b->endpoint, NULL, &sub, NULL));
    do {
        usleep(1000);
        dmn_previews_state(b->previews, &st);
    } while (st.previews_subscribers != heard);
    int64_t next = pvx_now_mono();
    for (int i = 0; i < SETS; i++) {
        shot_put(&b->shot, b->slot.frame);
        b->slot.set++;
        b->slot.t_exposure_ns = pvx_now_real();
        int64_t t0 = pvx_now_mono();
        rec_frame_carve(b->slot.frame);
        dmn_previews_offer(b->previews, &b->slot);
        took[i] = ms(pvx_now_mono() - t0);
        next += PVX_NS_PER_S / RATE;
        for (int64_t left; (left = next - pvx_now_mono()) > 0;)
            nanosleep(&(struct timespec){.tv_nsec = left}, NULL);
        came += drain(sub);
    }
    pvp_sub_free(&sub);
    return came;
}

static void run(FILE *csv, const int32_t size[3], pvx_pool *pool)
{
    static double took[2][TURNS * SETS];
    static struct dmn_config cfg;
    char text[256];
    struct pvx_diag d = {""};
    struct scene s;
    rec_sysmat *S;
    struct bed b = {.slot.mask = 0xff};
    uint64_t came = 0;
    scene_flame(&s, size, REC_BOX, pool);
    shot_new(&b.shot, &s, &noise_8bit, 1);
    CHECK(rec_sysmat_build(&s.rig, &rec_sysmat_defaults, pool, NULL, NULL, &S, NULL));
    CHECK(rec_frame_alone(S, &s.rig, &rec_frame_defaults, pool, &b.slot.frame, NULL));
    snprintf(text, sizeof text, "publish: {endpoints: ['ipc://%s/v']}\n", dir);
    CHECK(dmn_config_parse(text, strlen(text), "bench", &cfg, &d));
    snprintf(b.endpoint, sizeof b.endpoint, "ipc://%s/v.previews", dir);
    struct pvp_start start = {.grid = {.n = {64, 64, 64}, .max = {1, 1, 1}, .channels = 3},
                              .session = 1,
                              .n_cameras = 8,
                              .fps = RATE};
    const struct dmn_previews_params p = {.config = &cfg,
                                          .rig = &s.rig,
                                          .S = S,
                                          .pool = pool,
                                          .start = &start,
                                          .rig_text = "cameras: []\n"};
    CHECK(dmn_previews_new(&p, &b.previews, &d));
    (void)turn(&b, false, took[0]); /* touches the pages */
    for (int t = 0; t < TURNS; t++)
        for (int heard = 0; heard < 2; heard++)
            came += turn(&b, heard, took[heard] + (size_t)t * SETS);
    double mean[2] = {0, 0};
    for (int heard = 0; heard < 2; heard++) {
        for (int i = 0; i < TURNS * SETS; i++)
            mean[heard] += took[heard][i] / (TURNS * SETS);
        qsort(took[heard], (size_t)TURNS * SETS, sizeof(double), by_size);
    }
    const int half = TURNS * SETS / 2, late = TURNS * SETS * 95 / 100;
    bench_row(csv, "%d,%d,%.1f,%.3f,%.3f,%.3f,%.3f,%.3f,%.3f,%.3f", size[0], size[1],
              (double)came / TURNS / (SETS / RATE), mean[0], mean[1], mean[1] / mean[0],
              took[0][half], took[1][half], took[0][late], took[1][late]);
    dmn_previews_free(&b.previews);
    rec_frame_free(&b.slot.frame);
    rec_sysmat_free(&S);
    shot_free(&b.shot);
    scene_fini(&s);
}

int main(int argc, char **argv)
{
    static const int32_t large[3] = {320, 240, 64};
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    scratch_new();
    FILE *csv = bench_csv(argc, argv, "previews",
                          "width,height,previews/s,ms alone,ms heard,ratio,median alone,"
                          "median heard,95 % alone,95 % heard");
    run(csv, size_64, pool);
    run(csv, large, pool);
    fclose(csv);
    scratch_remove();
    pvx_pool_free(&pool);
    return 0;
}
