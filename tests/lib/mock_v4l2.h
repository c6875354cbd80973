/* mock_v4l2.h - a V4L2 camera that does what real ones do only when something is wrong.
 *
 * umockdev answers the ioctls of an unmodified client; the node is a regular file, so that it can be
 * mapped.  Programs that use it run under LD_PRELOAD=libumockdev-preload.so.0: mock_preload() starts
 * the program again that way.  poll() on the node is always ready, frames come at the rate that was
 * set (EAGAIN in between).
 * Each frame is filled with one byte: 1 + sequence % 250.
 * The switches may be changed at any time, under mock_lock/unlock. */
#ifndef MOCK_V4L2_H
#define MOCK_V4L2_H
#include <linux/videodev2.h>
#include <stdbool.h>
#include <stdint.h>

#define MOCK_BUFFERS 32

struct mock_camera {
    /* what it is: set before mock_plug */
    const char *card, *bus, *serial; /* serial NULL: a platform device */
    uint32_t caps;                   /* device_caps; 0 = single-planar capture */
    unsigned number, index;          /* of /dev/videoN; of the device's nodes */
    uint32_t fourcc[4];              /* formats, 0-terminated; all have 320x240 and 160x120 */

    /* switches */
    uint32_t substitute;   /* S_FMT silently gives this format */
    uint32_t bytesperline; /* 0 = tight */
    uint32_t field;        /* 0 = progressive */
    bool ranges;           /* sizes and rates are from .. to, not lists */
    bool no_parm;          /* ENOTTY */
    bool rate_fixed;       /* S_PARM keeps 30 Hz */
    unsigned max_buffers;  /* REQBUFS gives no more; 0 = 32 */
    uint32_t short_by;     /* bytes missing from each frame */
    unsigned error_every;  /* every n-th frame has V4L2_BUF_FLAG_ERROR */
    uint32_t stamp_flags;  /* V4L2_BUF_FLAG_TIMESTAMP_* | TSTAMP_SRC_*; default MONOTONIC, SOE */
    bool sequence_stays;   /* at 0, as v4l2loopback's */
    unsigned skip_every;   /* every n-th frame the sequence goes on by 3 */
    int dqbuf_errno;       /* from now on */
    int streamon_errno, s_fmt_errno, reqbufs_errno, open_errno; /* open: of QUERYCAP */
    unsigned interrupts;   /* so many ioctls end in EINTR first */
    uint32_t data_offset;  /* multi-planar */
    int control_errno;     /* S_EXT_CTRLS */
    int32_t control_keeps; /* >= 0: the exposure is this whatever is written */

    /* what happened */
    uint64_t frames, refused_reads; /* handed out; EAGAIN */
    unsigned queued, streamons, buffers;
    bool streaming;
    int32_t exposure_auto, exposure, priority, gain, autogain;
    struct mock_state *state;
};

void mock_preload(
    char **argv); /* first thing in main; returns in the process that has it preloaded */
void mock_start(void);
void mock_stop(void);
void mock_lock(void);
void mock_unlock(void);
/* Defaults: a USB webcam with YUYV, GREY, MJPG. */
void mock_init(struct mock_camera *c, unsigned number, const char *serial);
void mock_plug(struct mock_camera *c);
void mock_unplug(struct mock_camera *c); /* ENODEV for those who have it open; the node goes */
#endif
