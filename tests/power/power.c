/* power.c - what a power cut leaves of a recording, by what shim.c saw of its making.
 *
 *     power take|volumes LOG WHOLE CUTS SEED SCRATCH
 *
 * A disk has, after a cut, what had been synced, and of what was written since any part: of each block any of the
 * versions that it had in memory, as the kernel writes back when it likes.  WHOLE is the recording as it was closed.
 * For each of CUTS cuts the file is made as it may be then, and read by the program's own readers in a process of its own:
 *   never wrong    what is read is what was recorded, or an error
 *   never less     sets that were readable when a sync began, which then ended before the cut, are there; but for one
 *                  block of the index (may_lose)
 * CUTS of each of three disks: one that writes in order (its last write torn), one that writes pages of 4 KiB in any
 * order, one that tears pages at sectors of 512 bytes, of which the second is not promised. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <xxhash.h>

#include "base/file.h"
#include "capture/take/take.h"
#include "daemon/volumes/hdf5.h"
#include "tests/power/log.h"

#define PAGE     4096u
#define SECTOR   512u
#define SETS_MAX 4096

enum disk { IN_ORDER, PAGES, SECTORS, DISKS };
static const char *const disk_names[DISKS] = {"in order", "pages in any order",
                                              "sectors in any order"};

/* What a reader makes of a file. */
struct seen {
    int32_t opened; /* 0 = refused with a message */
    char why[256];
    uint32_t sets, damaged; /* given out; of these, with an error when they are read */
    uint64_t number[SETS_MAX], hash[SETS_MAX]; /* hash 0: damaged */
};

static struct op {
    struct power_op o;
    const unsigned char *data;
    uint64_t synced; /* ops that are on the disk when this one has been done */
} * op;
static size_t n_ops;
static uint64_t most; /* bytes that the file ever had */
static uint64_t state;

static uint64_t rnd(uint64_t below)
{
    state += 0x9e3779b97f4a7c15u; /* splitmix64 */
    uint64_t z = state;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return below > 0 ? (z ^ (z >> 31)) % below : 0;
}

static void die(const char *what)
{
    perror(what);
    exit(2);
}

static void read_log(const char *path)
{
    char *text;
    size_t len;
    if (pvx_file_read(path, SIZE_MAX / 4, &text, &len, NULL) != PVX_OK)
        die(path);
    uint64_t synced = 0;
    for (size_t at = 0; at + sizeof(struct power_op) <= len; n_ops++) {
        op = realloc(op, (n_ops + 1) * sizeof *op);
        if (op == NULL)
            die("memory");
        struct op *o = &op[n_ops];
        memcpy(&o->o, text + at, sizeof o->o);
        at += sizeof o->o;
        o->data = (unsigned char *)text + at;
        at += o->o.what == POWER_WRITE ? o->o.bytes : 0;
        if (at > len)
            break; /* the program was killed here */
        if (o->o.what == POWER_SYNCED)
            for (size_t k = n_ops; k-- > 0;)
                if (op[k].o.what == POWER_SYNC && op[k].o.thread == o->o.thread) {
                    synced = k > synced ? k : synced;
                    break;
                }
        o->synced = synced;
        uint64_t end = o->o.at + o->o.bytes;
        most = o->o.what < POWER_SYNC && end > most ? end : most;
    }
}

/* ---- a file as it may be ---- */

struct image {
    unsigned char *mem; /* [most] */
    uint64_t size;
};

static void apply(struct image *f, const struct op *o)
{
    if (o->o.what == POWER_WRITE) {
        memcpy(f->mem + o->o.at, o->data, o->o.bytes);
        f->size = o->o.at + o->o.bytes > f->size ? o->o.at + o->o.bytes : f->size;
    } else if (o->o.what == POWER_SIZE) {
        if (o->o.at < f->size)
            memset(f->mem + o->o.at, 0, f->size - o->o.at);
        f->size = o->o.at;
    }
}

/* The first ops, in order. */
static void replay(struct image *f, size_t ops)
{
    memset(f->mem, 0, most);
    f->size = 0;
    for (size_t i = 0; i < ops; i++)
        apply(f, &op[i]);
}

