/* bench_proto.c - volumes on their way out: flames on 64^3 and 128^3 in three colours, every number format and
 * compression, one core: the one of the simulated cameras, and what the solver makes of pictures of others ("solved").
 * Least time of a volume; ratio: its floats, dense, over the message; bound: what is read and written over the bandwidth
 * of one core; unpack: least time of a reader's dense volume; most/s on 1 GbE: messages of that size, 117 MB/s. */
#include "volume.h"

static const char *const samples[] = {[PVP_F32] = "f32", [PVP_F16] = "f16"};
static const char *const comps[] = {[PVP_RAW] = "none", [PVP_LZ4] = "lz4", [PVP_ZSTD] = "zstd"};

static double unpacking(const void *msg, size_t len, float *dense, size_t n)
{
    double least = INFINITY;
    pvp_decoder *dec;
    struct pvp_view v;
    CHECK(pvp_decoder_new(&dec));
    for (int r = 0; r < 10; r++) {
        int64_t t0 = pvx_now_mono();
        CHECK(pvp_decode_volume(msg, len, &v, NULL));
        CHECK(pvp_volume_unpack(dec, &v, dense, n, NULL));
        least = fmin(least, ms(pvx_now_mono() - t0));
    }
    pvp_decoder_free(&dec);
    return least;
}

static void encoding(FILE *csv, const char *flame, const struct volume *v, double bandwidth)
{
    struct pvp_volume m = {.grid = v->grid};
    size_t n = pvp_grid_count(&v->grid);
    double floats = (double)n * 4;
    float *dense = must_floats(n);
    for (int sample = PVP_F32; sample <= PVP_F16; sample++)
        for (int comp = PVP_RAW; comp <= PVP_ZSTD; comp++) {
            pvp_encoder *e;
            const void *msg;
            size_t len = 0;
            double least = INFINITY;
            CHECK(pvp_encoder_new(&v->grid, (enum pvp_sample)sample, (enum pvp_compress)comp, &e));
            for (int r = 0; r < 30; r++) {
                int64_t t0 = pvx_now_mono();
                CHECK(pvp_encode_volume(e, (uint64_t)r, &m, &v->x, &msg, &len));
                least = fmin(least, ms(pvx_now_mono() - t0));
            }
            double bound = ((double)v->x.n * 20 + (double)len) / bandwidth * 1e3;
            bench_row(csv, "%s,%u,%s,%s,%.3f,%.2f,%.2f,%.0f,%.3f,%.1f,%.2f,%.0f", flame,
                      v->grid.n[2], samples[sample], comps[comp], volume_lit(v), least, bound,
                      floats / least * 1e-3, (double)len * 1e-6, floats / (double)len,
                      unpacking(msg, len, dense, n), 117e6 / (double)len);
            pvp_encoder_free(&e);
        }
    free(dense);
}

int main(int argc, char **argv)
{
    FILE *csv =
        bench_csv(argc, argv, "proto_encode",
                  "flame,voxels,sample,compress,lit share,ms,bound ms,MB/s,MB,ratio,unpack ms,"
                  "most/s on 1 GbE");
    return volume_each(csv, encoding);
}
