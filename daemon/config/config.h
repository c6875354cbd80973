/* config.h - how the daemon runs: pyrovoxd.yaml, read strictly.
 *
 * Refused with "file:line: key: reason": unknown and duplicate keys, wrong types, values outside
 * their range.  Every key has a default; `rig` and `cameras` must be given to run.
 *     rig: rig.yaml
 *     cameras: "aravis:127.0.0.2+"     # all cameras of the rig, in its order: .2, .3, .4 ...
 * or  cameras: { cam0: "aravis:GV01", cam3: "aravis:GV04" }   # the others of the rig are left out
 * In a pattern for all, {name} is the camera's name and a trailing + counts the number before it up.
 * File names are relative to the configuration file.  Threads: constant once read. */
#ifndef DMN_CONFIG_H
#define DMN_CONFIG_H
#include <limits.h>
#include <stdbool.h>
#include <stdint.h>
#include "base/err.h"
#include "capture/sync/frameset.h"
#include "capture/pixel/pixfmt.h"
#include "daemon/config/options.h"
#include "daemon/config/triggers.h"
#include "recon/frame/frame.h"
#include "recon/geom/rig.h"

struct dmn_config {
    char dir[PATH_MAX]; /* relative names start here */
    char name[PATH_MAX];

    char rig[DMN_WORD_MAX];
    struct dmn_pairs cameras;
    struct dmn_ints grid;
    int basis;    /* 0 as the rig says, 1 box, 2 trilinear */
    int channels; /* 0 auto, 1 one, 2 three */
    int64_t threads;
    char compute[DMN_WORD_MAX]; /* compute.h */
    int log_level;

    double fps;
    int pixel_format; /* enum cap_pixfmt */
    int transfer;     /* enum cap_transfer */
    int bayer;        /* 0 auto, 1 rays, 2 demosaic */
    int trigger;      /* enum cap_trigger */
    char trigger_line[DMN_WORD_MAX];
    int ptp;
    double ptp_offset_us;
    int shared_clock, lossless, loop;
    int64_t discard_first, buffers;
    double exposure_us, gain;
    int chunks;
    struct dmn_pairs features, camera_features;

    int64_t action_device_key, action_group_key, action_group_mask;
    struct dmn_texts action_addresses;
    double action_lead_ms;
    int action_acknowledge;

    int64_t packet_size, packet_delay_ns, socket_buffer, rt_priority;
    int resend; /* enum cap_resend */
    double frame_retention_ms, packet_timeout_ms;
    int packet_socket;

    double tolerance_ms, max_wait_ms;
    int policy; /* enum cap_policy; 3 = CAP_POLICY_PARTIAL too */
    int64_t min_cameras;

    int64_t binning, rays;
    char cache[DMN_WORD_MAX];

    double black, threshold, floor, auto_k, saturation;
    int64_t margin;
    int despeckle;

    int64_t min_views;
    int keep_partial;

    double absorption;
    int saturated; /* 0 left out, 1 at least */
    int error_bars;

    int trust; /* 0 vote, 1 all */

    int solver;
    int64_t iterations;
    double lambda;
    int stop;
    double deadline_ms;
    int warm_start; /* 0 auto, 1 on, 2 off */
    int temporal;   /* 0 off, 1 on */
    int selfcal;    /* enum rec_selfcal_mode */

    struct dmn_texts endpoints;
    char previews[DMN_WORD_MAX], temperature[DMN_WORD_MAX];
    int sample, compress;
    int64_t hwm;
    int wait_subscriber;
    char control[DMN_WORD_MAX], metrics[DMN_WORD_MAX];
    int insecure;
    char key_server[DMN_WORD_MAX], key_clients[DMN_WORD_MAX];

    int record_mode; /* 0 off, 1 raw */
    char record_path[DMN_WORD_MAX];
    int64_t record_queue;
    int record_volumes; /* 0 none, 1 npy, 2 hdf5, 3 vdb, 4 nvdb */
    char record_volumes_path[DMN_WORD_MAX];
    double record_limit_gb, record_roll_s, record_keep_free_gb, record_sync_s;
    struct dmn_ring ring;
    struct dmn_triggers triggers;

