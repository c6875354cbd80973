/* Volumes in shared memory: every voxel as it was put, whose the name is, what is left of a writer that was killed, what a
 * reader makes of a segment that is none.
 *
 * `test_share --publish ENDPOINT SIDES CHANNELS PAUSE_US [VOLUMES [no-end]]` is the system tests' publisher: volumes of
 * bed_value.h, until it is ended or so many. */
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>

#include "base/clock.h"
#include "daemon/volumes/segment.h"
#include "daemon/volumes/share.h"
#include "daemon/volumes/voxels.h"
#include "proto/pub.h"
#include "tests/lib/plugins.h"
#include "tests/lib/share_check.h"
#include "tests/lib/volume_bed.h"
#include "tests/t.h"

#define T0 INT64_C(1767225600000000000)

static struct pvx_diag d;
static char name[64], path[80];

static vol_share *share_new(bool split)
{
    vol_share *s = NULL;
    d = (struct pvx_diag){""};
    T_EQ_I(vol_share_new(&(struct vol_share_config){.name = name, .mode = 0600, .split = split}, &s,
                         &d),
           PVX_OK);
    T_EQ_S(d.text, "");
    return s;
}

static pvx_err put(vol_share *s, struct volume_bed *b, uint64_t set)
{
    return vol_share_put(s, &b->head.start, volume_bed_make(b, set, T0 + (int64_t)set), &d);
}

static struct share_want want_of(const struct volume_bed *b, bool split)
{
    const struct pvp_grid *g = &b->head.start.grid;
    struct share_want w = {.n = {g->n[0], g->n[1], g->n[2]},
                           .channels = g->channels,
                           .split = split && g->channels == 3};
    memcpy(w.min, g->min, sizeof w.min);
    memcpy(w.max, g->max, sizeof w.max);
    return w;
}

static int newest(struct pvp_share_volume *v)
{
    struct pvp_share r;
    int e = pvp_share_open(&r, name);
    if (e == PVP_SHARE_OK)
        e = pvp_share_newest(&r, v);
    v->grids = NULL; /* gone with the mapping */
    pvp_share_close(&r);
    return e;
}

/* ---- what is in it ------------------------------------------------------------------------------ */

static void every_voxel(const uint32_t n[3], uint32_t channels, bool split)
{
    struct volume_bed b;
    struct pvp_share r;
    struct pvp_share_volume v;
    vol_share *s = share_new(split);
    volume_bed_new(&b, n[0], n[1], n[2], channels, 0);
    const struct share_want w = want_of(&b, split);
    for (uint64_t set = 7; set < 12; set++) { /* each slot, and one again */
        T_EQ_I(put(s, &b, set), PVX_OK);
        if (set == 7)
            T_EQ_I(pvp_share_open(&r, name), PVP_SHARE_OK);
        T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_OK);
        T_EQ_I(v.number, set - 6);
        T_EQ_I(v.set, set);
        T_OK(v.session == b.head.start.session);
        T_EQ_I(v.t_exposure_ns, T0 + (int64_t)set);
        T_EQ_I(v.t_publish_ns, T0 + (int64_t)set + 20000000);
        T_OK(v.t_shared_ns > T0 && v.t_shared_ns <= pvx_now_real());
        T_EQ_I(share_errors(&v, &w), 0);
        T_OK(pvp_share_intact(&r, &v));
    }
    T_EQ_I(r.nanovdb >> 21, PNANOVDB_MAJOR_VERSION_NUMBER);
    T_EQ_I(r.writer, getpid());
    T_EQ_I(r.owner, geteuid());
    pvp_share_close(&r);
    vol_share_free(&s);
    volume_bed_free(&b);
}

T_CASE(every_voxel_grey)
{
    every_voxel((const uint32_t[]){19, 25, 9}, 1, false);
}
T_CASE(every_voxel_of_vectors)
{
    every_voxel((const uint32_t[]){19, 25, 9}, 3, false);
}
T_CASE(every_voxel_of_three_grids)
{
    every_voxel((const uint32_t[]){8, 17, 1}, 3, true);
}
T_CASE(every_voxel_of_several_lower_nodes) /* 128 voxels a side have one */
{
    every_voxel((const uint32_t[]){260, 17, 136}, 1, false);
}

