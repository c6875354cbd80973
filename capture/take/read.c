/* read.c - one file of a take (piece.h).
 *
 * No content of the file is trusted.  Types, ranks and sizes are compared with what they must be before a byte is read
 * into memory.  Tables are read a chunk at a time, up to the first that cannot be read.  A row counts only with its
 * checksum, and a set only with all its frames.  Errors of libhdf5 itself on a hostile file are not covered. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "base/mem.h"
#include "capture/take/piece.h"

#define SQUEEZE   1100 /* largest ratio of gzip, for a file that was repacked with it */
#define ROW_SLACK 65536

static pvx_err read_wrong(const struct piece *p, struct pvx_diag *d, const char *what)
{
    H5Eclear2(H5E_DEFAULT);
    return pvx_fail(d, PVX_EFORMAT, "%s: is not a take of raw frames, or damaged: %s", p->path,
                    what);
}

/* ---- tables ---- */

/* All rows up to the first chunk that cannot be read; *n = how many.  Owner: caller.  NULL = no memory, or more rows
 * than the file can have. */
static void *read_table(const struct piece *p, hid_t set, hid_t type, int rank, hsize_t width,
                        size_t size, uint64_t *n)
{
    uint64_t rows = *n;
    *n = 0;
    if (rows > (p->file_bytes / size + 1) * SQUEEZE + ROW_SLACK)
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

static pvx_err take_read_gaps(struct piece *p, struct pvx_diag *d)
{
    hid_t type = take_h5_gap_type(),
          set = take_h5_open_table(p->file, "gaps", type, 1, NULL, &p->gaps);
    pvx_err e = PVX_OK;
    if (set < 0)
        e = read_wrong(p, d, "gaps");
    else if ((p->gap = read_table(p, set, type, 1, 1, sizeof *p->gap, &p->gaps)) == NULL)
        e = read_wrong(p, d, "too many gaps");
    for (uint64_t i = 0; e == PVX_OK && i < p->gaps; i++)
        if (p->gap[i].camera >= p->head.n_cameras || p->gap[i].why >= CAP_TAKE_N_WHY)
            p->gaps = i;
    if (set >= 0)
        H5Dclose(set);
    H5Tclose(type);
    return e;
}

/* A table that only some takes have.  *rows = NULL: it is not there. */
static pvx_err read_optional(struct piece *p, const char *name, hid_t type, size_t size,
                             void **rows, uint64_t *n, struct pvx_diag *d)
{
    pvx_err e = PVX_OK;
    if (H5Lexists(p->file, name, H5P_DEFAULT) > 0) {
        hid_t set = take_h5_open_table(p->file, name, type, 1, NULL, n);
        if (set < 0 || (*rows = read_table(p, set, type, 1, 1, size, n)) == NULL)
            e = read_wrong(p, d, name);
        if (set >= 0)
            H5Dclose(set);
    }
    H5Tclose(type);
    return e;
}

static void end_text(char *text, size_t size)
{
    text[size - 1] = '\0';
    for (char *c = text; *c != '\0'; c++)
        if ((unsigned char)*c < ' ')
            *c = '?';
}

/* The triggers that began the take, and the frames that it lacks. */
static pvx_err read_triggers(struct piece *p, struct pvx_diag *d)
{
    void *triggers = NULL, *losses = NULL;
    pvx_err e = read_optional(p, "triggers", take_h5_trigger_type(), sizeof *p->trigger, &triggers,
                              &p->triggers, d);
    pvx_err f =
        read_optional(p, "lost", take_h5_lost_type(), sizeof *p->lost, &losses, &p->losses, d);
    p->trigger = triggers;
    p->lost = losses;
    p->head.triggered = triggers != NULL;
    for (uint64_t i = 0; triggers != NULL && i < p->triggers; i++)
        end_text(p->trigger[i].name, sizeof p->trigger[i].name);
    for (uint64_t i = 0; losses != NULL && i < p->losses; i++) {
        end_text(p->lost[i].why, sizeof p->lost[i].why);
        if (p->lost[i].camera >= p->head.n_cameras)
            p->losses = i;
    }
    return e != PVX_OK ? e : f;
}

/* ---- cameras ---- */

/* Whether ns can be subtracted from other times, and repeated in turns (source.c), without overflow. */
static bool is_time(int64_t ns)
{
    return ns >= 0 && ns <= INT64_MAX / 2;
}

static bool row_fits(const struct piece_camera *k, const struct cap_take_row *r, size_t bytes)
{
    if (r->check != take_row_check(r) || r->why > CAP_TAKE_OVERFLOW || !is_time(r->t_exposure_ns) ||
        !is_time(r->t_arrival_mono_ns))
        return false;
    if (k->rank > 1)
        return r->bytes == bytes && r->offset == 0;
    return r->bytes > 0 && r->bytes <= cap_pixfmt_image(k->c.fmt, k->c.width, k->c.height) * 4 &&
           r->offset <= k->stream && r->bytes <= k->stream - r->offset;
}

static bool has_pixels(const struct piece *p, uint32_t camera, uint64_t row, void *mem)
{
    struct cap_image img;
    return piece_fetch(p, camera, row, mem) && piece_is(p, camera, row, mem, &img);
}

/* Rows lie before their pixels, so a cut takes the pixels of a camera's last frames first.  These frames are left
 * out.  Pixels are appended in order, so bisection finds the first frame without pixels. */
static pvx_err leave_out_cut_frames(struct piece *p, uint32_t camera, struct pvx_diag *d)
{
    struct piece_camera *k = &p->camera[camera];
    if (k->largest > p->file_bytes * SQUEEZE + ROW_SLACK)
        return read_wrong(p, d, "frames larger than the file");
    void *mem = malloc(k->largest + 1);
    if (mem == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a frame of %zu bytes", p->path,
                        k->largest);
    uint64_t good = 0, bad = k->c.frames; /* frames before `good` have pixels, `bad` has none */
    if (bad > 0 && has_pixels(p, camera, bad - 1, mem))
        good = bad;
    while (good < bad) {
        uint64_t mid = good + (bad - good) / 2;
        if (has_pixels(p, camera, mid, mem))
            good = mid + 1;
        else
            bad = mid;
    }
    free(mem);
    k->c.frames = good;
    return PVX_OK;
}

static pvx_err read_index(struct piece *p, struct piece_camera *k, hid_t group, uint64_t frames,
                          struct pvx_diag *d)
{
    hid_t type = take_h5_row_type();
    hid_t set = take_h5_open_table(group, "index", type, 1, NULL, &k->c.frames);
    if (set >= 0)
        k->row = read_table(p, set, type, 1, 1, sizeof *k->row, &k->c.frames);
    if (set >= 0)
        H5Dclose(set);
    H5Tclose(type);
    if (k->row == NULL)
        return read_wrong(p, d, "a camera's index");
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

static pvx_err read_frames(struct piece *p, struct piece_camera *k, hid_t group, struct pvx_diag *d)
{
    int64_t width, height, yuv;
    char *fmt = take_h5_get_text(group, "pixel_format", false);
    k->c.fmt = fmt != NULL ? cap_pixfmt_parse(fmt) : CAP_FMT_NONE;
    free(fmt);
    if (k->c.fmt == CAP_FMT_NONE || !take_h5_get_int(group, "width", &width) ||
        !take_h5_get_int(group, "height", &height) || !take_h5_get_int(group, "yuv", &yuv) ||
        width < 1 || height < 1 || width > TAKE_SIDE_MAX || height > TAKE_SIDE_MAX || yuv < 0 ||
        yuv > 255)
        return read_wrong(p, d, "a camera's pixel format or size");
    k->c.width = (int32_t)width;
    k->c.height = (int32_t)height;
    k->c.yuv = (uint8_t)yuv;
    k->rank = take_h5_shape(k->c.fmt, k->c.width, k->c.height, k->dims, &k->type);
    if (k->rank < 1)
        return read_wrong(p, d, "a camera's pixel format");
    uint64_t n;
    k->frames = take_h5_open_table(group, "frames", k->type, k->rank, k->dims, &n);
    if (k->frames < 0)
        return read_wrong(p, d, "a camera's frames");
    k->stream = k->rank == 1 ? n : 0;
    return read_index(p, k, group, n, d);
}

struct listing {
    struct piece *p;
    uint32_t n;
    bool bad;
};

static herr_t read_list_camera(hid_t group, const char *name, const H5L_info_t *info, void *ctx)
{
    struct listing *l = ctx;
    struct piece *p = l->p;
    int64_t number = -1;
    if (info->type != H5L_TYPE_HARD || strlen(name) >= CAP_TAKE_NAME_MAX) {
        l->bad = true;
        return 1;
    }
    hid_t g = H5Gopen2(group, name, H5P_DEFAULT);
    if (g >= 0 && take_h5_get_int(g, "number", &number) && number >= 0 &&
        number < CAP_MAX_CAMERAS && p->camera[number].c.name == NULL) {
        p->camera[number].c.name = strdup(name);
        p->camera[number].c.uri = take_h5_get_text(g, "uri", false);
        p->camera[number].c.settings = take_h5_get_text(g, "settings", true);
        p->camera[number].c.serial = take_h5_get_text(g, "serial", false);
        p->camera[number].c.temperature_c = NAN; /* older takes have neither */
        take_h5_get_attr(g, "temperature_c", H5T_NATIVE_DOUBLE, 8,
                         &p->camera[number].c.temperature_c);
        l->n++;
    } else {
        l->bad = true;
    }
    if (g >= 0)
        H5Gclose(g);
    return l->bad;
}

static pvx_err read_cameras(struct piece *p, struct pvx_diag *d)
{
    struct listing l = {.p = p};
    hid_t cameras = H5Gopen2(p->file, "cameras", H5P_DEFAULT);
    if (cameras < 0)
        return read_wrong(p, d, "no cameras");
    hsize_t at = 0;
    if (H5Literate(cameras, H5_INDEX_NAME, H5_ITER_INC, &at, read_list_camera, &l) < 0 || l.n == 0)
        l.bad = true;
    pvx_err e = l.bad ? read_wrong(p, d, "the list of cameras") : PVX_OK;
    p->head.n_cameras = l.n;
    for (uint32_t c = 0; c < l.n && e == PVX_OK; c++) {
        struct piece_camera *k = &p->camera[c];
        if (k->c.name == NULL || k->c.uri == NULL || k->c.settings == NULL) {
            e = read_wrong(p, d, "a camera's name, source or settings");
            break;
        }
        hid_t g = H5Gopen2(cameras, k->c.name, H5P_DEFAULT);
        if (H5Lexists(g, "frames", H5P_DEFAULT) > 0)
            e = read_frames(p, k, g, d);
        PVX_THEN(e, leave_out_cut_frames(p, c, d));
        H5Gclose(g);
    }
    H5Gclose(cameras);
    return e;
}

/* ---- sets ---- */

static bool set_is_whole(const struct piece *p, const struct cap_take_set *s, const int64_t *member)
{
    if (s->check != take_set_check(s, member, p->head.n_cameras) || s->number > INT64_MAX ||
        !is_time(s->t_exposure_ns) || !is_time(s->t_last_mono_ns))
        return false;
    uint32_t n = 0;
    uint64_t mask = 0;
    for (uint32_t c = 0; c < p->head.n_cameras; c++) {
        const struct piece_camera *k = &p->camera[c];
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

/* Keep the sets that are whole and whose numbers increase.  Sets left out at the end of a cut file were lost by the
 * cut; anywhere else they are damaged. */
static void keep_whole_sets(struct piece *p, uint64_t rows)
{
    uint32_t n = p->head.n_cameras;
    uint64_t kept = 0;
    for (uint64_t k = 0; k < rows; k++) {
        const struct cap_take_set *s = &p->set[k];
        const int64_t *member = &p->member[k * n];
        if (!set_is_whole(p, s, member) || (kept > 0 && s->number <= p->set[kept - 1].number))
            continue;
        p->set[kept] = *s;
        memmove(&p->member[kept * n], member, n * sizeof *member);
        kept++;
    }
    p->sets = kept;
    p->sets_lost = rows - kept;
}

static pvx_err read_sets(struct piece *p, struct pvx_diag *d)
{
    uint32_t n = p->head.n_cameras;
    hsize_t dims[2] = {0, n};
    uint64_t sets = 0, members = 0;
    hid_t type = take_h5_set_type();
    hid_t a = take_h5_open_table(p->file, "sets", type, 1, NULL, &sets);
    hid_t b = take_h5_open_table(p->file, "members", H5T_STD_I64LE, 2, dims, &members);
    uint64_t said = sets;
    if (a >= 0 && b >= 0) {
        p->set = read_table(p, a, type, 1, 1, sizeof *p->set, &sets);
        p->member = read_table(p, b, H5T_NATIVE_INT64, 2, n, n * sizeof *p->member, &members);
    }
    if (a >= 0)
        H5Dclose(a);
    if (b >= 0)
        H5Dclose(b);
    H5Tclose(type);
    if (p->set == NULL || p->member == NULL)
        return read_wrong(p, d, "the table of sets");
    keep_whole_sets(p, members < sets ? members : sets);
    p->sets_lost = said - p->sets;
    return PVX_OK;
}

/* ---- the file ---- */

static pvx_err take_read_head(struct piece *p, struct pvx_diag *d)
{
    struct cap_take_head *h = &p->head;
    int64_t version, closed = 0, goes_on = 0;
    char *format = take_h5_get_text(p->file, "format", false);
    bool ours = format != NULL && strcmp(format, "pyrovox take") == 0;
    free(format);
    if (!ours || !take_h5_get_int(p->file, "version", &version))
        return read_wrong(p, d, "HDF5, but of another kind");
    if (version != CAP_TAKE_FORMAT)
        return pvx_fail(d, PVX_EVERSION, "%s: version %lld of the layout; this program reads %d",
                        p->path, (long long)version, CAP_TAKE_FORMAT);
    h->rig = take_h5_get_text(p->file, "rig", true);
    h->config = take_h5_get_text(p->file, "config", true);
    h->software = take_h5_get_text(p->file, "software", false);
    h->host = take_h5_get_text(p->file, "host", false);
    h->base = take_h5_get_text(p->file, "base", false);
    if (h->rig == NULL || h->config == NULL || h->software == NULL || h->host == NULL ||
        h->base == NULL || !take_h5_get_int(p->file, "t_created_ns", &h->t_created_ns) ||
        !take_h5_get_attr(p->file, "session", H5T_NATIVE_UINT64, 8, &h->session) ||
        !take_h5_get_attr(p->file, "fps", H5T_NATIVE_DOUBLE, 8, &h->fps) || !isfinite(h->fps))
        return read_wrong(p, d, "an attribute of the head");
    /* older takes do not have these */
    take_h5_get_int(p->file, "t_began_ns", &h->t_began_ns);
    p->goes_on = take_h5_get_int(p->file, "goes_on", &goes_on) && goes_on == 1;
    p->closed = take_h5_get_int(p->file, "closed", &closed) && closed == 1;
    return PVX_OK;
}

static pvx_err take_read_all(struct piece *p, struct pvx_diag *d)
{
    if (!take_h5_looks(p->path, &p->file_bytes)) {
        if (access(p->path, R_OK) != 0)
            return pvx_fail(d, PVX_ENOENT, "%s: no such file, or not readable", p->path);
        return read_wrong(p, d, "not HDF5");
    }
    p->file = take_h5_open(p->path);
    if (p->file < 0)
        return read_wrong(p, d, "libhdf5 cannot open it");
    PVX_TRY(take_read_head(p, d));
    PVX_TRY(read_cameras(p, d));
    PVX_TRY(read_sets(p, d));
    PVX_TRY(take_read_gaps(p, d));
    return read_triggers(p, d);
}

pvx_err piece_open(const char *path, struct piece **out, struct pvx_diag *d)
{
    *out = NULL;
    struct piece *p = pvx_calloc(1, sizeof *p);
    PVX_NEED(p);
    p->file = -1;
    p->path = strdup(path);
    p->camera = pvx_calloc(CAP_MAX_CAMERAS, sizeof *p->camera);
    pvx_err e = PVX_ENOMEM;
    if (p->path != NULL && p->camera != NULL) {
        for (int c = 0; c < CAP_MAX_CAMERAS; c++)
            p->camera[c].frames = -1;
        e = take_read_all(p, d);
    }
    if (e != PVX_OK)
        piece_free(&p);
    *out = p;
    return e;
}

void piece_free(struct piece **pp)
{
    struct piece *p = *pp;
    if (p == NULL)
        return;
    *pp = NULL;
    piece_shut(p);
    for (int c = 0; p->camera != NULL && c < CAP_MAX_CAMERAS; c++) {
        free((char *)p->camera[c].c.name);
        free((char *)p->camera[c].c.uri);
        free((char *)p->camera[c].c.settings);
        free((char *)p->camera[c].c.serial);
        free(p->camera[c].row);
    }
    free(p->camera);
    free((char *)p->head.rig);
    free((char *)p->head.config);
    free((char *)p->head.software);
    free((char *)p->head.host);
    free((char *)p->head.base);
    free(p->set);
    free(p->member);
    free(p->gap);
    free(p->trigger);
    free(p->lost);
    free(p->path);
    free(p);
}

void piece_shut(struct piece *p)
{
    if (p->file >= 0)
        H5Fclose(p->file); /* closes all objects in it too */
    p->file = -1;
    for (int c = 0; p->camera != NULL && c < CAP_MAX_CAMERAS; c++)
        p->camera[c].frames = -1;
}

bool piece_reopen(struct piece *p)
{
    char name[CAP_TAKE_NAME_MAX + 24];
    p->file = take_h5_open(p->path);
    for (uint32_t c = 0; p->file >= 0 && c < p->head.n_cameras; c++) {
        struct piece_camera *k = &p->camera[c];
        uint64_t n;
        snprintf(name, sizeof name, "cameras/%s/frames", k->c.name);
        if (k->c.fmt != CAP_FMT_NONE)
            k->frames = take_h5_open_table(p->file, name, k->type, k->rank, k->dims, &n);
    }
    H5Eclear2(H5E_DEFAULT);
    return p->file >= 0;
}

/* ---- pixels ---- */

bool piece_fetch(const struct piece *p, uint32_t camera, uint64_t row, void *mem)
{
    const struct piece_camera *k = &p->camera[camera];
    hsize_t at[4] = {row, 0, 0, 0}, size[4];
    if (k->frames < 0)
        return false;
    memcpy(size, k->dims, sizeof size);
    size[0] = 1;
    if (k->rank == 1) {
        at[0] = k->row[row].offset;
        size[0] = k->row[row].bytes;
    }
    hid_t space = H5Dget_space(k->frames), to = H5Screate_simple(k->rank, size, NULL);
    bool ok = H5Sselect_hyperslab(space, H5S_SELECT_SET, at, NULL, size, NULL) >= 0 &&
              H5Dread(k->frames, k->type, to, space, H5P_DEFAULT, mem) >= 0;
    H5Sclose(to);
    H5Sclose(space);
    H5Eclear2(H5E_DEFAULT);
    return ok;
}

bool piece_is(const struct piece *p, uint32_t camera, uint64_t row, const void *mem,
              struct cap_image *img)
{
    const struct piece_camera *k = &p->camera[camera];
    const struct cap_take_row *r = &k->row[row];
    *img = (struct cap_image){.data = mem,
                              .size = r->bytes,
                              .width = k->c.width,
                              .height = k->c.height,
                              .stride = (ptrdiff_t)cap_pixfmt_row(k->c.fmt, k->c.width),
                              .fmt = k->c.fmt,
                              .yuv = k->c.yuv};
    return XXH3_64bits(mem, r->bytes) == r->xxh3;
}
