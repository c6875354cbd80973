/* fuzz_gvcp.c - any bytes as GVCP datagrams to a simulated camera, and as GVSP packets to the parser.
 * Input: records of u8 who (0 or 1: one of two clients; + 2: half a second later), u8 length, bytes. */
#include <string.h>

#include "base/clock.h"
#include "capture/gevsim/gevsim.h"
#include "tests/fuzz/fuzz.h"
#include "tests/lib/gvsp_read.h"

#define W 16
#define H 8

static struct cap_gvcam *camera(struct gvcam_link *link)
{
    static unsigned char image[W * H * 3];
    static const void *const ring[1] = {image};
    const struct cap_gvcam_config config = {.address = "127.0.0.2",
                                            .serial = "F",
                                            .fmt = CAP_RGB8,
                                            .width = W,
                                            .height = H,
                                            .ring = ring,
                                            .n_ring = 1,
                                            .ring_fps = 10};
    struct cap_gvcam *c = NULL;
    MUST(gvcam_build(link, &config, &c) == PVX_OK);
    c->rng = 1;
    return c;
}

static void check(const struct cap_gvcam *c)
{
    MUST(c->send.q_n <= GVCAM_QUEUE && c->expose.n_actions <= GVCAM_ACTIONS &&
         c->reg.v[GVF_SCPS] >= GVCAM_PACKET_MIN && c->reg.v[GVF_SCPS] <= GVCAM_PACKET_MAX &&
         c->reg.v[GVF_WIDTH] >= 1 && c->reg.v[GVF_WIDTH] + c->reg.v[GVF_OFFSET_X] <= W &&
         c->reg.v[GVF_HEIGHT] >= 1 && c->reg.v[GVF_HEIGHT] + c->reg.v[GVF_OFFSET_Y] <= H &&
         gvcam_offers(c, cap_pixfmt_from_pfnc(c->reg.v[GVF_PIXEL_FORMAT])));
}

static void stream_packet(const uint8_t *p, size_t n)
{
    struct cap_gvsp_head h;
    struct cap_gvsp_leader l;
    uint8_t back[CAP_GVSP_HEAD_WIDE];
    size_t m = gvsp_head(p, n, &h);
    MUST(m <= n);
    if (m > 0) {
        MUST(cap_gvsp_put_head(back, &h) == m && memcmp(back, p, 2) == 0);
        (void)gvsp_leader(p + m, n - m, &l);
    }
}

static void datagram(struct cap_gvcam *c, uint8_t who, const uint8_t *p, size_t n, int64_t *now)
{
    struct sockaddr_in from = {.sin_family = AF_INET, .sin_port = htons(1000 + (who & 1))};
    struct cap_gvcp_answer answer;
    uint8_t *exact = malloc(n + 1); /* so that a byte too many is seen */
    if (exact == NULL)
        return;
    memcpy(exact, p, n);
    *now += (who & 2) != 0 ? 500000000 : 1000;
    gvcam_control_datagram(c, exact, n, &from, *now);
    (void)gvcam_control_step(c, *now);
    (void)gvcam_expose_step(c, *now);
    for (int k = 0; k < 8; k++)
        (void)gvcam_send_step(c, *now);
    MUST(!cap_gvcp_parse_ack(exact, n, &answer) || answer.n <= n);
    fuzz_taken += c->control.ccp != 0; /* it has an owner */
    stream_packet(exact, n);
    free(exact);
    check(c);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct gvcam_link link;
    struct cap_gvcam *c = camera(&link);
    int64_t now = pvx_now_real();
    while (size >= 2) {
        size_t n = data[1] < size - 2 ? data[1] : size - 2;
        datagram(c, data[0], data + 2, n, &now);
        data += 2 + n;
        size -= 2 + n;
    }
    gvcam_destroy(c);
    return 0;
}
