/* gvsp.h - GigE Vision stream protocol on the wire.  All numbers big-endian.
 *
 * One block = one frame: leader (packet 0), payload (1..n), trailer (n + 1).
 *   head, 8 bytes   u16 status | u16 block | u8 content | u24 packet
 *   head, 20 bytes  u16 status | u16 flags | u8 0x80 + content | u24 0 | u64 block | u32 packet
 *   leader          u16 0 | u16 payload type | u64 stamp [ticks] | u32 pixel format (PFNC)
 *                   | u32 width | u32 height | u32 x | u32 y | u16 x padding | u16 y padding
 *   trailer         u16 0 | u16 payload type | u32 rows;
 *                   with chunks after it u32 bytes of chunk data | u32 chunk layout id
 * Chunk data follow the image.  Each chunk is its bytes, then u32 id | u32 bytes, so it is read from the end.
 * A block id is never 0: 65535 is followed by 1.
 * Source: GigE Vision 1.2 and 2.0 as implemented by Aravis (arvgvspprivate.h).
 * Threads: pure. */
#ifndef CAP_GVSP_H
#define CAP_GVSP_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CAP_GVSP_UDP_IP    28 /* bytes that the packet size counts before GVSP's own head */
#define CAP_GVSP_HEAD      8
#define CAP_GVSP_HEAD_WIDE 20 /* 64-bit block ids */
#define CAP_GVSP_LEADER    36

enum cap_gvsp_content { CAP_GVSP_LEAD = 1, CAP_GVSP_TRAIL = 2, CAP_GVSP_DATA = 3 };
enum cap_gvsp_payload {
    CAP_GVSP_IMAGE = 0x0001,
    CAP_GVSP_EXTENDED_CHUNK = 0x0005, /* 1.2: image, then chunks */
    CAP_GVSP_IMAGE_CHUNK = 0x4001     /* 2.0: the same */
};
#define CAP_GVSP_RESENT 0x0100 /* status of a packet that was asked for again */

struct cap_gvsp_head {
    uint16_t status;
    bool wide;
    uint8_t content;
    uint64_t block;
    uint32_t packet;
};
size_t cap_gvsp_put_head(uint8_t *out, const struct cap_gvsp_head *h); /* bytes written */

struct cap_gvsp_leader {
    uint16_t payload;
    uint64_t ticks;
    uint32_t pixel_format, width, height, x, y;
};
size_t cap_gvsp_put_leader(uint8_t *out, const struct cap_gvsp_leader *l); /* CAP_GVSP_LEADER */
/* chunk_bytes: bytes of the chunk data, with the image's own chunk; only for a chunk payload. */
size_t cap_gvsp_put_trailer(uint8_t *out, uint16_t payload, uint32_t rows, uint32_t chunk_bytes);

/* Next block id. */
uint64_t cap_gvsp_next(uint64_t block, bool wide);
#endif
