/* gvcam_feature.h - the features of the simulated camera: one table is the registers and the GenICam
 * XML (private to gvcam*.c).
 * A feature without an address of its own is the 32-bit register 0xa000 + 4 * its number; floats are
 * IEEE single.  Several features may share a register (GevIEEE1588 is PtpEnable). */
#ifndef CAP_GVCAM_FEATURE_H
#define CAP_GVCAM_FEATURE_H
#include <stddef.h>
#include <stdint.h>

enum gvcam_feature {
    GVF_DEVICE_RESET,
    GVF_TEMPERATURE_SELECTOR,
    GVF_TEMPERATURE,
    GVF_TIMESTAMP_LATCH,
    GVF_TIMESTAMP_RESET,
    GVF_TIMESTAMP_VALUE, /* 64 bits */
    GVF_TIMESTAMP_VALUE_LOW,
    GVF_SENSOR_WIDTH,
    GVF_SENSOR_HEIGHT,
    GVF_WIDTH_MAX,
    GVF_HEIGHT_MAX,
    GVF_WIDTH,
    GVF_HEIGHT,
    GVF_OFFSET_X,
    GVF_OFFSET_Y,
    GVF_PIXEL_FORMAT,
    GVF_ACQ_MODE,
    GVF_ACQ_START,
    GVF_ACQ_STOP,
    GVF_ACQ_COUNT,
    GVF_RATE_ENABLE,
    GVF_RATE,
    GVF_RESULTING_RATE,
    GVF_TRIGGER_SELECTOR,
    GVF_TRIGGER_MODE,
    GVF_TRIGGER_SOURCE,
    GVF_TRIGGER_ACTIVATION,
    GVF_TRIGGER_DELAY,
    GVF_TRIGGER_SOFTWARE,
    GVF_EXPOSURE_MODE,
    GVF_EXPOSURE,
    GVF_GAIN,
    GVF_BLACK_LEVEL,
    GVF_LINE_SELECTOR,
    GVF_LINE_MODE,
    GVF_LINE_STATUS,
    GVF_LINE_STATUS_ALL,
    GVF_ACTION_SELECTOR,
    GVF_ACTION_DEVICE_KEY,
    GVF_ACTION_GROUP_KEY,
    GVF_ACTION_GROUP_MASK,
    GVF_PTP_ENABLE,
    GVF_PTP_LATCH,
    GVF_PTP_STATUS,
    GVF_PTP_OFFSET, /* 64 bits */
    GVF_PTP_OFFSET_LOW,
    GVF_CHUNK_MODE,
    GVF_CHUNK_SELECTOR,
    GVF_CHUNK_ENABLE,
    GVF_USER_SET_SELECTOR,
    GVF_USER_SET_LOAD,
    GVF_USER_SET_SAVE,
    GVF_USER_SET_DEFAULT,
    GVF_WIDE_IDS,
    GVF_CHUNK_LAYOUT, /* which payload type chunks come in */
    GVF_PAYLOAD_SIZE,
    GVF_STREAM_SELECTOR,
    GVF_CHUNKS_ON, /* bits, behind ChunkEnable; not in the XML */
    GVF_HEARTBEAT,
    GVF_SCP_PORT,
    GVF_SCPS,
    GVF_SCPD,
    GVF_SCDA,
    GVCAM_N_FEATURES
};
#define GVF_ADDRESS(f) (0xa000u + 4u * (uint32_t)(f))

