/* read.c - the reading half of take.h.
 *
 * Nothing that the file says is believed: types, ranks and sizes are compared with what they must be
 * before a byte is read into memory, tables are read a chunk at a time up to the first that cannot be
 * read, rows count only with their checksum, sets only with all their frames.  What libhdf5 itself makes
 * of a hostile file is beyond this. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "base/mem.h"
#include "capture/take/h5.h"

#define SQUEEZE   1100 /* gzip, should somebody have repacked the file, makes no more of a byte */
#define ROW_SLACK 65536

struct camera {
    struct cap_take_camera c; /* its strings are owned here */
    struct cap_take_row *row;
    hid_t frames;
    int rank;
    hsize_t dims[4];
    hid_t type;
    uint64_t stream; /* bytes of JPEG that there are */
    size_t largest;
};

struct cap_take {
    char *path;
    hid_t file;
    uint64_t file_bytes;
    struct cap_take_info info;
    struct camera *camera;
    struct cap_take_camera *cameras; /* for info.head */
    struct cap_take_set *set;
    int64_t *member; /* [sets][n_cameras] */
    struct cap_take_gap *gap;
};

static pvx_err wrong(const cap_take *t, struct pvx_diag *d, const char *what)
{
    H5Eclear2(H5E_DEFAULT);
    return pvx_fail(d, PVX_EFORMAT, "%s: is not a take of raw frames, or damaged: %s", t->path,
                    what);
}

/* ---- tables ---- */

/* All rows that can be read, from the first; *n = how many.  rows * size bytes, owner: caller; NULL = no
 * memory, or more rows than the file can have. */
static void *read_table(const cap_take *t, hid_t set, hid_t type, int rank, hsize_t width,
                        size_t size, uint64_t *n)
{
    uint64_t rows = *n;
    *n = 0;
    if (rows > (t->file_bytes / size + 1) * SQUEEZE + ROW_SLACK)
        return NULL;
    unsigned char *out = calloc(rows + 1, size);
    if (out == NULL)
        return NULL;
    for (uint64_t i = 0; i < rows; i += TAKE_ROWS) {
        uint64_t count = rows - i < TAKE_ROWS ? rows - i : TAKE_ROWS;
        if (!take_h5_read_rows(set, type, rank, width, i, count, out + i * size))
            break;
        *n = i + count;
    }
    H5Eclear2(H5E_DEFAULT);
    return out;
}

static pvx_err read_gaps(cap_take *t, struct pvx_diag *d)
{
    hid_t type = take_h5_gap_type(),
          set = take_h5_open_table(t->file, "gaps", type, 1, NULL, &t->info.gaps);
    pvx_err e = PVX_OK;
    if (set < 0)
        e = wrong(t, d, "gaps");
    else if ((t->gap = read_table(t, set, type, 1, 1, sizeof *t->gap, &t->info.gaps)) == NULL)
        e = wrong(t, d, "too many gaps");
    for (uint64_t i = 0; e == PVX_OK && i < t->info.gaps; i++)
        if (t->gap[i].camera >= t->info.head.n_cameras || t->gap[i].why >= CAP_TAKE_N_WHY)
            t->info.gaps = i;
    if (set >= 0)
        H5Dclose(set);
    H5Tclose(type);
    return e;
}

/* ---- cameras ---- */

/* Times that can be subtracted from each other, and played in turns (source.c). */
static bool is_time(int64_t ns)
{
    return ns >= 0 && ns <= INT64_MAX / 2;
}

static bool row_fits(const struct camera *k, const struct cap_take_row *r, size_t bytes)
{
    if (r->check != take_row_check(r) || r->why > CAP_TAKE_OVERFLOW || !is_time(r->t_exposure_ns) ||
        !is_time(r->t_arrival_mono_ns))
        return false;
    if (k->rank > 1)
        return r->bytes == bytes && r->offset == 0;
    return r->bytes > 0 && r->bytes <= cap_pixfmt_image(k->c.fmt, k->c.width, k->c.height) * 4 &&
           r->offset <= k->stream && r->bytes <= k->stream - r->offset;
}

/* Rows lie before their pixels, so a cut takes the pixels of a camera's last frames first: those are left
 * out.  Pixels are appended in order, so the first frame without is found by halving. */