/* Of a write, whole pages from its beginning. */
static uint64_t torn(const struct power_op *o)
{
    uint64_t end = (o->at + rnd(o->bytes + 1)) / PAGE * PAGE;
    return rnd(2) == 0 ? o->bytes : end > o->at ? end - o->at : 0;
}

/* Cut after `ops`, of which the last may be torn. */
static void in_order(struct image *f, size_t ops)
{
    replay(f, ops - 1);
    struct op last = op[ops - 1];
    if (last.o.what == POWER_WRITE)
        last.o.bytes = torn(&last.o);
    apply(f, &last);
}

/* Each block in any of its versions since the sync; most of them the newest, or few, as it comes. */
static void any_order(struct image *f, size_t ops, uint64_t block)
{
    size_t from = op[ops - 1].synced, blocks = most / block + 1;
    uint32_t *versions = calloc(blocks, sizeof *versions), *take = calloc(blocks, sizeof *take);
    uint64_t percent = rnd(3) == 0 ? rnd(100) : 90 + rnd(11), size, sizes = 0;
    if (versions == NULL || take == NULL)
        die("memory");
    replay(f, from);
    size = f->size;
    for (size_t i = from; i < ops; i++)
        if (op[i].o.what == POWER_WRITE && op[i].o.bytes > 0)
            for (uint64_t b = op[i].o.at / block; b <= (op[i].o.at + op[i].o.bytes - 1) / block;
                 b++)
                versions[b]++;
    for (size_t b = 0; b < blocks; b++)
        take[b] = rnd(100) < percent ? versions[b] : (uint32_t)rnd(versions[b] + 1);
    memset(versions, 0, blocks * sizeof *versions);
    for (size_t i = from; i < ops; i++) {
        const struct power_op *o = &op[i].o;
        struct image now = {.mem = f->mem, .size = size};
        if (o->what == POWER_SIZE)
            apply(&now, &op[i]);
        else if (o->what == POWER_WRITE && o->bytes > 0) {
            for (uint64_t b = o->at / block; b <= (o->at + o->bytes - 1) / block; b++) {
                uint64_t lo = b * block > o->at ? b * block : o->at;
                uint64_t hi =
                    (b + 1) * block < o->at + o->bytes ? (b + 1) * block : o->at + o->bytes;
                if (++versions[b] <= take[b])
                    memcpy(f->mem + lo, op[i].data + (lo - o->at), hi - lo);
            }
            now.size = o->at + o->bytes > size ? o->at + o->bytes : size;
        }
        size = now.size;
        /* the size, too, is one of those that it had: mostly the newest */
        if (rnd(++sizes) == 0 || rnd(100) < percent)
            f->size = size;
    }
    if (f->size < most)
        memset(f->mem + f->size, 0, most - f->size);
    free(versions);
    free(take);
}

/* ---- what is read ---- */

static void look_take(const char *path, struct seen *s)
{
    cap_take *t;
    struct pvx_diag d = {""};
    if (cap_take_open(path, &t, &d) != PVX_OK) {
        if (d.text[0] == '\0')
            abort();
        snprintf(s->why, sizeof s->why, "%s", d.text);
        return;
    }
    const struct cap_take_info *info = cap_take_info(t);
    s->opened = 1;
    for (uint64_t k = 0; k < info->sets && k < SETS_MAX; k++) {
        const int64_t *member;
        const struct cap_take_set *set = cap_take_set(t, k, &member);
        uint64_t h = XXH3_64bits(set, sizeof *set);
        for (uint32_t c = 0; c < info->head.n_cameras && h != 0; c++) {
            if (member[c] < 0)
                continue;
            size_t room = cap_take_frame_max(t, c);
            void *mem = malloc(room);
            struct cap_image img;
            const struct cap_take_row *row = cap_take_row(t, c, (uint64_t)member[c]);
            if (mem != NULL &&
                cap_take_read(t, c, (uint64_t)member[c], mem, room, &img, &d) == PVX_OK)
                h = XXH3_64bits_withSeed(mem, img.size, XXH3_64bits_withSeed(row, sizeof *row, h)) |
                    1;
            else
                h = 0;
            free(mem);
        }
        s->number[s->sets] = set->number;
        s->hash[s->sets++] = h;
        s->damaged += h == 0;
    }
    cap_take_free(&t);
}

