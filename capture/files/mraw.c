/* mraw.c - Photron's .mraw: pixels, frame after frame, and nothing else.  What they are stands in a file beside it:
 *
 *   .cih    text, "Key : Value" on each line, up to the line END
 *   .cihx   the same as XML, between <cih> and </cih>, after some bytes of another kind
 *
 * Rows are stored from the top down.  Frame k of the file is frame StartFrame + k * SaveStep of the camera, which counts
 * from its trigger.  12 bits are packed with the highest bit first. */
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "capture/files/raw.h"
#include "capture/files/said.h"

#define HEADER_MOST (16u << 20)
#define WORD        80

/* A header, and how to ask it. */
struct mraw {
    struct cap_raw *r;
    const char *name, *text, *end;
    bool xml;
};

enum mraw_key {
    FILE_FORMAT,
    WIDTH,
    HEIGHT,
    COLOUR,
    PATTERN,
    BITS,
    DEPTH,
    SIDE,
    TOTAL,
    START,
    STEP,
    RATE,
    CORRECTED,
    ZERO,
    PROCESSED,
    GAMMA,
    SIGN,
    SHUTTER,
    SHUTTER_NS,
    KEYS
};

/* In .cih a key, in .cihx the names of elements in each other. */
static const struct {
    const char *cih, *cihx;
} mraw_keys[KEYS] = {
    [FILE_FORMAT] = {"File Format", "imageFileInfo/fileFormat"},
    [WIDTH] = {"Image Width", "imageDataInfo/resolution/width"},
    [HEIGHT] = {"Image Height", "imageDataInfo/resolution/height"},
    [COLOUR] = {"Color Type", "imageDataInfo/colorInfo/type"},
    [PATTERN] = {"Bayer Pattern", "imageDataInfo/colorInfo/bayerPattern"},
    [BITS] = {"Color Bit", "imageDataInfo/colorInfo/bit"},
    [DEPTH] = {"EffectiveBit Depth", "imageDataInfo/effectiveBit/depth"},
    [SIDE] = {"EffectiveBit Side", "imageDataInfo/effectiveBit/side"},
    [TOTAL] = {"Total Frame", "frameInfo/totalFrame"},
    [START] = {"Start Frame", "frameInfo/startFrame"},
    [STEP] = {"Save Step", "frameInfo/skipFrame"},
    [RATE] = {"Record Rate(fps)", "recordInfo/recordRate"},
    [CORRECTED] = {"Correct Trigger Frame", "frameInfo/correctTriggerFrame"},
    [ZERO] = {"Zero Frame", ""},
    [PROCESSED] = {"", "imageDataInfo/applyImageProc"},
    [GAMMA] = {"Pre LUT Gamma", ""},
    [SIGN] = {"Pre LUT PosiNega", ""},
    [SHUTTER] = {"Shutter Speed(s)", "recordInfo/shutterSpeed"},
    [SHUTTER_NS] = {"Shutter Type2(nsec)", "recordInfo/shutterSpeedNsec"},
};

/* ---- the header ------------------------------------------------------------------------------- */

/* Copy [from, to) without the spaces about it. */
static void mraw_copy(const char *from, const char *to, char out[WORD])
{
    while (from < to && isspace((unsigned char)*from))
        from++;
    while (to > from && isspace((unsigned char)to[-1]))
        to--;
    size_t n = (size_t)(to - from) < WORD - 1 ? (size_t)(to - from) : WORD - 1;
    memcpy(out, from, n);
    out[n] = '\0';
}

/* The value of a line "Key : Value" of the first part. */
static bool mraw_line(const struct mraw *m, const char *key, char out[WORD])
{
    const char *end;
    for (const char *line = m->text; line < m->end; line = end + 1) {
        if ((end = memchr(line, '\n', (size_t)(m->end - line))) == NULL)
            end = m->end;
        const char *colon = memchr(line, ':', (size_t)(end - line));
        char have[WORD];
        mraw_copy(line, colon != NULL ? colon : end, have);
        if (strcmp(have, "END") == 0)
            return false;
        if (colon == NULL || strcasecmp(have, key) != 0)
            continue;
        mraw_copy(colon + 1, end, out);
        return true;
    }
    return false;
}

