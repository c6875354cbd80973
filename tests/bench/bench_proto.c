/* bench_proto.c - volumes on their way out.
 *
 * (a) encoding: the flame of the simulated cameras on 64^3 and 128^3 in three colours, every number format
 *     and compression, one core: least time of a volume; ratio: its floats, dense, over the message;
 *     bound: what is read and written over the bandwidth of one core.
 * (b) fan-out: 64^3 at 60 volumes a second over ipc to 0 to 16 subscribers, processes of their own that
 *     unpack each, and one more that is stopped with SIGSTOP: time of a publish, volumes that came,
 *     latency from publish to unpacked, growth of the publisher's memory. */
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/hist.h"
#include "proto/clients/sub.h"
#include "proto/pub.h"
#include "volume.h"

enum { FLOW = 300, RATE = 60 };

static const char *const samples[] = {[PVP_F32] = "f32", [PVP_F16] = "f16"};
static const char *const comps[] = {[PVP_RAW] = "none", [PVP_LZ4] = "lz4", [PVP_ZSTD] = "zstd"};

static void encoding(FILE *csv, int side, double bandwidth)
{
    struct volume v = volume_ring(side, 0.3);
    struct pvp_volume m = {.grid = v.grid};
    double floats = (double)pvp_grid_count(&v.grid) * 4;
    for (int sample = PVP_F32; sample <= PVP_F16; sample++)
        for (int comp = PVP_RAW; comp <= PVP_ZSTD; comp++) {
            pvp_encoder *e;
            const void *msg;
            size_t len = 0;
            double least = INFINITY;
            CHECK(pvp_encoder_new(&v.grid, (enum pvp_sample)sample, (enum pvp_compress)comp, &e));
            for (int r = 0; r < 30; r++) {
                int64_t t0 = pvx_now_mono();
                CHECK(pvp_encode_volume(e, (uint64_t)r, &m, &v.x, &msg, &len));
                least = fmin(least, ms(pvx_now_mono() - t0));
            }
            double bound = ((double)v.x.n * 20 + (double)len) / bandwidth * 1e3;
            bench_row(csv, "encode,%d,%s,%s,%.3f,%.2f,%.2f,%.0f,%.1f", side, samples[sample],
                      comps[comp], 3.0 * v.x.n / (double)pvp_grid_count(&v.grid), least, bound,
                      floats / least * 1e-3, floats / (double)len);
            pvp_encoder_free(&e);
        }
    volume_free(&v);
}

/* ---- fan-out ------------------------------------------------------------------------------------ */

struct tally {
    uint64_t volumes;
    struct pvx_hist latency;
};

/* A process: unpacks until the end, then says what came.  It has no threads yet when it is made. */
static pid_t subscriber(const char *endpoint, int *from)
{
    int ends[2];
    if (pipe(ends) != 0)
        exit(1);
    fflush(NULL);
    pid_t p = fork();
    *from = ends[0];
    if (p != 0) {
        close(ends[1]);
        return p;
    }
    static struct tally t;
    pvp_sub *sub;
    pvp_decoder *dec;
    struct pvp_header h;
    struct pvp_view v;
    const void *msg;
    size_t len, n;
    CHECK(pvp_sub_new(endpoint, NULL, &sub, NULL));
    CHECK(pvp_decoder_new(&dec));
    float *dense = NULL;
    while (pvp_sub_next(sub, 20 * PVX_NS_PER_S, &h, &msg, &len, NULL) == PVX_OK &&
           h.type != PVP_END) {
        if (h.type != PVP_VOLUME)
            continue;
        n = pvp_grid_count(&pvp_sub_start(sub)->grid);
        if (dense == NULL)
            dense = must_floats(n);
        CHECK(pvp_decode_volume(msg, len, &v, NULL));
        CHECK(pvp_volume_unpack(dec, &v, dense, n, NULL));
        t.volumes++;
        pvx_hist_add(&t.latency, pvx_now_real() - v.v.t_publish_ns);
    }
    _exit(write(ends[1], &t, sizeof t) != sizeof t);
}

static double resident_mib(void)
{
    long all = 0, pages = 0;
    FILE *f = fopen("/proc/self/statm", "r");
    if (f == NULL || fscanf(f, "%ld %ld", &all, &pages) != 2)
        pages = 0;
    if (f != NULL)
        fclose(f);
    return (double)pages * (double)sysconf(_SC_PAGESIZE) / (1 << 20);
}

