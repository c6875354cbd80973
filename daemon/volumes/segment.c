#include "daemon/volumes/segment.h"

#include <pwd.h>
#include <stdlib.h>

#include "base/clock.h"

#define SHM         "/dev/shm"
#define DATA_OFFSET 4096u
#define TRIES       100 /* the name may come and go meanwhile */

_Static_assert(sizeof(struct pvp_share_head) == 64 && sizeof(struct pvp_share_slot) == 64,
               "PROTOCOL.md");

struct vol_segment {
    char path[sizeof SHM + PVP_SHARE_NAME];
    mode_t mode;
    int fd;
    uint64_t size, slot_size;
    uint64_t backed[PVP_SHARE_SLOTS]; /* bytes of each slot that have memory */
    struct pvp_share_head *head;      /* the whole segment, mapped */
};

static struct pvp_share_slot *segment_slot_of(const struct vol_segment *s, uint64_t number)
{
    return (struct pvp_share_slot *)(s->head + 1) + number % PVP_SHARE_SLOTS;
}

/* An OFD lock belongs to the open file, not to the process.  So a reader in this process sees it too, and only the
 * last close drops it. */
static bool lock(int fd)
{
    struct flock l = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
    return fcntl(fd, F_OFD_SETLK, &l) == 0;
}

static pvx_err no_room(const struct vol_segment *s, int why, struct pvx_diag *d)
{
    if (why == ENOSPC || why == ENOMEM || why == EDQUOT)
        return pvx_fail(d, PVX_ENOSPC,
                        "%s: no room in " SHM ": remove what is not needed there, or give it more "
                        "(mount -o remount,size=4G " SHM ")",
                        s->path);
    return pvx_fail(d, pvx_err_from_errno(why), "%s: %s", s->path, strerror(why));
}

/* ---- a segment without a name ------------------------------------------------------------------- */

static void segment_drop(struct vol_segment *s)
{
    if (s->head != NULL)
        munmap(s->head, s->size);
    if (s->fd >= 0)
        close(s->fd);
    s->head = NULL;
    s->fd = -1;
}

/* Get memory for bytes from..to of the file, which keeps it, so that a write never meets a full /dev/shm. */
static int segment_back(int fd, uint64_t from, uint64_t to)
{
    int e = 0;
    do
        e = fallocate(fd, 0, (off_t)from, (off_t)(to - from)) == 0 ? 0 : errno;
    while (e == EINTR);
    return e;
}