static void look_volumes(const char *path, struct seen *s)
{
    vol_reader *r;
    struct pvx_diag d = {""};
    if (vol_reader_open(path, &r, &d) != PVX_OK) {
        if (d.text[0] == '\0')
            abort();
        snprintf(s->why, sizeof s->why, "%s", d.text);
        return;
    }
    s->opened = 1;
    for (uint64_t k = 0; k < vol_reader_count(r) && k < SETS_MAX; k++) {
        struct vol_volume v;
        uint64_t h = 0;
        s->number[s->sets] = UINT64_MAX;
        if (vol_reader_get(r, k, &v, &d) == PVX_OK) {
            size_t floats =
                (size_t)v.n_bricks * PVP_BRICK * PVP_BRICK * PVP_BRICK * v.v.grid.channels;
            s->number[s->sets] = v.v.set;
            h = XXH3_64bits_withSeed(v.ids, v.n_bricks * sizeof *v.ids,
                                     (uint64_t)v.v.t_exposure_ns);
            h = XXH3_64bits_withSeed(v.brick, floats * sizeof *v.brick, h) | 1;
        }
        s->hash[s->sets++] = h;
        s->damaged += h == 0;
    }
    vol_reader_close(&r);
}

typedef void look_fn(const char *path, struct seen *s);

/* In a process of its own; false = it died. */
static bool look(look_fn *reader, const char *path, struct seen *shared)
{
    memset(shared, 0, sizeof *shared);
    fflush(stdout);
    pid_t pid = fork();
    if (pid == 0) {
        reader(path, shared);
        _exit(0);
    }
    int status;
    return pid > 0 && waitpid(pid, &status, 0) == pid && WIFEXITED(status) &&
           WEXITSTATUS(status) == 0;
}

