/* feature.h - the features of the simulated camera.  One table defines the registers and the GenICam XML
 * (private to gvcam*.c).
 * A feature without an address of its own is the 32-bit register 0xa000 + 4 * its number.  Floats are
 * IEEE single.  Several features may share a register (GevIEEE1588 is PtpEnable). */
#ifndef CAP_GVCAM_FEATURE_H
#define CAP_GVCAM_FEATURE_H
#include <stddef.h>
#include <stdint.h>

/* Each feature once: its number, then the members of its struct gvcam_feature_def. */
/* clang-format off */
#define GVCAM_FEATURES(F) \
    F(GVF_DEVICE_RESET, "DeviceReset", DEV, GVK_COMMAND, .access = GVA_W, .tip = "Reboot") \
    F(GVF_TEMPERATURE_SELECTOR, "DeviceTemperatureSelector", DEV, GVK_ENUM, .access = GVA_RW, .entry = e_temperature) \
    F(GVF_TEMPERATURE, "DeviceTemperature", DEV, GVK_FLOAT, .access = GVA_R, .min = -40, .max = 100, .unit = "C", .selector = "DeviceTemperatureSelector") \
    F(GVF_TIMESTAMP_LATCH, "TimestampLatch", DEV, GVK_COMMAND, .access = GVA_W) \
    F(GVF_TIMESTAMP_RESET, "TimestampReset", DEV, GVK_COMMAND, .access = GVA_W, .tip = "Device clock to 0; not while PTP is on") \
    F(GVF_TIMESTAMP_VALUE, "TimestampLatchValue", DEV, GVK_INT64, .access = GVA_R, .tip = "Ticks at the last TimestampLatch") /* 64 bits */ \
    F(GVF_TIMESTAMP_VALUE_LOW, NULL, DEV, GVK_INT, .access = GVA_R) \
    F(GVF_SENSOR_WIDTH, "SensorWidth", IMG, GVK_INT, .access = GVA_R, .max = 16384) \
    F(GVF_SENSOR_HEIGHT, "SensorHeight", IMG, GVK_INT, .access = GVA_R, .max = 16384) \
    F(GVF_WIDTH_MAX, "WidthMax", IMG, GVK_INT, .access = GVA_R, .max = 16384) \
    F(GVF_HEIGHT_MAX, "HeightMax", IMG, GVK_INT, .access = GVA_R, .max = 16384) \
    F(GVF_WIDTH, "Width", IMG, GVK_INT, .access = GVA_LOCKED, .min = 1, .max_of = "WidthMax") \
    F(GVF_HEIGHT, "Height", IMG, GVK_INT, .access = GVA_LOCKED, .min = 1, .max_of = "HeightMax") \
    F(GVF_OFFSET_X, "OffsetX", IMG, GVK_INT, .access = GVA_LOCKED, .inc = 2, .max_of = "SensorWidth") \
    F(GVF_OFFSET_Y, "OffsetY", IMG, GVK_INT, .access = GVA_LOCKED, .inc = 2, .max_of = "SensorHeight") \
    F(GVF_PIXEL_FORMAT, "PixelFormat", IMG, GVK_FORMAT, .access = GVA_LOCKED) \
    F(GVF_ACQ_MODE, "AcquisitionMode", ACQ, GVK_ENUM, .access = GVA_LOCKED, .entry = e_mode) \
    F(GVF_ACQ_START, "AcquisitionStart", ACQ, GVK_COMMAND, .access = GVA_W) \
    F(GVF_ACQ_STOP, "AcquisitionStop", ACQ, GVK_COMMAND, .access = GVA_W) \
    F(GVF_ACQ_COUNT, "AcquisitionFrameCount", ACQ, GVK_INT, .access = GVA_LOCKED, .value = 1, .min = 1, .max = 65535) \
    F(GVF_RATE_ENABLE, "AcquisitionFrameRateEnable", ACQ, GVK_BOOL, .access = GVA_RW, .value = 1) \
    F(GVF_RATE, "AcquisitionFrameRate", ACQ, GVK_FLOAT, .access = GVA_RW, .min = 0.1, .max = 1000, .unit = "Hz") \
    F(GVF_RESULTING_RATE, "AcquisitionResultingFrameRate", ACQ, GVK_FLOAT, .access = GVA_R, .max = 1000, .unit = "Hz") \
    F(GVF_TRIGGER_SELECTOR, "TriggerSelector", ACQ, GVK_ENUM, .access = GVA_RW, .entry = e_frame_start) \
    F(GVF_TRIGGER_MODE, "TriggerMode", ACQ, GVK_ENUM, .access = GVA_RW, .entry = e_on, .selector = "TriggerSelector") \
    F(GVF_TRIGGER_SOURCE, "TriggerSource", ACQ, GVK_ENUM, .access = GVA_RW, .entry = e_source, .selector = "TriggerSelector") \
    F(GVF_TRIGGER_ACTIVATION, "TriggerActivation", ACQ, GVK_ENUM, .access = GVA_RW, .entry = e_edge, .selector = "TriggerSelector") \
    F(GVF_TRIGGER_DELAY, "TriggerDelay", ACQ, GVK_FLOAT, .access = GVA_RW, .max = 1e6, .unit = "us", .selector = "TriggerSelector") \
    F(GVF_TRIGGER_SOFTWARE, "TriggerSoftware", ACQ, GVK_COMMAND, .access = GVA_W, .selector = "TriggerSelector") \
    F(GVF_EXPOSURE_MODE, "ExposureMode", ACQ, GVK_ENUM, .access = GVA_RW, .entry = e_timed) \
    F(GVF_EXPOSURE, "ExposureTime", ACQ, GVK_FLOAT, .access = GVA_RW, .value = 1000, .min = 10, .max = 1e6, .unit = "us") \
    F(GVF_GAIN, "Gain", ANA, GVK_FLOAT, .access = GVA_RW, .max = 24, .unit = "dB") \
    F(GVF_BLACK_LEVEL, "BlackLevel", ANA, GVK_FLOAT, .access = GVA_RW, .max = 255) \
    F(GVF_LINE_SELECTOR, "LineSelector", DIO, GVK_ENUM, .access = GVA_RW, .entry = e_line) \
    F(GVF_LINE_MODE, "LineMode", DIO, GVK_ENUM, .access = GVA_R, .entry = e_input, .selector = "LineSelector") \
    F(GVF_LINE_STATUS, "LineStatus", DIO, GVK_BOOL, .access = GVA_R, .selector = "LineSelector") \
    F(GVF_LINE_STATUS_ALL, "LineStatusAll", DIO, GVK_INT, .access = GVA_R, .max = 4294967295.0) \
    F(GVF_ACTION_SELECTOR, "ActionSelector", ACT, GVK_INT, .access = GVA_RW, .value = 1, .min = 1, .max = 1) \
    F(GVF_ACTION_DEVICE_KEY, "ActionDeviceKey", ACT, GVK_INT, .address = GVB_ACTION_DEVICE_KEY, .access = GVA_W, .max = 4294967295.0) \
    F(GVF_ACTION_GROUP_KEY, "ActionGroupKey", ACT, GVK_INT, .address = GVB_ACTION_GROUP_KEY, .access = GVA_RW, .max = 4294967295.0, .selector = "ActionSelector") \
    F(GVF_ACTION_GROUP_MASK, "ActionGroupMask", ACT, GVK_INT, .address = GVB_ACTION_GROUP_MASK, .access = GVA_RW, .max = 4294967295.0, .selector = "ActionSelector") \
    F(GVF_PTP_ENABLE, "PtpEnable", PTP, GVK_BOOL, .access = GVA_RW) \
    F(GVF_PTP_LATCH, "PtpDataSetLatch", PTP, GVK_COMMAND, .access = GVA_W) \
    F(GVF_PTP_STATUS, "PtpStatus", PTP, GVK_ENUM, .access = GVA_R, .entry = e_ptp, .tip = "At the last PtpDataSetLatch") \
    F(GVF_PTP_OFFSET, "PtpOffsetFromMaster", PTP, GVK_INT64, .access = GVA_R, .unit = "ns", .tip = "At the last PtpDataSetLatch") /* 64 bits */ \
    F(GVF_PTP_OFFSET_LOW, NULL, PTP, GVK_INT, .access = GVA_R) \
    F(GVF_CHUNK_MODE, "ChunkModeActive", CHK, GVK_BOOL, .access = GVA_LOCKED) \
    F(GVF_CHUNK_SELECTOR, "ChunkSelector", CHK, GVK_ENUM, .access = GVA_RW, .entry = e_chunk, .value = GVC_TIMESTAMP) \
    F(GVF_CHUNK_ENABLE, "ChunkEnable", CHK, GVK_BOOL, .access = GVA_LOCKED, .selector = "ChunkSelector") \
    F(GVF_USER_SET_SELECTOR, "UserSetSelector", USER, GVK_ENUM, .access = GVA_RW, .entry = e_user_set) \
    F(GVF_USER_SET_LOAD, "UserSetLoad", USER, GVK_COMMAND, .access = GVA_W, .selector = "UserSetSelector") \
    F(GVF_USER_SET_SAVE, "UserSetSave", USER, GVK_COMMAND, .access = GVA_W, .selector = "UserSetSelector") \
    F(GVF_USER_SET_DEFAULT, "UserSetDefault", USER, GVK_ENUM, .access = GVA_RW, .entry = e_user_set, .tip = "Loaded at power-up") \
    F(GVF_WIDE_IDS, "GevGVSPExtendedIDMode", TL, GVK_ENUM, .access = GVA_LOCKED, .entry = e_on) \
    F(GVF_CHUNK_LAYOUT, "ChunkPayloadType", CHK, GVK_ENUM, .access = GVA_LOCKED, .entry = e_layout, .tip = "0x4001 of GigE Vision 2.0, or 0x0005 of 1.2, whose chunks Aravis 0.8 does not read") /* which payload type chunks come in */ \
    F(GVF_PAYLOAD_SIZE, "PayloadSize", TL, GVK_INT, .access = GVA_R, .max = 4294967295.0) \
    F(GVF_STREAM_SELECTOR, "GevStreamChannelSelector", TL, GVK_INT, .access = GVA_RW) \
    F(GVF_CHUNKS_ON, NULL, CHK, GVK_INT, .access = GVA_R) /* bits, behind ChunkEnable; not in the XML */ \
    F(GVF_HEARTBEAT, "GevHeartbeatTimeout", TL, GVK_INT, .address = GVB_HEARTBEAT, .access = GVA_RW, .value = 3000, .min = 500, .max = 600000, .unit = "ms") \
    F(GVF_SCP_PORT, "GevSCPHostPort", TL, GVK_INT, .address = GVB_SCP, .access = GVA_RW, .max = 65535, .selector = "GevStreamChannelSelector") \
    F(GVF_SCPS, NULL, TL, GVK_INT, .address = GVB_SCPS, .access = GVA_RW, .value = 1500) \
    F(GVF_SCPD, "GevSCPD", TL, GVK_INT, .address = GVB_SCPD, .access = GVA_RW, .max = 1e9, .unit = "ticks", .selector = "GevStreamChannelSelector", .tip = "Delay between packets") \
    F(GVF_SCDA, "GevSCDA", TL, GVK_INT, .address = GVB_SCDA, .access = GVA_RW, .max = 4294967295.0, .selector = "GevStreamChannelSelector")
