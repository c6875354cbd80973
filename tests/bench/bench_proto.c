/* bench_proto.c - volumes on their way out.
 *
 * (a) encoding: flames on 64^3 and 128^3 in three colours, every number format and compression, one core: the one of
 *     the simulated cameras, and what the solver makes of pictures of others ("solved"); least time of a volume;
 *     ratio: its floats, dense, over the message; bound: what is read and written over the bandwidth of one core;
 *     unpack: least time of a reader's dense volume; most/s on 1 GbE: messages of that size, 117 MB/s.
 * (b) fan-out: 64^3 at 60 volumes a second over ipc to 0 to 16 subscribers, processes of their own that
 *     unpack each, and one more that is stopped with SIGSTOP: time of a publish, volumes that came,
 *     latency from publish to unpacked, growth of the publisher's memory. */
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/hist.h"
#include "proto/clients/sub.h"
#include "proto/pub.h"
#include "tests/lib/scratch.h"
#include "volume.h"

enum { FLOW = 300, RATE = 60, MOST = 17 };

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

/* Frees v. */
static void encoding(FILE *csv, const char *flame, struct volume v, double bandwidth)
{
    struct pvp_volume m = {.grid = v.grid};
    size_t n = pvp_grid_count(&v.grid);
    double floats = (double)n * 4;
    float *dense = must_floats(n);
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
            bench_row(csv, "%s,%u,%s,%s,%.3f,%.2f,%.2f,%.0f,%.3f,%.1f,%.2f,%.0f", flame,
                      v.grid.n[2], samples[sample], comps[comp], volume_lit(&v), least, bound,
                      floats / least * 1e-3, (double)len * 1e-6, floats / (double)len,
                      unpacking(msg, len, dense, n), 117e6 / (double)len);
            pvp_encoder_free(&e);
        }
    free(dense);
    volume_free(&v);
}

/* ---- fan-out ------------------------------------------------------------------------------------ */

struct tally {
    uint64_t volumes;
    struct pvx_hist latency;
};

/* Unpacks each volume until the end of the session. */
static void listen_to(const char *endpoint, struct tally *t)
{
    const struct pvp_sub_options o = {0};
    struct pvx_diag d = {""};
    pvp_sub *sub;
    pvp_decoder *dec;
    struct pvp_header h;
    struct pvp_view v;
    const void *msg;
    size_t len, n;
    bench_check(pvp_sub_new(endpoint, &o, &sub, &d), &d);
    CHECK(pvp_decoder_new(&dec));
    float *dense = NULL;
    while (pvp_sub_next(sub, 20 * PVX_NS_PER_S, &h, &msg, &len, NULL) == PVX_OK &&
           h.type != PVP_END) {
        if (h.type != PVP_VOLUME)
            continue;
        t->volumes++;
        CHECK(pvp_decode_volume(msg, len, &v, NULL));
        n = pvp_grid_count(&pvp_sub_start(sub)->grid);
        if (dense == NULL)
            dense = must_floats(n);
        CHECK(pvp_volume_unpack(dec, &v, dense, n, NULL));
        pvx_hist_add(&t->latency, pvx_now_real() - v.v.t_publish_ns);
    }
}

