/* bench_replug.c - a camera back after its cable, its restart, the restart of the switch: seconds from the
 * moment at which it could answer again to the first set with all four cameras, over 20 runs of each. */
#include "base.h"
#include "base/median.h"
#include "tests/lib/arvbed.h"

enum { RUNS = 20 };
#define AWAY_S 1.5

static void cable(void)
{
    cap_gvcam_free(&bed_cam[1]);
    pvx_sleep_until_mono(pvx_now_mono() + (int64_t)(AWAY_S * 1e9));
    bed_fresh(1);
}

static void restart(void)
{
    cap_gvcam_do(bed_cam[2], CAP_GVCAM_REBOOT, AWAY_S);
}

static void network(void)
{
    cap_gvnet_reboot(bed_net, AWAY_S);
}

int main(int argc, char **argv)
{
    static const struct {
        const char *name;
        void (*go)(void);
    } event[] = {{"cable", cable}, {"restart", restart}, {"switch", network}};
    struct rig r;
    bed_open();
    if (!bed_usable) {
        bench_not_run("replug", "a private network, or the addresses 127.0.0.2 to 127.0.0.5");
        return *bench_status();
    }
    printf("\n-- a camera back, %d runs each: seconds until all frames are there again\n", RUNS);
    FILE *csv = bench_csv(argc, argv, "replug", "event,runs,median_s,p95_s,worst_s");
    bed_rig(&r, BED_CAMERAS, BED_FPS);
    r.cfg.sets.max_wait_ns = 300 * MS;
    rig_start(&r);
    bool all = rig_whole_after(&r, 0) > 0;
    for (size_t k = 0; k < sizeof event / sizeof *event; k++) {
        double s[RUNS];
        for (int i = 0; i < RUNS; i++) {
            int64_t back = pvx_now_mono() + (int64_t)(AWAY_S * 1e9);
            event[k].go();
            int64_t whole = rig_whole_after(&r, back);
            all &= whole > 0;
            s[i] = (double)(whole - back) * 1e-9;
        }
        qsort(s, RUNS, sizeof *s, pvx_ascending);
        double median = 0.5 * (s[RUNS / 2 - 1] + s[RUNS / 2]), p95 = s[RUNS - 1 - RUNS / 20];
        bench_row(csv, "%s,%d,%.3f,%.3f,%.3f", event[k].name, RUNS, median, p95, s[RUNS - 1]);
    }
    fclose(csv);
    rig_end(&r);
    bed_close();
    return all ? 0 : 1;
}