/* Bootstrap registers of GigE Vision. */
enum gvcam_bootstrap {
    GVB_VERSION = 0x0000,
    GVB_MODE = 0x0004,
    GVB_MAC_HIGH = 0x0008,
    GVB_MAC_LOW = 0x000c,
    GVB_IP_SUPPORTED = 0x0010,
    GVB_IP_CURRENT = 0x0014,
    GVB_IP = 0x0024,
    GVB_MASK = 0x0034,
    GVB_GATEWAY = 0x0044,
    GVB_VENDOR = 0x0048,
    GVB_MODEL = 0x0068,
    GVB_DEVICE_VERSION = 0x0088,
    GVB_INFO = 0x00a8,
    GVB_SERIAL = 0x00d8,
    GVB_USER_NAME = 0x00e8,
    GVB_BOOT_END = 0x00f8,
    GVB_URL_0 = 0x0200,
    GVB_URL_1 = 0x0400,
    GVB_URL_END = 0x0600,
    GVB_INTERFACES = 0x0600,
    GVB_LINK_SPEED = 0x0670,
    GVB_MESSAGE_CHANNELS = 0x0900,
    GVB_STREAM_CHANNELS = 0x0904,
    GVB_ACTIONS = 0x0908,
    GVB_ACTION_DEVICE_KEY = 0x090c,
    GVB_ACTIVE_LINKS = 0x0910,
    GVB_GVSP_CAPABILITY = 0x092c,
    GVB_MESSAGE_CAPABILITY = 0x0930,
    GVB_GVCP_CAPABILITY = 0x0934,
    GVB_HEARTBEAT = 0x0938,
    GVB_TICKS_HIGH = 0x093c,
    GVB_TICKS_LOW = 0x0940,
    GVB_TIMESTAMP_CONTROL = 0x0944,
    GVB_TIMESTAMP_HIGH = 0x0948,
    GVB_TIMESTAMP_LOW = 0x094c,
    GVB_GVCP_CONFIG = 0x0954,
    GVB_PENDING_TIMEOUT = 0x0958,
    GVB_CCP = 0x0a00,
    GVB_PRIMARY_PORT = 0x0a04,
    GVB_PRIMARY_IP = 0x0a14,
    GVB_SCP = 0x0d00,
    GVB_SCPS = 0x0d04,
    GVB_SCPD = 0x0d08,
    GVB_SCDA = 0x0d18,
    GVB_SCSP = 0x0d1c,
    GVB_ACTION_GROUP_KEY = 0x9800,
    GVB_ACTION_GROUP_MASK = 0x9804,
    GVB_XML = 0x100000
};
#define GVCAM_CAN_CONCATENATE (1u << 0)
#define GVCAM_CAN_WRITEMEM    (1u << 1)
#define GVCAM_CAN_RESEND      (1u << 2)
#define GVCAM_CAN_ACTION      (1u << 6)
#define GVCAM_CAN_SCHEDULE    (1u << 17)
#define GVCAM_CAN_PTP         (1u << 19)
#define GVCAM_CAN_SERIAL      (1u << 30)
#define GVCAM_CAN_NAME        (1u << 31)
#define GVCAM_CCP_EXCLUSIVE   1u
#define GVCAM_CCP_CONTROL     2u
#define GVCAM_SCPS_FIRE       (1u << 31)
#define GVCAM_SCPS_DF         (1u << 30)

enum gvcam_kind {
    GVK_INT,
    GVK_INT64,
    GVK_FLOAT,
    GVK_BOOL,
    GVK_ENUM,
    GVK_FORMAT, /* enumeration of the pixel formats that the camera offers */
    GVK_COMMAND,
    GVK_STRING,
    GVK_BIT,     /* command: one bit of a register */
    GVK_BIT_BOOL /* boolean: likewise */
};
enum gvcam_access {
    GVA_R = 1,
    GVA_W = 2,
    GVA_RW = 3,
    GVA_LOCKED = 7 /* RW, not while streaming */
};

struct gvcam_entry {
    const char *name;
    uint32_t value;
};
struct gvcam_feature_def {
    const char *name, *category;
    enum gvcam_kind kind;
    uint32_t address; /* 0 = GVF_ADDRESS of its number */
    enum gvcam_access access;
    double value, min, max, inc;     /* value: after power-up; inc 0 = 1 */
    const char *unit, *max_of;       /* max_of: feature that gives the limit instead */
    const char *selector;            /* that this one is selected by */
    const struct gvcam_entry *entry; /* ends with a NULL name */
    uint32_t bytes;                  /* strings */
    int bit;                         /* GVK_BIT*, from the most significant */
    const char *tip;
};
/* The first GVCAM_N_FEATURES are those of enum gvcam_feature; more follow, which are other names of
 * registers.  NULL name: a register without a feature.  Ends with a NULL category. */
extern const struct gvcam_feature_def gvcam_features[];

/* Chunks: bit in GVF_CHUNKS_ON = index; what ChunkSelector selects. */
enum gvcam_chunk {
    GVC_IMAGE,
    GVC_TIMESTAMP,
    GVC_EXPOSURE,
    GVC_FRAME_ID,
    GVC_FRAME_COUNTER,
    GVC_GAIN,
    GVC_LINES,
    GVCAM_N_CHUNKS
};
struct gvcam_chunk_def {
    const char *selector, *feature; /* "Timestamp", "ChunkTimestamp" */
    uint32_t id, bytes;
    enum gvcam_kind kind;
};
extern const struct gvcam_chunk_def gvcam_chunk_defs[GVCAM_N_CHUNKS];
#endif
