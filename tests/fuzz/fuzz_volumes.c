/* fuzz_volumes.c - HDF5 recordings of volumes whose contents are not what the recorder writes.
 *
 * libhdf5's own structures carry checksums, so bytes at random would test those only.  Here a good recording is made
 * once; the input says what is changed in it: 11 bytes each, (kind, which, place, value of 64 bits).
 *     0  a byte anywhere                   1  the file is cut there
 *     2  an attribute of the head          3  a row of a column, of sets or gaps
 *     4  a length: of a column, of emission    5  something is deleted
 * One byte more than a multiple of 11: the same done to a file that is joined of two parts.
 * Whatever opens is read from end to end; what it says must be consistent. */
#include <fcntl.h>
#include <hdf5.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#include "daemon/volumes/join.h"
#include "tests/fuzz/fuzz.h"
#include "tests/lib/volumes.h"

#define SETS 4

static struct subject {
    unsigned char *base; /* the good recording */
    size_t base_size;
    int fd;
    char path[64];
    char link_name[64][64]; /* of groups and datasets, as "sets/number" */
    unsigned links;
} whole, joined, *now;
static char parts[] = "/dev/shm/fuzz_joined-XXXXXX"; /* on a disk most of the time would be its */

static herr_t note_link(hid_t group, const char *name, const H5L_info_t *info, void *ctx)
{
    struct subject *s = ctx;
    (void)group, (void)info;
    if (s->links < sizeof s->link_name / sizeof s->link_name[0])
        snprintf(s->link_name[s->links++], sizeof s->link_name[0], "%s", name);
    return 0;
}

/* Sets [first, end) of five, of which set 3 is missing. */
static void record(const char *name, uint64_t first, uint64_t end)
{
    struct pvp_start s = volumes_start(20, 9, 17, 3);
    struct vol_head head = {.start = s, .rig = "cameras: []\n", .config = "x: 1\n"};
    struct vol_gap gap = {VOL_GAP_LOST, 3, 3, 1};
    vol_writer *w;
    MUST(vol_writer_open(VOL_HDF5, name, &head, NULL, &w, NULL) == PVX_OK);
    for (uint64_t k = first; k < end; k++) {
        struct made_volume m = volumes_make(&s, k < 3 ? k : k + 1, 0.6);
        float *bars = k == 1 ? NULL : volumes_bars(&m, k == 0 ? 0 : 2, PVP_DOUBT_LATE);
        MUST(vol_writer_put(w, &m.v, NULL) == PVX_OK);
        vol_store_free(&m.store);
        free(bars);
    }
    MUST(vol_writer_gap(w, &gap, NULL) == PVX_OK && vol_writer_close(&w, NULL) == PVX_OK);
}

static void keep(struct subject *s, const char *name)
{
    FILE *f = fopen(name, "rb");
    MUST(f != NULL);
    fseek(f, 0, SEEK_END);
    s->base_size = (size_t)ftell(f);
    rewind(f);
    s->base = malloc(s->base_size);
    MUST(s->base != NULL && fread(s->base, 1, s->base_size, f) == s->base_size);
    fclose(f);
    hid_t h = H5Fopen(name, H5F_ACC_RDONLY, H5P_DEFAULT);
    MUST(h >= 0);
    H5Lvisit(h, H5_INDEX_NAME, H5_ITER_INC, note_link, s);
    H5Fclose(h);
    MUST(s->links > 20);
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
}

static void remove_parts(void)
{
    unlink(whole.path);
    static const char *const names[] = {"/v.h5", "/a.h5", "/b.h5", ""};
    char name[64];
    for (int i = 0; i < 4; i++) {
        snprintf(name, sizeof name, "%s%s", parts, names[i]);
        remove(name);
    }
}

