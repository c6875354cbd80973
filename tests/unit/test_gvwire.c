/* GVCP and GVSP on the wire, byte for byte against the tables of the protocol. */
#include "capture/wire/be.h"
#include "capture/gevsim/feature.h"
#include "capture/wire/gvcp.h"
#include "tests/lib/gvsp_read.h"
#include "tests/t.h"

/* The bytes of `hex`, spaces left out. */
static size_t bytes_of(const char *hex, uint8_t *out)
{
    size_t n = 0;
    for (; *hex != '\0'; hex++) {
        unsigned v;
        if (*hex == ' ' || sscanf(hex, "%2x", &v) != 1)
            continue;
        out[n++] = (uint8_t)v;
        hex++;
    }
    return n;
}

static void same(const void *got, size_t n, const char *hex, int line)
{
    uint8_t want[CAP_GVCP_MAX];
    size_t m = bytes_of(hex, want);
    T_CHECK_(n == m && memcmp(got, want, n) == 0, "line %d: other bytes than %s", line, hex);
}
#define SAME(got, n, hex) same(got, n, hex, __LINE__)

T_CASE(numbers_in_network_order)
{
    uint8_t p[9] = {0};
    cap_put64(p + 1, 0x0123456789abcdef);
    SAME(p + 1, 8, "01 23 45 67 89 ab cd ef");
    T_EQ_I(cap_get16(p + 1), 0x0123);
    T_EQ_I(cap_get32(p + 1), 0x01234567);
    T_OK(cap_get64(p + 1) == 0x0123456789abcdef);
}

T_CASE(commands_as_they_are_sent)
{
    uint8_t p[CAP_GVCP_MAX], d[8];
    struct cap_gvcp_action a = {0x11223344, 0x55667788, 0x99aabbcc, false, 7};
    SAME(p, cap_gvcp_put_command(p, 0x11, CAP_GVCP_DISCOVERY, 0xffff, NULL, 0),
         "42 11 0002 0000 ffff");
    cap_put32(d, 0x0a00);
    cap_put32(d + 4, 2);
    SAME(p, cap_gvcp_put_command(p, CAP_GVCP_ACK, CAP_GVCP_WRITEREG, 1, d, 8),
         "42 01 0082 0008 0001 00000a00 00000002");
    SAME(p, cap_gvcp_put_action(p, &a, true, 0x1234),
         "42 01 0100 000c 1234 11223344 55667788 99aabbcc");
    a.scheduled = true;
    a.time = 0x0102030405060708;
    SAME(p, cap_gvcp_put_action(p, &a, false, 2),
         "42 80 0100 0014 0002 11223344 55667788 99aabbcc 0102030405060708");
    SAME(p, cap_gvcp_put_ack(p, CAP_GVCP_ACCESS_DENIED, CAP_GVCP_WRITEREG, 9, 0),
         "8006 0083 0000 0009");
}

T_CASE(commands_as_they_arrive)
{
    static const struct {
        const char *hex;
        uint16_t status;
    } t[] = {
        {"42 01 0002 0000 0001", CAP_GVCP_OK},
        {"42 01 0080 0004 0001 00000a00", CAP_GVCP_OK},
        {"42 01 0080 0004 0001 00000a00 ffff", CAP_GVCP_OK}, /* padding after it is no harm */
        {"", CAP_GVCP_SILENT},
        {"42 01 0080 0004 00", CAP_GVCP_SILENT},                    /* no head */
        {"43 01 0080 0004 0001 00000a00", CAP_GVCP_SILENT},         /* no command */
        {"42 01 0080 0004 0000 00000a00", CAP_GVCP_SILENT},         /* number 0 */
        {"42 01 0080 0008 0001 00000a00", CAP_GVCP_INVALID_HEADER}, /* says more than there is */
        {"42 01 0080 0000 0001", CAP_GVCP_INVALID_HEADER},
        {"42 01 0080 0006 0001 00000a00 0000", CAP_GVCP_INVALID_HEADER},
        {"42 01 0082 0004 0001 00000a00", CAP_GVCP_INVALID_HEADER},
        {"42 01 0084 0004 0001 00000200", CAP_GVCP_INVALID_HEADER},
        {"42 01 0086 0004 0001 000000e8", CAP_GVCP_INVALID_HEADER},
        {"42 00 0040 000c 0001 0000 0005 00000001 00000002", CAP_GVCP_OK},
        {"42 10 0040 000c 0001 0000 0005 00000001 00000002", CAP_GVCP_INVALID_HEADER},
        {"42 81 0100 000c 0001 00000001 00000002 00000003", CAP_GVCP_INVALID_HEADER},
        {"42 01 0004 0004 0001 00000000", CAP_GVCP_INVALID_HEADER},
        {"42 01 0777 0000 0001", CAP_GVCP_NOT_IMPLEMENTED},
    };
    for (size_t k = 0; k < sizeof t / sizeof t[0]; k++) {
        uint8_t p[CAP_GVCP_MAX];
        struct cap_gvcp_request r;
        size_t n = bytes_of(t[k].hex, p);
        T_CHECK_(cap_gvcp_parse(p, n, &r) == t[k].status, "%s: %04x", t[k].hex,
                 cap_gvcp_parse(p, n, &r));
    }
    uint8_t big[700];
    struct cap_gvcp_request r;
    size_t n = bytes_of("42 01 0080 0240 0001", big);
    T_EQ_I(n, 8);
    T_EQ_I(cap_gvcp_parse(big, sizeof big, &r), CAP_GVCP_INVALID_HEADER); /* over 576 bytes */
}

