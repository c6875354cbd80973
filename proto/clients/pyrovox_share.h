/* pyrovox_share.h - volumes of `pyrovox share NAME`, read in place: NanoVDB grids in POSIX shared memory /NAME.
 *
 * This file alone reads them: C99, C11 and C++, GCC or Clang, Linux, with only libc.  The layout is in PROTOCOL.md,
 * Shared memory.
 *
 *     struct pvp_share s;
 *     struct pvp_share_volume v;
 *     if (pvp_share_open(&s, "flame") == PVP_SHARE_OK && pvp_share_newest(&s, &v) == PVP_SHARE_OK) {
 *         ... copy or upload v.size bytes at v.grids ...
 *         if (pvp_share_intact(&s, &v))
 *             ... it is a volume: pvp_share_grid(&v, "density", &size) is where its grid begins ...
 *     }
 *     pvp_share_close(&s);
 *
 * A reader writes nothing and holds nothing, so it cannot stop or slow the writer, and a killed reader leaves nothing
 * behind.  A volume stays unchanged until two more have come and the third begins.  Trust the data that you read only
 * if pvp_share_intact says so afterwards.  A half overwritten tree has offsets that lead anywhere.  So walk a tree in
 * a copy that was found intact, or in place only if you are done in time.
 * Nothing in the segment is trusted beyond the size that the kernel reports for it.  Its owner can cut it short,
 * which ends a reader with SIGBUS: `owner` tells whose it is.
 * Threads: a pvp_share may be read by many at once. */
