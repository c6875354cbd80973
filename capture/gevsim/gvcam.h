/* gvcam.h - simulated GigE Vision cameras of our own: GVCP and GVSP on real sockets, our pixels.
 *
 * The cameras of one simulation share a cap_gvnet: one thread that serves them all, a hardware trigger line to each
 * (TriggerSource Line1), and a network switch.  A cap_gvcam is one camera at an address of this host, UDP port 3956.
 * Clients cannot distinguish it from a physical camera.  It has discovery, registers, GenICam XML, control privilege
 * with heartbeat, stream with packet delay and packet resend, software, line and action trigger (also scheduled),
 * time-stamp latch, PTP, chunks.
 *
 * What a frame shows (all cameras of a host show the same instant):
 *     free run    Frames are exposed at multiples T of the frame period (host CLOCK_REALTIME), with image
 *                 i = floor(T ring_fps) of the ring.  At the ring's rate the stamp is that image's own instant
 *                 i/ring_fps, so it is exact for the scene.  At any other rate it is T.
 *     triggered   The image of the instant of the trigger, stamped with that instant: the edge of the line, the
 *                 arrival of the command, or the time that an action was scheduled for.
 * cap_gvcam_index gives the image for a stamp in both cases.
 * Device clock: host CLOCK_REALTIME + skew, drifting, or from 0 at the start (boot_clock); with PTP
 * on, after ptp_settle_ms, host CLOCK_REALTIME + TAI offset to within 100 ns, in ns.
 * Samples of another depth than the ring's: with the 16-bit value s (v * 257 from 8 bits), s >> (16 - depth).
 * Mono from RGB is (R + G + B) / 3 of the 16-bit values.  Bayer from RGB takes each pixel's own channel.
 * A camera sends no faster than its cable allows (1 Gbit/s), because eight bursts at the speed of loopback overrun
 * the kernel's queues (net.core.netdev_max_backlog) on a busy machine.
 * Frame ids: 16 bits, 65535 is followed by 1; or 64 bits (feature GevGVSPExtendedIDMode).
 *
 * Faults can be changed while a camera runs, are per camera, and are counted: struct cap_gvcam_fault, cap_gvcam_do.
 * The counts are the truth for comparison with a receiver's counts.  See feature.c for the features.
 * Addresses must belong to an interface: netns.h has a private network for an ordinary user.
 * Threads: any thread may call anything; a net must outlive its cameras.
 * Cost: without conversion, packets are sent straight from the ring, by sendmmsg. */
#ifndef CAP_GVCAM_H
#define CAP_GVCAM_H
#include <math.h>
#include <stdbool.h>
#include "base/err.h"
#include "capture/gevsim/optics.h"
#include "capture/pixel/image.h"

#define CAP_GVCAM_NAME_MAX 15 /* characters */
#define CAP_GVCAM_LATE_MAX 63 /* frames */

typedef struct cap_gvnet cap_gvnet;
typedef struct cap_gvcam cap_gvcam;

/* PVX_ENOMEM, PVX_EIO. */
PVX_MUST_CHECK pvx_err cap_gvnet_new(cap_gvnet **out, struct pvx_diag *d);
void cap_gvnet_free(cap_gvnet **net);
/* Pulses on Line1 at multiples of 1/hz (host CLOCK_REALTIME); 0 = none, the default. */
void cap_gvnet_line(cap_gvnet *net, double hz);
void cap_gvnet_pulse(cap_gvnet *net); /* one, now */
/* The link from the switch to the host: mbit_s (0 = no limit) with a buffer of buffer_bytes (0 = 512 KiB).  Packets
 * that find the buffer full are dropped, also in the middle of frames. */
void cap_gvnet_link(cap_gvnet *net, double mbit_s, size_t buffer_bytes);
/* From now on all cameras show image number `image` of their rings at any instant, for a scene that stands still or
 * is moved by hand.  -1 = the image of the instant, the default. */
void cap_gvnet_show(cap_gvnet *net, int64_t image);
/* The switch reboots: it passes nothing for `seconds`.  The cameras run on. */
void cap_gvnet_reboot(cap_gvnet *net, double seconds);

struct cap_gvcam_config {
    const char *address;   /* "127.0.0.2" */
    const char *serial;    /* "SIM00", at most CAP_GVCAM_NAME_MAX */
    const char *user_name; /* "cam0", likewise; NULL = none */
    enum cap_pixfmt fmt;   /* of the ring: Mono8, Mono16, RGB8, RGB16, any Bayer of 8 or 16 bits */
    int32_t width, height; /* 1..16384 */
    const void *const *ring; /* [n_ring] images, tightly packed, borrowed */
    size_t n_ring;
    /* Called before image k is sent; or NULL.  If the image was made with other optics, makes it again in place and
     * returns true.  Called with the net locked, never twice at once for a camera, so it must not call this
     * interface. */
    bool (*renew)(void *ctx, size_t k, const struct cap_optics *o);
    void *renew_ctx;
    double ring_fps;      /* images per second of scene time */
    double tick_hz;       /* of the device clock without PTP; 0 = 1e9 */
    double link_mbit;     /* of the camera's own cable; 0 = 1000.  It limits the frame rate too */
    double ptp_settle_ms; /* PtpEnable to Slave; 0 = 2000 */
    double tai_offset_s;  /* of the grandmaster's clock from the host's; 0 */
    double reboot_s;      /* how long DeviceReset takes; 0 = 2 */
    uint16_t first_id;    /* 0 = 65401, so that the wrap comes soon */
    bool boot_clock;      /* device clock counts from the start of the camera */
    bool zip;             /* GenICam file zipped */
    bool no_resend;       /* reports that it cannot resend packets, and refuses requests */
};

