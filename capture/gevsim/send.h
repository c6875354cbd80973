/* send.h - sends frames as packets. */
#ifndef CAP_GVCAM_SEND_H
#define CAP_GVCAM_SEND_H
#include <netinet/in.h>

#include "capture/gevsim/gvcam.h"
#include "capture/wire/gvcp.h"

#define GVCAM_QUEUE      1024 /* frames exposed, waiting to be sent */
#define GVCAM_HISTORY    8    /* frames sent that can be asked for again */
#define GVCAM_TAIL       160  /* bytes of chunks after the image */
#define GVCAM_BATCH      32   /* packets in one system call */
#define GVCAM_PACKET_MIN 220
#define GVCAM_PACKET_MAX 16404

/* One frame as it was exposed. */
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
/* A frame that is being sent, or was sent and is still remembered. */
struct gvcam_sent {
    struct gvcam_shot shot;
    bool used, torn;
    const uint8_t *image;
    size_t image_bytes, tail_bytes;
    uint8_t tail[GVCAM_TAIL];
    uint32_t per_packet;   /* bytes of it in a data packet; SCPS may have changed since */
    uint32_t n_data, next; /* data packets; next packet to send: 0 leader .. n_data + 1 trailer */
};

/* pixel.c: the ring's images as AcquisitionStart found the format and region. */
struct gvcam_image {
    enum cap_pixfmt fmt;
    uint32_t region[4]; /* width, height, x, y */
    size_t frame_bytes;
    uint8_t **conv; /* [n_ring] converted images, made when first sent */
};
void gvcam_image_start(struct cap_gvcam *c);
size_t gvcam_formats(const struct cap_gvcam *c, enum cap_pixfmt *out, size_t max);
bool gvcam_offers(const struct cap_gvcam *c, enum cap_pixfmt f);
size_t gvcam_image_number(const struct cap_gvcam *c, int64_t index); /* modulo n_ring */
const uint8_t *gvcam_image_of(struct cap_gvcam *c, int64_t index);   /* NULL = no memory */
void gvcam_image_drop(struct cap_gvcam *c);

/* chunk.c */
size_t gvcam_chunks(const struct cap_gvcam *c, const struct gvcam_shot *s, uint8_t *out);
size_t gvcam_chunks_max(const struct cap_gvcam *c);

/* hostile.c */
void gvcam_hostile_acks(struct cap_gvcam *c, const struct cap_gvcp_request *r,
                        const struct sockaddr_in *to);
void gvcam_hostile_packets(struct cap_gvcam *c, const struct gvcam_shot *s,
                           const struct sockaddr_in *to);

/* send.c */
struct gvcam_send {
    int fd;
    uint16_t port;
    bool wide, chunks; /* as AcquisitionStart found them */
    struct gvcam_shot queue[GVCAM_QUEUE];
    size_t q_first, q_n;
    struct gvcam_sent history[GVCAM_HISTORY];
    size_t h_next;
    struct gvcam_sent *cur;
    int64_t packet_at; /* not before, packet delay */
};
void gvcam_send_start(struct cap_gvcam *c);
void gvcam_send_forget(struct cap_gvcam *c); /* drop frames queued, being sent or remembered */
bool gvcam_send_queue(struct cap_gvcam *c, const struct gvcam_shot *s); /* false: full */
int64_t gvcam_send_step(struct cap_gvcam *c, int64_t now); /* when it wants to be called next */
void gvcam_send_again(struct cap_gvcam *c, const struct cap_gvcp_resend *r);
void gvcam_send_test(struct cap_gvcam *c);
uint32_t gvcam_payload(const struct cap_gvcam *c); /* bytes of a frame as the registers stand */
#endif
