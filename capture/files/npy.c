#include "capture/files/npy.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/mem.h"
#include "capture/files/imgio.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
               "files are little-endian and mapped as is");

/* ---- the header: a Python dictionary of three known keys ---------------------------------------- */

struct cursor {
    const char *p, *end;
};

static void skip_space(struct cursor *c)
{
    while (c->p < c->end && (*c->p == ' ' || *c->p == '\t' || *c->p == '\n'))
        c->p++;
}

static bool npy_accept(struct cursor *c, char ch)
{
    skip_space(c);
    if (c->p == c->end || *c->p != ch)
        return false;
    c->p++;
    return true;
}

/* 'text' or "text" into out.  It is never cut short: false if it does not fit. */
static bool npy_quoted(struct cursor *c, char *out, size_t size)
{
    skip_space(c);
    if (c->p == c->end || (*c->p != '\'' && *c->p != '"'))
        return false;
    char quote = *c->p++;
    size_t n = 0;
    while (c->p < c->end && *c->p != quote) {
        if (n + 1 >= size)
            return false;
        out[n++] = *c->p++;
    }
    out[n] = '\0';
    return npy_accept(c, quote);
}

static bool npy_word(struct cursor *c, const char *w)
{
    skip_space(c);
    size_t n = strlen(w);
    if ((size_t)(c->end - c->p) < n || memcmp(c->p, w, n) != 0)
        return false;
    c->p += n;
    return true;
}

static bool npy_number(struct cursor *c, size_t *out)
{
    skip_space(c);
    const char *start = c->p;
    size_t v = 0;
    while (c->p < c->end && *c->p >= '0' && *c->p <= '9') {
        if (__builtin_mul_overflow(v, (size_t)10, &v) ||
            __builtin_add_overflow(v, (size_t)(*c->p - '0'), &v))
            return false;
        c->p++;
    }
    *out = v;
    return c->p > start;
}

/* (a,) or (a, b, ...); ndim also counts beyond 4, so that the message can give it. */
static bool shape(struct cursor *c, struct cap_npy *a)
{
    if (!npy_accept(c, '('))
        return false;
    while (!npy_accept(c, ')')) {
        size_t n;
        if (!npy_number(c, &n) || a->ndim >= 64)
            return false;
        if (a->ndim < 4)
            a->shape[a->ndim] = n;
        a->ndim++;
        if (!npy_accept(c, ',')) {
            if (!npy_accept(c, ')'))
                return false;
            break;
        }
    }
    return true;
}

static bool dictionary(struct cursor *c, char *descr, size_t size, bool *fortran, struct cap_npy *a)
{
    unsigned seen = 0;
    if (!npy_accept(c, '{'))
        return false;
    while (!npy_accept(c, '}')) {
        char key[24];
        unsigned which = 0;
        if (!npy_quoted(c, key, sizeof key) || !npy_accept(c, ':'))
            return false;
        if (strcmp(key, "descr") == 0 && npy_quoted(c, descr, size)) {
            which = 1;
        } else if (strcmp(key, "fortran_order") == 0) {
            *fortran = npy_word(c, "True");
            if (*fortran || npy_word(c, "False"))
                which = 2;
        } else if (strcmp(key, "shape") == 0 && shape(c, a)) {
            which = 4;
        }
        if (which == 0 || (seen & which) != 0)
            return false;
        seen |= which;
        if (!npy_accept(c, ',')) {
            if (!npy_accept(c, '}'))
                return false;
            break;
        }
    }
    skip_space(c);
    return seen == 7 && c->p == c->end;
}

static bool element_type(const char *descr, struct cap_npy *a)
{
    static const struct {
        const char *descr;
        enum cap_npy_type type;
        size_t item;
    } known[] = {{"<f2", CAP_NPY_F2, 2}, {"<f4", CAP_NPY_F4, 4}, {"<f8", CAP_NPY_F8, 8},
                 {"|u1", CAP_NPY_U1, 1}, {"<u1", CAP_NPY_U1, 1}, {"<u2", CAP_NPY_U2, 2}};
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (strcmp(known[i].descr, descr) == 0) {
            a->type = known[i].type;
            a->item = known[i].item;
            return true;
        }
    return false;
}