    int64_t sim_seed;
    double sim_period_s, sim_ignite_s;
};

/* All defaults; dir "." */
void dmn_config_defaults(struct dmn_config *c);
/* Parse text over the defaults; `name` is what messages call the file. */
PVX_MUST_CHECK pvx_err dmn_config_parse(const char *text, size_t len, const char *name,
                                        struct dmn_config *c, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err dmn_config_load(const char *path, struct dmn_config *c, struct pvx_diag *d);
/* One key as a command line gives it: value is YAML, messages begin with `name`. */
PVX_MUST_CHECK pvx_err dmn_config_set(struct dmn_config *c, const char *key, const char *value,
                                      const char *name, struct pvx_diag *d);
/* One value as it would stand in the file.  Owner: caller, free(); NULL when out of memory. */
char *dmn_config_value(const struct dmn_config *c, const struct dmn_option *o);
/* YAML text with every key, explained, that dmn_config_parse reads back to the same values.
 * Owner: caller, free(); NULL when out of memory. */
char *dmn_config_format(const struct dmn_config *c);

/* `name` as the daemon opens it: an absolute name unchanged, else under c->dir. */
void dmn_config_path(const struct dmn_config *c, const char *name, char *out, size_t size);
/* Source of the camera `name`, number `index` of the rig: "" when it is not in the configuration.
 * PVX_EINVAL: a pattern that cannot be continued. */
PVX_MUST_CHECK pvx_err dmn_config_source(const struct dmn_config *c, const char *name, size_t index,
                                         char *out, size_t size, struct pvx_diag *d);

/* The rig that the configuration names, with its grid and basis overridden and only the cameras
 * that have a source.  Owner: caller, rec_rig_fini. */
PVX_MUST_CHECK pvx_err dmn_config_rig(const struct dmn_config *c, struct rec_rig *out,
                                      struct pvx_diag *d);
/* PVX_EINVAL: no camera of the rig, read from `path`, sees its volume.  What else recon/geom/blind.h finds is a warning. */
PVX_MUST_CHECK pvx_err dmn_config_sees(const struct rec_rig *rig, const char *path,
                                       struct pvx_diag *d);
/* Whether a camera is simulated (sim:) and so looks at a scene. */
bool dmn_config_simulated(const struct dmn_config *c);
enum cap_pixfmt dmn_config_pixfmt(const struct dmn_config *c);
/* Channels that are reconstructed, 1 or 3. */
int dmn_config_channels(const struct dmn_config *c);
/* Chooses how Bayer pixels at binning 1 are used; bayer: 0 auto, 1 rays, 2 demosaic.  Auto means rays if they can
 * be solved for.  false: rays are asked for, but cannot be used. */
bool dmn_choose_mosaic(int bayer, const char *solver, int channels, enum cap_mosaic *out);
/* The same for c.  PVX_EINVAL: rays are asked for, but cannot be used with the solver or the channels. */
PVX_MUST_CHECK pvx_err dmn_config_mosaic(const struct dmn_config *c, enum cap_mosaic *out,
                                         struct pvx_diag *d);
/* PVX_EINVAL: error bars are asked for, but cannot be made with the solver. */
PVX_MUST_CHECK pvx_err dmn_config_bars(const struct dmn_config *c, struct pvx_diag *d);
/* What c asks for that only the processors can do, in a few words; NULL: nothing. */
const char *dmn_config_card_why_not(const struct dmn_config *c);
/* PVX_EINVAL: `compute` asks for a device that cannot do what other keys ask for. */
PVX_MUST_CHECK pvx_err dmn_config_compute(const struct dmn_config *c, struct pvx_diag *d);
/* The parameters of recon for each frame set. */
void dmn_config_frame(const struct dmn_config *c, struct rec_frame_params *out);
/* Solver's time limit after the arrival of the set's last frame (lossless: after it began), ns; 0 = none. */
int64_t dmn_config_deadline(const struct dmn_config *c);
/* Whether a solve starts from the volume before. */
int dmn_config_warm(const struct dmn_config *c);

#endif
