/* The chain of folders of tags: TIFF 6.0, section 2, and BigTIFF, where counts and offsets have 8 bytes. */
#include "capture/files/tiff.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "capture/files/picture.h"

struct tiff_chain {
    const struct cap_bytes *b;
    const char *name;
    bool big, big_endian;
};

struct tiff_folder {
    uint64_t next;
    bool page;
    uint64_t planes;       /* of MetaMorph */
    uint64_t text, length; /* ImageDescription */
    uint64_t width, height, samples, orientation, compression, predictor;
    const char *strange; /* a tag by which samples mean something else */
};

bool cap_bytes_get(const struct cap_bytes *b, uint64_t at, void *to, size_t size)
{
    if (at > b->n || b->n - at < size)
        return false;
    if (b->p != NULL) {
        memcpy(to, (const char *)b->p + at, size);
        return true;
    }
    for (size_t n = 0; n < size;) {
        ssize_t r = pread(b->fd, (char *)to + n, size - n, (off_t)(at + n));
        if (r <= 0)
            return false;
        n += (size_t)r;
    }
    return true;
}

static uint64_t tiff_number(const struct tiff_chain *t, const unsigned char *p, unsigned size)
{
    uint64_t v = 0;
    for (unsigned i = 0; i < size; i++)
        v |= (uint64_t)p[i] << 8 * (t->big_endian ? size - 1 - i : i);
    return v;
}

/* A number in the file; 0 if it is not all there. */
static uint64_t tiff_number_at(const struct tiff_chain *t, uint64_t at, unsigned size)
{
    unsigned char p[8];
    return cap_bytes_get(t->b, at, p, size) ? tiff_number(t, p, size) : 0;
}

static void tiff_tag(const struct tiff_chain *t, const unsigned char *p, uint64_t at,
                     struct tiff_folder *f)
{
    static const struct {
        uint16_t tag;
        const char *name;
    } strange[] = {{291, "GrayResponseCurve"}, {33422, "CFAPattern"}, {50706, "DNGVersion"}};
    uint64_t type = tiff_number(t, p + 2, 2);
    unsigned wide = t->big ? 8 : 4, item = type == 1 ? 1 : type == 3 ? 2 : type == 16 ? 8 : 4;
    item = item < wide ? item : wide;
    uint64_t tag = tiff_number(t, p, 2), count = tiff_number(t, p + 4, wide);
    uint64_t value = tiff_number(t, p + 4 + wide, item);
    switch (tag) {
    case 254: f->page = f->page && (value & 5) == 0; break; /* NewSubfileType */
    case 255: f->page = f->page && value != 2; break;       /* SubfileType */
    case 256: f->width = value; break;
    case 257: f->height = value; break;
    case 259: f->compression = value; break;
    case 274: f->orientation = value; break;
    case 277: f->samples = value; break;
    case 317: f->predictor = value; break;
    case 33629: f->planes = count; break; /* UIC2Tag */
    case 270:
        f->length = count;
        f->text = count <= wide ? at + 4 + wide : tiff_number(t, p + 4 + wide, wide);
        break;
    }
    for (size_t i = 0; i < sizeof strange / sizeof strange[0]; i++)
        if (tag == strange[i].tag)
            f->strange = strange[i].name;
}

static pvx_err tiff_read_folder(const struct tiff_chain *t, uint64_t at, struct tiff_folder *f,
                                struct pvx_diag *d)
{
    enum { BATCH = 64 };
    unsigned char p[BATCH * 20], next[8];
    size_t entry = t->big ? 20 : 12, counted = t->big ? 8 : 2;
    uint64_t n = tiff_number_at(t, at, (unsigned)counted);
    *f = (struct tiff_folder){.page = true};
    at += counted;
    bool whole = n > 0 && n <= t->b->n / entry;
    for (uint64_t left = n; whole && left > 0;) {
        size_t some = left < BATCH ? (size_t)left : BATCH;
        whole = cap_bytes_get(t->b, at, p, some * entry);
        for (size_t i = 0; i < some && whole; i++)
            tiff_tag(t, p + i * entry, at + i * entry, f);
        at += some * entry;
        left -= some;
    }
    if (!whole || !cap_bytes_get(t->b, at, next, t->big ? 8 : 4))
        return pvx_fail(d, PVX_ECORRUPT, "%s: damaged or cut: the tags of a page are not all there",
                        t->name);
    f->next = tiff_number(t, next, t->big ? 8 : 4);
    return PVX_OK;
}

