/* hdf5_safe.c - whether libhdf5 can open a dataset of a file that may be damaged, and read it. */
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "daemon/volumes/hdf5.h"

bool vol_hdf5_filtered(hid_t file, const char *name)
{
    enum { FILTERS = 0x0B }; /* a message in a dataset's head, which has a checksum */
    H5O_info_t about;
    return H5Oget_info_by_name2(file, name, &about, H5O_INFO_HDR, H5P_DEFAULT) >= 0 &&
           (about.hdr.mesg.present >> FILTERS & 1) != 0;
}

int vol_hdf5_lacks(hid_t set)
{
    hid_t p = H5Dget_create_plist(set);
    int n = H5Pget_nfilters(p), lacks = -1;
    for (int k = 0; k < n && lacks < 0; k++) {
        unsigned flags;
        size_t values = 0;
        H5Z_filter_t filter = H5Pget_filter2(p, (unsigned)k, &flags, &values, NULL, 0, NULL, NULL);
        if (filter >= 0 && H5Zfilter_avail(filter) <= 0)
            lacks = filter;
    }
    H5Pclose(p);
    H5Eclear2(H5E_DEFAULT);
    return lacks;
}

static uint64_t safe_load(const char *p, size_t bytes)
{
    uint64_t v = 0;
    memcpy(&v, p, bytes); /* little-endian, as the file */
    return v;
}

/* Whether the objects of a collection of the global heap (HDF5's format, III.E) follow each other to its end; object
 * 0 is free space.  p[0, n) begins with the collection. */
static bool heap_ends(const char *p, size_t n)
{
    uint64_t size = n >= 16 ? safe_load(p + 8, 8) : 0;
    if (size < 16 || size > n)
        return false;
    for (uint64_t at = 16, need; size - at >= 16; at += need) {
        need = safe_load(p + at + 8, 8);
        if (safe_load(p + at, 2) != 0)
            need = need <= size ? 16 + (need + 7) / 8 * 8 : size + 1;
        if (need == 0 || need > size - at)
            return false;
    }
    return true;
}

bool vol_hdf5_heaps_end(const char *path, uint64_t bytes)
{
    static const char begin[5] = "GCOL\1";
    char *file, *p;
    size_t n;
    if (bytes > VOL_HEAPS_MOST)
        return true;
    if (pvx_file_read(path, bytes, &file, &n, NULL) != PVX_OK)
        return false;
    bool good = true;
    for (p = file; good && (p = memmem(p, n - (size_t)(p - file), begin, sizeof begin)); p++)
        good = heap_ends(p, n - (size_t)(p - file));
    free(file);
    return good;
}