static pvx_err leave_out_cut_frames(cap_take *t, uint32_t camera, struct pvx_diag *d)
{
    struct camera *k = &t->camera[camera];
    if (k->largest > t->file_bytes * SQUEEZE + ROW_SLACK)
        return wrong(t, d, "frames larger than the file");
    void *mem = malloc(k->largest + 1);
    if (mem == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a frame of %zu bytes", t->path,
                        k->largest);
    struct cap_image img;
    uint64_t good = 0, bad = k->c.frames; /* those before `good` have theirs, `bad` has not */
    if (bad > 0 && cap_take_read(t, camera, bad - 1, mem, k->largest, &img, NULL) == PVX_OK)
        good = bad;
    while (good < bad) {
        uint64_t mid = good + (bad - good) / 2;
        if (cap_take_read(t, camera, mid, mem, k->largest, &img, NULL) == PVX_OK)
            good = mid + 1;
        else
            bad = mid;
    }
    free(mem);
    k->c.frames = good;
    return PVX_OK;
}

static pvx_err read_index(cap_take *t, struct camera *k, hid_t group, uint64_t frames,
                          struct pvx_diag *d)
{
    hid_t type = take_h5_row_type();
    hid_t set = take_h5_open_table(group, "index", type, 1, NULL, &k->c.frames);
    if (set >= 0)
        k->row = read_table(t, set, type, 1, 1, sizeof *k->row, &k->c.frames);
    if (set >= 0)
        H5Dclose(set);
    H5Tclose(type);
    if (k->row == NULL)
        return wrong(t, d, "a camera's index");
    size_t bytes = cap_pixfmt_row(k->c.fmt, k->c.width) * (size_t)k->c.height;
    k->largest = k->rank > 1 ? bytes : 0;
    uint64_t n = k->rank > 1 && frames < k->c.frames ? frames : k->c.frames;
    for (k->c.frames = 0; k->c.frames < n; k->c.frames++) {
        const struct cap_take_row *r = &k->row[k->c.frames];
        if (!row_fits(k, r, bytes))
            break;
        k->largest = r->bytes > k->largest ? r->bytes : k->largest;
    }
    return PVX_OK;
}

static pvx_err read_frames(cap_take *t, struct camera *k, hid_t group, struct pvx_diag *d)
{
    int64_t width, height, yuv;
    char *fmt = take_h5_get_text(group, "pixel_format", false);
    k->c.fmt = fmt != NULL ? cap_pixfmt_parse(fmt) : CAP_FMT_NONE;
    free(fmt);
    if (k->c.fmt == CAP_FMT_NONE || !take_h5_get_int(group, "width", &width) ||
        !take_h5_get_int(group, "height", &height) || !take_h5_get_int(group, "yuv", &yuv) ||
        width < 1 || height < 1 || width > TAKE_SIDE_MAX || height > TAKE_SIDE_MAX || yuv < 0 ||
        yuv > 255)
        return wrong(t, d, "a camera's pixel format or size");
    k->c.width = (int32_t)width;
    k->c.height = (int32_t)height;
    k->c.yuv = (uint8_t)yuv;
    k->rank = take_h5_shape(k->c.fmt, k->c.width, k->c.height, k->dims, &k->type);
    if (k->rank < 1)
        return wrong(t, d, "a camera's pixel format");
    uint64_t n;
    k->frames = take_h5_open_table(group, "frames", k->type, k->rank, k->dims, &n);
    if (k->frames < 0)
        return wrong(t, d, "a camera's frames");
    k->stream = k->rank == 1 ? n : 0;
    return read_index(t, k, group, n, d);
}

struct listing {
    cap_take *t;
    uint32_t n;
    bool bad;
};

