/* gvcp.h - GigE Vision control protocol (UDP port 3956) on the wire.  All numbers big-endian.
 *
 *   command      u8 0x42 | u8 flags | u16 command | u16 length of payload | u16 request id (not 0)
 *   acknowledge  u16 status         | u16 command + 1 | u16 length of payload | u16 request id
 *
 *   payload of      command                                      acknowledge
 *   DISCOVERY       -                                            248 bytes: registers 0x0000..0x00f7
 *   FORCEIP         56 bytes: u16 0, MAC (6), ...                -
 *   PACKETRESEND    u16 channel | u16 block | u32 first | u32 last [| u64 block, flag 0x10]   (none)
 *   READREG         n x u32 address                              n x u32 value
 *   WRITEREG        n x (u32 address, u32 value)                 u16 0 | u16 registers written
 *   READMEM         u32 address | u16 0 | u16 bytes (x4)         u32 address | bytes
 *   WRITEMEM        u32 address | bytes (x4)                     u16 0 | u16 bytes written
 *   ACTION          u32 device key | u32 group key | u32 group mask [| u64 time, flag 0x80]   -
 * Source: GigE Vision 1.2 and 2.0 as implemented by Aravis (arvgvcpprivate.h) and Wireshark's
 * dissector; the tests speak with Aravis.
 * Threads: pure. */
#ifndef CAP_GVCP_H
#define CAP_GVCP_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CAP_GVCP_PORT     3956
#define CAP_GVCP_HEAD     8
#define CAP_GVCP_MAX      576 /* whole packet, both ways */
#define CAP_GVCP_DATA_MAX 536 /* bytes of one READMEM or WRITEMEM */
#define CAP_GVCP_CMD_KEY  0x42
#define CAP_GVCP_DISCOVER 248 /* bytes of a discovery acknowledge's payload */

enum cap_gvcp_command {
    CAP_GVCP_DISCOVERY = 0x0002,
    CAP_GVCP_FORCEIP = 0x0004,
    CAP_GVCP_RESEND = 0x0040,
    CAP_GVCP_READREG = 0x0080,
    CAP_GVCP_WRITEREG = 0x0082,
    CAP_GVCP_READMEM = 0x0084,
    CAP_GVCP_WRITEMEM = 0x0086,
    CAP_GVCP_ACTION = 0x0100
};
/* flags of a command */
#define CAP_GVCP_ACK       0x01u /* wants an acknowledge */
#define CAP_GVCP_EXTENDED  0x10u /* PACKETRESEND: 64-bit block id */
#define CAP_GVCP_SCHEDULED 0x80u /* ACTION: has a time */

enum cap_gvcp_status {
    CAP_GVCP_OK = 0x0000,
    CAP_GVCP_NOT_IMPLEMENTED = 0x8001,
    CAP_GVCP_INVALID_PARAMETER = 0x8002,
    CAP_GVCP_INVALID_ADDRESS = 0x8003,
    CAP_GVCP_WRITE_PROTECT = 0x8004,
    CAP_GVCP_BAD_ALIGNMENT = 0x8005,
    CAP_GVCP_ACCESS_DENIED = 0x8006,
    CAP_GVCP_INVALID_HEADER = 0x800e,
    CAP_GVCP_PACKET_NOT_YET = 0x8010,
    CAP_GVCP_PACKET_REMOVED = 0x8012,
    CAP_GVCP_NO_REFERENCE_TIME = 0x8013,
    CAP_GVCP_OVERFLOW = 0x8015,
    CAP_GVCP_ACTION_LATE = 0x8016,
    CAP_GVCP_SILENT = 0xffff /* not in the protocol: not a command, so no answer */
};

struct cap_gvcp_request {
    uint8_t flags;
    uint16_t command, id;
    const uint8_t *data; /* payload, borrowed */
    size_t n;            /* its bytes */
};
/* Parses a received datagram.  CAP_GVCP_OK: *out is a command whose payload has the right length (READREG,
 * WRITEREG: at least one register).  Else: the status for the answer to the sender (*out is good for that), or
 * CAP_GVCP_SILENT. */
uint16_t cap_gvcp_parse(const void *packet, size_t bytes, struct cap_gvcp_request *out);

struct cap_gvcp_resend {
    uint64_t block;
    uint32_t first, last; /* packet numbers, both included; last 0xffffff(ff): to the end */
};
void cap_gvcp_get_resend(const struct cap_gvcp_request *r, struct cap_gvcp_resend *out);

struct cap_gvcp_action {
    uint32_t device_key, group_key, group_mask;
    bool scheduled;
    uint64_t time; /* ns of the PTP clock */
};
void cap_gvcp_get_action(const struct cap_gvcp_request *r, struct cap_gvcp_action *out);

/* The client's side: writes a command to out [CAP_GVCP_MAX], and returns the bytes of the packet.  data may be NULL
 * if n = 0; n <= CAP_GVCP_MAX - CAP_GVCP_HEAD.  put_action: 20 bytes, 28 with a time. */
size_t cap_gvcp_put_command(uint8_t *out, uint8_t flags, uint16_t command, uint16_t id,
                            const void *data, size_t n);
size_t cap_gvcp_put_action(uint8_t *out, const struct cap_gvcp_action *a, bool want_ack,
                           uint16_t id);
/* The device's side: writes the head of an acknowledge with n bytes of payload.  The caller puts the payload at
 * out + CAP_GVCP_HEAD.  `command` is the request's. */
size_t cap_gvcp_put_ack(uint8_t *out, uint16_t status, uint16_t command, uint16_t id, size_t n);

struct cap_gvcp_answer {
    uint16_t status, command, id; /* command of the acknowledge: the request's + 1 */
    const uint8_t *data;
    size_t n;
};
/* False: not an acknowledge, or shorter than its head says. */
bool cap_gvcp_parse_ack(const void *packet, size_t bytes, struct cap_gvcp_answer *out);
#endif