pvx_err cap_npy_header(const void *bytes, size_t len, const char *name, struct cap_npy *out,
                       struct pvx_diag *d)
{
    const uint8_t *b = bytes;
    if (len < 10 || memcmp(b, "\x93NUMPY", 6) != 0)
        return pvx_fail(d, PVX_EFORMAT, "%s: not a .npy file", name);
    if (b[6] < 1 || b[6] > 3)
        return pvx_fail(d, PVX_EVERSION, "%s: .npy version %u, this program reads 1 to 3", name,
                        b[6]);
    size_t start = b[6] == 1 ? 10 : 12, header = (size_t)b[8] | (size_t)b[9] << 8;
    if (start == 12 && len >= 12)
        header |= (size_t)b[10] << 16 | (size_t)b[11] << 24;
    if (len < start || header > len - start)
        return pvx_fail(d, PVX_EFORMAT, "%s: ends inside the .npy header", name);
    struct cursor c = {(const char *)b + start, (const char *)b + start + header};
    struct cap_npy a = {.shape = {1, 1, 1, 1}};
    char descr[16] = "";
    bool fortran = false;
    if (!dictionary(&c, descr, sizeof descr, &fortran, &a))
        return pvx_fail(d, PVX_EFORMAT, "%s: malformed .npy header (or an array of records)", name);
    if (!element_type(descr, &a))
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: elements of type '%.15s'; readable are <f2 <f4 <f8 |u1 <u2", name,
                        descr);
    if (a.ndim < 1 || a.ndim > 4)
        return pvx_fail(d, PVX_EUNSUP, "%s: %d dimensions; 1 to 4 are readable", name, a.ndim);
    if (fortran && a.ndim > 1)
        return pvx_fail(d, PVX_EUNSUP, "%s: Fortran order; save with numpy.ascontiguousarray",
                        name);
    size_t need = a.item;
    a.count = 1;
    for (int i = 0; i < a.ndim; i++) {
        if (a.shape[i] == 0)
            return pvx_fail(d, PVX_EFORMAT, "%s: empty array", name);
        if (__builtin_mul_overflow(need, a.shape[i], &need))
            return pvx_fail(d, PVX_EFORMAT, "%s: shape does not fit into memory", name);
        a.count *= a.shape[i];
    }
    if (need != len - start - header)
        return pvx_fail(d, PVX_EFORMAT, "%s: shape and type need %zu bytes of data, file has %zu",
                        name, need, len - start - header);
    a.data = b + start + header;
    *out = a;
    return PVX_OK;
}

/* ---- elements ----------------------------------------------------------------------------------- */

float cap_npy_half(uint16_t h)
{
    int exponent = h >> 10 & 31;
    float m = (float)(h & 1023), v;
    if (exponent == 31)
        v = m > 0 ? NAN : INFINITY;
    else if (exponent == 0)
        v = m * 0x1p-24f;
    else
        v = ldexpf(m + 1024, exponent - 25);
    return h & 0x8000 ? -v : v;
}

void cap_npy_floats(const struct cap_npy *a, float *out)
{
    const char *p = a->data;
    if (a->type == CAP_NPY_F4) {
        memcpy(out, p, a->count * sizeof *out);
        return;
    }
    for (size_t i = 0; i < a->count; i++, p += a->item) {
        uint16_t u;
        double f;
        switch (a->type) {
        case CAP_NPY_F8:
            memcpy(&f, p, sizeof f);
            out[i] = (float)f;
            break;
        case CAP_NPY_U1: out[i] = (float)*(const uint8_t *)p; break;
        default:
            memcpy(&u, p, sizeof u);
            out[i] = a->type == CAP_NPY_U2 ? (float)u : cap_npy_half(u);
        }
    }
}

pvx_err cap_npy_parse(const void *bytes, size_t len, const char *name, float **data,
                      size_t shape_out[4], int *ndim, struct pvx_diag *d)
{
    struct cap_npy a;
    *data = NULL;
    PVX_TRY(cap_npy_header(bytes, len, name, &a, d));
    float *out = pvx_calloc(a.count, sizeof *out);
    if (out == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for %zu values", name, a.count);
    cap_npy_floats(&a, out);
    memcpy(shape_out, a.shape, sizeof a.shape);
    *ndim = a.ndim;
    *data = out;
    return PVX_OK;
}

pvx_err cap_npy_load(const char *path, float **data, size_t shape_out[4], int *ndim,
                     struct pvx_diag *d)
{
    char *bytes;
    size_t len;
    *data = NULL;
    PVX_TRY(pvx_file_read(path, (size_t)1 << 36, &bytes, &len, d));
    pvx_err e = cap_npy_parse(bytes, len, path, data, shape_out, ndim, d);
    free(bytes);
    return e;
}

pvx_err cap_npy_save(const char *path, const float *data, const size_t *shape_in, int ndim,
                     struct pvx_diag *d)
{
    if (ndim < 1 || ndim > 4)
        return pvx_fail(d, PVX_EINVAL, "%s: an array has 1 to 4 dimensions", path);
    size_t count = 1, bytes;
    char dims[4 * 24] = "";
    for (int i = 0; i < ndim; i++) {
        size_t at = strlen(dims);
        const char *comma = i + 1 < ndim ? ", " : ndim == 1 ? "," : "";
        snprintf(dims + at, sizeof dims - at, "%zu%s", shape_in[i], comma);
        if (__builtin_mul_overflow(count, shape_in[i], &count))
            return pvx_fail(d, PVX_EINVAL, "%s: array too large", path);
    }
    char head[256];
    int n = snprintf(head, sizeof head, "{'descr': '<f4', 'fortran_order': False, 'shape': (%s), }",
                     dims);
    size_t total = (10 + (size_t)n + 1 + 63) / 64 * 64; /* data starts at a multiple of 64 */
    if (__builtin_mul_overflow(count, sizeof *data, &bytes) ||
        __builtin_add_overflow(bytes, total, &bytes))
        return pvx_fail(d, PVX_EINVAL, "%s: array too large", path);
    char *file = malloc(bytes);
    if (file == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for %zu bytes", path, bytes);
    memset(file, ' ', total);
    memcpy(file, "\x93NUMPY\x01\x00", 8);
    file[8] = (char)((total - 10) & 255);
    file[9] = (char)((total - 10) >> 8);
    memcpy(file + 10, head, (size_t)n);
    file[total - 1] = '\n';
    memcpy(file + total, data, count * sizeof *data);
    pvx_err e = pvx_file_write(path, file, bytes, d);
    free(file);
    return e;
}
