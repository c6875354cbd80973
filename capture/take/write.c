/* write.c - the writing half of take.h.
 *
 * A camera's datasets are made when its first frame comes, because its format is known only then.  This leaves SWMR
 * mode for some milliseconds (close, open, make, start again).  Otherwise all tables only grow.  Metadata gets blocks
 * of META bytes, so that rows and chunk indices lie before the pixels that they describe.  A file that is cut
 * anywhere still describes all pixels that are left. */
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"
#include "capture/take/h5.h"

#define ATTRS 64 /* up to this many attributes lie with their group, in one piece */

struct camera {
    char *name, *uri, *settings;
    char serial[CAP_SERIAL_MAX];
    double temperature_c;
    bool made;
    enum cap_pixfmt fmt;
    int32_t width, height;
    uint8_t yuv;
    hsize_t dims[4]; /* of a chunk of frames */
    int rank;
    size_t bytes;
    hid_t frames, index;
    uint64_t n, stream; /* rows; bytes of JPEG */
};

struct cap_take_writer {
    char *path;
    struct take_h5_room room;
    hid_t file, sets, members, gaps, row_type, set_type, gap_type;
    hid_t triggers, lost, trigger_type, lost_type; /* the tables only if `triggered` */
    uint64_t n_triggers, n_lost;
    bool swmr, goes_on, triggered;
    uint32_t n_cameras;
    struct camera *camera;
    uint64_t n_sets, n_gaps, n_frames, bytes;
    unsigned char *tight; /* rows without padding, for frames that have some */
    size_t tight_size;
    int64_t *member;
};

static pvx_err write_fail(cap_take_writer *w, const char *what, struct pvx_diag *d)
{
    return take_h5_fail(d, PVX_EIO, w->path, what);
}

static pvx_err write_reserve(cap_take_writer *w, uint64_t bytes, struct pvx_diag *d)
{
    return take_h5_reserve(&w->room, w->file, w->path, bytes, d);
}

/* ---- making ---- */

static bool open_tables(cap_take_writer *w)
{
    w->sets = H5Dopen2(w->file, "sets", H5P_DEFAULT);
    w->members = H5Dopen2(w->file, "members", H5P_DEFAULT);
    w->gaps = H5Dopen2(w->file, "gaps", H5P_DEFAULT);
    bool ok = w->sets >= 0 && w->members >= 0 && w->gaps >= 0;
    if (ok && w->triggered) {
        w->triggers = H5Dopen2(w->file, "triggers", H5P_DEFAULT);
        w->lost = H5Dopen2(w->file, "lost", H5P_DEFAULT);
        ok = w->triggers >= 0 && w->lost >= 0;
    }
    for (uint32_t c = 0; c < w->n_cameras && ok; c++) {
        struct camera *k = &w->camera[c];
        char name[CAP_TAKE_NAME_MAX + 24];
        if (!k->made)
            continue;
        snprintf(name, sizeof name, "cameras/%s/frames", k->name);
        k->frames = H5Dopen2(w->file, name, H5P_DEFAULT);
        snprintf(name, sizeof name, "cameras/%s/index", k->name);
        k->index = H5Dopen2(w->file, name, H5P_DEFAULT);
        ok = k->frames >= 0 && k->index >= 0;
    }
    return ok;
}

static bool close_file(cap_take_writer *w)
{
    bool ok = w->file < 0 || H5Fclose(w->file) >= 0;
    w->file = -1;
    w->swmr = false;
    return ok;
}

static bool reopen(cap_take_writer *w)
{
    hid_t fapl = take_h5_access(TAKE_ALIGN);
    if (!close_file(w)) {
        H5Pclose(fapl);
        return false;
    }
    w->file = H5Fopen(w->path, H5F_ACC_RDWR, fapl);
    H5Pclose(fapl);
    return w->file >= 0 && open_tables(w);
}

static pvx_err start_swmr(cap_take_writer *w, struct pvx_diag *d)
{
    if (w->swmr)
        return PVX_OK;
    if (H5Fstart_swmr_write(w->file) < 0)
        return write_fail(w, "cannot begin to append", d);
    w->swmr = true;
    return PVX_OK;
}