/* The content of the first element of that name in [*from, *to). */
static bool mraw_element(const char **from, const char **to, const char *name, size_t n)
{
    for (const char *at = *from; (at = memchr(at, '<', (size_t)(*to - at))) != NULL; at++) {
        if ((size_t)(*to - at) < n + 2 || memcmp(at + 1, name, n) != 0 ||
            (at[n + 1] != '>' && !isspace((unsigned char)at[n + 1])))
            continue;
        const char *in = memchr(at, '>', (size_t)(*to - at));
        if (in == NULL || in[-1] == '/')
            return false;
        for (const char *out = ++in; (out = memchr(out, '<', (size_t)(*to - out))) != NULL; out++)
            if ((size_t)(*to - out) >= n + 3 && out[1] == '/' && memcmp(out + 2, name, n) == 0 &&
                out[n + 2] == '>') {
                *from = in;
                *to = out;
                return true;
            }
        return false;
    }
    return false;
}

/* The value of a key; false: the header does not say it. */
static bool mraw_value(const struct mraw *m, enum mraw_key key, char out[WORD])
{
    const char *from = m->text, *to = m->end, *path = mraw_keys[key].cihx;
    *out = '\0';
    if (!m->xml)
        return *mraw_keys[key].cih != '\0' && mraw_line(m, mraw_keys[key].cih, out);
    if (*path == '\0')
        return false;
    for (size_t n; *path != '\0'; path += n + (path[n] == '/')) {
        n = strcspn(path, "/");
        if (!mraw_element(&from, &to, path, n))
            return false;
    }
    mraw_copy(from, to, out);
    return true;
}

static const char *mraw_key_name(const struct mraw *m, enum mraw_key key)
{
    return m->xml ? mraw_keys[key].cihx : mraw_keys[key].cih;
}

/* A number from `least` to `most`; `absent`: where the header does not say it, NaN: it has to. */
static pvx_err mraw_number(const struct mraw *m, enum mraw_key key, double least, double most,
                           double absent, double *out, struct pvx_diag *d)
{
    char text[WORD], *end = text;
    bool there = mraw_value(m, key, text);
    *out = absent;
    if (!there && isfinite(absent))
        return PVX_OK;
    if (there)
        *out = strtod(text, &end);
    if (!there)
        return pvx_fail(d, PVX_EFORMAT, "%s: does not say %s", m->name, mraw_key_name(m, key));
    if (end == text || *end != '\0' || !(*out >= least && *out <= most))
        return pvx_fail(d, PVX_EFORMAT, "%s: %s is \"%s\", no number from %.10g to %.10g", m->name,
                        mraw_key_name(m, key), text, least, most);
    return PVX_OK;
}

static pvx_err mraw_whole(const struct mraw *m, enum mraw_key key, double least, double most,
                          double absent, int64_t *out, struct pvx_diag *d)
{
    double v;
    PVX_TRY(mraw_number(m, key, least, most, absent, &v, d));
    *out = (int64_t)v;
    return v == floor(v) ? PVX_OK
                         : pvx_fail(d, PVX_EFORMAT, "%s: %s is %g, not a whole number", m->name,
                                    mraw_key_name(m, key), v);
}

/* ---- pixels ----------------------------------------------------------------------------------- */