static pvx_err segment_make(struct vol_segment *s, uint64_t slot_size, uint32_t nanovdb,
                            struct pvx_diag *d)
{
    s->slot_size = (slot_size + DATA_OFFSET - 1) / DATA_OFFSET * DATA_OFFSET;
    s->size = DATA_OFFSET + PVP_SHARE_SLOTS * s->slot_size;
    memset(s->backed, 0, sizeof s->backed);
    s->fd = open(SHM, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (s->fd < 0)
        return no_room(s, errno, d);
    int why = fchmod(s->fd, s->mode) != 0 || !lock(s->fd) || ftruncate(s->fd, (off_t)s->size) != 0
                  ? errno
                  : segment_back(s->fd, 0, DATA_OFFSET);
    void *map = MAP_FAILED;
    if (why == 0) {
        map = mmap(NULL, s->size, PROT_READ | PROT_WRITE, MAP_SHARED, s->fd, 0);
        why = map != MAP_FAILED ? 0 : errno;
    }
    if (why != 0) {
        segment_drop(s);
        return no_room(s, why, d);
    }
    s->head = map;
    *s->head = (struct pvp_share_head){.major = PVP_SHARE_MAJOR,
                                       .n_slots = PVP_SHARE_SLOTS,
                                       .size = s->size,
                                       .data_offset = DATA_OFFSET,
                                       .slot_size = s->slot_size,
                                       .nanovdb = nanovdb,
                                       .writer = (uint32_t)getpid()};
    memcpy(s->head->magic, PVP_SHARE_MAGIC, sizeof s->head->magic);
    return PVX_OK;
}

/* ---- its name ----------------------------------------------------------------------------------- */

static bool is_at(int fd, const char *path)
{
    struct stat a, b;
    return fstat(fd, &a) == 0 && lstat(path, &b) == 0 && a.st_dev == b.st_dev &&
           a.st_ino == b.st_ino;
}

static pvx_err of_another(const struct vol_segment *s, struct pvx_diag *d)
{
    struct stat st;
    if (lstat(s->path, &st) != 0)
        return PVX_OK; /* gone meanwhile */
    const struct passwd *who = getpwuid(st.st_uid);
    return pvx_fail(d, PVX_EPERM,
                    "%s belongs to another user, %s (%u): choose another name, or have it removed "
                    "by them",
                    s->path, who != NULL ? who->pw_name : "?", (unsigned)st.st_uid);
}

/* Remove a dead segment that has the name, open on `fd`.  PVX_OK: it has been removed or was gone. */
static pvx_err remove_dead(const struct vol_segment *s, int fd, struct pvx_diag *d)
{
    struct stat st;
    struct pvp_share_head h = {.writer = 0};
    if (fstat(fd, &st) != 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", s->path, strerror(errno));
    if (st.st_uid != geteuid())
        return of_another(s, d);
    if (!S_ISREG(st.st_mode) || pread(fd, &h, sizeof h, 0) != sizeof h ||
        memcmp(h.magic, PVP_SHARE_MAGIC, sizeof h.magic) != 0)
        return pvx_fail(d, PVX_EBUSY,
                        "%s is there and not pyrovox's: choose another name, or remove it",
                        s->path);
    if (!lock(fd))
        return pvx_fail(d, PVX_EBUSY,
                        "%s: process %u shares under that name: choose another, or end that one",
                        s->path, h.writer);
    /* Of two writers at once, only one gets here while the file still has the name. */
    if (is_at(fd, s->path) && unlink(s->path) != 0 && errno != ENOENT)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", s->path, strerror(errno));
    return PVX_OK;
}

static pvx_err make_way(const struct vol_segment *s, struct pvx_diag *d)
{
    int fd = open(s->path, O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (fd < 0 && errno == ENOENT)
        return PVX_OK;
    if (fd < 0 && errno == EACCES)
        return of_another(s, d);
    if (fd < 0)
        return pvx_fail(d, PVX_EBUSY, "%s: %s: choose another name", s->path, strerror(errno));
    pvx_err e = remove_dead(s, fd, d);
    close(fd);
    return e;
}

static pvx_err give_name(const struct vol_segment *s, struct pvx_diag *d)
{
    char self[64];
    snprintf(self, sizeof self, "/proc/self/fd/%d", s->fd);
    for (int k = 0; k < TRIES; k++) {
        if (linkat(AT_FDCWD, self, AT_FDCWD, s->path, AT_SYMLINK_FOLLOW) == 0)
            return PVX_OK;
        if (errno != EEXIST)
            return no_room(s, errno, d);
        PVX_TRY(make_way(s, d));
    }
    return pvx_fail(d, PVX_EBUSY, "%s: others take that name: choose another", s->path);
}

/* Set `ended` first: a reader that finds the name gone, or on another file, has then seen why. */
static void segment_end(struct vol_segment *s)
{
    if (s->head == NULL)
        return;
    __atomic_store_n(&s->head->ended, 1, __ATOMIC_RELEASE);
    if (is_at(s->fd, s->path))
        unlink(s->path);
    segment_drop(s);
}

/* ---- what others call --------------------------------------------------------------------------- */

pvx_err vol_segment_new(const char *name, mode_t mode, vol_segment **out, struct pvx_diag *d)
{
    const char *own = name[0] == '/' ? name + 1 : name;
    *out = NULL;
    if (own[0] == '\0' || strlen(own) >= PVP_SHARE_NAME || strchr(own, '/') != NULL ||
        strcmp(own, ".") == 0 || strcmp(own, "..") == 0)
        return pvx_fail(d, PVX_EINVAL,
                        "'%.64s' cannot be a name in shared memory: 1 to %d bytes, no slash", name,
                        PVP_SHARE_NAME - 1);
    struct vol_segment *s = calloc(1, sizeof *s);
    PVX_NEED(s);
    s->mode = mode;
    snprintf(s->path, sizeof s->path, SHM "/%s", own);
    pvx_err e = segment_make(s, 0, 0, d);
    if (e == PVX_OK) {
        e = give_name(s, d);
        if (e != PVX_OK)
            segment_drop(s);
    }
    if (e != PVX_OK)
        free(s);
    else
        *out = s;
    return e;
}

pvx_err vol_segment_room(vol_segment *s, uint64_t slot_size, uint32_t nanovdb, struct pvx_diag *d)
{
    struct vol_segment before = *s;
    s->head = NULL;
    pvx_err e = segment_make(s, slot_size, nanovdb, d);
    if (e != PVX_OK) {
        *s = before;
        return e;
    }
    segment_end(&before);
    return give_name(s, d);
}

uint64_t vol_segment_slot_size(const vol_segment *s)
{
    return s->slot_size;
}

bool vol_segment_named(const vol_segment *s)
{
    struct stat st;
    return fstat(s->fd, &st) == 0 && st.st_nlink > 0;
}

pvx_err vol_segment_begin(vol_segment *s, uint64_t bytes, void **grids, struct pvx_diag *d)
{
    const uint64_t number = s->head->newest + 1, k = number % PVP_SHARE_SLOTS;
    const uint64_t at = DATA_OFFSET + k * s->slot_size;
    if (bytes > s->slot_size)
        return pvx_fail(d, PVX_ERANGE, "%s: a volume larger than its slots", s->path);
    if (bytes > s->backed[k]) {
        int why = segment_back(s->fd, at + s->backed[k], at + bytes);
        if (why != 0)
            return no_room(s, why, d);
        s->backed[k] = bytes;
    }
    /* A reader that sees anything of what is written from now on sees the lock too. */
    __atomic_store_n(&segment_slot_of(s, number)->lock, 2 * number - 1, __ATOMIC_RELAXED);
    PVP_SHARE_FENCE(__ATOMIC_RELEASE);
    *grids = (char *)s->head + at;
    return PVX_OK;
}

void vol_segment_commit(vol_segment *s, const struct pvp_share_slot *about)
{
    const uint64_t number = s->head->newest + 1;
    struct pvp_share_slot *to = segment_slot_of(s, number);
#define PUT(field, value) __atomic_store_n(&to->field, value, __ATOMIC_RELAXED)
    PUT(set, about->set);
    PUT(session, about->session);
    PUT(t_exposure_ns, about->t_exposure_ns);
    PUT(t_publish_ns, about->t_publish_ns);
    PUT(t_shared_ns, pvx_now_real());
    PUT(size, about->size);
    PUT(n_grids, about->n_grids);
    PUT(flags, about->flags);
#undef PUT
    __atomic_store_n(&to->lock, 2 * number, __ATOMIC_RELEASE);
    __atomic_store_n(&s->head->newest, number, __ATOMIC_RELEASE);
}

void vol_segment_free(vol_segment **sp)
{
    if (*sp == NULL)
        return;
    segment_end(*sp);
    free(*sp);
    *sp = NULL;
}