static bool look_at(look_fn *reader, const struct image *f, const char *scratch, struct seen *s)
{
    int fd = open(scratch, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    if (fd < 0)
        die(scratch);
    for (uint64_t at = 0; at < f->size;) {
        ssize_t n = write(fd, f->mem + at, f->size - at);
        if (n <= 0)
            die(scratch);
        at += (uint64_t)n;
    }
    close(fd);
    return look(reader, scratch, s);
}

/* How many of the recording's first sets are there, whole. */
static uint32_t whole(const struct seen *s, const struct seen *truth)
{
    uint32_t n = 0, k = 0;
    for (; n < truth->sets; n++) {
        while (k < s->sets && s->number[k] != truth->number[n])
            k++;
        if (k == s->sets || s->hash[k] != truth->hash[n])
            break;
    }
    return n;
}

static bool is_true(const struct seen *s, const struct seen *truth)
{
    for (uint32_t k = 0; k < s->sets; k++) {
        bool found = s->hash[k] == 0;
        for (uint32_t i = 0; i < truth->sets && !found; i++)
            found = truth->number[i] == s->number[k] && truth->hash[i] == s->hash[k];
        if (!found)
            return false;
    }
    return true;
}

/* A dataset's index is in blocks (libhdf5's extensible array: 4 entries, then 1 block of 16, 1 of 32, 2 of 32, 2 of
 * 64, ...; at most 1024 are checked together).  One that spans two pages may be torn, and is lost with its entries. */
static uint32_t may_lose(uint64_t entries, uint64_t bytes, uint64_t align)
{
    uint64_t block = 16, at = 4;
    for (int k = 0; at + ((uint64_t)block << k / 2) <= entries; k++) {
        at += block << k / 2;
        block <<= k % 2 == 0;
    }
    block = block < 1024 ? block : 1024;
    return block * bytes + 64 > align ? (uint32_t)block : 0;
}

static uint32_t chunks_of(const char *path)
{
    vol_reader *r;
    if (vol_reader_open(path, &r, NULL) != PVX_OK)
        return 1;
    uint32_t n = vol_tiles(&vol_reader_head(r)->start.grid).all;
    vol_reader_close(&r);
    return n;
}

int main(int argc, char **argv)
{
    if (argc != 7) {
        fprintf(stderr, "power take|volumes LOG WHOLE CUTS SEED SCRATCH\n");
        return 2;
    }
    bool take = strcmp(argv[1], "take") == 0;
    look_fn *reader = take ? look_take : look_volumes;
    unsigned cuts = (unsigned)strtoul(argv[4], NULL, 10);
    uint64_t seed = strtoull(argv[5], NULL, 10), bad = 0;
    struct seen *s =
        mmap(NULL, sizeof *s, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    static struct seen whole_one, *truth = &whole_one;
    read_log(argv[2]);
    static struct image f;
    static uint32_t *kept; /* by ops that are on the disk: sets then, and 1; 0 = not looked yet */
    f.mem = malloc(most);
    kept = calloc(n_ops + 1, sizeof *kept);
    if (s == MAP_FAILED || f.mem == NULL || kept == NULL || n_ops == 0)
        die("memory, or an empty log");
    if (!look(reader, argv[3], s) || s->sets < 10 || s->damaged > 0) {
        fprintf(stderr, "%s: %u sets, %u damaged: no recording to compare with\n", argv[3], s->sets,
                s->damaged);
        return 2;
    }
    *truth = *s;
    replay(&f, n_ops);
    if (!look_at(reader, &f, argv[6], s) || whole(s, truth) != truth->sets) {
        fprintf(stderr, "%s: played back it is not %s: writes are missing\n", argv[2], argv[3]);
        return 2;
    }
    uint32_t chunks = take ? 1 : chunks_of(argv[3]);
    size_t syncs = 0;
    for (size_t i = 0; i < n_ops; i++)
        syncs += op[i].o.what == POWER_SYNCED;
    printf("%u sets, %zu writes and syncs, %zu of them syncs, %.1f MB, seed %llu\n", truth->sets,
           n_ops, syncs, (double)most * 1e-6, (unsigned long long)seed);
    for (int disk = 0; disk < DISKS; disk++) {
        unsigned died = 0, lied = 0, less = 0, refused = 0, with_floor = 0;
        uint64_t unsynced = 0, came = 0, damaged = 0;
        for (unsigned i = 0; i < cuts; i++) {
            state = seed * 1000003u + (uint64_t)disk * 100000007u + i;
            size_t ops = i < cuts / 4 && i < n_ops ? n_ops - i
                                                   : 1 + rnd(n_ops); /* also while it is closed */
            size_t from = op[ops - 1].synced;
            if (kept[from] == 0) {
                replay(&f, from);
                kept[from] = 1 + (look_at(reader, &f, argv[6], s) ? whole(s, truth) : 0);
            }
            uint32_t floor = kept[from] - 1;
            if (disk == IN_ORDER)
                in_order(&f, ops);
            else
                any_order(&f, ops, disk == PAGES ? PAGE : SECTOR);
            bool lives = look_at(reader, &f, argv[6], s);
            uint32_t lose = disk == IN_ORDER ? 0
                            : take           ? may_lose(floor, 8, TAKE_ALIGN)
                                             : may_lose((uint64_t)floor * chunks, 15, VOL_ALIGN);
            bool honest = is_true(s, truth),
                 all = whole(s, truth) + (lose + chunks - 1) / chunks >= floor;
            died += !lives;
            lied += !honest;
            refused += lives && !s->opened;
            with_floor += floor > 0;
            less += lives && !all;
            damaged += s->damaged;
            unsynced += whole(s, truth) > floor ? whole(s, truth) - floor : 0;
            came += floor;
            if (getenv("POWER_TELL") != NULL && (!lives || !honest || !all))
                printf("  %s\n  %s, cut %u: after %zu of %zu, %zu synced with %u sets: %s, %u sets "
                       "whole, %u damaged\n",
                       s->why, disk_names[disk], i, ops, n_ops, from, floor,
                       !lives       ? "died"
                       : !s->opened ? "refused"
                                    : "opened",
                       whole(s, truth), s->damaged);
        }
        printf("%s: %u cuts, %u behind a sync: died %u, wrong %u, less than synced %u; refused %u; "
               "sets synced %.1f on average, "
               "beyond that %.1f, damaged and told %.2f\n",
               disk_names[disk], cuts, with_floor, died, lied, less, refused, (double)came / cuts,
               (double)unsynced / cuts, (double)damaged / cuts);
        bad += died + lied + (disk == SECTORS ? 0 : less) + (with_floor == 0);
    }
    return bad > 0;
}
