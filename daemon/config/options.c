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
     "Source of each camera, by its name in the rig. Or one pattern for all of them, in "
     "which {name} is the camera's name and a trailing + counts up. Must be given. "
     "Sources: aravis:ADDRESS-SERIAL-OR-NAME, v4l2:NAME, libcamera:ID, files:PATTERN, "
     "take:FILE, sim:. `pyrovox cameras` lists those that can be listed."},
    {"grid", DMN_INTS, AT(grid), "[]", 1, REC_GRID_MAX, "voxels", NULL,
     "Voxels of the volume, one number (along x, the others in proportion) or three. "
     "Empty: from the rig."},
    CHOICE("basis", basis, "rig", "rig|box|trilinear",
           "Emission between voxel centres. box: constant in the voxel, which is faster. "
           "trilinear: interpolated. rig: from the rig, trilinear where it gives none."),
    CHOICE("channels", channels, "auto", "auto|1|3",
           "Colours to reconstruct. auto: 1 if pixel_format is grey, else 3. With 3, grey cameras "
           "are left out while others have colour. With 1, the three colours' mean counts."),
    CHOICE("trust", trust, "vote", "vote|all",
           "Cameras to believe. vote: a camera that contradicts the others (dark, flooded, "
           "moved, late, another gain) is left out of the set and named with a remedy. It is "
           "back when it has agreed for half a second. This takes four cameras or more. all: "
           "every camera, for comparison."),
    INT("threads", threads, "0", 0, 256, "threads",
        "Threads that share the computing of a stage. 0: one per processor."),
    {"compute", DMN_WHERE, AT(compute), "cpu", 0, 0, "", NULL,
     "Where frame sets are solved. cpu: on the processors. auto: on a graphics card (OpenCL) if a "
     "short measurement at the start shows that it is faster. opencl: on the first graphics card. "
     "opencl:NAME: on the first device whose name contains NAME, which may also be a processor "
     "(pocl). `pyrovox cpu` lists them. If a device fails, its sets are solved on the processors. "
     "Error bars, model.temporal and at-least are made on the processors only."},
    BOOL("insecure", insecure, "false",
         "Allow volumes on addresses that other hosts reach, and control by more than a file. "
         "Everybody there may read, and stop the daemon by control.endpoint. Log, status and "
         "top warn of it."),
    CHOICE("log_level", log_level, "info", "error|warn|info|debug",
           "Least important message to show."),

    REAL("fps", fps, "20", 0.01, 10000, "Hz", "Nominal frame sets per second."),
    {"pixel_format", DMN_FORMAT, AT(pixel_format), "auto", 0, 0, "", NULL,
     "Pixel format to ask of the cameras. auto: as they are set. Mono8 10 12 14 16 10p 12p "
     "10Packed 12Packed 10csi 12csi, BayerRG, BayerGR, BayerGB and BayerBG likewise, RGB8, "
     "BGR8, RGB10 12 14 16, YUV422_8 (YUYV), YUV422_8_UYVY (UYVY), JPEG (MJPG), Mono32f, RGB32f. "
     "Grey files are read as Bayer images when this names a Bayer format of their depth."},
    CHOICE("bayer", bayer, "auto", "auto|rays|demosaic",
           "Bayer pixels at binning 1. rays: each pixel is a ray of its own colour, without "
           "interpolation. demosaic: the missing colours are interpolated, which blurs. auto: "
           "rays where the solver can (pcg, three channels)."),
    CHOICE("transfer", transfer, "auto", "auto|linear|srgb|bt709",
           "Relation of samples to light. auto: linear for grey, RGB and Bayer, files and videos "
           "too. For YUV and JPEG: as the camera says, else sRGB."),
    CHOICE("trigger", trigger, "free-run", "free-run|software|line|action",
           "Start of an exposure: by the camera, by one software command per period to each, by "
           "a signal on a cable, or by one GigE Vision action command per period to all (keys "
           "under action)."),
    TEXT("trigger_line", trigger_line, "Input of trigger: line. Empty: Line1."),
    BOOL("ptp", ptp, "false",
         "Let the cameras synchronize their clocks by PTP (IEEE 1588). Frames are used once "
         "the clocks are synchronized."),
    REAL("ptp_offset_us", ptp_offset_us, "10", 0.001, 1e6, "us",
         "Largest offset from the PTP master with which a camera counts as synchronized."),
    BOOL("shared_clock", shared_clock, "false",
         "The cameras' time stamps are the host's UTC already (PTP, simulated cameras), so no "
         "clock is fitted."),
    BOOL("lossless", lossless, "false",
         "Replay: wait instead of dropping, and take files as fast as they can be solved."),
    BOOL("loop", loop, "false", "Files start over at their end."),
    INT("discard_first", discard_first, "1", 0, 1000, "frames",
        "Frames of each camera to ignore after its start. Files lose none when lossless."),
    INT("buffers", buffers, "16", 4, 512, "frames", "Raw frames kept per camera."),
    REAL("exposure_us", exposure_us, "-1", -1, 1e9, "us",
         "Exposure time. Negative: as set in the camera."),
    REAL("gain", gain, "-1", -1, 1000, "", "Gain. Negative: as set in the camera."),
    {"features", DMN_PAIRS, AT(features), "{}", 0, 0, "", NULL,
     "GenICam features, V4L2 controls by their name or number in v4l2-ctl -L, or libcamera "
     "controls by name. They are written to every camera when it is opened, and read back."},
    {"camera_features", DMN_PAIRS, AT(camera_features), "{}", 0, 0, "", NULL,
     "The same for one camera, as CAMERA.FEATURE: value. Written after those for all."},
    BOOL("chunks", chunks, "false",
         "Ask GenICam cameras to send exposure time and gain with each frame (chunk data)."),

    INT("action.device_key", action_device_key, "1", 0, 4294967295.0, "",
        "Key of action commands. The cameras are set to it."),
    INT("action.group_key", action_group_key, "1", 0, 4294967295.0, "",
        "Group of action commands. The cameras are set to it."),
    INT("action.group_mask", action_group_mask, "1", 1, 4294967295.0, "",
        "Members of the group. The cameras are set to it."),
    {"action.addresses", DMN_TEXTS, AT(action_addresses), "[]", 0, 0, "", NULL,
     "IPv4 addresses of action commands. Empty: the broadcast address of every network "
     "that has a camera."},
    REAL("action.lead_ms", action_lead_ms, "0", 0, 1000, "ms",
         "Above 0, commands are scheduled: sent this long before the instant at which all cameras "
         "act by their own clocks (needs ptp). 0: cameras act when the command arrives."),
    BOOL("action.acknowledge", action_acknowledge, "true",
         "Cameras answer each action command. Missing answers are counted."),

    INT("gige.packet_size", packet_size, "0", 0, 16384, "bytes",
        "GigE Vision packet size. 0: negotiate."),
    INT("gige.packet_delay_ns", packet_delay_ns, "0", 0, 1e9, "ns",
        "Pause of a GigE camera between two packets of a frame, so that cameras that expose "
        "together share a link. 0: as set in the camera."),
    CHOICE("gige.resend", resend, "auto", "auto|always|never",
           "Ask for lost packets again. auto: when the camera supports it."),
    INT("gige.socket_buffer", socket_buffer, "8388608", 65536, 1073741824, "bytes",
        "Receive buffer of each GigE camera, as far as net.core.rmem_max allows."),
    REAL("gige.frame_retention_ms", frame_retention_ms, "50", 1, 10000, "ms",
         "Longest wait for the packets of a frame. Good frames behind it wait as long."),
    REAL("gige.packet_timeout_ms", packet_timeout_ms, "5", 0.1, 1000, "ms",
         "Delay after which a missing packet is asked for again, and then every four times as "
         "long."),
    INT("gige.rt_priority", rt_priority, "10", 0, 99, "",
        "Real-time priority of the receiving threads. 0: none."),
    BOOL("gige.packet_socket", packet_socket, "true",
         "Receive by packet socket where it is allowed (CAP_NET_RAW). false: plain UDP."),

    REAL("sync.tolerance_ms", tolerance_ms, "0", 0, 10000, "ms",
         "Frames belong together when their exposures differ by no more. 0: a quarter of the "
         "period."),
    REAL("sync.max_wait_ms", max_wait_ms, "0", 0, 60000, "ms",
         "Longest wait for the missing frames of a set, from its first one. 0: 150, with wait "
         "500. Frames are held meanwhile: mind `buffers`."),
    CHOICE("sync.policy", policy, "drop", "drop|partial|wait|solve-with-what-is-there",
           "Handling of a set without all cameras. drop: it is dropped. wait: the set waits "
           "longer for slow cameras, and only lost cameras are left out. "
           "solve-with-what-is-there (or partial): it is solved with its cameras."),
    INT("sync.min_cameras", min_cameras, "2", 1, CAP_MAX_CAMERAS, "cameras",
        "Sets with fewer cameras are dropped, whatever the policy."),

    INT("binning", binning, "0", 0, 64, "pixels",
        "Raw pixels per side of a bin. 0: chosen from the grid."),
    INT("rays", rays, "0", 0, 16, "rays",
        "Rays per side of a bin. 0: 2, the mean over its area. 1 is faster and less accurate."),
    TEXT("matrix_cache", cache,
         "File of the system matrix. Empty: under $PYROVOX_CACHE, $XDG_CACHE_HOME or ~/.cache."),

    REAL("photometry.black", black, "0", 0, 1e6, "full scale",
         "Black level, subtracted. More than 1 for images of floating-point numbers only."),
    REAL("photometry.threshold", threshold, "-1", -1, 1e6, "full scale",
         "Brightness from which a pixel is flame. Negative: from the noise."),
    REAL("photometry.floor", floor, "0.004", 0, 1e6, "full scale",
         "Least automatic threshold. For pixels of more than 8 bits: half a percent of a dim "
         "picture's brightest bin."),
    REAL("photometry.auto_k", auto_k, "4", 0, 100, "sigma", "Automatic threshold over the noise."),
    REAL("photometry.saturation", saturation, "-1", -1, 1000, "full scale",
         "Brightness from which a pixel is saturated and does not count. Negative: 0.998, or "
         "off for images of floating-point numbers. 0: off."),
    INT("photometry.margin", margin, "0", 0, 100, "bins",
        "Silhouettes are grown by it to cover the calibration error."),
    BOOL("photometry.despeckle", despeckle, "true",
         "Lit bins without lit neighbours are noise (automatic threshold only)."),

    INT("hull.min_views", min_views, "2", 1, CAP_MAX_CAMERAS, "cameras",
        "A voxel seen by fewer cameras is empty."),
    BOOL("hull.keep_partial", keep_partial, "true",
         "Keep voxels that are only partly inside a silhouette."),

    REAL("model.absorption", absorption, "0", 0, 1e6, "per full scale",
         "Absorption of the flame's own light: kappa over its emission, as `pyrovox "
         "reconstruct --absorption auto` finds it in a recording. 0: none."),

    CHOICE("model.saturated", saturated, "left-out", "left-out|at-least",
           "Meaning of a saturated pixel: none, or at least that bright. Only pcg does this."),
    CHOICE("model.temporal", temporal, "off", "off|on",
           "Expect the previous volume, moved along the flame's motion, as far as the pictures "
           "agree. For noisy pictures of a flame that moves slowly. Only pcg does this."),
    CHOICE("model.selfcal", selfcal, "on", "off|gain|on",
           "Correct gain and aim (on), or gain alone, of the cameras in the solve, where the "
           "pictures show beyond chance that they are off. Only pcg does this, with four cameras "
           "or more."),
    BOOL("model.error_bars", error_bars, "false",
         "Send error bars with the volumes. After a set was published its solve is repeated once, "
         "at "
         "low priority and only if there is time. The bars of a volume come from the sets before "
         "it. Lossless: each set is solved 16 times more. Only pcg does this."),

    CHOICE("solver.name", solver, "pcg", &(REC_SOLVERS(ONE_MORE))[1],
           "Method of solution. All but pcg are for comparison."),
    INT("solver.iterations", iterations, "0", 0, 100000, "",
        "Most iterations. 0: the method's default."),
    REAL("solver.lambda", lambda, "-1", -1, 1e6, "", "Weight of smoothness. Negative: automatic."),
    CHOICE("solver.stop", stop, "auto", "auto|lcurve|discrepancy|iterations", "When to stop."),
    REAL("solver.deadline_ms", deadline_ms, "-1", -1, 1e6, "ms",
         "Time limit after the arrival of the last frame (lossless: after the start of the solve), "
         "at which the solver returns its best result. Negative: as long as keeps up with the "
         "cameras, and longer only while that gives no solution (none when lossless). 0: none."),
    CHOICE("solver.warm_start", warm_start, "auto", "auto|on|off",
           "Start from the previous volume. auto: live only, so that in a replay no set depends "
           "on another."),

    {"publish.endpoints", DMN_TEXTS, AT(endpoints), "[]", 0, 0, "", NULL,
     "ZeroMQ endpoints of the volumes. Empty: ipc in the run folder."},
    TEXT("publish.previews", previews,
         "Endpoint of the cameras' previews, which are made only for subscribers. Empty: the "
         "first ipc path of publish.endpoints followed by .previews. off: none."),
    TEXT("publish.temperature", temperature,
         "Endpoint of volumes in kelvin, the temperature of soot, which are made only for "
         "subscribers. Needs `spectral:` in the rig and model.error_bars. Empty: none."),
    CHOICE("publish.sample", sample, "f16", "f16|f32", "Number format of the voxels."),
    CHOICE("publish.compress", compress, "auto", "auto|none|lz4|zstd",
           "Compression of the voxels. auto: lz4 if an endpoint is for other hosts, else none."),
    BOOL("publish.wait_subscriber", wait_subscriber, "false",
         "Take no images before the first subscriber. For replays that are recorded."),
    INT("publish.hwm", hwm, "8", 1, 100000, "messages",
        "Messages kept for a slow subscriber. It loses more, and detects the gaps."),

    TEXT("control.endpoint", control,
         "ZeroMQ endpoint of `pyrovox status`. Empty: ipc in the run folder."),

    TEXT("metrics.endpoint", metrics,
         "Address and port of the counters for Prometheus, as 127.0.0.1:9464, GET /metrics. "
         "Empty: none. Other addresses than loopback need insecure: true."),

    TEXT("keys.server", key_server,
         "The daemon's key: a .key file of `pyrovox keygen`, or credential:NAME, given by "
         "systemd's LoadCredential=. With keys.clients, volumes may be published on any "
         "address and control may be on tcp://, encrypted and for listed keys only. ipc:// "
         "files, and volumes on loopback addresses, need no key. Read again on SIGHUP. After a "
         "change clients need the new key's public half."),
    TEXT("keys.clients", key_clients,
         "Keys of the clients: lines NAME read|control KEY, as in .pub files of `pyrovox "
         "keygen`. Read again on SIGHUP. A client that is no longer listed is disconnected."),

    CHOICE("record.mode", record_mode, "off", "off|raw",
           "raw: record the raw frames from the start (a take, HDF5). `record: raw` is the same. "
           "`pyrovox record --raw start` begins a take at any time."),
    {"record.path", DMN_TEXT, AT(record_path), "takes/%Y%m%d-%H%M%S.h5", 0, 0, "", NULL,
     "File of a take. % as in strftime(3), local time. Existing files are not overwritten."},
    INT("record.queue", record_queue, "8", 0, 64, "sets",
        "Frame sets that may wait for the disk. Each camera gets this number of `buffers` "
        "more. When the queue is full, sets are left out and listed in the take. The live "
        "solve never waits. 0: no recording is possible."),
    REAL("record.limit_gb", record_limit_gb, "0", 0, 1e6, "GB",
         "Size at which a take ends. 0: no limit."),
    REAL("record.roll_s", record_roll_s, "0", 0, 1e8, "s",
         "Time after which a recording, of raw frames or of volumes, goes on in another file "
         "or folder (NAME-0002, NAME-0003, ...). No set is lost between them. 0: one file."),
    REAL("record.keep_free_gb", record_keep_free_gb, "1", 0, 1e6, "GB",
         "Free space at which a recording ends. With less it does not begin."),
    REAL("record.sync_s", record_sync_s, "2", 0, 3600, "s",
         "Period of forcing recorded data to the disk, against a power cut. 0: never. A crash "
         "of the daemon loses nothing in either case."),

    {"record.ring", DMN_RING, AT(ring), "{}", 0, 0, "", NULL,
     "The last seconds of raw frames of all cameras, always kept in memory for triggers. "
     "{ seconds: 5, memory: 8GB }: so long, and no more than this memory. pre and post: seconds "
     "before and after the instant that an order without a name of `triggers` writes, 2 and 3 by "
     "default. Empty: none."},
    CHOICE("record.volumes", record_volumes, "none", "none|npy|hdf5|vdb|nvdb",
           "Record the volumes from the start, by `pyrovox record --format` beside the daemon. "
           "It ends with the daemon and is started again after a crash."),
    {"record.volumes_path", DMN_TEXT, AT(record_volumes_path), "takes/%Y%m%d-%H%M%S-volumes", 0, 0,
     "", NULL,
     "File or folder of these volumes. % as in record.path. The session, which raw takes "
     "carry too, and .h5 are added to it."},

    {"triggers", DMN_TRIGGERS, AT(triggers), "[]", 0, 0, "", NULL,
     "What makes a take of the frames in record.ring, each with a name. { name: ignition, when: "
     "appears, pre: 2, post: 3 } writes from 2 s before to 3 s after. when: order, light, height, "
     "change, appears or vanishes. Instead of when: at, a time in UTC. Levels: above, release, "
     "box, agree (sets), hold_off (s)."},

    INT("sim.seed", sim_seed, "1", 0, 4294967295.0, "", "Flame of the sim: cameras."),
    REAL("sim.period_s", sim_period_s, "2", 0.01, 3600, "s", "Period of the flame's motion."),
    REAL("sim.ignite_s", sim_ignite_s, "0", 0, 3600, "s",
         "The flame ignites once in each of these periods, at a random time, and burns for a third "
         "of it. 0: it always burns."),
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