static void make_joined(void)
{
    static const uint64_t numbers[] = {0, 1, 2, 4, 9}; /* the last is not there */
    char a[64], b[64];
    const char *const part[] = {a, b};
    size_t missing;
    MUST(mkdtemp(parts) != NULL);
    atexit(remove_parts);
    snprintf(a, sizeof a, "%s/a.h5", parts);
    snprintf(b, sizeof b, "%s/b.h5", parts);
    snprintf(joined.path, sizeof joined.path, "%s/v.h5", parts);
    record(a, 0, 2);
    record(b, 2, SETS);
    const struct vol_join j = {joined.path, part, 2, numbers, 5};
    MUST(vol_join(&j, &missing, NULL) == PVX_OK && missing == 1);
    keep(&joined, joined.path);
    joined.fd = open(joined.path, O_RDWR | O_CLOEXEC);
    MUST(joined.fd >= 0);
}

static void make_whole(void)
{
    char folder[] = "/tmp/fuzz_volumes-XXXXXX", name[64];
    MUST(mkdtemp(folder) != NULL);
    snprintf(name, sizeof name, "%s/v.h5", folder);
    record(name, 0, SETS);
    keep(&whole, name);
    unlink(name);
    rmdir(folder);
    /* with a name of its own: libhdf5 asks for the real one of what it opens */
    snprintf(whole.path, sizeof whole.path, "/dev/shm/fuzz_volumes-XXXXXX");
    whole.fd = mkstemp(whole.path);
    MUST(whole.fd >= 0);
}

static void set_attribute(hid_t f, unsigned which, const uint8_t *value)
{
    int64_t v[8] = {0};
    memcpy(v, value, 8);
    v[1] = v[2] = v[0];
    hsize_t n = (hsize_t)H5Aget_num_attrs(f);
    hid_t a =
        H5Aopen_by_idx(f, ".", H5_INDEX_NAME, H5_ITER_INC, which % n, H5P_DEFAULT, H5P_DEFAULT);
    hid_t type = H5Aget_type(a);
    if (H5Aget_storage_size(a) <= sizeof v)
        H5Awrite(a, type, v);
    H5Tclose(type);
    H5Aclose(a);
}

static void set_row(hid_t set, unsigned row, const uint8_t *value)
{
    char v[64] = {0};
    memcpy(v, value, 8);
    hid_t space = H5Dget_space(set), type = H5Dget_type(set), one;
    hsize_t n = 0, at, k = 1;
    if (H5Sget_simple_extent_ndims(space) == 1 && H5Tget_size(type) <= sizeof v) {
        H5Sget_simple_extent_dims(space, &n, NULL);
        at = n > 0 ? row % n : 0;
        one = H5Screate_simple(1, &k, NULL);
        if (n > 0 && H5Sselect_hyperslab(space, H5S_SELECT_SET, &at, NULL, &k, NULL) >= 0)
            H5Dwrite(set, type, one, space, H5P_DEFAULT, v);
        H5Sclose(one);
    }
    H5Tclose(type);
    H5Sclose(space);
}

static void set_length(hid_t set, unsigned length)
{
    hsize_t n[8];
    hid_t space = H5Dget_space(set);
    if (H5Sget_simple_extent_ndims(space) >= 1 && H5Sget_simple_extent_ndims(space) <= 8) {
        H5Sget_simple_extent_dims(space, n, NULL);
        n[0] = length % (2 * SETS);
        H5Dset_extent(set, n);
    }
    H5Sclose(space);
}

static void edit(hid_t f, const uint8_t *p)
{
    const char *name = now->link_name[p[1] % now->links];
    hid_t set = p[0] % 6 == 3 || p[0] % 6 == 4 ? H5Dopen2(f, name, H5P_DEFAULT) : -1;
    switch (p[0] % 6) {
    case 2: set_attribute(f, p[1], p + 3); break;
    case 3:
        if (set >= 0)
            set_row(set, p[2], p + 3);
        break;
    case 4:
        if (set >= 0)
            set_length(set, p[2]);
        break;
    default: H5Ldelete(f, name, H5P_DEFAULT);
    }
    if (set >= 0)
        H5Dclose(set);
}