/* After all others of the run: who is stopped still holds its place. */
static void fan_out(FILE *csv, const struct volume *v, int healthy, bool stopped)
{
    enum { MOST = 17 };
    static struct tally t, all;
    struct pvx_hist took = {0};
    char endpoint[64];
    int from[MOST], n = healthy + stopped;
    pid_t who[MOST];
    all = (struct tally){0};
    snprintf(endpoint, sizeof endpoint, "ipc:///tmp/pyrovox-bench-%ld", (long)getpid());
    for (int i = 0; i < n; i++)
        who[i] = subscriber(endpoint, &from[i]);
    const char *at = endpoint;
    struct pvp_pub_params params = {
        .endpoints = &at, .n_endpoints = 1, .sample = PVP_F16, .comp = PVP_RAW};
    struct pvp_start start = {.grid = v->grid, .session = 1, .n_cameras = 8, .fps = RATE};
    struct pvx_diag d = {""};
    pvp_pub *pub;
    if (pvp_pub_new(&params, &start, &pub, &d) != PVX_OK) {
        fprintf(stderr, "bench_proto: %s\n", d.text);
        exit(1);
    }
    while (pvp_pub_subscribers(pub) < (size_t)n) {
        pvp_pub_tick(pub);
        usleep(1000);
    }
    if (stopped)
        kill(who[n - 1], SIGSTOP);
    double before = resident_mib();
    int64_t next = pvx_now_mono();
    for (uint64_t set = 0; set < FLOW; set++) {
        struct pvp_volume m = {.set = set, .grid = v->grid, .t_publish_ns = pvx_now_real()};
        int64_t t0 = pvx_now_mono();
        CHECK(pvp_pub_volume(pub, &m, &v->x, NULL));
        pvx_hist_add(&took, pvx_now_mono() - t0);
        next += PVX_NS_PER_S / RATE;
        while (pvx_now_mono() < next)
            usleep(200);
    }
    double grown = resident_mib() - before;
    CHECK(pvp_pub_end(pub, "done"));
    for (int i = 0; i < n; i++) {
        if (i >= healthy) {
            kill(who[i], SIGKILL);
        } else if (read(from[i], &t, sizeof t) == sizeof t) {
            all.volumes += t.volumes;
            for (int k = 0; k < PVX_HIST_BUCKETS; k++)
                all.latency.bucket[k] += t.latency.bucket[k];
            all.latency.count += t.latency.count;
            if (all.latency.max_ns < t.latency.max_ns)
                all.latency.max_ns = t.latency.max_ns;
        }
        close(from[i]);
        waitpid(who[i], NULL, 0);
    }
    pvp_pub_free(&pub);
    bench_row(csv, "fan-out,%d,%s,%.3f,%.3f,%.3f,%.2f,%.2f,%.1f", healthy,
              stopped ? "one more stopped" : "", ms(pvx_hist_quantile(&took, 0.5)),
              ms(pvx_hist_quantile(&took, 0.99)),
              healthy > 0 ? (double)all.volumes / (FLOW * healthy) : 1,
              ms(pvx_hist_quantile(&all.latency, 0.5)), ms(pvx_hist_quantile(&all.latency, 0.99)),
              grown);
}

int main(int argc, char **argv)
{
    static const int crowds[] = {0, 1, 4, 16};
    FILE *csv = bench_csv(argc, argv, "proto",
                          "part,voxels,sample,compress,lit share,ms,bound ms,MB/s,ratio");
    struct volume v = volume_ring(64, 0.3);
    bench_row(csv,
              "part,healthy,,publish p50,publish p99,came share,latency p50,latency p99,grown MiB");
    for (size_t i = 0; i < sizeof crowds / sizeof *crowds; i++)
        fan_out(csv, &v, crowds[i], false);
    fan_out(csv, &v, 16, true);
    volume_free(&v);
    pvx_pool *one; /* threads only now: who forks has none */
    CHECK(pvx_pool_new(1, "bench", &one));
    double bandwidth = bench_bandwidth((size_t)96 << 20, one);
    bench_row(csv, "part,voxels,sample,compress,lit share,ms,bound ms,MB/s,ratio");
    encoding(csv, 64, bandwidth);
    encoding(csv, 128, bandwidth);
    pvx_pool_free(&one);
    fclose(csv);
    return 0;
}