T_CASE(nothing_burns)
{
    struct volume_bed b;
    struct pvp_share r;
    struct pvp_share_volume v;
    volume_bed_new(&b, 19, 25, 9, 3, 0);
    struct share_want w = want_of(&b, false);
    w.empty = true;
    vol_share *s = share_new(false);
    for (int k = 0; k < 2; k++) { /* no brick, and one that has no flame in it */
        volume_bed_make(&b, 1, T0);
        b.v.n_bricks = (uint32_t)k;
        memset(b.brick, 0, (size_t)k * 512 * 3 * sizeof *b.brick);
        T_EQ_I(vol_share_put(s, &b.head.start, &b.v, &d), PVX_OK);
        T_EQ_I(pvp_share_open(&r, name), PVP_SHARE_OK);
        T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_OK);
        T_EQ_I(share_errors(&v, &w), 0);
        pvp_share_close(&r);
    }
    vol_share_free(&s);
    volume_bed_free(&b);
}

/* Whether the shared grid has for each voxel of the bed f times its channel c; c 3: luminance. */
static bool share_is(const struct pvp_share_volume *v, const struct volume_bed *b, const char *grid,
                     int c, float f)
{
    struct share_grid g;
    const struct pvp_grid *k = &b->head.start.grid;
    bool same = share_grid_open(v, grid, PNANOVDB_GRID_TYPE_FLOAT, &g);
    for (uint32_t n = 0; n < b->v.n_bricks && same; n++)
        for (uint32_t i = 0; i < 512 && same; i++) {
            uint32_t nb[3], id = b->ids[n];
            pvp_grid_bricks(k, nb);
            const int at[3] = {(int)(id % nb[0] * 8 + i % 8),
                               (int)(id / nb[0] % nb[1] * 8 + i / 8 % 8),
                               (int)(id / nb[0] / nb[1] * 8 + i / 64)};
            const float *e = b->brick + ((size_t)n * 512 + i) * k->channels;
            const float want = c < 3 ? e[c] : 0.2126f * e[0] + 0.7152f * e[1] + 0.0722f * e[2];
            const pnanovdb_coord_t ijk = {at[0], at[1], at[2]};
            const pnanovdb_address_t a =
                pnanovdb_readaccessor_get_value_address(g.type, g.buf, &g.acc, PNANOVDB_REF(ijk));
            same = fabsf(pnanovdb_read_float(g.buf, a) - f * want) <= 1e-5f * f * fabsf(want);
        }
    return same;
}

T_CASE(error_bars_too) /* the first that come make a new segment, with more room */
{
    for (int split = 0; split < 2; split++) {
        struct volume_bed b;
        struct pvp_share r, later;
        struct pvp_share_volume v;
        size_t size;
        vol_share *s = share_new(split != 0);
        volume_bed_new(&b, 19, 25, 9, 3, 0);
        T_EQ_I(put(s, &b, 7), PVX_OK);
        T_EQ_I(pvp_share_open(&r, name), PVP_SHARE_OK);
        volume_bed_make(&b, 8, T0 + 8);
        for (size_t i = 0; i < (size_t)b.v.n_bricks * 512 * 3; i++)
            b.brick[i] = fabsf(b.brick[i]);
        b.v.bars.sd = b.brick; /* as large as the values */
        T_EQ_I(vol_share_put(s, &b.head.start, &b.v, &d), PVX_OK);
        T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_ENDED);
        T_EQ_I(pvp_share_open(&later, name), PVP_SHARE_OK);
        T_EQ_I(pvp_share_newest(&later, &v), PVP_SHARE_OK);
        T_EQ_I(v.n_grids, split ? 7 : 4);
        T_OK(share_is(&v, &b, "density", 3, 1));
        if (split) {
            T_OK(share_is(&v, &b, "red_sd", 0, 1) && share_is(&v, &b, "blue_sd", 2, 1));
            T_OK(pvp_share_grid(&v, "emission_sd", &size) == NULL);
        } else {
            T_OK(share_is(&v, &b, "emission_sd", 3, 1));
            T_OK(pvp_share_grid(&v, "rgb_sd", &size) != NULL);
        }
        T_EQ_I(put(s, &b, 9), PVX_OK); /* without bars */
        T_EQ_I(pvp_share_newest(&later, &v), PVP_SHARE_OK);
        T_EQ_I(v.n_grids, split ? 4 : 2);
        pvp_share_close(&r);
        pvp_share_close(&later);
        vol_share_free(&s);
        volume_bed_free(&b);
    }
}