static bool make_attributes(cap_take_writer *w, const struct cap_take_head *h)
{
    return take_h5_put_text(w->file, "format", "pyrovox take") &&
           take_h5_put_int(w->file, "version", CAP_TAKE_FORMAT) &&
           take_h5_put_int(w->file, "t_created_ns", h->t_created_ns) &&
           take_h5_put_int(w->file, "t_began_ns",
                           h->t_began_ns != 0 ? h->t_began_ns : h->t_created_ns) &&
           take_h5_put_attr(w->file, "session", H5T_STD_U64LE, &h->session) &&
           take_h5_put_attr(w->file, "fps", H5T_IEEE_F64LE, &h->fps) &&
           take_h5_put_text(w->file, "host", h->host) &&
           take_h5_put_text(w->file, "software", h->software) &&
           take_h5_put_text(w->file, "base", h->base) &&
           /* overwritten at the end: new ones would lie behind all pixels and be cut off first */
           take_h5_put_int(w->file, "closed", 0) && take_h5_put_int(w->file, "goes_on", 0) &&
           take_h5_put_int(w->file, "t_closed_ns", 0) && take_h5_put_int(w->file, "n_sets", -1) &&
           take_h5_put_int(w->file, "n_frames", -1) && take_h5_put_int(w->file, "n_gaps", -1) &&
           take_h5_put_long_text(w->file, "rig", h->rig) &&
           take_h5_put_long_text(w->file, "config", h->config);
}

static bool make_groups(cap_take_writer *w)
{
    hid_t p = H5Pcreate(H5P_GROUP_CREATE);
    H5Pset_attr_phase_change(p, ATTRS, 0);
    hid_t g = H5Gcreate2(w->file, "cameras", H5P_DEFAULT, p, H5P_DEFAULT);
    bool ok = g >= 0;
    H5Gclose(g);
    for (uint32_t c = 0; c < w->n_cameras && ok; c++) {
        struct camera *k = &w->camera[c];
        char name[CAP_TAKE_NAME_MAX + 24];
        snprintf(name, sizeof name, "cameras/%s", k->name);
        g = H5Gcreate2(w->file, name, H5P_DEFAULT, p, H5P_DEFAULT);
        ok = g >= 0 && take_h5_put_int(g, "number", c) && take_h5_put_text(g, "uri", k->uri) &&
             take_h5_put_long_text(g, "settings", k->settings);
        H5Gclose(g);
    }
    H5Pclose(p);
    return ok;
}

static bool make_root(cap_take_writer *w, const struct cap_take_head *h)
{
    hsize_t rows = TAKE_ROWS, members[2] = {TAKE_ROWS, w->n_cameras};
    return make_attributes(w, h) && make_groups(w) &&
           take_h5_make_table(w->file, "sets", w->set_type, 1, &rows, &w->sets) &&
           take_h5_make_table(w->file, "members", H5T_STD_I64LE, 2, members, &w->members) &&
           take_h5_make_table(w->file, "gaps", w->gap_type, 1, &rows, &w->gaps) &&
           (!w->triggered ||
            (take_h5_make_table(w->file, "triggers", w->trigger_type, 1, &rows, &w->triggers) &&
             take_h5_make_table(w->file, "lost", w->lost_type, 1, &rows, &w->lost)));
}

/* The text has room for a longer serial number later. */
static bool put_about(hid_t at, const struct camera *k)
{
    hid_t t = H5Tcopy(H5T_C_S1);
    H5Tset_size(t, sizeof k->serial);
    H5Tset_cset(t, H5T_CSET_UTF8);
    bool ok = take_h5_put_attr(at, "serial", t, k->serial) &&
              take_h5_put_attr(at, "temperature_c", H5T_IEEE_F64LE, &k->temperature_c);
    H5Tclose(t);
    return ok;
}