static pvx_err mraw_colours(const struct mraw *m, struct pvx_diag *d)
{
    struct cap_raw *r = m->r;
    char type[WORD], pattern[WORD];
    int64_t bits;
    PVX_TRY(mraw_whole(m, BITS, 1, 1024, NAN, &bits, d));
    if (!mraw_value(m, COLOUR, type))
        return pvx_fail(d, PVX_EFORMAT, "%s: does not say %s", m->name, mraw_key_name(m, COLOUR));
    if (strcasecmp(type, "Mono") == 0)
        return PVX_OK;
    bool colour = strcasecmp(type, "Color") == 0;
    if (colour && bits > 16)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its colours are interpolated (%s is %s, of %d bits), and so not as "
                        "the sensor saw them: save it as raw (Bayer) pictures",
                        m->name, mraw_key_name(m, COLOUR), type, (int)bits);
    if (!colour && strncasecmp(type, "Bayer", 5) != 0)
        return pvx_fail(d, PVX_EUNSUP, "%s: %s is \"%s\"; Mono and Bayer are read", m->name,
                        mraw_key_name(m, COLOUR), type);
    if (!mraw_value(m, PATTERN, pattern) || strlen(pattern) != 4) {
        r->filter = true; /* one sample in a pixel of a colour camera */
        return PVX_OK;
    }
    for (int i = 0; i < 4; i++)
        r->cell[i] = (char)toupper((unsigned char)pattern[i]);
    return PVX_OK;
}

/* Samples that are not light on a linear scale. */
static pvx_err mraw_processed(const struct mraw *m, struct pvx_diag *d)
{
    char sign[WORD];
    int64_t applied;
    double gamma;
    PVX_TRY(mraw_whole(m, PROCESSED, INT32_MIN, INT32_MAX, 0, &applied, d));
    PVX_TRY(mraw_number(m, GAMMA, -1e6, 1e6, 1, &gamma, d));
    if (applied == 0 && !(gamma > 1 || gamma < 1) &&
        (!mraw_value(m, SIGN, sign) || strcasecmp(sign, "Posi") == 0))
        return PVX_OK;
    return pvx_fail(d, PVX_EUNSUP,
                    "%s: its pictures were processed when they were saved (%s), so that samples "
                    "need not be light on a linear scale: save it without image processing",
                    m->name,
                    applied != 0             ? "applyImageProc"
                    : gamma > 1 || gamma < 1 ? "Pre LUT Gamma"
                                             : "Pre LUT PosiNega");
}

static pvx_err mraw_samples(const struct mraw *m, struct pvx_diag *d)
{
    struct cap_raw *r = m->r;
    char side[WORD];
    int64_t bits, depth;
    PVX_TRY(mraw_whole(m, BITS, 1, 1024, NAN, &bits, d));
    if (bits != 8 && bits != 12 && bits != 16)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: %s is %d; 8, 12 and 16 are read: save it with one of these", m->name,
                        mraw_key_name(m, BITS), (int)bits);
    PVX_TRY(mraw_whole(m, DEPTH, 1, 64, (double)bits, &depth, d));
    r->code = bits == 8 ? CAP_RAW_8 : bits == 12 ? CAP_RAW_12 : CAP_RAW_16;
    r->depth = (int)(depth < bits ? depth : bits);
    if (r->depth < 8)
        return pvx_fail(d, PVX_EUNSUP, "%s: %s is %d; 8 to 16 are read", m->name,
                        mraw_key_name(m, DEPTH), r->depth);
    if (r->depth == bits)
        return PVX_OK;
    bool said = mraw_value(m, SIDE, side);
    if (!said || (strcasecmp(side, "Lower") != 0 && strcasecmp(side, "Higher") != 0))
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: %d of %d bits are used, but %s is \"%s\", neither Lower nor Higher",
                        m->name, r->depth, (int)bits, mraw_key_name(m, SIDE), side);
    r->shift = strcasecmp(side, "Higher") == 0 ? (int)bits - r->depth : 0;
    return PVX_OK;
}

