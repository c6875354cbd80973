/* gvcam_int.h - inside of the simulated camera (private to gvcam*.c): one net thread owns all state;
 * every function here is called with the net's lock held. */
#ifndef CAP_GVCAM_INT_H
#define CAP_GVCAM_INT_H
#include <netinet/in.h>
#include <pthread.h>
#include <poll.h>
#include <sys/socket.h>

#include "capture/wire/be.h"
#include "capture/gevsim/gvcam.h"
#include "capture/gvcam_feature.h"
#include "capture/wire/gvcp.h"
#include "capture/wire/gvsp.h"

#define GVCAM_QUEUE      1024 /* frames taken, waiting to be sent */
#define GVCAM_HISTORY    8    /* frames sent that can be asked for again */
#define GVCAM_TAIL       160  /* bytes of chunks after the image */
#define GVCAM_BATCH      32   /* packets in one system call */
#define GVCAM_ACTIONS    16   /* scheduled actions that wait */
#define GVCAM_PACKET_MIN 220
#define GVCAM_PACKET_MAX 16404
#define GVCAM_NEVER      INT64_MAX

/* The device clock: dev0 + (t - host0)(1 + drift) while PTP does not hold it. */
struct gvcam_clock {
    int64_t host0, dev0;
    double drift_ppm, skew_us;
    bool stuck;
    int64_t stuck_ns;
    int64_t ptp_since; /* host time of PtpEnable; 0 = off */
    bool ptp_locked;   /* was Slave when last looked at */
};
enum gvcam_ptp {
    GVCAM_PTP_INITIALIZING = 1,
    GVCAM_PTP_DISABLED = 3,
    GVCAM_PTP_LISTENING = 4,
    GVCAM_PTP_MASTER = 6,
    GVCAM_PTP_UNCALIBRATED = 8,
    GVCAM_PTP_SLAVE = 9
};

/* One frame that was taken. */
struct gvcam_shot {
    uint64_t id;
    int64_t index;   /* image, not yet modulo n_ring */
    int64_t send_at; /* host ns */
    uint64_t ticks;  /* stamp */
    uint32_t line;   /* LineStatusAll */
    uint32_t count;  /* frames since the start */
    float exposure_us, gain;
    uint8_t wrong;   /* 1: width, 2: rows */
    uint8_t corrupt; /* 1: a head, 2: a long packet */
    bool hostile;
};
/* A frame on its way out, or still remembered. */
struct gvcam_sent {
    struct gvcam_shot shot;
    bool used, torn;
    const uint8_t *image;
    size_t image_bytes, tail_bytes;
    uint8_t tail[GVCAM_TAIL];
    uint32_t per_packet;   /* bytes of it in a data packet; SCPS may be another by now */
    uint32_t n_data, next; /* data packets; next packet to send: 0 leader .. n_data + 1 trailer */
};

struct cap_gvcam {
    cap_gvnet *net;
    struct cap_gvcam *next;
    struct cap_gvcam_config c;
    char *strings[3];
    const void **ring;
    size_t image_bytes; /* of one in the ring */
    struct in_addr addr, mask;
    unsigned ifindex;
    int control, stream; /* sockets */
    uint16_t stream_port;
    uint64_t rng;
    uint8_t boot[0x100]; /* bootstrap registers 0x0000.. */
    char url[512];
    uint8_t *xml;
    size_t xml_bytes;

    struct cap_gvcam_fault fault;
    struct cap_gvcam_stats stats;
    uint32_t v[GVCAM_N_FEATURES]; /* registers; floats as their bits */
    uint32_t user_set[GVCAM_N_FEATURES];

    /* control */
    uint32_t ccp;
    struct sockaddr_in owner;
    int64_t heartbeat_at; /* last sign of life of the owner */
    struct {
        struct sockaddr_in from;
        uint16_t id, command;
        uint8_t ack[CAP_GVCP_MAX];
        size_t n;
    } last;             /* last command that changed something, for retransmissions */
    uint32_t df;        /* do not fragment */
    int64_t gone_until; /* rebooting; 0 = there */

    struct gvcam_clock clock;
    uint64_t latched;
    uint32_t ptp_status_latched;
    int64_t ptp_offset_latched;

    /* acquisition */
    bool acquiring;
    uint64_t id;
    int64_t tick; /* number of the last free-run tick */
    double tick_rate;
    int64_t last_moment;  /* host ns of the last frame */
    int64_t busy_until;   /* exposure */
    int64_t trigger_at;   /* delayed trigger; GVCAM_NEVER = none */
    uint32_t frames_left; /* single, multi */
    bool frozen;
    int64_t frozen_index;
    uint64_t frozen_ticks;
    int64_t action[GVCAM_ACTIONS]; /* device ns */
    size_t n_actions;
    uint32_t frame_count; /* chunk FrameID low part: frames since start */

    /* what AcquisitionStart fixed */
    enum cap_pixfmt fmt;
    uint32_t region[4]; /* width, height, x, y */
    bool wide, chunks;
    uint8_t **conv; /* [n_ring] converted images, made when first sent */
    size_t frame_bytes;

    /* stream */
    struct gvcam_shot queue[GVCAM_QUEUE];
    size_t q_first, q_n;
    struct gvcam_sent history[GVCAM_HISTORY];
    size_t h_next;
    struct gvcam_sent *cur;
    int64_t packet_at; /* not before, packet delay */
};