/* A process that says at its end what came.  It has no threads yet when it is made. */
static pid_t subscriber(const char *endpoint, int *from)
{
    static struct tally t;
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
    listen_to(endpoint, &t);
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

struct run {
    int healthy;
    bool stopped;
    /* what came of it */
    double took[FLOW], grown;
    struct tally all;
};

static pvp_pub *publisher(const char *endpoint, const struct volume *v)
{
    struct pvp_pub_params params = {
        .endpoints = &endpoint, .n_endpoints = 1, .sample = PVP_F16, .comp = PVP_RAW};
    struct pvp_start start = {.grid = v->grid, .session = 1, .n_cameras = 8, .fps = RATE};
    struct pvx_diag d = {""};
    pvp_pub *pub;
    bench_check(pvp_pub_new(&params, &start, &pub, &d), &d);
    return pub;
}

static void publish_all(pvp_pub *pub, const struct volume *v, struct run *r)
{
    int64_t next = pvx_now_mono();
    for (int set = 0; set < FLOW; set++) {
        struct pvp_volume m = {
            .set = (uint64_t)set, .grid = v->grid, .t_publish_ns = pvx_now_real()};
        int64_t t0 = pvx_now_mono();
        CHECK(pvp_pub_volume(pub, &m, &v->x, NULL));
        r->took[set] = ms(pvx_now_mono() - t0);
        next += PVX_NS_PER_S / RATE;
        for (int64_t left; (left = next - pvx_now_mono()) > 0;)
            nanosleep(&(struct timespec){.tv_nsec = left}, NULL);
    }
}

static void add_up(struct tally *all, const struct tally *t)
{
    all->volumes += t->volumes;
    for (int k = 0; k < PVX_HIST_BUCKETS; k++)
        all->latency.bucket[k] += t->latency.bucket[k];
    all->latency.count += t->latency.count;
    if (all->latency.max_ns < t->latency.max_ns)
        all->latency.max_ns = t->latency.max_ns;
}

static void travel(const char *endpoint, const struct volume *v, struct run *r)
{
    static struct tally t;
    int from[MOST], n = r->healthy + r->stopped;
    pid_t who[MOST];
    r->all = (struct tally){0};
    for (int i = 0; i < n; i++)
        who[i] = subscriber(endpoint, &from[i]);
    pvp_pub *pub = publisher(endpoint, v);
    while (pvp_pub_subscribers(pub) < (size_t)n) {
        pvp_pub_tick(pub);
        usleep(1000);
    }
    if (r->stopped)
        kill(who[n - 1], SIGSTOP);
    double before = resident_mib();
    publish_all(pub, v, r);
    r->grown = resident_mib() - before;
    CHECK(pvp_pub_say(pub, PVP_END, "done"));
    for (int i = 0; i < n; i++) {
        if (i >= r->healthy)
            kill(who[i], SIGKILL);
        else if (read(from[i], &t, sizeof t) == sizeof t)
            add_up(&r->all, &t);
        close(from[i]);
        waitpid(who[i], NULL, 0);
    }
    pvp_pub_free(&pub);
    qsort(r->took, FLOW, sizeof *r->took, bench_less);
}

/* After all others of the run: who is stopped still holds its place. */
static void fan_out(FILE *csv, const struct volume *v, int healthy, bool stopped)
{
    static struct run r;
    char endpoint[80];
    snprintf(endpoint, sizeof endpoint, "ipc://%s/v", dir);
    r = (struct run){.healthy = healthy, .stopped = stopped};
    travel(endpoint, v, &r);
    bench_row(csv, "%d,%s,%.3f,%.3f,%.3f,%.2f,%.2f,%.1f", healthy,
              stopped ? "one more stopped" : "", r.took[FLOW / 2], r.took[FLOW * 99 / 100],
              healthy > 0 ? (double)r.all.volumes / (FLOW * healthy) : 1,
              ms(pvx_hist_quantile(&r.all.latency, 0.5)),
              ms(pvx_hist_quantile(&r.all.latency, 0.99)), r.grown);
}

int main(int argc, char **argv)
{
    static const int crowds[] = {0, 1, 4, 16};
    static const int32_t size[3] = {320, 240, 128};
    scratch_new();
    struct volume v = volume_ring(64, 0.3);
    FILE *csv = bench_csv(argc, argv, "proto_fanout",
                          "healthy,more,publish p50,publish p99,came share,latency p50,latency p99,"
                          "grown MiB");
    for (size_t i = 0; i < sizeof crowds / sizeof *crowds; i++)
        fan_out(csv, &v, crowds[i], false);
    fan_out(csv, &v, 16, true);
    fclose(csv);
    volume_free(&v);
    scratch_remove();
    pvx_pool *one, *all; /* threads only now: who forks has none */
    CHECK(pvx_pool_new(1, "bench", &one));
    CHECK(pvx_pool_new(2, "bench", &all));
    double bandwidth = bench_bandwidth((size_t)96 << 20, one);
    csv = bench_csv(argc, argv, "proto_encode",
                    "flame,voxels,sample,compress,lit share,ms,bound ms,MB/s,MB,ratio,unpack ms,"
                    "most/s on 1 GbE");
    encoding(csv, "ring", volume_ring(64, 0.3), bandwidth);
    encoding(csv, "ring", volume_ring(128, 0.3), bandwidth);
    encoding(csv, "ring solved", volume_solved(FLAME_RING, size, all), bandwidth);
    encoding(csv, "pool solved", volume_solved(FLAME_POOL, size, all), bandwidth);
    pvx_pool_free(&one);
    pvx_pool_free(&all);
    fclose(csv);
    return 0;
}
