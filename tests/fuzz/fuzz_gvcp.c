/* fuzz_gvcp.c - any bytes as GVCP datagrams to a simulated camera, and as GVSP packets to the parser.
 * Input: records of u8 who (0 or 1: one of two clients; + 2: half a second later), u8 length, bytes. */
#include <stdlib.h>
#include <string.h>

#include "capture/gvcam_int.h"

#define W 16
#define H 8

static struct cap_gvcam *camera(cap_gvnet *net)
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
    if (gvcam_build(net, &config, &c) != PVX_OK)
        abort();
    c->rng = 1;
    return c;
}

static void check(const struct cap_gvcam *c)
{
    if (c->q_n > GVCAM_QUEUE || c->n_actions > GVCAM_ACTIONS || c->v[GVF_SCPS] < GVCAM_PACKET_MIN ||
        c->v[GVF_SCPS] > GVCAM_PACKET_MAX || c->v[GVF_WIDTH] < 1 ||
        c->v[GVF_WIDTH] + c->v[GVF_OFFSET_X] > W || c->v[GVF_HEIGHT] < 1 ||
        c->v[GVF_HEIGHT] + c->v[GVF_OFFSET_Y] > H ||
        !gvcam_offers(c, cap_pixfmt_from_pfnc(c->v[GVF_PIXEL_FORMAT])))
        abort();
}

static void stream_packet(const uint8_t *p, size_t n)
{
    struct cap_gvsp_head h;
    struct cap_gvsp_leader l;
    uint8_t back[CAP_GVSP_HEAD_WIDE];
    size_t m = cap_gvsp_get_head(p, n, &h);
    if (m > n)
        abort();
    if (m > 0) {
        if (cap_gvsp_put_head(back, &h) != m || memcmp(back, p, 2) != 0)
            abort();
        (void)cap_gvsp_get_leader(p + m, n - m, &l);
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
    if (c->gone_until != 0 && *now >= c->gone_until)
        c->gone_until = 0;
    (void)gvcam_control_step(c, *now);
    (void)gvcam_take_step(c, *now);
    for (int k = 0; k < 8; k++)
        (void)gvcam_send_step(c, *now);
    if (cap_gvcp_parse_ack(exact, n, &answer) && answer.n > n)
        abort();
    stream_packet(exact, n);
    free(exact);
    check(c);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct cap_gvnet net;
    struct cap_gvcam *c = camera(&net);
    int64_t now = gvcam_now();
    net.cams = c;
    while (size >= 2) {
        size_t n = data[1] < size - 2 ? data[1] : size - 2;
        datagram(c, data[0], data + 2, n, &now);
        data += 2 + n;
        size -= 2 + n;
    }
    gvcam_destroy(c);
    return 0;
}
