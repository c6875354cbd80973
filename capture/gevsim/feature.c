#include "capture/gevsim/feature.h"

static const struct gvcam_entry e_temperature[] = {{"Sensor", 0}, {"Mainboard", 1}, {NULL, 0}};
static const struct gvcam_entry e_mode[] = {
    {"Continuous", 0}, {"SingleFrame", 1}, {"MultiFrame", 2}, {NULL, 0}};
static const struct gvcam_entry e_on[] = {{"Off", 0}, {"On", 1}, {NULL, 0}};
static const struct gvcam_entry e_frame_start[] = {{"FrameStart", 0}, {NULL, 0}};
static const struct gvcam_entry e_source[] = {
    {"Software", 0}, {"Line1", 1}, {"Action1", 2}, {NULL, 0}};
static const struct gvcam_entry e_edge[] = {{"RisingEdge", 0}, {"FallingEdge", 1}, {NULL, 0}};
static const struct gvcam_entry e_timed[] = {{"Timed", 0}, {NULL, 0}};
static const struct gvcam_entry e_line[] = {{"Line1", 0}, {NULL, 0}};
static const struct gvcam_entry e_input[] = {{"Input", 0}, {NULL, 0}};
static const struct gvcam_entry e_ptp[] = {
    {"Initializing", 1}, {"Faulty", 2},  {"Disabled", 3},     {"Listening", 4}, {"PreMaster", 5},
    {"Master", 6},       {"Passive", 7}, {"Uncalibrated", 8}, {"Slave", 9},     {NULL, 0}};
#define ENTRY(number, selector, ...) {selector, number},
static const struct gvcam_entry e_chunk[] = {GVCAM_CHUNKS(ENTRY){NULL, 0}};
static const struct gvcam_entry e_user_set[] = {{"Default", 0}, {"UserSet1", 1}, {NULL, 0}};
static const struct gvcam_entry e_layout[] = {
    {"ImageExtendedChunk", 0}, {"ExtendedChunk", 1}, {NULL, 0}};
static const struct gvcam_entry e_ccp[] = {
    {"OpenAccess", 0}, {"ExclusiveAccess", 1}, {"ControlAccess", 2}, {NULL, 0}};

#define DEV  "DeviceControl"
#define IMG  "ImageFormatControl"
#define ACQ  "AcquisitionControl"
#define ANA  "AnalogControl"
#define DIO  "DigitalIOControl"
#define ACT  "ActionControl"
#define PTP  "PtpControl"
#define CHK  "ChunkDataControl"
#define USER "UserSetControl"
#define TL   "TransportLayerControl"
#define A    GVF_ADDRESS

#define ROW(number, ...) [number] = {__VA_ARGS__},

/* clang-format off */
const struct gvcam_feature_def gvcam_features[] = {
    GVCAM_FEATURES(ROW)
    /* other names, and features that are not a 32-bit register of their own */
    {"DeviceVendorName", DEV, GVK_STRING, GVB_VENDOR, GVA_R, .bytes = 32},
    {"DeviceModelName", DEV, GVK_STRING, GVB_MODEL, GVA_R, .bytes = 32},
    {"DeviceVersion", DEV, GVK_STRING, GVB_DEVICE_VERSION, GVA_R, .bytes = 32},
    {"DeviceManufacturerInfo", DEV, GVK_STRING, GVB_INFO, GVA_R, .bytes = 48},
    {"DeviceSerialNumber", DEV, GVK_STRING, GVB_SERIAL, GVA_R, .bytes = 16},
    {"DeviceID", DEV, GVK_STRING, GVB_SERIAL, GVA_R, .bytes = 16},
    {"DeviceUserID", DEV, GVK_STRING, GVB_USER_NAME, GVA_RW, .bytes = 16},
    {"GevIEEE1588", PTP, GVK_BOOL, A(GVF_PTP_ENABLE), .access = GVA_RW},
    {"GevIEEE1588DataSetLatch", PTP, GVK_COMMAND, A(GVF_PTP_LATCH), .access = GVA_W},
    {"GevIEEE1588Status", PTP, GVK_ENUM, A(GVF_PTP_STATUS), GVA_R, .entry = e_ptp},
    {"GevIEEE1588OffsetFromMaster", PTP, GVK_INT64, A(GVF_PTP_OFFSET), GVA_R, .unit = "ns"},
    {"GevStreamChannelCount", TL, GVK_INT, GVB_STREAM_CHANNELS, GVA_R, .max = 1},
    {"GevSCPSPacketSize", TL, GVK_INT, GVB_SCPS, GVA_LOCKED, .min = 220, .max = 16404, .inc = 4, .unit = "B", .bit = 16, .selector = "GevStreamChannelSelector"},
    {"GevSCPSDoNotFragment", TL, GVK_BIT_BOOL, GVB_SCPS, GVA_RW, .bit = 1, .selector = "GevStreamChannelSelector"},
    {"GevSCPSFireTestPacket", TL, GVK_BIT, GVB_SCPS, GVA_RW, .bit = 0, .selector = "GevStreamChannelSelector"},
    {"GevCCP", TL, GVK_ENUM, GVB_CCP, GVA_RW, .entry = e_ccp},
    {"GevCurrentIPAddress", TL, GVK_INT, GVB_IP, GVA_R, .max = 4294967295.0},
    {"GevCurrentSubnetMask", TL, GVK_INT, GVB_MASK, GVA_R, .max = 4294967295.0},
    {"GevCurrentDefaultGateway", TL, GVK_INT, GVB_GATEWAY, GVA_R, .max = 4294967295.0},
    {"GevMACAddress", TL, GVK_INT64, GVB_MAC_HIGH, .access = GVA_R},
    {"GevTimestampTickFrequency", TL, GVK_INT64, GVB_TICKS_HIGH, GVA_R, .unit = "Hz"},
    {"GevTimestampControlLatch", TL, GVK_BIT, GVB_TIMESTAMP_CONTROL, GVA_W, .bit = 30},
    {"GevTimestampControlReset", TL, GVK_BIT, GVB_TIMESTAMP_CONTROL, GVA_W, .bit = 31},
    {"GevTimestampValue", TL, GVK_INT64, GVB_TIMESTAMP_HIGH, GVA_R, .unit = "ticks"},
    {.category = NULL},
};
/* clang-format on */

const struct gvcam_chunk_def gvcam_chunk_defs[GVCAM_N_CHUNKS] = {GVCAM_CHUNKS(ROW)};
