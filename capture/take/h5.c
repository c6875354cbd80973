#include "capture/take/h5.h"

#include <pthread.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <xxhash.h>

const char *const cap_take_why_names[CAP_TAKE_N_WHY] = {
    [CAP_TAKE_IN_SET] = "in_set",       [CAP_TAKE_LATE] = "late",
    [CAP_TAKE_UNMATCHED] = "unmatched", [CAP_TAKE_OVERFLOW] = "overflow",
    [CAP_TAKE_QUEUE] = "queue",         [CAP_TAKE_UNFIT] = "unfit",
};

static void once(void)
{
    /* Their owners close files.  At exit, libhdf5 would try again to write what could not be written. */
    H5dont_atexit();
    /* A file has its own data: no link of it leads into another. */
    H5Lunregister(H5L_TYPE_EXTERNAL);
}

void take_h5_init(void)
{
    static pthread_once_t done = PTHREAD_ONCE_INIT;
    pthread_once(&done, once);
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL); /* per thread */
}

static herr_t innermost(unsigned n, const H5E_error2_t *e, void *text)
{
    if (n == 0 && e->desc != NULL)
        snprintf(text, 256, "%s", e->desc);
    return 0;
}

pvx_err take_h5_fail(struct pvx_diag *d, pvx_err e, const char *path, const char *what)
{
    char reason[256] = "libhdf5 does not say why";
    H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, innermost, reason);
    H5Eclear2(H5E_DEFAULT);
    for (char *p = reason; *p != '\0'; p++)
        if ((unsigned char)*p < ' ' || (unsigned char)*p > '~')
            *p = ' ';
    if (strstr(reason, "No space left") != NULL || strstr(reason, "errno = 28") != NULL)
        return pvx_fail(d, PVX_ENOSPC, "%s: %s: the disk is full", path, what);
    return pvx_fail(d, e, "%s: %s: %s", path, what, reason);
}

static hid_t why_type(void)
{
    hid_t t = H5Tenum_create(H5T_STD_U32LE);
    for (uint32_t i = 0; i < CAP_TAKE_N_WHY; i++)
        H5Tenum_insert(t, cap_take_why_names[i], &i);
    return t;
}