static pvx_err mraw_pixels(const struct mraw *m, struct pvx_diag *d)
{
    struct cap_raw *r = m->r;
    char format[WORD];
    int64_t w, h;
    if (mraw_value(m, FILE_FORMAT, format) && strcasecmp(format, "MRaw") != 0)
        return pvx_fail(d, PVX_EUNSUP, "%s: its pictures are saved as %s, not as MRAW: give those",
                        m->name, format);
    PVX_TRY(mraw_whole(m, WIDTH, 1, INT32_MAX, NAN, &w, d));
    PVX_TRY(mraw_whole(m, HEIGHT, 1, INT32_MAX, NAN, &h, d));
    PVX_TRY(mraw_colours(m, d));
    PVX_TRY(mraw_samples(m, d));
    PVX_TRY(mraw_processed(m, d));
    if (w > CAP_SIDE_MAX || h > CAP_SIDE_MAX)
        return pvx_fail(d, PVX_ERANGE, "%s: %lldx%lld pixels; at most %d each way are read",
                        m->name, (long long)w, (long long)h, CAP_SIDE_MAX);
    r->width = (int32_t)w;
    r->height = (int32_t)h;
    uint64_t bits = r->code == CAP_RAW_8 ? 8 : r->code == CAP_RAW_12 ? 12 : 16;
    r->frame_bytes = ((uint64_t)(w * h) * bits + 7) / 8;
    return PVX_OK;
}

/* ---- frames ----------------------------------------------------------------------------------- */

static pvx_err mraw_say(const struct mraw *m, int64_t total, int64_t step, double rate)
{
    struct cap_raw *r = m->r;
    char text[WORD];
    if ((uint64_t)total > r->n)
        PVX_TRY(cap_said_add(&r->said,
                             "%s: %lld of its %lld frames are not whole: it is cut; they are left "
                             "out",
                             r->path, (long long)(total - (int64_t)r->n), (long long)total));
    if (step > 1)
        PVX_TRY(cap_said_add(&r->said,
                             "%s: every %lldth of %.6g frames a second was saved: it has %.6g a "
                             "second",
                             r->path, (long long)step, rate, rate / (double)step));
    if (mraw_value(m, CORRECTED, text) && strtod(text, NULL) != 0)
        PVX_TRY(
            cap_said_add(&r->said,
                         "%s: the camera has corrected its trigger by %s frames: beside cameras "
                         "that have not, compare an event that all see",
                         r->path, text));
    if (mraw_value(m, ZERO, text) && strcasecmp(text, "Exist") != 0)
        PVX_TRY(cap_said_add(&r->said,
                             "%s: its frames count without a zero (%s): those after the trigger "
                             "may be one frame period late",
                             r->path, text));
    return PVX_OK;
}

/* Seconds: a fraction as 1/800000, or seconds, in .cih; what is below 1 in .cihx.  0: not known. */
static double mraw_exposure(const struct mraw *m)
{
    char text[WORD], *end;
    double v = mraw_value(m, SHUTTER_NS, text) ? strtod(text, NULL) * 1e-9 : 0;
    if (v > 0 || !mraw_value(m, SHUTTER, text))
        return v > 0 ? v : 0;
    v = strtod(text, &end);
    double below = *end == '/' ? strtod(end + 1, NULL) : 1;
    v = m->xml ? 1 / v : v / below;
    return isfinite(v) && v > 0 ? v : 0;
}

static pvx_err mraw_frames(const struct mraw *m, struct pvx_diag *d)
{
    struct cap_raw *r = m->r;
    int64_t total, start, step;
    double rate;
    PVX_TRY(mraw_whole(m, TOTAL, 1, INT32_MAX, NAN, &total, d));
    PVX_TRY(mraw_whole(m, START, INT32_MIN, INT32_MAX, 0, &start, d));
    PVX_TRY(mraw_whole(m, STEP, 0, INT32_MAX, 1, &step, d));
    PVX_TRY(mraw_number(m, RATE, 1e-3, 1e9, NAN, &rate, d));
    step = step > 1 ? step : 1;
    uint64_t whole = r->bytes / r->frame_bytes;
    if (r->bytes > (uint64_t)total * r->frame_bytes)
        return pvx_fail(d, PVX_ECORRUPT,
                        "%s: has %llu bytes, but %lld frames of %dx%d pixels have %llu: the header "
                        "%s does not belong to it; if it does, put the right Total Frame there",
                        r->path, (unsigned long long)r->bytes, (long long)total, r->width,
                        r->height, (unsigned long long)((uint64_t)total * r->frame_bytes), m->name);
    if (whole == 0)
        return pvx_fail(d, PVX_ECORRUPT, "%s: none of its %lld frames is whole: cut", r->path,
                        (long long)total);
    if (start + (total - 1) * step > INT32_MAX)
        return pvx_fail(d, PVX_ERANGE, "%s: its frames have too large numbers", m->name);
    r->frame = pvx_calloc((size_t)whole, sizeof *r->frame);
    if (r->frame == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for its %llu frames", r->path,
                        (unsigned long long)whole);
    for (; r->n < whole; r->n++) {
        int64_t number = start + (int64_t)r->n * step;
        double t = (double)number * (1e9 / rate);
        if (fabs(t) > (double)(INT64_MAX / 4) || 1e9 / rate * (double)step < 1)
            return pvx_fail(d, PVX_ERANGE,
                            "%s: frame %lld at %.6g a second has no time that counts", m->name,
                            (long long)number, rate);
        r->frame[r->n] = (struct cap_raw_frame){r->n * r->frame_bytes, llround(t), (int32_t)number};
    }
    r->exposure_s[0] = r->exposure_s[1] = mraw_exposure(m);
    return mraw_say(m, total, step, rate);
}

