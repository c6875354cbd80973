#include "capture/gvcam_feature.h"

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
static const struct gvcam_entry e_chunk[] = {{"Image", GVC_IMAGE},
                                             {"Timestamp", GVC_TIMESTAMP},
                                             {"ExposureTime", GVC_EXPOSURE},
                                             {"FrameID", GVC_FRAME_ID},
                                             {"FrameCounter", GVC_FRAME_COUNTER},
                                             {"Gain", GVC_GAIN},
                                             {"LineStatusAll", GVC_LINES},
                                             {NULL, 0}};
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

/* clang-format off */
const struct gvcam_feature_def gvcam_features[] = {
    [GVF_DEVICE_RESET] = {"DeviceReset", DEV, GVK_COMMAND, .access = GVA_W, .tip = "Reboot"},
    [GVF_TEMPERATURE_SELECTOR] = {"DeviceTemperatureSelector", DEV, GVK_ENUM, .access = GVA_RW, .entry = e_temperature},
    [GVF_TEMPERATURE] = {"DeviceTemperature", DEV, GVK_FLOAT, .access = GVA_R, .min = -40, .max = 100, .unit = "C", .selector = "DeviceTemperatureSelector"},
    [GVF_TIMESTAMP_LATCH] = {"TimestampLatch", DEV, GVK_COMMAND, .access = GVA_W},
    [GVF_TIMESTAMP_RESET] = {"TimestampReset", DEV, GVK_COMMAND, .access = GVA_W, .tip = "Device clock to 0; not while PTP is on"},
    [GVF_TIMESTAMP_VALUE] = {"TimestampLatchValue", DEV, GVK_INT64, .access = GVA_R, .tip = "Ticks at the last TimestampLatch"},
    [GVF_TIMESTAMP_VALUE_LOW] = {NULL, DEV, GVK_INT, .access = GVA_R},
    [GVF_SENSOR_WIDTH] = {"SensorWidth", IMG, GVK_INT, .access = GVA_R, .max = 16384},
    [GVF_SENSOR_HEIGHT] = {"SensorHeight", IMG, GVK_INT, .access = GVA_R, .max = 16384},
    [GVF_WIDTH_MAX] = {"WidthMax", IMG, GVK_INT, .access = GVA_R, .max = 16384},
    [GVF_HEIGHT_MAX] = {"HeightMax", IMG, GVK_INT, .access = GVA_R, .max = 16384},
    [GVF_WIDTH] = {"Width", IMG, GVK_INT, .access = GVA_LOCKED, .min = 1, .max_of = "WidthMax"},
    [GVF_HEIGHT] = {"Height", IMG, GVK_INT, .access = GVA_LOCKED, .min = 1, .max_of = "HeightMax"},
    [GVF_OFFSET_X] = {"OffsetX", IMG, GVK_INT, .access = GVA_LOCKED, .inc = 2, .max_of = "SensorWidth"},
    [GVF_OFFSET_Y] = {"OffsetY", IMG, GVK_INT, .access = GVA_LOCKED, .inc = 2, .max_of = "SensorHeight"},
    [GVF_PIXEL_FORMAT] = {"PixelFormat", IMG, GVK_FORMAT, .access = GVA_LOCKED},
    [GVF_ACQ_MODE] = {"AcquisitionMode", ACQ, GVK_ENUM, .access = GVA_LOCKED, .entry = e_mode},
    [GVF_ACQ_START] = {"AcquisitionStart", ACQ, GVK_COMMAND, .access = GVA_W},
    [GVF_ACQ_STOP] = {"AcquisitionStop", ACQ, GVK_COMMAND, .access = GVA_W},
    [GVF_ACQ_COUNT] = {"AcquisitionFrameCount", ACQ, GVK_INT, .access = GVA_LOCKED, .value = 1, .min = 1, .max = 65535},
    [GVF_RATE_ENABLE] = {"AcquisitionFrameRateEnable", ACQ, GVK_BOOL, .access = GVA_RW, .value = 1},
    [GVF_RATE] = {"AcquisitionFrameRate", ACQ, GVK_FLOAT, .access = GVA_RW, .min = 0.1, .max = 1000, .unit = "Hz"},
    [GVF_RESULTING_RATE] = {"AcquisitionResultingFrameRate", ACQ, GVK_FLOAT, .access = GVA_R, .max = 1000, .unit = "Hz"},
    [GVF_TRIGGER_SELECTOR] = {"TriggerSelector", ACQ, GVK_ENUM, .access = GVA_RW, .entry = e_frame_start},
    [GVF_TRIGGER_MODE] = {"TriggerMode", ACQ, GVK_ENUM, .access = GVA_RW, .entry = e_on, .selector = "TriggerSelector"},
    [GVF_TRIGGER_SOURCE] = {"TriggerSource", ACQ, GVK_ENUM, .access = GVA_RW, .entry = e_source, .selector = "TriggerSelector"},
    [GVF_TRIGGER_ACTIVATION] = {"TriggerActivation", ACQ, GVK_ENUM, .access = GVA_RW, .entry = e_edge, .selector = "TriggerSelector"},
    [GVF_TRIGGER_DELAY] = {"TriggerDelay", ACQ, GVK_FLOAT, .access = GVA_RW, .max = 1e6, .unit = "us", .selector = "TriggerSelector"},
    [GVF_TRIGGER_SOFTWARE] = {"TriggerSoftware", ACQ, GVK_COMMAND, .access = GVA_W, .selector = "TriggerSelector"},
    [GVF_EXPOSURE_MODE] = {"ExposureMode", ACQ, GVK_ENUM, .access = GVA_RW, .entry = e_timed},
    [GVF_EXPOSURE] = {"ExposureTime", ACQ, GVK_FLOAT, .access = GVA_RW, .value = 1000, .min = 10, .max = 1e6, .unit = "us"},
    [GVF_GAIN] = {"Gain", ANA, GVK_FLOAT, .access = GVA_RW, .max = 24, .unit = "dB"},
    [GVF_BLACK_LEVEL] = {"BlackLevel", ANA, GVK_FLOAT, .access = GVA_RW, .max = 255},
    [GVF_LINE_SELECTOR] = {"LineSelector", DIO, GVK_ENUM, .access = GVA_RW, .entry = e_line},
    [GVF_LINE_MODE] = {"LineMode", DIO, GVK_ENUM, .access = GVA_R, .entry = e_input, .selector = "LineSelector"},
    [GVF_LINE_STATUS] = {"LineStatus", DIO, GVK_BOOL, .access = GVA_R, .selector = "LineSelector"},
    [GVF_LINE_STATUS_ALL] = {"LineStatusAll", DIO, GVK_INT, .access = GVA_R, .max = 4294967295.0},
    [GVF_ACTION_SELECTOR] = {"ActionSelector", ACT, GVK_INT, .access = GVA_RW, .value = 1, .min = 1, .max = 1},
    [GVF_ACTION_DEVICE_KEY] = {"ActionDeviceKey", ACT, GVK_INT, .address = GVB_ACTION_DEVICE_KEY, .access = GVA_W, .max = 4294967295.0},
    [GVF_ACTION_GROUP_KEY] = {"ActionGroupKey", ACT, GVK_INT, .address = GVB_ACTION_GROUP_KEY, .access = GVA_RW, .max = 4294967295.0, .selector = "ActionSelector"},
    [GVF_ACTION_GROUP_MASK] = {"ActionGroupMask", ACT, GVK_INT, .address = GVB_ACTION_GROUP_MASK, .access = GVA_RW, .max = 4294967295.0, .selector = "ActionSelector"},
    [GVF_PTP_ENABLE] = {"PtpEnable", PTP, GVK_BOOL, .access = GVA_RW},
    [GVF_PTP_LATCH] = {"PtpDataSetLatch", PTP, GVK_COMMAND, .access = GVA_W},
    [GVF_PTP_STATUS] = {"PtpStatus", PTP, GVK_ENUM, .access = GVA_R, .entry = e_ptp, .tip = "At the last PtpDataSetLatch"},
    [GVF_PTP_OFFSET] = {"PtpOffsetFromMaster", PTP, GVK_INT64, .access = GVA_R, .unit = "ns", .tip = "At the last PtpDataSetLatch"},
    [GVF_PTP_OFFSET_LOW] = {NULL, PTP, GVK_INT, .access = GVA_R},
    [GVF_CHUNK_MODE] = {"ChunkModeActive", CHK, GVK_BOOL, .access = GVA_LOCKED},
    [GVF_CHUNK_SELECTOR] = {"ChunkSelector", CHK, GVK_ENUM, .access = GVA_RW, .entry = e_chunk, .value = GVC_TIMESTAMP},
    [GVF_CHUNK_ENABLE] = {"ChunkEnable", CHK, GVK_BOOL, .access = GVA_LOCKED, .selector = "ChunkSelector"},
    [GVF_USER_SET_SELECTOR] = {"UserSetSelector", USER, GVK_ENUM, .access = GVA_RW, .entry = e_user_set},
    [GVF_USER_SET_LOAD] = {"UserSetLoad", USER, GVK_COMMAND, .access = GVA_W, .selector = "UserSetSelector"},
    [GVF_USER_SET_SAVE] = {"UserSetSave", USER, GVK_COMMAND, .access = GVA_W, .selector = "UserSetSelector"},
    [GVF_USER_SET_DEFAULT] = {"UserSetDefault", USER, GVK_ENUM, .access = GVA_RW, .entry = e_user_set, .tip = "Loaded at power-up"},
    [GVF_WIDE_IDS] = {"GevGVSPExtendedIDMode", TL, GVK_ENUM, .access = GVA_LOCKED, .entry = e_on},
    [GVF_CHUNK_LAYOUT] = {"ChunkPayloadType", CHK, GVK_ENUM, .access = GVA_LOCKED, .entry = e_layout, .tip = "0x4001 of GigE Vision 2.0, or 0x0005 of 1.2, whose chunks Aravis 0.8 does not read"},
    [GVF_PAYLOAD_SIZE] = {"PayloadSize", TL, GVK_INT, .access = GVA_R, .max = 4294967295.0},
    [GVF_STREAM_SELECTOR] = {"GevStreamChannelSelector", TL, GVK_INT, .access = GVA_RW},
    [GVF_CHUNKS_ON] = {NULL, CHK, GVK_INT, .access = GVA_R},
    [GVF_HEARTBEAT] = {"GevHeartbeatTimeout", TL, GVK_INT, .address = GVB_HEARTBEAT, .access = GVA_RW, .value = 3000, .min = 500, .max = 600000, .unit = "ms"},
    [GVF_SCP_PORT] = {"GevSCPHostPort", TL, GVK_INT, .address = GVB_SCP, .access = GVA_RW, .max = 65535, .selector = "GevStreamChannelSelector"},
    [GVF_SCPS] = {NULL, TL, GVK_INT, .address = GVB_SCPS, .access = GVA_RW, .value = 1500},
    [GVF_SCPD] = {"GevSCPD", TL, GVK_INT, .address = GVB_SCPD, .access = GVA_RW, .max = 1e9, .unit = "ticks", .selector = "GevStreamChannelSelector", .tip = "Delay between packets"},
    [GVF_SCDA] = {"GevSCDA", TL, GVK_INT, .address = GVB_SCDA, .access = GVA_RW, .max = 4294967295.0, .selector = "GevStreamChannelSelector"},
    /* other names, and what is not a 32-bit register of ours */
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

const struct gvcam_chunk_def gvcam_chunk_defs[GVCAM_N_CHUNKS] = {
    [GVC_IMAGE] = {"Image", NULL, 0x8000, 0, GVK_INT},
    [GVC_TIMESTAMP] = {"Timestamp", "ChunkTimestamp", 0x8001, 8, GVK_INT64},
    [GVC_EXPOSURE] = {"ExposureTime", "ChunkExposureTime", 0x8002, 4, GVK_FLOAT},
    [GVC_FRAME_ID] = {"FrameID", "ChunkFrameID", 0x8003, 8, GVK_INT64},
    [GVC_FRAME_COUNTER] = {"FrameCounter", "ChunkFrameCounter", 0x8004, 4, GVK_INT},
    [GVC_GAIN] = {"Gain", "ChunkGain", 0x8005, 4, GVK_FLOAT},
    [GVC_LINES] = {"LineStatusAll", "ChunkLineStatusAll", 0x8006, 4, GVK_INT},
};