#ifndef PYROVOX_SHARE_H
#define PYROVOX_SHARE_H
#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#ifdef __cplusplus
extern "C" {
#endif

#define PVP_SHARE_MAGIC "PVXSHARE"
#define PVP_SHARE_MAJOR 1
#define PVP_SHARE_SLOTS 3
#define PVP_SHARE_GRIDS 7   /* at most: density, red, green, blue, and red_sd, green_sd, blue_sd */
#define PVP_SHARE_NAME  200 /* bytes of a name, with the 0 */

/* ---- the contents of the segment (host byte order) ------------------------------------------------- */

struct pvp_share_head { /* 64 bytes, at 0 */
    char magic[8];
    uint16_t major, minor;
    uint32_t n_slots;
    uint64_t size;        /* bytes of the segment */
    uint64_t data_offset; /* of the grids of slot 0 */
    uint64_t slot_size;   /* bytes from one slot's grids to the next one's */
    uint64_t
        newest; /* atomic: number of the newest whole volume, 0 none; it is in slot newest % n_slots */
    uint32_t ended;   /* atomic: 1 no more volumes come here */
    uint32_t nanovdb; /* version of the grids: major << 21 | minor << 10 | patch */
    uint32_t writer;  /* its process id, for people */
    uint32_t reserved;
};
struct pvp_share_slot { /* 64 bytes, behind the head; all fields are atomic */
    uint64_t lock;      /* twice the volume's number: whole; an odd number: being written */
    uint64_t set, session;
    int64_t t_exposure_ns, t_publish_ns, t_shared_ns;
    uint64_t size; /* bytes of all grids */
    uint32_t n_grids;
    uint32_t flags; /* as of the wire's header */
};

/* ---- reading ------------------------------------------------------------------------------------ */

enum pvp_share_result {
    PVP_SHARE_OK,
    PVP_SHARE_NONE,  /* no volume has come yet */
    PVP_SHARE_ENDED, /* the writer has ended or made a new segment: close, and open by name again */
    PVP_SHARE_ABSENT,  /* no segment has this name */
    PVP_SHARE_DENIED,  /* another user's, and not for all users (`--readers`) */
    PVP_SHARE_FOREIGN, /* not a segment of pyrovox, or damaged */
    PVP_SHARE_LATER,   /* of a later version: needs a newer pyrovox_share.h */
    PVP_SHARE_SYSTEM   /* the system refused, with the reason in errno */
};

struct pvp_share {
    int fd;
    const unsigned char *map;
    size_t size;
    uint64_t data_offset, slot_size;
    uint32_t
        nanovdb; /* compare its major, nanovdb >> 21, with that of the NanoVDB.h or PNanoVDB.h that you read with */
    uint32_t writer; /* process id */
    unsigned owner;  /* user id of the segment's owner */
};

struct pvp_share_volume {
    uint64_t number; /* counts the volumes of this segment from 1 */
    const void *
        grids; /* NanoVDB grids one behind the other, each aligned to 32 bytes, the first to a page; never NULL
                        * where number is not 0 */
    size_t size; /* bytes of all */
    uint32_t n_grids;
    uint32_t flags;        /* 1: some value was cut to +-65504 on the wire */
    uint64_t set, session; /* PROTOCOL.md, as the three times but the last */
    int64_t t_exposure_ns, t_publish_ns;
    int64_t t_shared_ns; /* when it was complete here, UTC */
};

static inline const char *pvp_share_text(int result)
{
    static const char *const text[] = {
        "done",
        "no volume has come yet",
        "its writer has gone or made a new segment: open it again",
        "nobody shares under this name",
        "another user's: `pyrovox share --readers` lets others read",
        "not a segment of `pyrovox share`, or a damaged one",
        "of a later version of pyrovox: update pyrovox_share.h",
        "the system refused it",
    };
    return result >= 0 && result <= PVP_SHARE_SYSTEM ? text[result] : "unknown";
}

/* Reads the segment that `fd` is open on.  The reader owns `fd` from now on, whatever is returned. */
static inline int pvp_share_attach(struct pvp_share *s, int fd)
{
    const size_t heads =
        sizeof(struct pvp_share_head) + PVP_SHARE_SLOTS * sizeof(struct pvp_share_slot);
    struct stat st;
    struct pvp_share_head h;
    void *map = MAP_FAILED;
    int result = PVP_SHARE_SYSTEM;
    memset(s, 0, sizeof *s);
    s->fd = fd;
    if (fstat(fd, &st) == 0) {
        result = PVP_SHARE_FOREIGN;
        if (st.st_size >= (off_t)heads && (uint64_t)st.st_size <= SIZE_MAX) {
            map = mmap(NULL, (size_t)st.st_size, PROT_READ, MAP_SHARED, fd, 0);
            result = map != MAP_FAILED ? PVP_SHARE_OK : PVP_SHARE_SYSTEM;
        }
    }
    if (result == PVP_SHARE_OK) { /* each field is read once, and then only from h */
        s->map = (const unsigned char *)map;
        s->size = (size_t)st.st_size;
        s->owner = st.st_uid;
        memcpy(&h, map, sizeof h);
        const int ours = memcmp(h.magic, PVP_SHARE_MAGIC, sizeof h.magic) == 0;
        if (ours && h.major != PVP_SHARE_MAJOR)
            result = PVP_SHARE_LATER;
        else if (!ours || h.n_slots != PVP_SHARE_SLOTS || h.size != (uint64_t)s->size ||
                 h.data_offset < heads || h.data_offset > h.size || h.data_offset % 32 != 0 ||
                 h.slot_size % 32 != 0 || h.slot_size > (h.size - h.data_offset) / PVP_SHARE_SLOTS)
            result = PVP_SHARE_FOREIGN;
        s->data_offset = h.data_offset;
        s->slot_size = h.slot_size;
        s->nanovdb = h.nanovdb;
        s->writer = h.writer;
    }
    if (result != PVP_SHARE_OK) {
        const int why = errno;
        if (map != MAP_FAILED)
            munmap(map, (size_t)st.st_size);
        close(fd);
        memset(s, 0, sizeof *s);
        s->fd = -1;
        errno = why;
    }
    return result;
}

/* name: as given to `pyrovox share`, with or without a slash in front.  On error s is closed. */
static inline int pvp_share_open(struct pvp_share *s, const char *name)
{
    char path[PVP_SHARE_NAME + 1];
    const int n = snprintf(path, sizeof path, "/%s", name[0] == '/' ? name + 1 : name);
    int fd;
    memset(s, 0, sizeof *s);
    s->fd = -1;
    if (n < 0 || (size_t)n >= sizeof path)
        return PVP_SHARE_ABSENT;
    fd = shm_open(path, O_RDONLY, 0);
    if (fd >= 0)
        return pvp_share_attach(s, fd);
    return errno == ENOENT || errno == EINVAL ? PVP_SHARE_ABSENT
           : errno == EACCES                  ? PVP_SHARE_DENIED
                                              : PVP_SHARE_SYSTEM;
}

/* May be closed already. */
static inline void pvp_share_close(struct pvp_share *s)
{
    if (s->fd >= 0 && s->map != NULL) {
        munmap((void *)(uintptr_t)s->map, s->size);
        close(s->fd);
    }
    memset(s, 0, sizeof *s);
    s->fd = -1;
}

static inline const struct pvp_share_slot *pvp_share_slot_of(const struct pvp_share *s,
                                                             uint64_t number)
{
    return (const struct pvp_share_slot *)(const void *)(s->map + sizeof(struct pvp_share_head)) +
           number % PVP_SHARE_SLOTS;
}

/* gcc warns that its thread sanitizer does not know fences. */
#if defined(__SANITIZE_THREAD__) && !defined(__clang__)
#define PVP_SHARE_FENCE(order)                        \
    do {                                              \
        _Pragma("GCC diagnostic push");               \
        _Pragma("GCC diagnostic ignored \"-Wtsan\""); \
        __atomic_thread_fence(order);                 \
        _Pragma("GCC diagnostic pop");                \
    } while (0)
#else
#define PVP_SHARE_FENCE(order) __atomic_thread_fence(order)
#endif

/* Reads the lock again, after all earlier reads. */
static inline int pvp_share_unchanged(const struct pvp_share_slot *slot, uint64_t lock)
{
    PVP_SHARE_FENCE(__ATOMIC_ACQUIRE);
    return __atomic_load_n(&slot->lock, __ATOMIC_RELAXED) == lock;
}

/* 1: there is a writer, or this is not known.  The writer holds a lock on the segment that the kernel releases
 * when it ends in any way.  Unlike a process id, the lock does not pass to another process.  Unlike a heartbeat, a
 * writer that is stopped or has nothing to write still has it.  Takes a system call. */
static inline int pvp_share_alive(const struct pvp_share *s)
{
    const struct pvp_share_head *h = (const struct pvp_share_head *)(const void *)s->map;
    struct flock l;
    memset(&l, 0, sizeof l);
    l.l_type = F_RDLCK;
    l.l_whence = SEEK_SET;
    return __atomic_load_n(&h->ended, __ATOMIC_ACQUIRE) == 0 &&
           (fcntl(s->fd, F_GETLK, &l) != 0 || l.l_type != F_UNLCK);
}

/* The newest volume.  PVP_SHARE_OK; PVP_SHARE_NONE; PVP_SHARE_ENDED: v is the last volume, its number 0 if there
 * was none; PVP_SHARE_FOREIGN: damaged.  Never waits: to get a newer volume call it again, with each drawn frame
 * or every few ms. */
static inline int pvp_share_newest(const struct pvp_share *s, struct pvp_share_volume *v)
{
    const struct pvp_share_head *h = (const struct pvp_share_head *)(const void *)s->map;
    const int alive = pvp_share_alive(s); /* first, so that a volume before the end is seen */
    int k;
    memset(v, 0, sizeof *v);
    for (k = 0; k < 16 && v->number == 0; k++) { /* again: it was overwritten at that moment */
        const uint64_t number = __atomic_load_n(&h->newest, __ATOMIC_ACQUIRE);
        const struct pvp_share_slot *slot = pvp_share_slot_of(s, number);
        if (number == 0)
            break;
        if (__atomic_load_n(&slot->lock, __ATOMIC_ACQUIRE) != 2 * number)
            continue;
        v->set = __atomic_load_n(&slot->set, __ATOMIC_RELAXED);
        v->session = __atomic_load_n(&slot->session, __ATOMIC_RELAXED);
        v->t_exposure_ns = __atomic_load_n(&slot->t_exposure_ns, __ATOMIC_RELAXED);
        v->t_publish_ns = __atomic_load_n(&slot->t_publish_ns, __ATOMIC_RELAXED);
        v->t_shared_ns = __atomic_load_n(&slot->t_shared_ns, __ATOMIC_RELAXED);
        v->n_grids = __atomic_load_n(&slot->n_grids, __ATOMIC_RELAXED);
        v->flags = __atomic_load_n(&slot->flags, __ATOMIC_RELAXED);
        const uint64_t size = __atomic_load_n(&slot->size, __ATOMIC_RELAXED);
        if (!pvp_share_unchanged(slot, 2 * number))
            continue;
        if (size > s->slot_size || v->n_grids > PVP_SHARE_GRIDS) {
            memset(v, 0, sizeof *v);
            return PVP_SHARE_FOREIGN;
        }
        v->size = (size_t)size;
        v->grids = s->map + s->data_offset + number % PVP_SHARE_SLOTS * s->slot_size;
        v->number = number;
    }
    if (v->number == 0)
        memset(v, 0, sizeof *v);
    return !alive ? PVP_SHARE_ENDED : v->number != 0 ? PVP_SHARE_OK : PVP_SHARE_NONE;
}

/* 1: no part of the volume was overwritten until now.  Data that was read from it before may be used. */
static inline int pvp_share_intact(const struct pvp_share *s, const struct pvp_share_volume *v)
{
    return v->number != 0 && pvp_share_unchanged(pvp_share_slot_of(s, v->number), 2 * v->number);
}

/* Copies the volume's grids to `to`, v->size bytes, aligned to 32.  1: v->grids are the copy from now on, which is
 * not overwritten; 0: the volume was overwritten meanwhile, ask for the newest. */
static inline int pvp_share_copy(const struct pvp_share *s, struct pvp_share_volume *v, void *to)
{
    memcpy(to, v->grids, v->size);
    if (!pvp_share_intact(s, v))
        return 0;
    v->grids = to;
    return 1;
}

/* The grid of that name ("density", "emission", with --split "red", "green", "blue"; where the volume has error bars
 * "emission_sd", "rgb_sd", "red_sd" and so on) and its bytes; NULL: there is none, or it was overwritten.  Only its size and name are checked. */
static inline const void *pvp_share_grid(const struct pvp_share_volume *v, const char *name,
                                         size_t *size)
{
    const unsigned char *at = (const unsigned char *)v->grids;
    size_t left = v->size;
    uint32_t k;
    for (k = 0; k < v->n_grids && left >= 672;
         k++) { /* a grid's head: its size at 32, its name at 40 */
        uint64_t bytes;
        char own[256];
        memcpy(&bytes, at + 32, sizeof bytes);
        memcpy(own, at + 40, sizeof own);
        if (bytes < 672 || bytes > left || bytes % 32 != 0)
            return NULL;
        own[sizeof own - 1] = '\0';
        if (strcmp(own, name) == 0) {
            *size = (size_t)bytes;
            return at;
        }
        at += bytes;
        left -= (size_t)bytes;
    }
    return NULL;
}

#ifdef __cplusplus
}
#endif
#endif