#define FIELD(t, struct_, member, type) \
    H5Tinsert(t, #member, offsetof(struct struct_, member), type)

hid_t take_h5_row_type(void)
{
    hid_t t = H5Tcreate(H5T_COMPOUND, sizeof(struct cap_take_row)), why = why_type();
    FIELD(t, cap_take_row, id, H5T_STD_U64LE);
    FIELD(t, cap_take_row, set, H5T_STD_I64LE);
    FIELD(t, cap_take_row, t_device_ns, H5T_STD_I64LE);
    FIELD(t, cap_take_row, t_arrival_ns, H5T_STD_I64LE);
    FIELD(t, cap_take_row, t_arrival_mono_ns, H5T_STD_I64LE);
    FIELD(t, cap_take_row, t_exposure_ns, H5T_STD_I64LE);
    FIELD(t, cap_take_row, exposure_us, H5T_IEEE_F64LE);
    FIELD(t, cap_take_row, gain, H5T_IEEE_F64LE);
    FIELD(t, cap_take_row, offset, H5T_STD_U64LE);
    FIELD(t, cap_take_row, bytes, H5T_STD_U64LE);
    FIELD(t, cap_take_row, xxh3, H5T_STD_U64LE);
    FIELD(t, cap_take_row, why, why);
    FIELD(t, cap_take_row, pad, H5T_STD_U32LE);
    FIELD(t, cap_take_row, check, H5T_STD_U64LE);
    H5Tclose(why);
    return t;
}

hid_t take_h5_set_type(void)
{
    hid_t t = H5Tcreate(H5T_COMPOUND, sizeof(struct cap_take_set));
    FIELD(t, cap_take_set, number, H5T_STD_U64LE);
    FIELD(t, cap_take_set, t_exposure_ns, H5T_STD_I64LE);
    FIELD(t, cap_take_set, spread_ns, H5T_STD_I64LE);
    FIELD(t, cap_take_set, t_last_mono_ns, H5T_STD_I64LE);
    FIELD(t, cap_take_set, mask, H5T_STD_U64LE);
    FIELD(t, cap_take_set, n, H5T_STD_U32LE);
    FIELD(t, cap_take_set, pad, H5T_STD_U32LE);
    FIELD(t, cap_take_set, check, H5T_STD_U64LE);
    return t;
}

hid_t take_h5_gap_type(void)
{
    hid_t t = H5Tcreate(H5T_COMPOUND, sizeof(struct cap_take_gap)), why = why_type();
    FIELD(t, cap_take_gap, camera, H5T_STD_U32LE);
    FIELD(t, cap_take_gap, why, why);
    FIELD(t, cap_take_gap, frames, H5T_STD_U64LE);
    FIELD(t, cap_take_gap, id_first, H5T_STD_U64LE);
    FIELD(t, cap_take_gap, id_last, H5T_STD_U64LE);
    FIELD(t, cap_take_gap, set_first, H5T_STD_I64LE);
    FIELD(t, cap_take_gap, set_last, H5T_STD_I64LE);
    FIELD(t, cap_take_gap, t_first_ns, H5T_STD_I64LE);
    FIELD(t, cap_take_gap, t_last_ns, H5T_STD_I64LE);
    H5Tclose(why);
    return t;
}

static hid_t word_type(size_t size)
{
    hid_t t = H5Tcopy(H5T_C_S1);
    H5Tset_size(t, size);
    H5Tset_cset(t, H5T_CSET_UTF8);
    return t;
}

hid_t take_h5_trigger_type(void)
{
    hid_t t = H5Tcreate(H5T_COMPOUND, sizeof(struct cap_take_trigger)),
          word = word_type(CAP_TAKE_TRIGGER_MAX);
    FIELD(t, cap_take_trigger, name, word);
    FIELD(t, cap_take_trigger, t_ns, H5T_STD_I64LE);
    FIELD(t, cap_take_trigger, set, H5T_STD_I64LE);
    FIELD(t, cap_take_trigger, latency_ns, H5T_STD_I64LE);
    FIELD(t, cap_take_trigger, t_from_ns, H5T_STD_I64LE);
    FIELD(t, cap_take_trigger, t_to_ns, H5T_STD_I64LE);
    H5Tclose(word);
    return t;
}

hid_t take_h5_lost_type(void)
{
    hid_t t = H5Tcreate(H5T_COMPOUND, sizeof(struct cap_take_lost)),
          word = word_type(CAP_TAKE_LOST_MAX);
    FIELD(t, cap_take_lost, camera, H5T_STD_U32LE);
    FIELD(t, cap_take_lost, pad, H5T_STD_U32LE);
    FIELD(t, cap_take_lost, why, word);
    FIELD(t, cap_take_lost, frames, H5T_STD_U64LE);
    FIELD(t, cap_take_lost, id_first, H5T_STD_U64LE);
    FIELD(t, cap_take_lost, id_last, H5T_STD_U64LE);
    FIELD(t, cap_take_lost, t_first_ns, H5T_STD_I64LE);
    FIELD(t, cap_take_lost, t_last_ns, H5T_STD_I64LE);
    H5Tclose(word);
    return t;
}

int take_h5_shape(enum cap_pixfmt fmt, int32_t width, int32_t height, hsize_t dims[4], hid_t *type)
{
    size_t row = cap_pixfmt_row(fmt, width), item = 1, last = 1;
    *type = H5T_STD_U8LE;
    switch (cap_pixfmt_layout(fmt)) {
    case CAP_LAYOUT_NONE: return 0;
    case CAP_LAYOUT_JPEG: dims[0] = TAKE_STREAM; return 1;
    case CAP_LAYOUT_16:
        *type = H5T_STD_U16LE;
        item = 2;
        break;
    case CAP_LAYOUT_F32:
        *type = H5T_IEEE_F32LE;
        item = 4;
        break;
    default: break;
    }
    dims[0] = 1;
    dims[1] = (hsize_t)height;
    last = row / item / (size_t)width;
    if (last < 2 || row != last * item * (size_t)width) { /* one sample a pixel, or packed */
        dims[2] = row / item;
        return 3;
    }
    dims[2] = (hsize_t)width;
    dims[3] = last;
    return 4;
}

uint64_t take_row_check(const struct cap_take_row *r)
{
    return XXH3_64bits(r, offsetof(struct cap_take_row, check));
}

uint64_t take_set_check(const struct cap_take_set *s, const int64_t *member, uint32_t n)
{
    uint64_t seed = XXH3_64bits(s, offsetof(struct cap_take_set, check));
    return XXH3_64bits_withSeed(member, n * sizeof *member, seed);
}
