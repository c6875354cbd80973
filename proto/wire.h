/* wire.h - cursors over little-endian bytes, and the numbers of the layout (private to proto).
 *
 * The writer trusts its caller to have made room (the encoder's buffer is sized for the largest
 * message).  The reader trusts nothing: past the end it gives zeros and remembers it in `bad`. */
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
static inline uint64_t wire_load64(const uint8_t *p)
{
    return (uint64_t)wire_load32(p) | (uint64_t)wire_load32(p + 4) << 32;
}

struct wire_out {
    uint8_t *p;
    size_t at;
};
static inline void put_u16(struct wire_out *o, uint32_t v)
{
    wire_store16(o->p + o->at, v);
    o->at += 2;
}
static inline void put_u32(struct wire_out *o, uint32_t v)
{
    wire_store32(o->p + o->at, v);
    o->at += 4;
}
static inline void put_u64(struct wire_out *o, uint64_t v)
{
    wire_store64(o->p + o->at, v);
    o->at += 8;
}
static inline void put_i64(struct wire_out *o, int64_t v)
{
    put_u64(o, (uint64_t)v);
}
static inline void put_f64(struct wire_out *o, double v)
{
    uint64_t u;
    memcpy(&u, &v, sizeof u);
    put_u64(o, u);
}
/* `size` bytes: the text, then zeros, at least one. */
static inline void put_text(struct wire_out *o, const char *s, size_t size)
{
    size_t n = strnlen(s, size - 1);
    memcpy(o->p + o->at, s, n);
    memset(o->p + o->at + n, 0, size - n);
    o->at += size;
}

struct wire_in {
    const uint8_t *p;
    size_t len, at;
    bool bad;
};
static inline const uint8_t *get_bytes(struct wire_in *in, size_t n)
{
    if (in->bad || n > in->len - in->at) {
        in->bad = true;
        return NULL;
    }
    const uint8_t *p = in->p + in->at;
    in->at += n;
    return p;
}
static inline uint32_t get_u16(struct wire_in *in)
{
    const uint8_t *p = get_bytes(in, 2);
    return p != NULL ? wire_load16(p) : 0;
}
static inline uint32_t get_u32(struct wire_in *in)
{
    const uint8_t *p = get_bytes(in, 4);
    return p != NULL ? wire_load32(p) : 0;
}
static inline uint64_t get_u64(struct wire_in *in)
{
    const uint8_t *p = get_bytes(in, 8);
    return p != NULL ? wire_load64(p) : 0;
}
static inline int64_t get_i64(struct wire_in *in)
{
    return (int64_t)get_u64(in);
}
static inline double get_f64(struct wire_in *in)
{
    uint64_t u = get_u64(in);
    double v;
    memcpy(&v, &u, sizeof v);
    return v;
}
/* A text field: it ends inside, and nothing in it can move a terminal's cursor. */
static inline void get_text(struct wire_in *in, char *s, size_t size)
{
    const uint8_t *p = get_bytes(in, size);
    s[0] = '\0';
    if (p == NULL)
        return;
    size_t n = strnlen((const char *)p, size);
    bool ok = n < size;
    for (size_t i = 0; i < n; i++)
        ok = ok && p[i] >= 0x20 && p[i] != 0x7f;
    if (!ok) {
        in->bad = true;
        return;
    }
    memcpy(s, p, n + 1);
}
#endif