T_CASE(resend_and_action_are_read)
{
    uint8_t p[64];
    struct cap_gvcp_request r;
    struct cap_gvcp_resend s;
    struct cap_gvcp_action a;
    size_t n = bytes_of("42 00 0040 000c 0001 0000 fffe 00000003 00ffffff", p);
    T_EQ_I(cap_gvcp_parse(p, n, &r), CAP_GVCP_OK);
    cap_gvcp_get_resend(&r, &s);
    T_OK(s.block == 0xfffe && s.first == 3 && s.last == 0xffffff);
    n = bytes_of("42 10 0040 0014 0001 0000 0000 00000003 00000007 0000000100000002", p);
    T_EQ_I(cap_gvcp_parse(p, n, &r), CAP_GVCP_OK);
    cap_gvcp_get_resend(&r, &s);
    T_OK(s.block == 0x100000002 && s.first == 3 && s.last == 7);
    n = bytes_of("42 81 0100 0014 0001 00000001 00000002 00000003 00000000 3b9aca00", p);
    T_EQ_I(cap_gvcp_parse(p, n, &r), CAP_GVCP_OK);
    cap_gvcp_get_action(&r, &a);
    T_OK(a.device_key == 1 && a.group_key == 2 && a.group_mask == 3 && a.scheduled &&
         a.time == 1000000000);
}

T_CASE(acknowledges_are_read)
{
    uint8_t p[64];
    struct cap_gvcp_answer a;
    size_t n = bytes_of("8006 0083 0004 0102 0000 0001", p);
    T_OK(cap_gvcp_parse_ack(p, n, &a));
    T_OK(a.status == CAP_GVCP_ACCESS_DENIED && a.command == 0x83 && a.id == 0x102 && a.n == 4 &&
         a.data[3] == 1);
    T_OK(!cap_gvcp_parse_ack(p, n - 1, &a));
    T_OK(!cap_gvcp_parse_ack(p, 7, &a));
    n = bytes_of("42 01 0080 0000 0001", p);
    T_OK(!cap_gvcp_parse_ack(p, n, &a)); /* a command */
}

T_CASE(stream_heads)
{
    uint8_t p[64];
    struct cap_gvsp_head h = {0, false, CAP_GVSP_DATA, 0xfffe, 0x010203}, back;
    SAME(p, cap_gvsp_put_head(p, &h), "0000 fffe 03 010203");
    T_EQ_I(gvsp_head(p, 8, &back), 8);
    T_OK(back.block == 0xfffe && back.packet == 0x010203 && back.content == CAP_GVSP_DATA &&
         !back.wide);
    T_EQ_I(gvsp_head(p, 7, &back), 0);
    h = (struct cap_gvsp_head){CAP_GVSP_RESENT, true, CAP_GVSP_LEAD, 0x100000002, 5};
    SAME(p, cap_gvsp_put_head(p, &h), "0100 0000 81 000000 0000000100000002 00000005");
    T_EQ_I(gvsp_head(p, 20, &back), 20);
    T_OK(back.block == 0x100000002 && back.packet == 5 && back.wide &&
         back.status == CAP_GVSP_RESENT && back.content == CAP_GVSP_LEAD);
    T_EQ_I(gvsp_head(p, 19, &back), 0);
}

T_CASE(leader_and_trailer)
{
    uint8_t p[64];
    struct cap_gvsp_leader l = {CAP_GVSP_IMAGE, 0x0102030405060708, 0x02180014, 640, 480, 16, 8},
                           back;
    SAME(p, cap_gvsp_put_leader(p, &l),
         "0000 0001 0102030405060708 02180014 00000280 000001e0 00000010 00000008 0000 0000");
    T_OK(gvsp_leader(p, 36, &back));
    T_OK(back.payload == l.payload && back.ticks == l.ticks && back.width == 640 &&
         back.height == 480 && back.x == 16 && back.y == 8 && back.pixel_format == 0x02180014);
    T_OK(!gvsp_leader(p, 35, &back));
    SAME(p, cap_gvsp_put_trailer(p, CAP_GVSP_IMAGE, 480, 0), "0000 0001 000001e0");
    SAME(p, cap_gvsp_put_trailer(p, CAP_GVSP_IMAGE_CHUNK, 480, 24),
         "0000 4001 000001e0 00000018 00000000");
    SAME(p, cap_gvsp_put_trailer(p, CAP_GVSP_EXTENDED_CHUNK, 480, 24),
         "0000 0005 00000018 000001e0 00000000");
    T_EQ_I(cap_gvsp_next(65534, false), 65535);
    T_EQ_I(cap_gvsp_next(65535, false), 1);
    T_EQ_I(cap_gvsp_next(65535, true), 65536);
    T_OK(cap_gvsp_next(UINT64_MAX, true) == 1);
}

/* The table that registers and XML come from holds together. */
T_CASE(features_are_consistent)
{
    size_t n = 0;
    for (const struct gvcam_feature_def *d = gvcam_features; d->category != NULL; d++, n++) {
        T_OK(d->kind != GVK_ENUM || d->entry != NULL);
        T_OK(d->min <= d->max || d->max_of != NULL);
        T_OK(n < GVCAM_N_FEATURES || (d->address != 0 && d->name != NULL));
        for (size_t k = 0; k < n && d->name != NULL; k++)
            T_OK(gvcam_features[k].name == NULL || strcmp(gvcam_features[k].name, d->name) != 0);
        for (int which = 0; which < 2; which++) { /* what is named is there */
            const char *want = which == 0 ? d->selector : d->max_of;
            bool found = want == NULL;
            for (const struct gvcam_feature_def *f = gvcam_features; f->category != NULL; f++)
                found |= want != NULL && f->name != NULL && strcmp(f->name, want) == 0;
            T_CHECK_(found, "%s refers to %s", d->name, want);
        }
    }
    T_LE(GVCAM_N_FEATURES + 20, n);
}
