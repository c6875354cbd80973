/* test_usbip.c - the virtual cameras' end of USB/IP (tests/vm/uvc/usbip.h): every transfer gets
 * exactly one answer, however it is taken back. */
#include <arpa/inet.h>
#include <errno.h>
#include <sys/socket.h>
#include <unistd.h>

#include "tests/t.h"
#include "tests/vm/uvc/usbip.h"

static int host, device;
static struct usbip usb;
static uint8_t seen[8];
static size_t seen_n;

static int control(void *ctx, const uint8_t setup[8], const uint8_t *data, size_t n,
                   uint8_t *answer)
{
    (void)ctx;
    memcpy(seen, n > 0 ? data : setup, n > 0 ? n : 8);
    seen_n = n;
    if (setup[1] == 99)
        return -EPIPE;
    memset(answer, 7, 20);
    return n > 0 ? 0 : 20;
}

static void begin(void)
{
    int pair[2];
    T_OK(socketpair(AF_UNIX, SOCK_STREAM, 0, pair) == 0);
    host = pair[0];
    device = pair[1];
    usb = (struct usbip){.fd = device, .control = control};
}

static void end(void)
{
    uint8_t b;
    T_EQ_I(recv(host, &b, 1, MSG_DONTWAIT), -1); /* no answer that nobody asked for */
    close(host);
    close(device);
}

static void put(uint32_t command, uint32_t seq, uint32_t in, uint32_t ep, uint32_t word5,
                uint32_t word6, const uint8_t setup[8])
{
    uint32_t h[12] = {htonl(command), htonl(seq),   0,           htonl(in),
                      htonl(ep),      htonl(word5), htonl(word6)};
    if (setup != NULL)
        memcpy(&h[10], setup, 8);
    T_EQ_I(send(host, h, sizeof h, 0), 48);
}
static void submit_bulk(uint32_t seq, uint32_t room)
{
    put(1, seq, 1, 1, 0, room, NULL);
    T_OK(usbip_serve(&usb));
}
static void unlink_it(uint32_t seq, uint32_t victim)
{
    put(2, seq, 0, 0, victim, 0, NULL);
    T_OK(usbip_serve(&usb));
}

/* The next answer: its command, number, status and length; data is read and thrown away. */
static void want(uint32_t command, uint32_t seq, int status, uint32_t length)
{
    uint32_t h[12] = {0};
    uint8_t data[4096];
    T_EQ_I(recv(host, h, sizeof h, MSG_DONTWAIT | MSG_WAITALL), 48);
    T_EQ_I(ntohl(h[0]), command);
    T_EQ_I(ntohl(h[1]), seq);
    T_EQ_I((int32_t)ntohl(h[5]), status);
    if (command != 3)
        return;
    T_EQ_I(ntohl(h[6]), length);
    if (length > 0)
        T_EQ_I(recv(host, data, length, MSG_DONTWAIT | MSG_WAITALL), length);
}

T_CASE(control_transfers)
{
    begin();
    const uint8_t get[8] = {0x80, 6, 0, 1, 0, 0, 18, 0}, set[8] = {0x21, 1, 0, 2, 1, 0, 4, 0};
    const uint8_t bad[8] = {0x80, 99, 0, 0, 0, 0, 8, 0}, out[4] = {1, 2, 3, 4};
    put(1, 1, 1, 0, 0, 64, get);
    T_OK(usbip_serve(&usb));
    want(3, 1, 0, 18); /* no more than asked for */
    put(1, 2, 1, 0, 0, 8, get);
    T_OK(usbip_serve(&usb));
    want(3, 2, 0, 8); /* no more than there is room */
    put(1, 3, 1, 0, 0, 64, bad);
    T_OK(usbip_serve(&usb));
    want(3, 3, -EPIPE, 0);
    put(1, 4, 0, 0, 0, 4, set);
    T_EQ_I(send(host, out, 4, 0), 4);
    T_OK(usbip_serve(&usb));
    T_EQ_I(seen_n, 4);
    T_OK(memcmp(seen, out, 4) == 0);
    uint32_t h[12];
    T_EQ_I(recv(host, h, sizeof h, MSG_DONTWAIT), 48); /* an OUT says how much, and sends nothing */
    T_EQ_I(ntohl(h[6]), 4);
    end();
}

/* The oldest transfer that waits, ended by nothing. */
static void answered(uint32_t seq)
{
    T_OK(usbip_bulk_answer(&usb, NULL, 0));
    want(3, seq, 0, 0);
}

T_CASE(bulk_in_order)
{
    begin();
    const uint8_t data[100] = {0};
    T_EQ_I(usbip_bulk_room(&usb), 0);
    for (uint32_t i = 1; i <= 3; i++)
        submit_bulk(i, 64 * i);
    T_EQ_I(usbip_bulk_room(&usb), 64);
    T_OK(usbip_bulk_answer(&usb, data, 64));
    want(3, 1, 0, 64);
    T_EQ_I(usbip_bulk_room(&usb), 128);
    answered(2);
    end();
}

T_CASE(unlink_waiting)
{
    begin();
    for (uint32_t i = 1; i <= 3; i++)
        submit_bulk(i, 64);
    unlink_it(4, 2);
    want(4, 4, -ECONNRESET, 0);
    answered(1);
    answered(3);
    T_EQ_I(usbip_bulk_room(&usb), 0);
    end();
}

T_CASE(unlink_answered)
{
    begin();
    submit_bulk(1, 64);
    answered(1);
    unlink_it(2, 1);
    want(4, 2, 0, 0);
    end();
}

/* The unlink overtakes its transfer: one answer, and only when both are here. */
T_CASE(unlink_first)
{
    begin();
    submit_bulk(1, 64);
    unlink_it(4, 3);
    submit_bulk(2, 64);
    submit_bulk(3, 64);
    want(4, 4, -ECONNRESET, 0);
    answered(1);
    answered(2);
    T_EQ_I(usbip_bulk_room(&usb), 0);
    T_EQ_I(usb.unlinked, 1);
    end();
}

T_CASE(nonsense_ends_it)
{
    begin();
    put(17, 1, 0, 0, 0, 0, NULL);
    T_OK(!usbip_serve(&usb));
    end();
    begin();
    put(1, 1, 0, 0, 0, 1u << 30, (const uint8_t[8]){0x21, 1}); /* a gigabyte for a control */
    T_OK(!usbip_serve(&usb));
    end();
    begin();
    T_EQ_I(send(host, "short", 5, 0), 5);
    shutdown(host, SHUT_WR);
    T_OK(!usbip_serve(&usb));
    end();
}
