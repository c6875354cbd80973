/* fuzz_take.c - takes whose contents are not what a recorder writes.
 *
 * libhdf5's own structures carry checksums, so bytes at random would test those only.  Here a good take is
 * made once; the input says what is changed in it: 6 bytes each, (kind, place 24 bits, value 16 bits).
 *     0  a byte anywhere                       1  a byte of a row, the rows' checksums made right again
 *     2  a byte of the table of members, ditto 3  the file is cut there
 * A second good take goes on from it.  Whatever opens is read from end to end; what it says must be consistent. */
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "capture/take/h5.h"
#include "tests/fuzz/fuzz.h"
#include "tests/lib/take.h"

#define CAMERAS 2
#define SETS    3
#define FROM    0x7700u
#define ROWS    (CAMERAS * SETS)

static unsigned char *base, *file; /* the good take; as it is changed */
static size_t base_size;
static size_t row_at[ROWS], set_at[SETS], member_at;
static int fd = -1;
static char path[64], next[72];

static void no_release(struct cap_frame *f)
{
    (void)f;
}

static void put_set(cap_take_writer *w, uint64_t number)
{
    static unsigned char pixels[64];
    struct cap_frame f[CAMERAS];
    struct cap_set s = {.number = number, .t_exposure_ns = 0x5555, .n = CAMERAS};
    for (uint32_t c = 0; c < CAMERAS; c++) {
        memset(pixels, (int)(number * CAMERAS + c), sizeof pixels);
        f[c] = (struct cap_frame){.img = {pixels, 60, 8, 6, 8, c == 0 ? CAP_GREY8 : CAP_JPEG, 0},
                                  .camera = c,
                                  .id = 0x1122334455660000u + number * CAMERAS + c,
                                  .release = no_release};
        s.frame[c] = &f[c];
    }
    MUST(cap_take_put_set(w, &s, NULL) == PVX_OK);
}

static void remove_files(void)
{
    unlink(path);
    unlink(next);
}

static size_t find(const void *what, size_t n)
{
    unsigned char *p = memmem(base, base_size, what, n);
    MUST(p != NULL);
    return (size_t)(p - base);
}

static void make_take(const char *name, uint64_t from)
{
    static const struct cap_take_camera cameras[CAMERAS] = {{.name = "a"}, {.name = "b"}};
    struct cap_take_head h = take_head(cameras, CAMERAS);
    cap_take_writer *w;
    h.triggered = true;
    h.t_began_ns = h.t_created_ns;
    h.t_created_ns += (int64_t)(from - FROM);
    MUST(cap_take_create(name, &h, &w, NULL) == PVX_OK);
    for (uint64_t k = 0; k < SETS; k++)
        put_set(w, from + k);
    for (uint32_t c = 0; c < CAMERAS; c++) {
        const struct cap_take_gap g = {.camera = c, .why = CAP_TAKE_QUEUE, .frames = 2};
        MUST(cap_take_put_gap(w, &g, NULL) == PVX_OK);
    }
    const struct cap_take_trigger t = {.name = "x", .set = (int64_t)from};
    const struct cap_take_lost l = {.camera = 1, .why = "ring", .frames = 3};
    MUST(cap_take_put_trigger(w, &t, NULL) == PVX_OK && cap_take_put_lost(w, &l, NULL) == PVX_OK);
    MUST(cap_take_close(&w, NULL) == PVX_OK);
}

static void make_base(void)
{
    char name[] = "/tmp/fuzz_take-XXXXXX";
    int tmp = mkstemp(name);
    MUST(tmp >= 0 && unlink(name) == 0);
    close(tmp);
    make_take(name, FROM);
    FILE *f = fopen(name, "rb");
    MUST(f != NULL);
    fseek(f, 0, SEEK_END);
    base_size = (size_t)ftell(f);
    rewind(f);
    base = malloc(base_size);
    file = malloc(base_size);
    MUST(base != NULL && file != NULL && fread(base, 1, base_size, f) == base_size);
    fclose(f);
    unlink(name);
    for (uint64_t i = 0; i < ROWS; i++) {
        uint64_t id = 0x1122334455660000u + FROM * CAMERAS + i;
        row_at[i] = find(&id, sizeof id);
    }
    for (uint64_t k = 0; k < SETS; k++) {
        uint64_t number[2] = {FROM + k, 0x5555}; /* and t_exposure_ns */
        set_at[k] = find(number, sizeof number);
    }
    int64_t members[SETS * CAMERAS] = {0, 0, 1, 1, 2, 2};
    member_at = find(members, sizeof members);
    /* with a name of its own: libhdf5 asks for the real one of what it opens */
    snprintf(path, sizeof path, "/dev/shm/fuzz_take-XXXXXX");
    fd = mkstemp(path);
    MUST(fd >= 0 && atexit(remove_files) == 0);
    snprintf(next, sizeof next, "%s-0002", path);
    make_take(next, FROM + SETS);
    /* each opening takes and clears a megabyte; given back, AddressSanitizer would map it anew each time */
    H5set_free_list_limits(16 << 20, 16 << 20, 4 << 20, 256 << 10, 16 << 20, 1 << 20);
}