T_CASE(all_burns) /* the most that a grid can have is what a slot is made for */
{
    struct volume_bed b;
    struct pvp_share r;
    struct pvp_share_volume v;
    volume_bed_new(&b, 40, 33, 24, 3, 0);
    volume_bed_make(&b, 0, T0);
    uint32_t nb[3], all = pvp_grid_bricks(&b.head.start.grid, nb);
    for (uint32_t id = 0; id < all; id++)
        b.ids[id] = id;
    for (size_t i = 0; i < (size_t)all * 512 * 3; i++)
        b.brick[i] = 2;
    b.v.n_bricks = all;
    vol_share *s = share_new(false);
    T_EQ_I(vol_share_put(s, &b.head.start, &b.v, &d), PVX_OK);
    T_EQ_I(pvp_share_open(&r, name), PVP_SHARE_OK);
    T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_OK);
    T_OK(v.size <= r.slot_size && v.size > r.slot_size - 16384);
    pvp_share_close(&r);
    vol_share_free(&s);
    volume_bed_free(&b);
}

/* ---- the lock ----------------------------------------------------------------------------------- */

T_CASE(two_more_may_come)
{
    struct volume_bed b;
    struct pvp_share r;
    struct pvp_share_volume v, later;
    volume_bed_new(&b, 19, 25, 9, 3, 0);
    const struct share_want w = want_of(&b, false);
    vol_share *s = share_new(false);
    void *copy = NULL;
    T_EQ_I(put(s, &b, 1), PVX_OK);
    T_EQ_I(pvp_share_open(&r, name), PVP_SHARE_OK);
    T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_OK);
    for (uint64_t set = 2; set < 4; set++) {
        T_EQ_I(put(s, &b, set), PVX_OK);
        T_OK(pvp_share_intact(&r, &v));
        T_EQ_I(share_errors(&v, &w), 0);
    }
    T_EQ_I(posix_memalign(&copy, 32, v.size), 0);
    later = v;
    T_OK(pvp_share_copy(&r, &later, copy));
    T_OK(later.grids == copy);
    T_EQ_I(put(s, &b, 4), PVX_OK); /* into the first slot again */
    T_OK(!pvp_share_intact(&r, &v));
    T_OK(!pvp_share_copy(&r, &v, copy));
    T_OK(share_errors(&v, &w) > 0); /* so this would see it */
    T_EQ_I(pvp_share_newest(&r, &later), PVP_SHARE_OK);
    T_EQ_I(later.set, 4);
    free(copy);
    pvp_share_close(&r);
    vol_share_free(&s);
    volume_bed_free(&b);
}

T_CASE(not_intact_from_the_first_byte) /* which is before anything is written */
{
    vol_segment *s;
    struct pvp_share r;
    struct pvp_share_volume v, old[3];
    void *grids;
    T_EQ_I(vol_segment_new(name, 0600, &s, &d), PVX_OK);
    T_EQ_I(newest(&v), PVP_SHARE_NONE);
    T_EQ_I(vol_segment_room(s, 8192, 1, &d), PVX_OK);
    T_EQ_I(pvp_share_open(&r, name), PVP_SHARE_OK);
    T_EQ_I(vol_segment_begin(s, 8193, &grids, &d), PVX_ERANGE);
    for (int k = 1; k < 9; k++) {
        T_EQ_I(vol_segment_begin(s, 8192, &grids, &d), PVX_OK);
        T_EQ_I(pvp_share_newest(&r, &v), k == 1 ? PVP_SHARE_NONE : PVP_SHARE_OK);
        T_EQ_I(v.number, k - 1);
        T_OK(k < 4 || !pvp_share_intact(&r, &old[k % 3]));
        memset(grids, k, 8192);
        vol_segment_commit(s, &(struct pvp_share_slot){.size = 8192, .n_grids = 1});
        T_OK(k == 1 || (pvp_share_intact(&r, &v) && *(const char *)v.grids == k - 1));
        T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_OK);
        T_OK(*(const char *)v.grids == k && ((const char *)v.grids)[8191] == k);
        old[k % 3] = v;
    }
    T_EQ_I(vol_segment_begin(s, 8192, &grids, &d), PVX_OK);
    T_EQ_I(vol_segment_begin(s, 8192, &grids, &d), PVX_OK); /* one that failed does not count */
    T_OK(pvp_share_intact(&r, &v));
    pvp_share_close(&r);
    vol_segment_free(&s);
}