static bool make_datasets(cap_take_writer *w, struct camera *k, hid_t type)
{
    char name[CAP_TAKE_NAME_MAX + 24];
    hsize_t rows = TAKE_ROWS;
    snprintf(name, sizeof name, "cameras/%s", k->name);
    hid_t g = H5Gopen2(w->file, name, H5P_DEFAULT);
    bool ok = g >= 0 && take_h5_put_text(g, "pixel_format", cap_pixfmt_name(k->fmt)) &&
              take_h5_put_int(g, "width", k->width) && take_h5_put_int(g, "height", k->height) &&
              take_h5_put_int(g, "yuv", k->yuv) && put_about(g, k) &&
              take_h5_make_table(g, "index", w->row_type, 1, &rows, &k->index) &&
              take_h5_make_table(g, "frames", type, k->rank, k->dims, &k->frames);
    H5Gclose(g);
    k->made = ok;
    return ok;
}

/* Whether the image has a known format and all its rows. */
static bool write_is_whole(const struct cap_image *img)
{
    enum cap_layout layout = cap_pixfmt_layout(img->fmt);
    if (layout == CAP_LAYOUT_NONE || img->width < 1 || img->height < 1 ||
        img->width > TAKE_SIDE_MAX || img->height > TAKE_SIDE_MAX)
        return false;
    if (layout == CAP_LAYOUT_JPEG)
        return img->size > 0;
    size_t row = cap_pixfmt_row(img->fmt, img->width), need;
    return img->stride >= (ptrdiff_t)row &&
           !__builtin_mul_overflow((size_t)img->stride, (size_t)(img->height - 1), &need) &&
           !__builtin_add_overflow(need, row, &need) && img->size >= need;
}

/* Make the tables of a camera, whose first whole frame defines its format. */
static pvx_err make_camera(cap_take_writer *w, struct camera *k, const struct cap_image *img,
                           struct pvx_diag *d)
{
    hid_t type;
    k->fmt = img->fmt;
    k->width = img->width;
    k->height = img->height;
    k->yuv = img->yuv;
    k->rank = take_h5_shape(k->fmt, k->width, k->height, k->dims, &type);
    if (k->rank == 0)
        return pvx_fail(d, PVX_EUNSUP, "%s: camera %s: %s cannot be recorded", w->path, k->name,
                        cap_pixfmt_name(img->fmt));
    k->bytes = cap_pixfmt_row(k->fmt, k->width) * (size_t)k->height;
    if (w->swmr && !reopen(w))
        return write_fail(w, "cannot be opened again for another camera", d);
    return make_datasets(w, k, type) ? PVX_OK : write_fail(w, "cannot make a camera's tables", d);
}

static pvx_err new_writer(const char *path, const struct cap_take_head *h, cap_take_writer **out)
{
    cap_take_writer *w = *out = pvx_calloc(1, sizeof *w);
    PVX_NEED(w);
    w->file = w->room.fd = -1;
    w->row_type = take_h5_row_type();
    w->set_type = take_h5_set_type();
    w->gap_type = take_h5_gap_type();
    w->trigger_type = take_h5_trigger_type();
    w->lost_type = take_h5_lost_type();
    w->triggered = h->triggered;
    w->path = strdup(path);
    w->camera = pvx_calloc(h->n_cameras, sizeof *w->camera);
    w->member = pvx_calloc(h->n_cameras, sizeof *w->member);
    if (w->path == NULL || w->camera == NULL || w->member == NULL)
        return PVX_ENOMEM;
    w->n_cameras = h->n_cameras;
    for (uint32_t c = 0; c < h->n_cameras; c++) {
        struct camera *k = &w->camera[c];
        const struct cap_take_camera *from = &h->camera[c];
        k->frames = k->index = -1;
        k->temperature_c = NAN;
        k->name = strdup(from->name);
        k->uri = strdup(from->uri != NULL ? from->uri : "");
        k->settings = strdup(from->settings != NULL ? from->settings : "");
        if (k->name == NULL || k->uri == NULL || k->settings == NULL)
            return PVX_ENOMEM;
    }
    return PVX_OK;
}