static herr_t list_camera(hid_t group, const char *name, const H5L_info_t *info, void *ctx)
{
    struct listing *l = ctx;
    cap_take *t = l->t;
    int64_t number = -1;
    if (info->type != H5L_TYPE_HARD || strlen(name) >= CAP_TAKE_NAME_MAX) {
        l->bad = true;
        return 1;
    }
    hid_t g = H5Gopen2(group, name, H5P_DEFAULT);
    if (g >= 0 && take_h5_get_int(g, "number", &number) && number >= 0 &&
        number < CAP_MAX_CAMERAS && t->camera[number].c.name == NULL) {
        t->camera[number].c.name = strdup(name);
        t->camera[number].c.uri = take_h5_get_text(g, "uri", false);
        t->camera[number].c.settings = take_h5_get_text(g, "settings", true);
        t->camera[number].c.serial = take_h5_get_text(g, "serial", false);
        t->camera[number].c.temperature_c = NAN; /* older takes have neither */
        take_h5_get_attr(g, "temperature_c", H5T_NATIVE_DOUBLE, 8,
                         &t->camera[number].c.temperature_c);
        l->n++;
    } else {
        l->bad = true;
    }
    if (g >= 0)
        H5Gclose(g);
    return l->bad;
}

static pvx_err read_cameras(cap_take *t, struct pvx_diag *d)
{
    struct listing l = {.t = t};
    hid_t cameras = H5Gopen2(t->file, "cameras", H5P_DEFAULT);
    if (cameras < 0)
        return wrong(t, d, "no cameras");
    hsize_t at = 0;
    if (H5Literate(cameras, H5_INDEX_NAME, H5_ITER_INC, &at, list_camera, &l) < 0 || l.n == 0)
        l.bad = true;
    pvx_err e = l.bad ? wrong(t, d, "the list of cameras") : PVX_OK;
    t->info.head.n_cameras = l.n;
    for (uint32_t c = 0; c < l.n && e == PVX_OK; c++) {
        struct camera *k = &t->camera[c];
        if (k->c.name == NULL || k->c.uri == NULL || k->c.settings == NULL) {
            e = wrong(t, d, "a camera's name, source or settings");
            break;
        }
        hid_t g = H5Gopen2(cameras, k->c.name, H5P_DEFAULT);
        if (H5Lexists(g, "frames", H5P_DEFAULT) > 0)
            e = read_frames(t, k, g, d);
        if (e == PVX_OK)
            e = leave_out_cut_frames(t, c, d);
        H5Gclose(g);
        t->cameras[c] = k->c;
        if (k->c.serial == NULL)
            t->cameras[c].serial = "";
    }
    H5Gclose(cameras);
    return e;
}

/* ---- sets ---- */

static bool set_is_whole(const cap_take *t, const struct cap_take_set *s, const int64_t *member)
{
    if (s->check != take_set_check(s, member, t->info.head.n_cameras) || s->number > INT64_MAX ||
        !is_time(s->t_exposure_ns) || !is_time(s->t_last_mono_ns))
        return false;
    uint32_t n = 0;
    uint64_t mask = 0;
    for (uint32_t c = 0; c < t->info.head.n_cameras; c++) {
        const struct camera *k = &t->camera[c];
        if (member[c] == -1)
            continue;
        if (member[c] < 0 || (uint64_t)member[c] >= k->c.frames ||
            k->row[member[c]].set != (int64_t)s->number)
            return false;
        n++;
        mask |= 1ull << c;
    }
    return n == s->n && mask == s->mask;
}

/* Sets count up; those that are not whole are left out.  At the end of a file that was cut that is what
 * the cut took; anywhere else it is damage. */
static void keep_whole_sets(cap_take *t, uint64_t rows)
{
    uint32_t n = t->info.head.n_cameras;
    uint64_t kept = 0;
    for (uint64_t k = 0; k < rows; k++) {
        const struct cap_take_set *s = &t->set[k];
        const int64_t *member = &t->member[k * n];
        if (!set_is_whole(t, s, member) || (kept > 0 && s->number <= t->set[kept - 1].number))
            continue;
        t->set[kept] = *s;
        memmove(&t->member[kept * n], member, n * sizeof *member);
        kept++;
    }
    t->info.sets = kept;
    t->info.sets_lost = rows - kept;
}