/* ---- the name ----------------------------------------------------------------------------------- */

T_CASE(readers_are_told_of_the_end)
{
    struct volume_bed b;
    struct pvp_share r, none;
    struct pvp_share_volume v;
    volume_bed_new(&b, 19, 25, 9, 1, 0);
    const struct share_want w = want_of(&b, false);
    vol_share *s = share_new(false);
    T_EQ_I(put(s, &b, 1), PVX_OK);
    T_EQ_I(pvp_share_open(&r, name), PVP_SHARE_OK);
    T_OK(pvp_share_alive(&r));
    vol_share_free(&s);
    T_OK(!pvp_share_alive(&r));
    T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_ENDED);
    T_EQ_I(share_errors(&v, &w), 0); /* what it had stays its own */
    T_EQ_I(pvp_share_open(&none, name), PVP_SHARE_ABSENT);
    pvp_share_close(&none);
    pvp_share_close(&r);
    volume_bed_free(&b);
}

T_CASE(another_grid)
{
    struct volume_bed small, large;
    struct pvp_share r;
    struct pvp_share_volume v;
    volume_bed_new(&small, 19, 25, 9, 1, 0);
    volume_bed_new(&large, 41, 25, 9, 3, 0);
    struct share_want w = want_of(&large, false);
    vol_share *s = share_new(false);
    T_EQ_I(put(s, &small, 1), PVX_OK);
    T_EQ_I(pvp_share_open(&r, name), PVP_SHARE_OK);
    T_EQ_I(put(s, &large, 2), PVX_OK);
    T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_ENDED);
    T_EQ_I(v.set, 1);
    pvp_share_close(&r);
    T_EQ_I(pvp_share_open(&r, name), PVP_SHARE_OK);
    T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_OK);
    T_EQ_I(share_errors(&v, &w), 0);
    T_EQ_I(put(s, &small, 3), PVX_OK); /* has room in the same */
    T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_OK);
    w = want_of(&small, false);
    T_EQ_I(share_errors(&v, &w), 0);
    T_EQ_I(unlink(path), 0); /* as logind does when its user has logged out */
    T_EQ_I(put(s, &small, 4), PVX_OK);
    T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_ENDED);
    pvp_share_close(&r);
    T_EQ_I(newest(&v), PVP_SHARE_OK);
    T_EQ_I(v.set, 4);
    vol_share_free(&s);
    volume_bed_free(&small);
    volume_bed_free(&large);
}

/* A name that is taken stays as it is. */
static void refused(pvx_err why, const char *says)
{
    vol_share *s = NULL;
    struct stat before, after;
    T_EQ_I(lstat(path, &before), 0);
    d = (struct pvx_diag){""};
    T_EQ_I(vol_share_new(&(struct vol_share_config){.name = name, .mode = 0600}, &s, &d), why);
    T_CONTAINS(d.text, says);
    T_CONTAINS(d.text, path);
    T_OK(s == NULL && lstat(path, &after) == 0 && before.st_ino == after.st_ino);
}

T_CASE(one_name_one_writer)
{
    char says[64];
    vol_share *s = share_new(false);
    snprintf(says, sizeof says, "process %d shares under that name", (int)getpid());
    refused(PVX_EBUSY, says);
    vol_share_free(&s);
    T_OK(access(path, F_OK) != 0);
}