/* "share": 0..1 of the frames, packets or triggers, at random (repeatable per address). */
struct cap_gvcam_fault {
    double skew_us, drift_ppm; /* of the camera's clock without PTP */
    double drop;               /* share of frames numbered but never sent */
    double packet_loss;        /* share of packets lost, resent ones too */
    double delay_ms;           /* each frame is sent this much late (stamp unchanged) */
    double jitter_ms;          /* and by up to this much more */
    double reorder;            /* share of packets that are overtaken by up to three others */
    double duplicate;          /* share of packets sent twice */
    double wrong_size;         /* share of frames with another width announced, or cut short */
    double corrupt;            /* share of frames with a garbled packet head or a packet too long */
    double miss;               /* share of triggers ignored: no number is used up */
    double inputs;  /* levels of its lines: bits of LineStatusAll, beside the trigger line's (0) */
    double hostile; /* share of frames, and of acknowledges, after malformed packets */
    double ptp_offset_us; /* a badly synchronised PTP slave is off by this, and reports it */
    double late;          /* frames: the image is from so many frames before, the stamp is not */
    bool freeze;          /* the same image and stamp again and again */
    bool still;           /* the same image, but stamps go on */
    bool stuck_clock;     /* the device clock stands still, and so do stamps */
    bool no_ptp_master;   /* PTP stays at Listening, or falls back to it */
    bool ptp_master;      /* it hears no other master and is one itself, by its own clock */
    bool lock_trigger;    /* TriggerMode and TriggerSource cannot be set while it takes frames */
    struct cap_optics optics; /* for `renew`; healthy is cap_optics_none, not 0 */
};

enum cap_gvcam_act {
    CAP_GVCAM_REBOOT,       /* silent for arg seconds (0 = reboot_s), then as after power-up */
    CAP_GVCAM_CLOCK_JUMP,   /* the device clock goes forward by arg seconds (may be negative) */
    CAP_GVCAM_RESTART_IDS,  /* the next frame has number arg, 1 to 2^53 (0 = 1) */
    CAP_GVCAM_TRIGGER_MODE, /* becomes Off (arg 0) or On, also if another program has control */
};

struct cap_gvcam_stats {
    uint64_t exposed;  /* frames: = sent + dropped + overrun + still queued or flushed */
    uint64_t frames;   /* sent, to the last packet */
    uint64_t dropped;  /* numbered but not sent: drop */
    uint64_t overrun;  /* numbered but not sent: the camera's queue was full */
    uint64_t triggers; /* triggers that reached a camera which waited for them */
    uint64_t missed;   /* of these, ignored: miss */
    uint64_t too_fast; /* of these, ignored: an exposure was in progress */
    uint64_t packets;  /* sent to the network, resent ones too */
    uint64_t lost;     /* packets not sent: packet_loss */
    uint64_t cut;      /* packets dropped by the switch: link limit, reboot */
    uint64_t asked;    /* requests for packets that did not come, granted or not */
    uint64_t resent;   /* packets sent again on request */
    uint64_t gone;     /* requested packets that were no longer stored */
    uint64_t torn;     /* frames sent with at least one packet lost or cut */
    uint64_t reordered, duplicated, wrong_size, corrupt, hostile;
    uint64_t commands;   /* GVCP requests understood */
    uint64_t refused;    /* GVCP requests answered with an error, or not at all */
    uint64_t heartbeats; /* how often control was withdrawn because no heartbeat came */
    uint64_t reboots;
    uint64_t send_errors; /* packets the kernel did not take (larger than the MTU, no buffer) */
};
struct cap_gvcam_stat_def {
    const char *name;
    size_t offset;
};
extern const struct cap_gvcam_stat_def cap_gvcam_stat_defs[]; /* ends with a NULL name */

/* Makes a camera and starts to serve it.  PVX_EBUSY: address in use; PVX_ENOENT: not an address of this host (diag:
 * how to get it); PVX_EINVAL; PVX_ENOMEM; PVX_EIO. */
PVX_MUST_CHECK pvx_err cap_gvcam_new(cap_gvnet *net, const struct cap_gvcam_config *c,
                                     cap_gvcam **out, struct pvx_diag *d);
void cap_gvcam_set_fault(cap_gvcam *cam, const struct cap_gvcam_fault *f);
void cap_gvcam_do(cap_gvcam *cam, enum cap_gvcam_act act, double arg);
void cap_gvcam_stats(cap_gvcam *cam, struct cap_gvcam_stats *out);
void cap_gvcam_free(cap_gvcam **cam); /* = kill: stops answering at once */

/* Number (not yet modulo n_ring) of the ring image that belongs to stamp t.  For stamps that went through a clock
 * map, the tolerance is a quarter of the ring period below and three quarters above. */
static inline int64_t cap_gvcam_index(int64_t t_ns, double ring_fps)
{
    return (int64_t)floorl((long double)t_ns * (long double)ring_fps / 1e9L + 0.25L);
}
#endif
