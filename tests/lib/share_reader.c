/* share_reader - what `pyrovox share` shares, as a program of somebody else reads it: built by tests/system/099-share.sh
 * against the installed pyrovox_share.h.
 *
 *     share_reader NAME SIDES CHANNELS vectors|split volumes N    checks N volumes of bed_value.h as they come
 *                                                    on           checks until SIGTERM, through writers that come and go
 *                                                    last         the writer is gone: checks what it left, if it left one
 *                                                    open         prints what opening says
 * Prints "N checked, N torn, N opened, N bad"; 0: none was bad. */
#include <signal.h>
#include <stdlib.h>

#include "tests/lib/share_check.h"

struct tally {
    unsigned long checked, torn, opened, bad;
};

static volatile sig_atomic_t stopped;
static void stop(int sig)
{
    stopped = sig;
}

/* A copy, as an upload is. */
static void look(const struct pvp_share *s, struct pvp_share_volume *v, const struct share_want *w,
                 struct tally *t)
{
    void *copy = NULL;
    if (posix_memalign(&copy, 32, v->size + 1) != 0)
        exit(1);
    if (!pvp_share_copy(s, v, copy)) {
        t->torn++;
    } else {
        const unsigned long bad = share_errors(v, w);
        if (bad > 0)
            printf("set %llu: %lu voxels are wrong\n", (unsigned long long)v->set, bad);
        t->checked++;
        t->bad += bad > 0;
    }
    free(copy);
}

static int follow(const char *name, const struct share_want *w, unsigned long most)
{
    struct tally t = {0, 0, 0, 0};
    while (!stopped && t.checked < most && t.bad == 0) {
        struct pvp_share s;
        struct pvp_share_volume v;
        uint64_t seen = 0;
        int e = pvp_share_open(&s, name);
        if (e == PVP_SHARE_OK)
            t.opened++;
        else if (e != PVP_SHARE_ABSENT)
            return printf("%s\n", pvp_share_text(e)), 1;
        while (e != PVP_SHARE_ABSENT && e != PVP_SHARE_ENDED && !stopped && t.checked < most) {
            e = pvp_share_newest(&s, &v);
            if (v.number != seen)
                look(&s, &v, w, &t);
            else
                usleep(200);
            seen = v.number;
            t.bad += e == PVP_SHARE_FOREIGN;
        }
        pvp_share_close(&s);
        usleep(1000);
    }
    printf("%lu checked, %lu torn, %lu opened, %lu bad\n", t.checked, t.torn, t.opened, t.bad);
    return t.bad > 0;
}

static int last(const char *name, const struct share_want *w)
{
    struct tally t = {0, 0, 0, 0};
    struct pvp_share s;
    struct pvp_share_volume v;
    int e = pvp_share_open(&s, name);
    if (e == PVP_SHARE_ABSENT) /* killed before it had a name */
        return printf("none\n"), 0;
    e = e == PVP_SHARE_OK ? pvp_share_newest(&s, &v) : e;
    if (e != PVP_SHARE_ENDED)
        return printf("not ended, but: %s\n", pvp_share_text(e)), 1;
    if (v.number != 0)
        look(&s, &v, w, &t);
    printf("set %lld is whole\n", v.number != 0 ? (long long)v.set : -1LL);
    pvp_share_close(&s);
    return t.bad > 0 || t.torn > 0;
}

int main(int argc, char **argv)
{
    struct share_want w = {.min = BED_MIN, .max = BED_MAX};
    if (argc < 6 || sscanf(argv[2], "%ux%ux%u", &w.n[0], &w.n[1], &w.n[2]) != 3)
        return 2;
    w.channels = (uint32_t)strtoul(argv[3], NULL, 10);
    w.split = strcmp(argv[4], "split") == 0;
    signal(SIGTERM, stop);
    if (strcmp(argv[5], "last") == 0)
        return last(argv[1], &w);
    if (strcmp(argv[5], "open") == 0) {
        struct pvp_share s;
        int e = pvp_share_open(&s, argv[1]);
        printf("%s\n", pvp_share_text(e));
        pvp_share_close(&s);
        return e;
    }
    return follow(argv[1], &w, argc > 6 ? strtoul(argv[6], NULL, 10) : (unsigned long)-1);
}