static pvx_err read_sets(cap_take *t, struct pvx_diag *d)
{
    uint32_t n = t->info.head.n_cameras;
    hsize_t dims[2] = {0, n};
    uint64_t sets = 0, members = 0;
    hid_t type = take_h5_set_type();
    hid_t a = take_h5_open_table(t->file, "sets", type, 1, NULL, &sets);
    hid_t b = take_h5_open_table(t->file, "members", H5T_STD_I64LE, 2, dims, &members);
    uint64_t said = sets;
    if (a >= 0 && b >= 0) {
        t->set = read_table(t, a, type, 1, 1, sizeof *t->set, &sets);
        t->member = read_table(t, b, H5T_NATIVE_INT64, 2, n, n * sizeof *t->member, &members);
    }
    if (a >= 0)
        H5Dclose(a);
    if (b >= 0)
        H5Dclose(b);
    H5Tclose(type);
    if (t->set == NULL || t->member == NULL)
        return wrong(t, d, "the table of sets");
    keep_whole_sets(t, members < sets ? members : sets);
    t->info.sets_lost = said - t->info.sets;
    return PVX_OK;
}

/* ---- the file ---- */

static pvx_err read_head(cap_take *t, struct pvx_diag *d)
{
    struct cap_take_head *h = &t->info.head;
    int64_t version, closed = 0;
    char *format = take_h5_get_text(t->file, "format", false);
    bool ours = format != NULL && strcmp(format, "pyrovox take") == 0;
    free(format);
    if (!ours || !take_h5_get_int(t->file, "version", &version))
        return wrong(t, d, "HDF5, but of another kind");
    if (version != CAP_TAKE_FORMAT)
        return pvx_fail(d, PVX_EVERSION, "%s: version %lld of the layout; this program reads %d",
                        t->path, (long long)version, CAP_TAKE_FORMAT);
    h->rig = take_h5_get_text(t->file, "rig", true);
    h->config = take_h5_get_text(t->file, "config", true);
    h->software = take_h5_get_text(t->file, "software", false);
    h->host = take_h5_get_text(t->file, "host", false);
    h->base = take_h5_get_text(t->file, "base", false);
    if (h->rig == NULL || h->config == NULL || h->software == NULL || h->host == NULL ||
        h->base == NULL || !take_h5_get_int(t->file, "t_created_ns", &h->t_created_ns) ||
        !take_h5_get_attr(t->file, "session", H5T_NATIVE_UINT64, 8, &h->session) ||
        !take_h5_get_attr(t->file, "fps", H5T_NATIVE_DOUBLE, 8, &h->fps) || !isfinite(h->fps))
        return wrong(t, d, "an attribute of the head");
    h->camera = t->cameras;
    t->info.closed = take_h5_get_int(t->file, "closed", &closed) && closed == 1;
    return PVX_OK;
}

static pvx_err read_all(cap_take *t, struct pvx_diag *d)
{
    if (!take_h5_looks(t->path, &t->file_bytes)) {
        if (access(t->path, R_OK) != 0)
            return pvx_fail(d, PVX_ENOENT, "%s: no such file, or not readable", t->path);
        return wrong(t, d, "not HDF5");
    }
    t->file = take_h5_open(t->path);
    if (t->file < 0)
        return wrong(t, d, "libhdf5 cannot open it");
    PVX_TRY(read_head(t, d));
    PVX_TRY(read_cameras(t, d));
    PVX_TRY(read_sets(t, d));
    return read_gaps(t, d);
}

pvx_err cap_take_open(const char *path, cap_take **out, struct pvx_diag *d)
{
    take_h5_init();
    *out = NULL;
    cap_take *t = pvx_calloc(1, sizeof *t);
    if (t == NULL)
        return PVX_ENOMEM;
    t->file = -1;
    t->path = strdup(path);
    t->camera = pvx_calloc(CAP_MAX_CAMERAS, sizeof *t->camera);
    t->cameras = pvx_calloc(CAP_MAX_CAMERAS, sizeof *t->cameras);
    pvx_err e = PVX_ENOMEM;
    if (t->path != NULL && t->camera != NULL && t->cameras != NULL) {
        for (int c = 0; c < CAP_MAX_CAMERAS; c++)
            t->camera[c].frames = -1;
        e = read_all(t, d);
    }
    if (e != PVX_OK)
        cap_take_free(&t);
    *out = t;
    return e;
}