static void free_writer(cap_take_writer *w)
{
    close_file(w);
    if (w->room.fd >= 0)
        close(w->room.fd);
    H5Tclose(w->row_type);
    H5Tclose(w->set_type);
    H5Tclose(w->gap_type);
    H5Tclose(w->trigger_type);
    H5Tclose(w->lost_type);
    for (uint32_t c = 0; c < w->n_cameras; c++) {
        free(w->camera[c].name);
        free(w->camera[c].uri);
        free(w->camera[c].settings);
    }
    free(w->camera);
    free(w->member);
    free(w->tight);
    free(w->path);
    free(w);
}

static pvx_err create_file(cap_take_writer *w, struct pvx_diag *d)
{
    hid_t fapl = take_h5_access(TAKE_ALIGN), fcpl = H5Pcreate(H5P_FILE_CREATE);
    H5Pset_attr_phase_change(fcpl, ATTRS, 0);
    pvx_err e = take_h5_create(&w->room, w->path, fcpl, fapl, &w->file, d);
    H5Pclose(fcpl);
    H5Pclose(fapl);
    return e;
}

pvx_err cap_take_create(const char *path, const struct cap_take_head *head, cap_take_writer **out,
                        struct pvx_diag *d)
{
    take_h5_init();
    *out = NULL;
    if (head->n_cameras < 1 || head->n_cameras > CAP_MAX_CAMERAS)
        return pvx_fail(d, PVX_EINVAL, "%s: a take of %u cameras; 1 to %d are possible", path,
                        head->n_cameras, CAP_MAX_CAMERAS);
    for (uint32_t c = 0; c < head->n_cameras; c++)
        if (head->camera[c].name[0] == '\0' || strlen(head->camera[c].name) >= CAP_TAKE_NAME_MAX ||
            strchr(head->camera[c].name, '/') != NULL || head->camera[c].name[0] == '.')
            return pvx_fail(d, PVX_EINVAL, "%s: '%s' cannot be a camera's name in a take", path,
                            head->camera[c].name);
    cap_take_writer *w;
    pvx_err e = new_writer(path, head, &w);
    PVX_THEN(e, create_file(w, d));
    if (e == PVX_OK && !make_root(w, head)) {
        e = write_fail(w, "cannot be begun", d);
        close_file(w);
        unlink(path);
    }
    if (e != PVX_OK && w != NULL) {
        free_writer(w);
        return e;
    }
    *out = w;
    return e;
}

/* ---- appending ---- */

/* The pixels without padding between rows; NULL = no memory for them. */
static const void *tight_pixels(cap_take_writer *w, const struct camera *k,
                                const struct cap_image *img)
{
    size_t row = cap_pixfmt_row(k->fmt, k->width);
    if (img->stride == (ptrdiff_t)row)
        return img->data;
    if (w->tight_size < k->bytes) {
        free(w->tight);
        w->tight = malloc(k->bytes);
        w->tight_size = w->tight != NULL ? k->bytes : 0;
    }
    for (int32_t y = 0; y < k->height && w->tight != NULL; y++)
        memcpy(w->tight + (size_t)y * row, (const unsigned char *)img->data + y * img->stride, row);
    return w->tight;
}

static bool append_image(struct camera *k, const void *pixels)
{
    hsize_t size[4], at[4] = {k->n, 0, 0, 0};
    memcpy(size, k->dims, sizeof size);
    size[0] = k->n + 1;
    return H5Dset_extent(k->frames, size) >= 0 &&
           H5Dwrite_chunk(k->frames, H5P_DEFAULT, 0, at, k->bytes, pixels) >= 0;
}

static bool write_fits(const struct camera *k, const struct cap_image *img)
{
    return img->fmt == k->fmt && img->width == k->width && img->height == k->height &&
           write_is_whole(img);
}

static pvx_err unfit(cap_take_writer *w, const struct cap_frame *f, int64_t set, struct pvx_diag *d)
{
    struct cap_take_gap g = {.camera = f->camera,
                             .why = CAP_TAKE_UNFIT,
                             .frames = 1,
                             .id_first = f->id,
                             .id_last = f->id,
                             .set_first = set,
                             .set_last = set,
                             .t_first_ns = f->t_exposure_ns,
                             .t_last_ns = f->t_exposure_ns};
    return cap_take_put_gap(w, &g, d);
}

