/* be.h - numbers in network byte order, at any alignment. */
#ifndef CAP_BE_H
#define CAP_BE_H
#include <stdint.h>

static inline void cap_put16(uint8_t *p, uint16_t v)
{
    p[0] = (uint8_t)(v >> 8);
    p[1] = (uint8_t)v;
}
static inline void cap_put32(uint8_t *p, uint32_t v)
{
    cap_put16(p, (uint16_t)(v >> 16));
    cap_put16(p + 2, (uint16_t)v);
}
static inline void cap_put64(uint8_t *p, uint64_t v)
{
    cap_put32(p, (uint32_t)(v >> 32));
    cap_put32(p + 4, (uint32_t)v);
}
static inline uint16_t cap_get16(const uint8_t *p)
{
    return (uint16_t)(p[0] << 8 | p[1]);
}
static inline uint32_t cap_get32(const uint8_t *p)
{
    return (uint32_t)cap_get16(p) << 16 | cap_get16(p + 2);
}
static inline uint64_t cap_get64(const uint8_t *p)
{
    return (uint64_t)cap_get32(p) << 32 | cap_get32(p + 4);
}
#endif
