/* wire.h - a cursor over little-endian bytes, and the sizes of the layout (private to proto).
 *
 * Writing relies on the caller for room (the encoder's buffer is sized for the largest message).  Reading relies
 * on nothing: past the end it gives zeros and sets `bad`. */
#ifndef PVP_WIRE_H
#define PVP_WIRE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define WIRE_HEADER     48u
#define WIRE_START      152u
#define WIRE_VOLUME     248u /* the description, before brick ids and payload */
#define WIRE_END        64u
#define WIRE_RIG        16u  /* before the text */
#define WIRE_PREVIEW    32u  /* before the cameras */
#define WIRE_CAMERA     104u /* of a preview */
#define WIRE_CELLS      512u /* voxels of a brick */
#define WIRE_FLAGS_MUST 0xffff0000u

static inline void wire_store16(uint8_t *p, uint32_t v)
{
    p[0] = (uint8_t)v;
    p[1] = (uint8_t)(v >> 8);
}
static inline void wire_store32(uint8_t *p, uint32_t v)
{
    p[0] = (uint8_t)v;
    p[1] = (uint8_t)(v >> 8);
    p[2] = (uint8_t)(v >> 16);
    p[3] = (uint8_t)(v >> 24);
}
static inline void wire_store64(uint8_t *p, uint64_t v)
{
    wire_store32(p, (uint32_t)v);
    wire_store32(p + 4, (uint32_t)(v >> 32));
}
static inline uint32_t wire_load16(const uint8_t *p)
{
    return (uint32_t)p[0] | (uint32_t)p[1] << 8;
}
static inline uint32_t wire_load32(const uint8_t *p)
{
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

/* Writes the fields of a message, or reads them.  One function defines their order for both. */
struct wire {
    uint8_t *out;
    const uint8_t *in; /* [len]; NULL = writes */
    size_t len, at;
    bool bad;
};
/* The next n bytes of a message that is read, NULL past its end. */
static inline const uint8_t *wire_read(struct wire *w, size_t n)
{
    if (w->bad || n > w->len - w->at) {
        w->bad = true;
        return NULL;
    }
    w->at += n;
    return w->in + w->at - n;
}
/* Room for n bytes of a message that is written. */
static inline uint8_t *wire_write(struct wire *w, size_t n)
{
    w->at += n;
    return w->out + w->at - n;
}
/* A number of n bytes, the lowest first. */
static inline void wire_uint(struct wire *w, uint64_t *v, size_t n)
{
    uint8_t *to = w->in == NULL ? wire_write(w, n) : NULL;
    const uint8_t *from = w->in == NULL ? NULL : wire_read(w, n);
    for (size_t i = 0; to != NULL && i < n; i++)
        to[i] = (uint8_t)(*v >> 8 * i);
    if (to == NULL)
        *v = 0;
    for (size_t i = 0; from != NULL && i < n; i++)
        *v |= (uint64_t)from[i] << 8 * i;
}
static inline void wire_u16(struct wire *w, uint32_t *v)
{
    uint64_t u = *v;
    wire_uint(w, &u, 2);
    *v = (uint32_t)u;
}
static inline void wire_u32(struct wire *w, uint32_t *v)
{
    uint64_t u = *v;
    wire_uint(w, &u, 4);
    *v = (uint32_t)u;
}
static inline void wire_u64(struct wire *w, uint64_t *v)
{
    wire_uint(w, v, 8);
}
static inline void wire_i64(struct wire *w, int64_t *v)
{
    uint64_t u = (uint64_t)*v;
    wire_u64(w, &u);
    *v = (int64_t)u;
}
static inline void wire_f64(struct wire *w, double *v)
{
    uint64_t u;
    memcpy(&u, v, sizeof u);
    wire_u64(w, &u);
    memcpy(v, &u, sizeof u);
}
/* `size` bytes: the text, then zeros, at least one.  When read, the text must end inside and have no control
 * characters. */
static inline void wire_text(struct wire *w, char *s, size_t size)
{
    if (w->in == NULL) {
        uint8_t *to = wire_write(w, size);
        size_t n = strnlen(s, size - 1);
        memcpy(to, s, n);
        memset(to + n, 0, size - n);
        return;
    }
    const uint8_t *p = wire_read(w, size);
    s[0] = '\0';
    if (p == NULL)
        return;
    size_t n = strnlen((const char *)p, size);
    bool ok = n < size;
    for (size_t i = 0; i < n; i++)
        ok = ok && p[i] >= 0x20 && p[i] != 0x7f;
    if (ok)
        memcpy(s, p, n + 1);
    else
        w->bad = true;
}
#endif