/* *place = index in the camera's list; -1 = the frame did not fit. */
static pvx_err put_frame(cap_take_writer *w, const struct cap_frame *f, int64_t set, uint32_t why,
                         int64_t *place, struct pvx_diag *d)
{
    *place = -1;
    struct camera *k = &w->camera[f->camera];
    if (!k->made && write_is_whole(&f->img))
        PVX_TRY(make_camera(w, k, &f->img, d));
    PVX_TRY(start_swmr(w, d));
    if (!k->made || !write_fits(k, &f->img))
        return unfit(w, f, set, d);
    struct cap_take_row r = {.id = f->id,
                             .set = set,
                             .t_device_ns = f->t_device_ns,
                             .t_arrival_ns = f->t_arrival_ns,
                             .t_arrival_mono_ns = f->t_arrival_mono_ns,
                             .t_exposure_ns = f->t_exposure_ns,
                             .exposure_us = f->exposure_us,
                             .gain = f->gain,
                             .why = why};
    const void *pixels = k->rank == 1 ? f->img.data : tight_pixels(w, k, &f->img);
    if (pixels == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a frame of camera %s", w->path, k->name);
    r.bytes = k->rank == 1 ? f->img.size : k->bytes;
    r.offset = k->rank == 1 ? k->stream : 0;
    r.xxh3 = XXH3_64bits(pixels, r.bytes);
    r.check = take_row_check(&r);
    if (!(k->rank == 1 ? take_h5_append(k->frames, H5T_NATIVE_UINT8, 0, k->stream, r.bytes, pixels)
                       : append_image(k, pixels)) ||
        !take_h5_append(k->index, w->row_type, 0, k->n, 1, &r))
        return write_fail(w, "cannot be written", d);
    k->stream += k->rank == 1 ? r.bytes : 0;
    *place = (int64_t)k->n++;
    w->n_frames++;
    w->bytes += r.bytes;
    return PVX_OK;
}

/* Make all new cameras of a set before its first row, because making one leaves SWMR mode. */
static pvx_err make_cameras(cap_take_writer *w, const struct cap_set *s, struct pvx_diag *d)
{
    for (uint32_t c = 0; c < w->n_cameras; c++)
        if (s->frame[c] != NULL && !w->camera[c].made && write_is_whole(&s->frame[c]->img))
            PVX_TRY(make_camera(w, &w->camera[c], &s->frame[c]->img, d));
    return PVX_OK;
}

pvx_err cap_take_put_set(cap_take_writer *w, const struct cap_set *s, struct pvx_diag *d)
{
    take_h5_init();
    uint64_t bytes = 0;
    for (uint32_t c = 0; c < w->n_cameras; c++)
        bytes += s->frame[c] != NULL ? s->frame[c]->img.size : 0;
    PVX_TRY(write_reserve(w, bytes, d));
    PVX_TRY(make_cameras(w, s, d));
    struct cap_take_set row = {.number = s->number,
                               .t_exposure_ns = s->t_exposure_ns,
                               .spread_ns = s->spread_ns,
                               .t_last_mono_ns = s->t_last_mono_ns};
    for (uint32_t c = 0; c < w->n_cameras; c++) {
        w->member[c] = -1;
        if (s->frame[c] == NULL)
            continue;
        PVX_TRY(put_frame(w, s->frame[c], (int64_t)s->number, CAP_TAKE_IN_SET, &w->member[c], d));
        if (w->member[c] >= 0) {
            row.mask |= 1ull << c;
            row.n++;
        }
    }
    row.check = take_set_check(&row, w->member, w->n_cameras);
    if (!take_h5_append(w->members, H5T_NATIVE_INT64, w->n_cameras, w->n_sets, 1, w->member) ||
        !take_h5_append(w->sets, w->set_type, 0, w->n_sets, 1, &row))
        return write_fail(w, "cannot be written", d);
    w->n_sets++;
    return PVX_OK;
}

pvx_err cap_take_put_stray(cap_take_writer *w, const struct cap_frame *f, enum cap_take_why why,
                           struct pvx_diag *d)
{
    take_h5_init();
    int64_t place;
    PVX_TRY(write_reserve(w, f->img.size, d));
    return put_frame(w, f, -1, why, &place, d);
}

pvx_err cap_take_put_gap(cap_take_writer *w, const struct cap_take_gap *g, struct pvx_diag *d)
{
    take_h5_init();
    PVX_TRY(write_reserve(w, 0, d));
    PVX_TRY(start_swmr(w, d));
    if (!take_h5_append(w->gaps, w->gap_type, 0, w->n_gaps, 1, g))
        return write_fail(w, "cannot be written", d);
    w->n_gaps++;
    return PVX_OK;
}

/* Append a row to a small table. */
static pvx_err put_row(cap_take_writer *w, hid_t table, hid_t type, uint64_t *n, const void *row,
                       struct pvx_diag *d)
{
    take_h5_init();
    if (!w->triggered)
        return pvx_fail(d, PVX_EINVAL, "%s: was not begun by a trigger", w->path);
    PVX_TRY(write_reserve(w, 0, d));
    PVX_TRY(start_swmr(w, d));
    if (!take_h5_append(table, type, 0, *n, 1, row))
        return write_fail(w, "cannot be written", d);
    ++*n;
    return PVX_OK;
}

pvx_err cap_take_put_trigger(cap_take_writer *w, const struct cap_take_trigger *t,
                             struct pvx_diag *d)
{
    return put_row(w, w->triggers, w->trigger_type, &w->n_triggers, t, d);
}

pvx_err cap_take_put_lost(cap_take_writer *w, const struct cap_take_lost *l, struct pvx_diag *d)
{
    return put_row(w, w->lost, w->lost_type, &w->n_lost, l, d);
}

pvx_err cap_take_commit(cap_take_writer *w, struct pvx_diag *d)
{
    take_h5_init();
    return H5Fflush(w->file, H5F_SCOPE_LOCAL) >= 0 ? PVX_OK : write_fail(w, "cannot be written", d);
}

/* Write the totals after the file has been closed once, so that it is whole even if this fails. */
static pvx_err put_totals(cap_take_writer *w, struct pvx_diag *d)
{
    if (!reopen(w))
        return write_fail(w, "cannot be closed", d);
    bool ok = true;
    for (uint32_t c = 0; c < w->n_cameras && ok; c++) {
        char name[CAP_TAKE_NAME_MAX + 24];
        snprintf(name, sizeof name, "cameras/%s", w->camera[c].name);
        hid_t g = w->camera[c].made ? H5Gopen2(w->file, name, H5P_DEFAULT) : -1;
        ok = g < 0 || put_about(g, &w->camera[c]);
        if (g >= 0)
            H5Gclose(g);
    }
    ok = ok && take_h5_put_int(w->file, "n_sets", (int64_t)w->n_sets) &&
         take_h5_put_int(w->file, "n_frames", (int64_t)w->n_frames) &&
         take_h5_put_int(w->file, "n_gaps", (int64_t)w->n_gaps) &&
         take_h5_put_int(w->file, "t_closed_ns", pvx_now_real()) &&
         take_h5_put_int(w->file, "goes_on", w->goes_on) && take_h5_put_int(w->file, "closed", 1);
    return close_file(w) && ok ? PVX_OK : write_fail(w, "cannot be closed", d);
}

void cap_take_about(cap_take_writer *w, uint32_t camera, const char *serial, double temperature_c)
{
    struct camera *k = &w->camera[camera];
    if (serial[0] != '\0' && strlen(serial) < sizeof k->serial)
        memcpy(k->serial, serial, strlen(serial) + 1);
    if (isfinite(temperature_c))
        k->temperature_c = temperature_c;
}

void cap_take_goes_on(cap_take_writer *w)
{
    w->goes_on = true;
}

pvx_err cap_take_close(cap_take_writer **wp, struct pvx_diag *d)
{
    cap_take_writer *w = *wp;
    if (w == NULL)
        return PVX_OK;
    *wp = NULL;
    take_h5_init();
    pvx_err e = put_totals(w, d);
    free_writer(w);
    return e;
}

uint64_t cap_take_bytes(const cap_take_writer *w)
{
    return w->bytes;
}