T_CASE(what_is_not_ours_stays)
{
    int fd = open(path, O_CREAT | O_EXCL | O_RDWR, 0600);
    char kept[1000];
    T_OK(fd >= 0 && write(fd, memset(kept, 'x', sizeof kept), sizeof kept) == sizeof kept);
    refused(PVX_EBUSY, "not pyrovox's");
    T_EQ_I(pread(fd, kept, sizeof kept, 0), sizeof kept);
    T_OK(kept[0] == 'x');
    close(fd);
    unlink(path);
    T_EQ_I(symlink("/etc/passwd", path), 0);
    refused(PVX_EBUSY, "choose another name");
    unlink(path);
    T_EQ_I(mkdir(path, 0700), 0);
    refused(PVX_EBUSY, "choose another name");
    rmdir(path);
    static const char *const bad[] = {"", "/", ".", "..", "a/b", "//a"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        vol_share *s;
        d = (struct pvx_diag){""};
        T_EQ_I(vol_share_new(&(struct vol_share_config){.name = bad[i]}, &s, &d), PVX_EINVAL);
        T_CONTAINS(d.text, "cannot be a name");
    }
}

/* In a process of its own, which says when it has put one, begins another and stays. */
static pid_t killed_writer(struct volume_bed *b, uint64_t set)
{
    int ready[2];
    char byte = 0;
    if (pipe(ready) != 0)
        exit(1);
    pid_t pid = fork();
    if (pid == 0) {
        vol_share *s = NULL;
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        const struct vol_share_config c = {.name = name, .mode = 0600};
        if (vol_share_new(&c, &s, &d) == PVX_OK && put(s, b, set) == PVX_OK &&
            write(ready[1], "r", 1) == 1)
            for (;;)
                pause();
        _exit(1);
    }
    close(ready[1]);
    T_EQ_I(read(ready[0], &byte, 1), 1);
    close(ready[0]);
    return pid;
}

T_CASE(killed)
{
    struct volume_bed b;
    struct pvp_share r;
    struct pvp_share_volume v;
    volume_bed_new(&b, 19, 25, 9, 3, 0);
    const struct share_want w = want_of(&b, false);
    pid_t pid = killed_writer(&b, 5);
    T_EQ_I(pvp_share_open(&r, name), PVP_SHARE_OK);
    T_OK(pvp_share_alive(&r));
    refused(PVX_EBUSY, "shares under that name");
    kill(pid, SIGSTOP); /* is there, though nothing moves */
    T_OK(pvp_share_alive(&r));
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
    T_OK(!pvp_share_alive(&r));
    T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_ENDED);
    T_EQ_I(v.set, 5);
    T_EQ_I(share_errors(&v, &w), 0);
    T_EQ_I(newest(&v), PVP_SHARE_ENDED); /* who comes now sees it too */
    vol_share *s = share_new(false);
    T_EQ_I(put(s, &b, 6), PVX_OK);
    T_EQ_I(pvp_share_newest(&r, &v), PVP_SHARE_ENDED);
    T_EQ_I(newest(&v), PVP_SHARE_OK);
    T_EQ_I(v.set, 6);
    pvp_share_close(&r);
    vol_share_free(&s);
    volume_bed_free(&b);
}

/* ---- segments that are none --------------------------------------------------------------------- */

static int attach(const void *bytes, size_t n)
{
    struct pvp_share r;
    int fd = memfd_create("test_share", MFD_CLOEXEC);
    T_OK(fd >= 0 && write(fd, bytes, n) == (ssize_t)n);
    int e = pvp_share_attach(&r, fd);
    T_OK((e == PVP_SHARE_OK) == (r.fd >= 0) && (e == PVP_SHARE_OK) == (r.map != NULL));
    pvp_share_close(&r);
    return e;
}

