#include "daemon/config/options.h"

#include <stdio.h>
#include <string.h>

#include "daemon/config/config.h"
#include "recon/solve/solve.h"

#define AT(member) offsetof(struct dmn_config, member), sizeof(((struct dmn_config *)0)->member)
#define BOOL(key, member, def, help)                         \
    {                                                        \
        key, DMN_BOOL, AT(member), def, 0, 0, "", NULL, help \
    }
#define INT(key, member, def, lo, hi, unit, help)               \
    {                                                           \
        key, DMN_INT, AT(member), def, lo, hi, unit, NULL, help \
    }
#define REAL(key, member, def, lo, hi, unit, help)               \
    {                                                            \
        key, DMN_REAL, AT(member), def, lo, hi, unit, NULL, help \
    }
#define TEXT(key, member, help)                                 \
    {                                                           \
        key, DMN_TEXT, AT(member), "\"\"", 0, 0, "", NULL, help \
    }
#define CHOICE(key, member, def, choices, help)                   \
    {                                                             \
        key, DMN_CHOICE, AT(member), def, 0, 0, "", choices, help \
    }

#define ONE_MORE(name, run) "|" name

const struct dmn_option dmn_options[] = {
    TEXT("rig", rig, "Calibration file: cameras and reconstruction volume. Must be given."),
    {"cameras", DMN_CAMERAS, AT(cameras), "\"\"", 0, 0, "", NULL,
     "Source of each camera, by its name in the rig; or one pattern for all of them, in which "
     "{name} is the camera's name and a trailing + counts up. Must be given. Sources: "
     "aravis:ADDRESS-SERIAL-OR-NAME, v4l2:NAME, libcamera:ID, files:PATTERN, take:FILE, sim:; "
     "`pyrovox cameras` lists those that can be listed."},
    {"grid", DMN_INTS, AT(grid), "[]", 1, REC_GRID_MAX, "voxels", NULL,
     "Voxels of the volume, one number (along x, the others in proportion) or three; empty = as "
     "the rig says."},
    CHOICE("basis", basis, "rig", "rig|box|trilinear",
           "How a volume is read between voxel centres: constant in the voxel, which is faster, or "
           "trilinear; rig = as the rig says, trilinear where it says nothing."),
    CHOICE("channels", channels, "auto", "auto|1|3",
           "Colours that are reconstructed. auto = 1 for grey pixel formats, else 3."),
    CHOICE("trust", trust, "vote", "vote|all",
           "Which cameras are believed. vote: one that contradicts the others (dark, flooded, "
           "moved, late, "
           "of another gain) is left out of the set, named with a remedy, and back when it has "
           "agreed for "
           "half a second; it takes four cameras or more. all: every one, for comparison."),
    INT("threads", threads, "0", 0, 256, "threads",
        "Threads that share the computing of a stage; 0 = one per processor."),
    BOOL("insecure", insecure, "false",
         "Allow volumes on addresses that other hosts reach, and control by more than a file: "
         "everybody there may read, and with control.endpoint stop the daemon. Warned of in log, "
         "status and top."),
    CHOICE("log_level", log_level, "info", "error|warn|info|debug",
           "Least important message shown."),

    REAL("fps", fps, "20", 0.01, 10000, "Hz", "Nominal frame sets per second."),
    {"pixel_format", DMN_FORMAT, AT(pixel_format), "auto", 0, 0, "", NULL,
     "Pixel format asked of the cameras; auto = what they are set to. Mono8 10 12 14 16 10p 12p "
     "10Packed 12Packed 10csi 12csi, BayerRG, BayerGR, BayerGB and BayerBG likewise, RGB8, BGR8, "
     "RGB16, YUV422_8 (YUYV), YUV422_8_UYVY (UYVY), JPEG (MJPG), Mono32f, RGB32f. Grey files are "
     "read as Bayer images when this names a Bayer format of their depth."},
    CHOICE("bayer", bayer, "auto", "auto|rays|demosaic",
           "Bayer pixels at binning 1. rays: each is a ray of its own colour, nothing is "
           "interpolated; demosaic: the missing colours are interpolated, which blurs; auto = rays "
           "where the solver can (pcg, three channels)."),
    CHOICE("transfer", transfer, "auto", "auto|linear|srgb|bt709",
           "How samples stand for light. auto = linear for grey, RGB and Bayer, files and videos "
           "too; what the camera says, else sRGB, for YUV and JPEG."),
    CHOICE("trigger", trigger, "free-run", "free-run|software|line|action",
           "Who starts an exposure: the camera, one software command per period to each, a signal "
           "on a cable, or one GigE Vision action command per period to all (keys under action)."),
    TEXT("trigger_line", trigger_line, "Input of trigger: line; empty = Line1."),
    BOOL("ptp", ptp, "false",
         "Let the cameras synchronize their clocks by PTP (IEEE 1588); frames are used once they "
         "have."),
    REAL("ptp_offset_us", ptp_offset_us, "10", 0.001, 1e6, "us",
         "Largest offset from the PTP master with which a camera counts as synchronized."),
    BOOL("shared_clock", shared_clock, "false",
         "The cameras' time stamps are the host's UTC already (PTP, simulated cameras), so no "
         "clock is fitted."),
    BOOL("lossless", lossless, "false",
         "Replay: wait instead of dropping, and take files as fast as they can be solved."),
    BOOL("loop", loop, "false", "Files start over at their end."),
    INT("discard_first", discard_first, "1", 0, 1000, "frames",
        "Frames of each camera that are ignored after it has been started; files lose none when "
        "lossless."),
    INT("buffers", buffers, "16", 4, 512, "frames", "Raw frames kept per camera."),
    REAL("exposure_us", exposure_us, "-1", -1, 1e9, "us",
         "Exposure time; negative = leave as the camera has it."),
    REAL("gain", gain, "-1", -1, 1000, "", "Gain; negative = leave as the camera has it."),
    {"features", DMN_PAIRS, AT(features), "{}", 0, 0, "", NULL,
     "GenICam features, V4L2 controls as v4l2-ctl -L names or numbers them, or libcamera controls "
     "by name, written to every camera when it is opened, and read back."},
    {"camera_features", DMN_PAIRS, AT(camera_features), "{}", 0, 0, "", NULL,
     "The same for one camera, as CAMERA.FEATURE: value; written after those for all."},
    BOOL("chunks", chunks, "false",
         "Ask GenICam cameras to send exposure time and gain with each frame (chunk data)."),

    INT("action.device_key", action_device_key, "1", 0, 4294967295.0, "",
        "Key of action commands; the cameras are set to it."),
    INT("action.group_key", action_group_key, "1", 0, 4294967295.0, "",
        "Group of action commands; the cameras are set to it."),
    INT("action.group_mask", action_group_mask, "1", 1, 4294967295.0, "",
        "Members of the group; the cameras are set to it."),
    {"action.addresses", DMN_TEXTS, AT(action_addresses), "[]", 0, 0, "", NULL,
     "IPv4 addresses that action commands are sent to; empty = the broadcast address of every "
     "network that has a camera."},
    REAL("action.lead_ms", action_lead_ms, "0", 0, 1000, "ms",
         "Above 0, commands are scheduled: sent that long before the instant at which all cameras "
         "act by their own clocks (needs ptp); 0 = they act when the command comes."),
    BOOL("action.acknowledge", action_acknowledge, "true",
         "Cameras answer each action command; those that do not are counted."),

    INT("gige.packet_size", packet_size, "0", 0, 16384, "bytes",
        "GigE Vision packet size; 0 = negotiate."),
    INT("gige.packet_delay_ns", packet_delay_ns, "0", 0, 1e9, "ns",
        "Pause of a GigE camera between two packets of a frame, so that cameras that expose "
        "together share a link; 0 = leave as the camera has it."),
    CHOICE("gige.resend", resend, "auto", "auto|always|never",
           "Ask for lost packets again; auto = when the camera says that it can."),
    INT("gige.socket_buffer", socket_buffer, "8388608", 65536, 1073741824, "bytes",
        "Receive buffer of each GigE camera, as far as net.core.rmem_max allows."),
    REAL("gige.frame_retention_ms", frame_retention_ms, "50", 1, 10000, "ms",
         "Longest wait for the packets of a frame; good frames behind it wait as long."),
    REAL("gige.packet_timeout_ms", packet_timeout_ms, "5", 0.1, 1000, "ms",
         "A packet that is late by this is asked for again, and then every four times as long."),
    INT("gige.rt_priority", rt_priority, "10", 0, 99, "",
        "Real-time priority of the threads that receive; 0 = none."),
    BOOL("gige.packet_socket", packet_socket, "true",
         "Receive by packet socket where it is allowed (CAP_NET_RAW); false = plain UDP."),

    REAL("sync.tolerance_ms", tolerance_ms, "0", 0, 10000, "ms",
         "Frames belong together when their exposures differ by no more; 0 = a quarter of the "
         "period."),
    REAL("sync.max_wait_ms", max_wait_ms, "0", 0, 60000, "ms",
         "Longest wait for the missing frames of a set, from its first one; 0 = 150, with wait "
         "500. Frames are held meanwhile: mind `buffers`."),
    CHOICE("sync.policy", policy, "drop", "drop|partial|wait|solve-with-what-is-there",
           "What becomes of a set without all cameras. drop: it is dropped. wait: slow cameras are "
           "waited for longer, none is left out as long as it lives; those that are gone are. "
           "solve-with-what-is-there (or partial): it is solved with the cameras that are in it."),
    INT("sync.min_cameras", min_cameras, "2", 1, CAP_MAX_CAMERAS, "cameras",
        "Sets with fewer are dropped, whatever the policy."),

    INT("binning", binning, "0", 0, 64, "pixels",
        "Raw pixels per side of a bin; 0 = chosen from the grid."),
    INT("rays", rays, "0", 0, 16, "rays",
        "Rays per side of a bin; 0 = 2, the mean over its area. 1 is faster and less accurate."),
    TEXT("matrix_cache", cache,
         "File that keeps the system matrix; empty = under $PYROVOX_CACHE, $XDG_CACHE_HOME or "
         "~/.cache."),

    REAL("photometry.black", black, "0", 0, 1, "full scale", "Black level, subtracted."),
    REAL("photometry.threshold", threshold, "-1", -1, 1, "full scale",
         "Pixels from here on are flame; negative = from the noise."),
    REAL("photometry.floor", floor, "0.004", 0, 1, "full scale",
         "Least automatic threshold; half a percent of a dim picture's brightest bin, if its "
         "pixels have more than 8 bits."),
    REAL("photometry.auto_k", auto_k, "4", 0, 100, "sigma", "Automatic threshold over the noise."),
    REAL("photometry.saturation", saturation, "-1", -1, 1000, "full scale",
         "Pixels from here on are saturated and do not count; negative = 0.998, or off for images "
         "of floating-point numbers; 0 = off."),
    INT("photometry.margin", margin, "0", 0, 100, "bins",
        "Silhouettes are grown by it to cover calibration error."),
    BOOL("photometry.despeckle", despeckle, "true",
         "Lit bins without lit neighbours are noise (automatic threshold only)."),

    INT("hull.min_views", min_views, "2", 1, CAP_MAX_CAMERAS, "cameras",
        "A voxel seen by fewer cameras is empty."),
    BOOL("hull.keep_partial", keep_partial, "true",
         "Keep voxels that are only partly inside a silhouette."),

    REAL("model.absorption", absorption, "0", 0, 1e6, "per full scale",
         "How much the flame absorbs of its own light: kappa over its emission, as `pyrovox "
         "reconstruct --absorption auto` finds it in a recording; 0 = nothing."),

    CHOICE("model.saturated", saturated, "left-out", "left-out|at-least",
           "What a saturated pixel says: nothing, or that it is at least as bright as that; pcg "
           "only."),
    CHOICE("model.temporal", temporal, "off", "off|on",
           "Expect what the volume before says, moved along the flame's motion, as far as the "
           "pictures bear it out: for noisy pictures of a flame that moves slowly. Only pcg does."),

    CHOICE("solver.name", solver, "pcg", &(REC_SOLVERS(ONE_MORE))[1],
           "Method of solution; the others than pcg are for comparison."),
    INT("solver.iterations", iterations, "0", 0, 100000, "",
        "Most iterations; 0 = the method's default."),
    REAL("solver.lambda", lambda, "-1", -1, 1e6, "", "Weight of smoothness; negative = automatic."),
    CHOICE("solver.stop", stop, "auto", "auto|lcurve|discrepancy|iterations", "When to stop."),
    REAL("solver.deadline_ms", deadline_ms, "-1", -1, 1e6, "ms",
         "The solver returns its best result by this time after the last frame came (lossless: "
         "after it began); negative = what keeps up with the cameras, and longer only while that "
         "does not give a solution (none when lossless); 0 = none."),
    CHOICE("solver.warm_start", warm_start, "auto", "auto|on|off",
           "Start from the volume before. auto = live only, so that in a replay no set depends on "
           "another."),

    {"publish.endpoints", DMN_TEXTS, AT(endpoints), "[]", 0, 0, "", NULL,
     "ZeroMQ endpoints that volumes are published on; empty = ipc in the run folder."},
    TEXT("publish.previews", previews,
         "Endpoint of the cameras' previews, which are made while somebody subscribes; empty = the "
         "first "
         "ipc path of publish.endpoints with .previews behind it; off = none."),
    CHOICE("publish.sample", sample, "f16", "f16|f32", "Number format of the voxels."),
    CHOICE("publish.compress", compress, "auto", "auto|none|lz4|zstd",
           "Compression of the voxels; auto = lz4 if an endpoint is for other hosts, else none."),
    BOOL("publish.wait_subscriber", wait_subscriber, "false",
         "Take no images before somebody subscribes; for replays that are recorded."),
    INT("publish.hwm", hwm, "8", 1, 100000, "messages",
        "Messages kept for a slow subscriber; more are lost for it and seen by it as gaps."),

    TEXT("control.endpoint", control,
         "ZeroMQ endpoint of `pyrovox status`; empty = ipc in the run folder."),

    TEXT("metrics.endpoint", metrics,
         "Counters for Prometheus at this address and port, as 127.0.0.1:9464, GET /metrics; empty "
         "= none. Other addresses than loopback need insecure: true."),

    TEXT("keys.server", key_server,
         "The daemon's key, a .key file of `pyrovox keygen`, or credential:NAME, given by "
         "systemd's LoadCredential=. With keys.clients, volumes may be published on any address "
         "and control be on tcp://: encrypted, and for listed keys only; ipc:// files, and volumes "
         "on loopback addresses, need none. Read again on SIGHUP; clients then need the new one's "
         "public half."),
    TEXT("keys.clients", key_clients,
         "Who may come in: lines NAME read|control KEY, as in .pub files of `pyrovox keygen`. Read "
         "again on SIGHUP; who is no longer in it is put out."),

    CHOICE("record.mode", record_mode, "off", "off|raw",
           "raw: record the raw frames from the start (a take, HDF5); `record: raw` says the same. "
           "`pyrovox record --raw start` begins one at any time."),
    {"record.path", DMN_TEXT, AT(record_path), "takes/%Y%m%d-%H%M%S.h5", 0, 0, "", NULL,
     "File to record to; % as in strftime(3), local time. An existing file is not written over."},
    INT("record.queue", record_queue, "8", 0, 64, "sets",
        "Frame sets that may wait for the disk; each camera gets so many `buffers` more. When it "
        "is full, sets are left out and listed in the take; the live solve never waits. 0 = no "
        "recording is possible."),
    REAL("record.limit_gb", record_limit_gb, "0", 0, 1e6, "GB",
         "A take ends at this size; 0 = no limit."),
    REAL(
        "record.roll_s", record_roll_s, "0", 0, 1e8, "s",
        "After so long a recording, of raw frames or of volumes, goes on in another file or folder "
        "(NAME-0002, NAME-0003, ...) without losing a set between them; 0 = one, however long."),
    REAL("record.keep_free_gb", record_keep_free_gb, "1", 0, 1e6, "GB",
         "A recording ends before the disk has less; with less it is not begun."),
    REAL("record.sync_s", record_sync_s, "2", 0, 3600, "s",
         "How often what is recorded is forced to the disk, against a power cut; 0 = never. The "
         "end of the daemon, however sudden, loses nothing in either case."),

    CHOICE("record.volumes", record_volumes, "none", "none|npy|hdf5|vdb|nvdb",
           "Record the volumes from the start: `pyrovox record --format` beside the daemon, which "
           "ends with it and is begun again when it dies."),
    {"record.volumes_path", DMN_TEXT, AT(record_volumes_path), "takes/%Y%m%d-%H%M%S-volumes", 0, 0,
     "", NULL,
     "File or folder for that; % as in record.path. The session, which raw takes carry too, and "
     ".h5 "
     "are put behind it."},

    INT("sim.seed", sim_seed, "1", 0, 4294967295.0, "", "Flame that sim: cameras see."),
    REAL("sim.period_s", sim_period_s, "2", 0.01, 3600, "s", "The flame's motion repeats."),
};
const size_t dmn_n_options = sizeof dmn_options / sizeof dmn_options[0];

void dmn_choice_word(const char *choices, int index, char *out, size_t size)
{
    const char *p = choices;
    for (int i = 0; i < index && p != NULL; i++) {
        p = strchr(p, '|');
        if (p != NULL)
            p++;
    }
    size_t n = p == NULL ? 0 : strcspn(p, "|");
    snprintf(out, size, "%.*s", (int)n, p == NULL ? "" : p);
}
