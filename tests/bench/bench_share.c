/* bench_share.c - a volume from the message to NanoVDB in shared memory (`pyrovox share`), one core.
 *
 * Flames in three colours as half floats, LZ4: unpack: from the message to bricks; make: from bricks to the grids that
 * readers map, the newest slot each time; both: median and 99 % of SETS.  vectors: density and emission; split: density, red,
 * green, blue; one: the bricks' red alone, as of a grey rig.
 * bound: the grids' bytes over the bandwidth of one core (a = b + 3c). */
#include <unistd.h>

#include "base/median.h"
#include "daemon/volumes/bricks.h"
#include "daemon/volumes/share.h"
#include "proto/clients/pyrovox_share.h"
#include "volume.h"

enum { SETS = 200 };

static const char *const kinds[] = {"one", "vectors", "split"};

static double quantile(double *t, double q)
{
    qsort(t, SETS, sizeof *t, pvx_ascending);
    return t[(int)(q * (SETS - 1))];
}

/* The same with its first channel alone. */
static struct volume grey(const struct volume *v)
{
    struct volume g = *v;
    g.grid.channels = 1;
    return g;
}

static void shared(FILE *csv, const char *flame, const struct volume *of, int kind,
                   double bandwidth)
{
    static double unpack[SETS], make[SETS], both[SETS];
    const struct volume v = kind == 0 ? grey(of) : *of;
    const struct pvp_start start = {.grid = v.grid, .session = 1, .n_cameras = 8, .fps = 20};
    struct pvp_volume about = {.grid = v.grid, .report.solver = "pcg"};
    struct pvx_diag d = {""};
    char name[64];
    pvp_encoder *enc;
    pvp_decoder *dec;
    struct vol_store s = {0};
    struct pvp_view view;
    struct pvp_share r;
    struct pvp_share_volume last;
    vol_share *out;
    const void *msg;
    size_t len;
    snprintf(name, sizeof name, "bench-share-%d", (int)getpid());
    bench_check(vol_share_new(&(struct vol_share_config){name, 0600, kind == 2}, &out, &d), &d);
    CHECK(pvp_encoder_new(&v.grid, PVP_F16, PVP_LZ4, &enc));
    CHECK(pvp_decoder_new(&dec));
    CHECK(pvp_encode_volume(enc, 0, &about, &v.x, &msg, &len));
    for (int k = -9; k < SETS; k++) { /* the first ones touch the pages */
        int64_t t0 = pvx_now_mono();
        bench_check(pvp_decode_volume(msg, len, &view, &d), &d);
        CHECK(vol_store_grow(&s, view.n_bricks, v.grid.channels));
        size_t floats = (size_t)view.n_bricks * 512 * v.grid.channels;
        bench_check(pvp_volume_bricks(dec, &view, s.ids, s.brick, floats, &d), &d);
        int64_t t1 = pvx_now_mono();
        const struct vol_volume put = {.v = view.v,
                                       .sample = view.sample,
                                       .n_bricks = view.n_bricks,
                                       .ids = s.ids,
                                       .brick = s.brick};
        bench_check(vol_share_put(out, &start, &put, &d), &d);
        int64_t t2 = pvx_now_mono();
        if (k < 0)
            continue;
        unpack[k] = ms(t1 - t0);
        make[k] = ms(t2 - t1);
        both[k] = ms(t2 - t0);
    }
    if (pvp_share_open(&r, name) != PVP_SHARE_OK || pvp_share_newest(&r, &last) != PVP_SHARE_OK)
        exit(1);
    double bound = (double)last.size / bandwidth * 1e3;
    bench_row(csv, "%s,%u,%s,%.3f,%u,%.2f,%.2f,%.2f,%.2f,%.2f,%.2f,%.1f", flame, v.grid.n[2],
              kinds[kind], volume_lit(&v) * v.grid.channels / 3, view.n_bricks,
              (double)last.size * 1e-6, quantile(unpack, 0.5), quantile(make, 0.5),
              quantile(both, 0.5), quantile(both, 0.99), bound, quantile(make, 0.5) / bound);
    pvp_share_close(&r);
    vol_share_free(&out);
    vol_store_free(&s);
    pvp_encoder_free(&enc);
    pvp_decoder_free(&dec);
}

static void flame(FILE *csv, const char *name, const struct volume *v, double bandwidth)
{
    for (int kind = 0; kind < 3; kind++)
        shared(csv, name, v, kind, bandwidth);
}

int main(int argc, char **argv)
{
    FILE *csv = bench_csv(argc, argv, "share",
                          "flame,voxels,grids,lit share,bricks,MB,unpack ms,make ms,both ms,"
                          "both p99 ms,bound ms,make over bound");
    return volume_each(csv, flame);
}