/* By libhdf5 itself, so that its checksums are right, before the damage, which it is not for.  What is not to be
 * edited is not opened. */
static void edit_all(const uint8_t *data, size_t size)
{
    hid_t f = -1;
    for (size_t i = 0; i + 11 <= size; i += 11) {
        if (data[i] % 6 < 2)
            continue;
        if (f < 0)
            f = H5Fopen(now->path, H5F_ACC_RDWR, H5P_DEFAULT);
        MUST(f >= 0);
        edit(f, data + i);
    }
    if (f >= 0)
        H5Fclose(f);
}

static void damage(const uint8_t *p)
{
    size_t place = (size_t)p[3] | (size_t)p[4] << 8 | (size_t)p[5] << 16;
    if (p[0] % 6 == 0)
        MUST(pwrite(now->fd, p + 6, 1, (off_t)(place % now->base_size)) == 1);
    else if (p[0] % 6 == 1)
        MUST(ftruncate(now->fd, (off_t)(place % now->base_size)) == 0);
}

static void use(vol_reader *r)
{
    const struct vol_head *h = vol_reader_head(r);
    uint64_t n = vol_reader_count(r);
    const struct vol_gap *g;
    uint32_t nb[3], all;
    MUST(pvp_grid_valid(&h->start.grid));
    MUST(memchr(h->start.units, 0, sizeof h->start.units) != NULL);
    all = pvp_grid_bricks(&h->start.grid, nb);
    for (uint64_t k = 0; k < n && k < 4 * SETS; k++) {
        vol_reader_modes(r, k % 2 == 0);
        struct vol_volume v;
        struct pvx_diag d = {""};
        if (vol_reader_get(r, k, &v, &d) != PVX_OK) {
            MUST(d.text[0] != '\0');
            continue;
        }
        for (uint32_t b = 0; b < v.n_bricks; b++)
            MUST(v.ids[b] < all && (b == 0 || v.ids[b] > v.ids[b - 1]));
        for (size_t i = 0; i < (size_t)v.n_bricks * 512 * h->start.grid.channels; i++)
            MUST(isfinite(v.brick[i]));
        for (size_t i = 0;
             v.bars.sd != NULL && i < (size_t)v.n_bricks * 512 * h->start.grid.channels; i++)
            MUST(v.bars.sd[i] >= 0);
        for (size_t i = 0; i < (size_t)v.bars.n_modes * v.n_bricks * 512 * h->start.grid.channels;
             i++)
            MUST(isfinite(v.bars.modes[i]));
        MUST(memchr(v.v.report.solver, 0, sizeof v.v.report.solver) != NULL);
    }
    for (uint64_t k = 0; (g = vol_reader_gap(r, k)) != NULL; k++)
        MUST(g->why < VOL_GAPS);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (whole.base == NULL) {
        make_whole();
        make_joined();
        /* each opening takes and clears a megabyte; given back, AddressSanitizer would map it anew each time */
        H5set_free_list_limits(16 << 20, 16 << 20, 4 << 20, 256 << 10, 16 << 20, 1 << 20);
    }
    now = size % 11 == 1 ? &joined : &whole;
    MUST(pwrite(now->fd, now->base, now->base_size, 0) == (ssize_t)now->base_size &&
         ftruncate(now->fd, (off_t)now->base_size) == 0);
    size = size < 98 ? size : 98;
    edit_all(data, size);
    for (size_t i = 0; i + 11 <= size; i += 11)
        damage(data + i);
    vol_reader *r;
    struct pvx_diag d = {""};
    pvx_err e = vol_reader_open(now->path, &r, &d);
    MUST(size > 1 || e == PVX_OK); /* as it was written */
    fuzz_taken += e == PVX_OK;
    if (e == PVX_OK)
        use(r);
    else
        MUST(r == NULL && d.text[0] != '\0');
    vol_reader_close(&r);
    return 0;
}