static unsigned long tiff_says(const char *text, const char *key)
{
    const char *at = strstr(text, key);
    return at != NULL ? strtoul(at + strlen(key), NULL, 10) : 0;
}

/* Pictures by the text of Python's tifffile, {"shape": [4, 60, 80]}.  0: it does not say so. */
static unsigned long tiff_shaped(const struct tiff_folder *f, const char *text)
{
    static const char key[] = "\"shape\": [";
    uint64_t all = 1, one = f->width * f->height * (f->samples > 1 ? f->samples : 1);
    const char *p = *text == '{' ? strstr(text, key) : NULL;
    if (p == NULL || one == 0)
        return 0;
    for (p += sizeof key - 1;; p++) {
        char *end;
        uint64_t n = strtoul(p, &end, 10);
        if (end == p || __builtin_mul_overflow(all, n, &all))
            return 0;
        if (*(p = end) != ',')
            return all / one;
    }
}

/* ImageJ's line or curve from a sample to what it means: signed samples are stored with 32768 added.  A function of
 * density (21) has no coefficients. */
static pvx_err tiff_uncalibrated(const char *text, const char *name, struct pvx_diag *d)
{
    if (strncmp(text, "ImageJ=", 7) != 0 || strstr(text, "\ncf=") == NULL ||
        (strstr(text, "\nc0=") == NULL && tiff_says(text, "\ncf=") != 21))
        return PVX_OK;
    return pvx_fail(d, PVX_EUNSUP,
                    "%s: ImageJ's calibration in it (cf=) gives its samples another meaning, for "
                    "instance 32768 less: convert it to 32 bits in ImageJ (Image > Type), which "
                    "applies it, or take it out (Analyze > Calibrate > None)",
                    name);
}

/* Refuses a folder of tags that stands for more pictures than one, and pages that are not one picture after the
 * other: ImageJ and OME write channels (of two cameras, too) and layers as pages. */
static pvx_err tiff_is_sequence(const struct tiff_chain *t, const struct tiff_folder *first,
                                uint32_t pages, struct pvx_diag *d)
{
    char text[8192] = "";
    unsigned long images = first->planes;
    size_t n = first->length < sizeof text ? (size_t)first->length : sizeof text - 1;
    (void)cap_bytes_get(t->b, first->text, text, n);
    bool imagej = strncmp(text, "ImageJ=", 7) == 0, ome = strstr(text, "<OME") != NULL;
    PVX_TRY(tiff_uncalibrated(text, t->name, d));
    if (imagej)
        images = tiff_says(text, "\nimages=");
    else if (images == 0)
        images = tiff_shaped(first, text);
    if (images > pages)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: says it has %lu pictures, but the tags of %u: save them as pages with "
                        "tags of their own, or as one file each",
                        t->name, images, pages);
    if (pages < 2 || (!imagej && !ome))
        return PVX_OK;
    bool channels = imagej ? tiff_says(text, "\nchannels=") > 1
                           : tiff_says(text, "SizeC=\"") > 1 && first->samples < 2;
    bool layers = imagej ? tiff_says(text, "\nslices=") > 1 && tiff_says(text, "\nframes=") > 1
                         : tiff_says(text, "SizeZ=\"") > 1 && tiff_says(text, "SizeT=\"") > 1;
    if (channels || layers)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its pages are not one picture after the other, but %s of each: save "
                        "each as a file of its own",
                        t->name, channels ? "several channels" : "several layers");
    return PVX_OK;
}