/* Rows as they are now get the checksums that they should have. */
static void make_right(void)
{
    for (int i = 0; i < ROWS; i++) {
        struct cap_take_row r;
        memcpy(&r, file + row_at[i], sizeof r);
        r.check = take_row_check(&r);
        memcpy(file + row_at[i], &r, sizeof r);
    }
    for (int k = 0; k < SETS; k++) {
        struct cap_take_set s;
        int64_t member[CAMERAS];
        memcpy(&s, file + set_at[k], sizeof s);
        memcpy(member, file + member_at + (size_t)k * sizeof member, sizeof member);
        s.check = take_set_check(&s, member, CAMERAS);
        memcpy(file + set_at[k], &s, sizeof s);
    }
}

static size_t change(size_t size, const uint8_t *p)
{
    size_t place = (size_t)p[1] | (size_t)p[2] << 8 | (size_t)p[3] << 16;
    switch (p[0] % 4) {
    case 0: file[place % base_size] = p[4]; return size;
    case 1: {
        size_t i = place % (ROWS + SETS), n = i < ROWS ? 104 : 48;
        file[(i < ROWS ? row_at[i] : set_at[i - ROWS]) + p[5] % n] = p[4];
        break;
    }
    case 2: file[member_at + place % (SETS * CAMERAS * 8)] = p[4]; break;
    default: return place % (base_size + 1) < size ? place % (base_size + 1) : size;
    }
    make_right();
    return size;
}

static void use(const cap_take *t)
{
    const struct cap_take_info *i = cap_take_info(t);
    MUST(i->head.n_cameras >= 1 && i->head.n_cameras <= CAP_MAX_CAMERAS);
    for (uint64_t k = 0; k < i->sets; k++) {
        const int64_t *member;
        const struct cap_take_set *s = cap_take_set(t, k, &member);
        MUST(cap_take_find_set(t, (int64_t)s->number) == (int64_t)k);
        for (uint32_t c = 0; c < i->head.n_cameras; c++)
            if (member[c] >= 0 &&
                cap_take_row(t, c, (uint64_t)member[c])->set != (int64_t)s->number)
                abort();
    }
    for (uint64_t g = 0; g < i->gaps; g++)
        if (cap_take_gap(t, g)->camera >= i->head.n_cameras)
            abort();
    for (uint64_t k = 0; k < i->triggers; k++)
        if (strlen(cap_take_trigger(t, k)->name) >= CAP_TAKE_TRIGGER_MAX)
            abort();
    for (uint64_t k = 0; k < i->lost; k++)
        if (cap_take_lost(t, k)->camera >= i->head.n_cameras ||
            strlen(cap_take_lost(t, k)->why) >= CAP_TAKE_LOST_MAX)
            abort();
    for (uint32_t c = 0; c < i->head.n_cameras; c++) {
        size_t size = cap_take_frame_max(t, c);
        void *mem = malloc(size > 0 ? size : 1);
        struct cap_image img;
        for (uint64_t r = 0; mem != NULL && r < i->head.camera[c].frames; r++)
            if (cap_take_read(t, c, r, mem, size, &img, NULL) == PVX_OK && img.size > size)
                abort();
        free(mem);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (base == NULL)
        make_base();
    memcpy(file, base, base_size);
    size_t n = base_size;
    for (size_t i = 0; i + 6 <= size && i < 96; i += 6)
        n = change(n, data + i);
    MUST(pwrite(fd, file, n, 0) == (ssize_t)n && ftruncate(fd, (off_t)n) == 0);
    cap_take *t;
    struct pvx_diag d = {""};
    pvx_err e = cap_take_open(path, &t, &d);
    MUST(size > 0 || e == PVX_OK); /* as it was written */
    fuzz_taken += e == PVX_OK;
    if (e == PVX_OK)
        use(t);
    else if (t != NULL || d.text[0] == '\0')
        abort();
    cap_take_free(&t);
    return 0;
}