struct cap_gvnet {
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t looked;
    int wake; /* eventfd */
    bool stop;
    bool polling;   /* the thread waits for sockets, and keeps them open by that */
    uint64_t polls; /* times that it has waited */
    struct cap_gvcam *cams;
    struct gvcam_caster {
        int fd;
        struct in_addr addr;
        struct gvcam_caster *next;
    } * casters; /* sockets for broadcasts */
    double line_hz;
    int64_t line_tick;
    uint32_t line_level;
    double link_bytes_per_ns;
    size_t link_buffer;
    double link_level;
    int64_t link_at, silent_until;
};

int64_t gvcam_now(void); /* host CLOCK_REALTIME */
double gvcam_uniform(struct cap_gvcam *c);
static inline bool gvcam_chance(struct cap_gvcam *c, double share)
{
    return share > 0 && gvcam_uniform(c) < share;
}

/* gvcam.c: a camera that has no network yet (that is enough to talk to it: the fuzz target). */
PVX_MUST_CHECK pvx_err gvcam_build(cap_gvnet *net, const struct cap_gvcam_config *config,
                                   struct cap_gvcam **out);
void gvcam_destroy(struct cap_gvcam *c);

/* gvcam_clock.c */
void gvcam_clock_start(struct cap_gvcam *c, int64_t now);
int64_t gvcam_clock_ns(struct cap_gvcam *c, int64_t now); /* device time */
uint64_t gvcam_clock_ticks(const struct cap_gvcam *c, int64_t dev_ns);
uint64_t gvcam_clock_hz(const struct cap_gvcam *c);
void gvcam_clock_faults(struct cap_gvcam *c, const struct cap_gvcam_fault *f, int64_t now);
void gvcam_clock_jump(struct cap_gvcam *c, int64_t now, int64_t ns);
void gvcam_clock_reset(struct cap_gvcam *c, int64_t now); /* to 0, unless PTP holds it */
void gvcam_ptp_enable(struct cap_gvcam *c, int64_t now, bool on);
enum gvcam_ptp gvcam_ptp_status(const struct cap_gvcam *c, int64_t now);
int64_t gvcam_ptp_offset_ns(struct cap_gvcam *c, int64_t now); /* camera - master */

/* gvcam_xml.c: c->xml, c->url */
PVX_MUST_CHECK pvx_err gvcam_xml_make(struct cap_gvcam *c);

/* gvcam_reg.c: 32-bit registers; enum cap_gvcp_status */
void gvcam_reg_reset(struct cap_gvcam *c); /* as after power-up */
uint16_t gvcam_reg_read(struct cap_gvcam *c, uint32_t address, int64_t now, uint32_t *out);
uint16_t gvcam_reg_write(struct cap_gvcam *c, uint32_t address, int64_t now, uint32_t value);
float gvcam_float(const struct cap_gvcam *c, enum gvcam_feature f);

/* gvcam_control.c */
void gvcam_control_datagram(struct cap_gvcam *c, const uint8_t *p, size_t n,
                            const struct sockaddr_in *from, int64_t now);
void gvcam_control_release(struct cap_gvcam *c); /* nobody controls it: acquisition stops */
int64_t gvcam_control_step(struct cap_gvcam *c, int64_t now); /* heartbeat */

/* gvcam_take.c */
void gvcam_start(struct cap_gvcam *c, int64_t now);
void gvcam_stop(struct cap_gvcam *c);
enum gvcam_trigger { GVCAM_SOFTWARE, GVCAM_LINE1, GVCAM_ACTION1 };
void gvcam_trigger(struct cap_gvcam *c, enum gvcam_trigger source, int64_t at);
/* An action that is meant for this camera: CAP_GVCP_... */
uint16_t gvcam_action(struct cap_gvcam *c, const struct cap_gvcp_action *a, int64_t now);
int64_t gvcam_take_step(struct cap_gvcam *c, int64_t now); /* next time it wants to be called */
double gvcam_rate(const struct cap_gvcam *c);              /* free run, frames per second */

/* gvcam_send.c */
int64_t gvcam_send_step(struct cap_gvcam *c, int64_t now);
void gvcam_resend(struct cap_gvcam *c, const struct cap_gvcp_resend *r);
void gvcam_test_packet(struct cap_gvcam *c);
uint32_t gvcam_payload(const struct cap_gvcam *c); /* bytes of a frame as the registers stand */
void gvcam_forget(struct cap_gvcam *c);            /* nothing queued, under way or remembered */

/* gvcam_pixel.c */
size_t gvcam_formats(const struct cap_gvcam *c, enum cap_pixfmt *out, size_t max);
bool gvcam_offers(const struct cap_gvcam *c, enum cap_pixfmt f);
const uint8_t *gvcam_image(struct cap_gvcam *c, int64_t index); /* as started; NULL = no memory */
void gvcam_images_drop(struct cap_gvcam *c);

/* gvcam_chunk.c */
size_t gvcam_chunks(const struct cap_gvcam *c, const struct gvcam_shot *s, uint8_t *out);
size_t gvcam_chunks_max(const struct cap_gvcam *c);

/* gvcam_hostile.c */
void gvcam_hostile_acks(struct cap_gvcam *c, const struct cap_gvcp_request *r,
                        const struct sockaddr_in *to);
void gvcam_hostile_packets(struct cap_gvcam *c, const struct gvcam_shot *s);

/* gvnet.c: may a packet of so many bytes go out?  (link, silence)  Counts. */
bool gvnet_pass(struct cap_gvcam *c, size_t bytes, int64_t now);
bool gvnet_silent(const struct cap_gvnet *n, int64_t now);
void gvcam_reboot(struct cap_gvcam *c, int64_t now, double seconds);
struct sockaddr_in gvcam_target(const struct cap_gvcam *c); /* of the stream; port 0 = none */
#endif