static pvx_err tiff_upright(uint64_t orientation, const char *name, struct pvx_diag *d)
{
    if (orientation < 2)
        return PVX_OK;
    return pvx_fail(d, PVX_EUNSUP,
                    "%s: its orientation tag (%llu) asks to turn or mirror it, and a camera's "
                    "calibration holds for one way only: set the tag to 1 in all pictures of the "
                    "camera (exiftool -n -Orientation=1), or save them all turned",
                    name, (unsigned long long)orientation);
}

pvx_err cap_exif_upright(const void *bytes, size_t n, const char *name, struct pvx_diag *d)
{
    const struct cap_bytes b = {.p = bytes, .n = n};
    struct tiff_chain t = {.b = &b, .name = name};
    struct tiff_folder f = {0};
    if (!cap_picture_is_tiff(bytes, n))
        return PVX_OK;
    t.big_endian = *(const char *)bytes == 'M';
    if (tiff_read_folder(&t, tiff_number_at(&t, 4, 4), &f, NULL) != PVX_OK)
        f.page = false; /* cut: counts as far as it goes */
    return tiff_upright(f.orientation, name, d);
}

/* What libtiff does not see, or guesses. */
static pvx_err tiff_check_page(const struct tiff_folder *f, uint64_t bytes, const char *name,
                               struct pvx_diag *d)
{
    if (f->width == 0 || f->height == 0)
        return pvx_fail(d, PVX_ECORRUPT,
                        "%s: its head is damaged or cut: no size or no samples in it", name);
    uint32_t w = f->width < UINT32_MAX ? (uint32_t)f->width : UINT32_MAX;
    uint32_t h = f->height < UINT32_MAX ? (uint32_t)f->height : UINT32_MAX;
    PVX_TRY(cap_picture_fits(w, h, bytes, name, d));
    if (f->strange != NULL)
        return pvx_fail(
            d, PVX_EUNSUP,
            "%s: its tag %s says that its samples are no light on a linear scale (a raw "
            "file, a scan): develop it without a curve, and save it as grey or RGB",
            name, f->strange);
    if (f->predictor > 1 && (f->compression < 2 || f->compression == 32773))
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: has a Predictor, but no compression that uses one: save it again",
                        name);
    return tiff_upright(f->orientation, name, d);
}

pvx_err cap_tiff_pages(const struct cap_bytes *b, const char *name, uint32_t page, uint32_t *pages,
                       uint64_t *where, struct pvx_diag *d)
{
    struct tiff_chain t = {.b = b, .name = name};
    struct tiff_folder f, first = {0};
    unsigned char head[4] = {0};
    uint32_t counted = 0;
    bool found = where == NULL, looked = cap_bytes_get(b, 0, head, 4);
    t.big_endian = looked && head[0] == 'M';
    t.big = tiff_number(&t, head + 2, 2) == 43;
    uint64_t at = t.big ? tiff_number_at(&t, 8, 8) : tiff_number_at(&t, 4, 4);
    /* A chain that leads back is found by a mark that moves on ever more rarely (Brent). */
    for (uint64_t n = 0, mark = 0, until = 1; at != 0 || n == 0; at = f.next) {
        PVX_TRY(tiff_read_folder(&t, at, &f, d));
        if (n == 0)
            first = f;
        if (f.page && where != NULL && counted == page) {
            PVX_TRY(tiff_check_page(&f, b->n, name, d));
            *where = at;
            found = true;
            if (pages == NULL)
                return PVX_OK;
        }
        counted += f.page;
        if (at == mark)
            return pvx_fail(d, PVX_ECORRUPT, "%s: damaged: its pages lead back to each other",
                            name);
        if (++n == until) {
            mark = at;
            until *= 2;
        }
    }
    if (counted == 0)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: has only previews or masks in its pages (a raw file?): save the "
                        "pictures themselves as TIFF",
                        name);
    PVX_TRY(tiff_is_sequence(&t, &first, counted, d));
    if (!found)
        return pvx_fail(d, PVX_ERANGE, "%s: has %u pages; there is no page %u", name, counted,
                        page);
    if (pages != NULL)
        *pages = counted;
    return PVX_OK;
}