/* ---- files ------------------------------------------------------------------------------------ */

/* The header beside the film.  *out NULL: there is none of this ending. */
static pvx_err mraw_beside(const struct cap_raw *r, const char *ending, char **out)
{
    char low[8], name[8];
    snprintf(low, sizeof low, "%s", ending);
    *out = NULL;
    for (int form = 0; form < 2; form++) {
        for (size_t i = 0; i < sizeof name; i++)
            name[i] = form == 0 ? low[i] : (char)toupper((unsigned char)low[i]);
        if (asprintf(out, "%.*s%s", (int)(strrchr(r->path, '.') - r->path), r->path, name) < 0) {
            *out = NULL;
            return PVX_ENOMEM;
        }
        if (access(*out, F_OK) == 0)
            return PVX_OK;
        PVX_FREE(*out);
    }
    return PVX_OK;
}

/* The part of a .cihx that is XML. */
static bool mraw_xml(struct mraw *m)
{
    const char *from = memmem(m->text, (size_t)(m->end - m->text), "<cih>", 5), *to;
    if (from == NULL || (to = memmem(from, (size_t)(m->end - from), "</cih>", 6)) == NULL)
        return false;
    m->text = from + 5;
    m->end = to;
    m->xml = true;
    return true;
}

static pvx_err mraw_header(struct cap_raw *r, const char *name, struct pvx_diag *d)
{
    char *text;
    size_t len;
    PVX_TRY(pvx_file_read(name, HEADER_MOST, &text, &len, d));
    struct mraw m = {.r = r, .name = name, .text = text, .end = text + len};
    pvx_err e = PVX_OK;
    if (strcasecmp(strrchr(name, '.'), ".cihx") == 0 && !mraw_xml(&m))
        e = pvx_fail(d, PVX_EFORMAT, "%s: has no <cih> ... </cih>: damaged; save it again", name);
    PVX_THEN(e, mraw_pixels(&m, d));
    PVX_THEN(e, mraw_frames(&m, d));
    free(text);
    return e;
}

pvx_err cap_mraw_read(struct cap_raw *r, struct pvx_diag *d)
{
    char *text = NULL, *xml = NULL;
    PVX_TRY(mraw_beside(r, ".cihx", &xml));
    pvx_err e = mraw_beside(r, ".cih", &text);
    if (e == PVX_OK && text == NULL && xml == NULL)
        e = pvx_fail(
            d, PVX_EFORMAT,
            "%s: without the .cih or .cihx of the same name it is not known what its bytes "
            "are: put that beside it",
            r->path);
    if (e == PVX_OK && text != NULL && xml != NULL)
        e = pvx_fail(d, PVX_EINVAL, "%s and %s: one of them belongs to %s: move the other away",
                     xml, text, r->path);
    PVX_THEN(e, mraw_header(r, xml != NULL ? xml : text, d));
    free(text);
    free(xml);
    return e;
}