T_CASE(reader_trusts_nothing)
{
    static struct {
        struct pvp_share_head head;
        struct pvp_share_slot slot[3];
        unsigned char data[3][4096];
    } good, s;
    good.head = (struct pvp_share_head){.major = PVP_SHARE_MAJOR,
                                        .n_slots = PVP_SHARE_SLOTS,
                                        .size = sizeof good,
                                        .data_offset = sizeof good.head + sizeof good.slot,
                                        .slot_size = sizeof good.data[0]};
    memcpy(good.head.magic, PVP_SHARE_MAGIC, 8);
    T_EQ_I(attach(&good, sizeof good), PVP_SHARE_OK);
    for (size_t n = 0; n < sizeof good; n += n < 300 ? 1 : 1000)
        T_EQ_I(attach(&good, n), PVP_SHARE_FOREIGN);
#define WRONG(result, ...)                      \
    do {                                        \
        s = good;                               \
        __VA_ARGS__;                            \
        T_EQ_I(attach(&s, sizeof s), (result)); \
    } while (0)
    WRONG(PVP_SHARE_FOREIGN, s.head.magic[7]++);
    WRONG(PVP_SHARE_LATER, s.head.major++);
    WRONG(PVP_SHARE_OK, s.head.minor++);
    WRONG(PVP_SHARE_FOREIGN, s.head.n_slots++);
    WRONG(PVP_SHARE_FOREIGN, s.head.size--);
    WRONG(PVP_SHARE_FOREIGN, s.head.data_offset -= 32);
    WRONG(PVP_SHARE_FOREIGN, s.head.data_offset += 32);
    WRONG(PVP_SHARE_FOREIGN, s.head.data_offset = UINT64_MAX - 31);
    WRONG(PVP_SHARE_FOREIGN, s.head.slot_size += 32);
    WRONG(PVP_SHARE_FOREIGN, s.head.slot_size = UINT64_MAX / 3 + 32);
#undef WRONG
    T_EQ_I(pvp_share_open(&(struct pvp_share){0}, "no/such"), PVP_SHARE_ABSENT);
    for (int e = -1; e <= PVP_SHARE_SYSTEM + 1; e++)
        T_OK(pvp_share_text(e)[0] != '\0');
}

/* ---- the system tests' publisher ---------------------------------------------------------------- */

static volatile sig_atomic_t stopped;
static void stop(int sig)
{
    stopped = sig;
}

static pvx_err publish(int argc, char **argv)
{
    struct volume_bed b;
    unsigned x, y, z;
    vol_voxels *voxels;
    pvp_pub *pub;
    if (sscanf(argv[3], "%ux%ux%u", &x, &y, &z) != 3)
        return PVX_EINVAL;
    volume_bed_new(&b, x, y, z, (uint32_t)atoi(argv[4]), 0);
    b.head.start.session = (uint64_t)getpid();
    const char *const endpoint = argv[2];
    const struct pvp_pub_params p = {
        .endpoints = &endpoint, .n_endpoints = 1, .sample = PVP_F16, .comp = PVP_LZ4};
    const uint64_t most = argc > 6 ? strtoull(argv[6], NULL, 10) : UINT64_MAX;
    PVX_TRY(vol_voxels_new(&b.head.start.grid, &voxels));
    PVX_TRY(pvp_pub_new(&p, &b.head.start, &pub, &d));
    signal(SIGTERM, stop);
    for (uint64_t set = 0; !stopped;) {
        pvp_pub_tick(pub);
        if (set < most && pvp_pub_subscribers(pub) > 0) {
            const struct vol_volume *v = volume_bed_make(&b, set, pvx_now_real());
            struct pvp_voxels list;
            vol_voxels_of(voxels, v, &list);
            PVX_TRY(pvp_pub_volume(pub, &v->v, &list, NULL));
            set++;
        }
        usleep((useconds_t)atoi(argv[5]));
    }
    if (argc <= 7)
        PVX_TRY(pvp_pub_say(pub, PVP_END, "stopped"));
    pvp_pub_free(&pub);
    vol_voxels_free(&voxels);
    volume_bed_free(&b);
    return PVX_OK;
}

int main(int argc, char **argv)
{
    plugins_of_this_build();
    if (argc > 5 && strcmp(argv[1], "--publish") == 0) {
        pvx_err e = publish(argc, argv);
        if (e != PVX_OK)
            fprintf(stderr, "test_share: %s\n", pvx_diag_text(&d, e));
        return e != PVX_OK;
    }
    snprintf(name, sizeof name, "pyrovox-test-share-%d", (int)getpid());
    snprintf(path, sizeof path, "/dev/shm/%s", name);
    t_run();
    unlink(path);
    return t_done();
}