/* clang-format on */
#define GVF_NUMBER(number, ...) number,
enum gvcam_feature { GVCAM_FEATURES(GVF_NUMBER) GVCAM_N_FEATURES };
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
    GVA_LOCKED = 7 /* RW, but read-only while streaming */
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
    const char *selector;            /* feature that selects this one */
    const struct gvcam_entry *entry; /* ends with a NULL name */
    uint32_t bytes;                  /* strings */
    int bit;                         /* GVK_BIT*, from the most significant */
    const char *tip;
};
/* The first GVCAM_N_FEATURES are those of enum gvcam_feature.  The ones after them are other names of registers.
 * NULL name: a register without a feature.  Ends with a NULL category. */
extern const struct gvcam_feature_def gvcam_features[];

/* Chunks, which ChunkSelector selects.  The index is the bit in GVF_CHUNKS_ON. */
#define GVCAM_CHUNKS(F)                                                           \
    F(GVC_IMAGE, "Image", NULL, 0x8000, 0, GVK_INT)                               \
    F(GVC_TIMESTAMP, "Timestamp", "ChunkTimestamp", 0x8001, 8, GVK_INT64)         \
    F(GVC_EXPOSURE, "ExposureTime", "ChunkExposureTime", 0x8002, 4, GVK_FLOAT)    \
    F(GVC_FRAME_ID, "FrameID", "ChunkFrameID", 0x8003, 8, GVK_INT64)              \
    F(GVC_FRAME_COUNTER, "FrameCounter", "ChunkFrameCounter", 0x8004, 4, GVK_INT) \
    F(GVC_GAIN, "Gain", "ChunkGain", 0x8005, 4, GVK_FLOAT)                        \
    F(GVC_LINES, "LineStatusAll", "ChunkLineStatusAll", 0x8006, 4, GVK_INT)
enum gvcam_chunk { GVCAM_CHUNKS(GVF_NUMBER) GVCAM_N_CHUNKS };
struct gvcam_chunk_def {
    const char *selector, *feature; /* "Timestamp", "ChunkTimestamp" */
    uint32_t id, bytes;
    enum gvcam_kind kind;
};
extern const struct gvcam_chunk_def gvcam_chunk_defs[GVCAM_N_CHUNKS];
#endif