void cap_take_free(cap_take **tp)
{
    cap_take *t = *tp;
    if (t == NULL)
        return;
    *tp = NULL;
    take_h5_init();
    if (t->file >= 0)
        H5Fclose(t->file);
    for (int c = 0; t->camera != NULL && c < CAP_MAX_CAMERAS; c++) {
        free((char *)t->camera[c].c.name);
        free((char *)t->camera[c].c.uri);
        free((char *)t->camera[c].c.settings);
        free((char *)t->camera[c].c.serial);
        free(t->camera[c].row);
    }
    free(t->camera);
    free(t->cameras);
    free((char *)t->info.head.rig);
    free((char *)t->info.head.config);
    free((char *)t->info.head.software);
    free((char *)t->info.head.host);
    free((char *)t->info.head.base);
    free(t->set);
    free(t->member);
    free(t->gap);
    free(t->path);
    free(t);
}

/* ---- what others ask ---- */

const struct cap_take_info *cap_take_info(const cap_take *t)
{
    return &t->info;
}

int cap_take_find(const cap_take *t, const char *camera)
{
    for (uint32_t c = 0; c < t->info.head.n_cameras; c++)
        if (strcmp(t->camera[c].c.name, camera) == 0)
            return (int)c;
    return -1;
}

const struct cap_take_set *cap_take_set(const cap_take *t, uint64_t k, const int64_t **member)
{
    if (member != NULL)
        *member = &t->member[k * t->info.head.n_cameras];
    return &t->set[k];
}

int64_t cap_take_find_set(const cap_take *t, int64_t number)
{
    uint64_t lo = 0, hi = t->info.sets;
    while (lo < hi) {
        uint64_t mid = lo + (hi - lo) / 2;
        if (t->set[mid].number < (uint64_t)number)
            lo = mid + 1;
        else
            hi = mid;
    }
    return number >= 0 && lo < t->info.sets && t->set[lo].number == (uint64_t)number ? (int64_t)lo
                                                                                     : -1;
}

const struct cap_take_row *cap_take_row(const cap_take *t, uint32_t camera, uint64_t row)
{
    return &t->camera[camera].row[row];
}

const struct cap_take_gap *cap_take_gap(const cap_take *t, uint64_t k)
{
    return &t->gap[k];
}

size_t cap_take_frame_max(const cap_take *t, uint32_t camera)
{
    return t->camera[camera].largest;
}

static bool read_pixels(const struct camera *k, const struct cap_take_row *r, uint64_t row,
                        void *mem)
{
    hsize_t at[4] = {row, 0, 0, 0}, size[4];
    memcpy(size, k->dims, sizeof size);
    size[0] = 1;
    if (k->rank == 1) {
        at[0] = r->offset;
        size[0] = r->bytes;
    }
    hid_t space = H5Dget_space(k->frames), to = H5Screate_simple(k->rank, size, NULL);
    bool ok = H5Sselect_hyperslab(space, H5S_SELECT_SET, at, NULL, size, NULL) >= 0 &&
              H5Dread(k->frames, k->type, to, space, H5P_DEFAULT, mem) >= 0;
    H5Sclose(to);
    H5Sclose(space);
    H5Eclear2(H5E_DEFAULT);
    return ok;
}

pvx_err cap_take_read(const cap_take *t, uint32_t camera, uint64_t row, void *mem, size_t size,
                      struct cap_image *img, struct pvx_diag *d)
{
    take_h5_init();
    const struct camera *k = &t->camera[camera];
    if (row >= k->c.frames)
        return pvx_fail(d, PVX_EINVAL, "%s: camera %s has no frame in place %llu", t->path,
                        k->c.name, (unsigned long long)row);
    const struct cap_take_row *r = &k->row[row];
    if (r->bytes > size)
        return pvx_fail(d, PVX_ERANGE, "%s: a frame of camera %s has %llu bytes, room is for %zu",
                        t->path, k->c.name, (unsigned long long)r->bytes, size);
    if (!read_pixels(k, r, row, mem) || XXH3_64bits(mem, r->bytes) != r->xxh3)
        return pvx_fail(d, PVX_ECORRUPT,
                        "%s: camera %s, frame %llu (place %llu): its pixels are cut off or damaged",
                        t->path, k->c.name, (unsigned long long)r->id, (unsigned long long)row);
    *img = (struct cap_image){.data = mem,
                              .size = r->bytes,
                              .width = k->c.width,
                              .height = k->c.height,
                              .stride = (ptrdiff_t)cap_pixfmt_row(k->c.fmt, k->c.width),
                              .fmt = k->c.fmt,
                              .yuv = k->c.yuv};
    return PVX_OK;
}
