/* GVCP of our camera, command by command: registers, privilege, heartbeat, actions, PTP, clock. */
#include "tests/lib/gvraw.h"

T_CASE(registers_one_by_one)
{
    struct raw r;
    uint8_t d[CAP_GVCP_MAX] = {0};
    raw_open(&r, bed_address[0]);
    T_EQ_I(raw_read(&r, GVB_VERSION), 0x00020000);
    T_EQ_I(raw_read(&r, GVB_IP), 0x7f000002);
    T_EQ_I(raw_read(&r, GVB_STREAM_CHANNELS), 1);
    T_OK((raw_read(&r, GVB_GVCP_CAPABILITY) & GVCAM_CAN_RESEND) != 0);
    /* three at once; the third does not exist: two values and the reason */
    cap_put32(d, feature(GVF_SENSOR_WIDTH));
    cap_put32(d + 4, feature(GVF_SENSOR_HEIGHT));
    cap_put32(d + 8, 0x9000);
    T_EQ_I(raw_command(&r, CAP_GVCP_READREG, d, 12), CAP_GVCP_INVALID_ADDRESS);
    T_EQ_I(r.a.n, 8);
    T_EQ_I(cap_get32(r.a.data), BED_W);
    T_EQ_I(cap_get32(r.a.data + 4), BED_H);
    cap_put32(d, 2);
    T_EQ_I(raw_command(&r, CAP_GVCP_READREG, d, 4), CAP_GVCP_BAD_ALIGNMENT);
    T_EQ_I(raw_command(&r, CAP_GVCP_READREG, d, 6), CAP_GVCP_INVALID_HEADER);
    T_EQ_I(raw_command(&r, CAP_GVCP_READREG, d, 0), CAP_GVCP_INVALID_HEADER);
    T_EQ_I(raw_command(&r, 0x0bad & 0xfffe, d, 4), CAP_GVCP_NOT_IMPLEMENTED);
    /* nobody controls it: nothing may be written */
    T_EQ_I(raw_write(&r, feature(GVF_GAIN), raw_float(3)), CAP_GVCP_ACCESS_DENIED);
    T_EQ_I(raw_write(&r, GVB_CCP, GVCAM_CCP_CONTROL), CAP_GVCP_OK);
    T_EQ_I(raw_write(&r, feature(GVF_GAIN), raw_float(3)), CAP_GVCP_OK);
    T_EQ_I(raw_read(&r, feature(GVF_GAIN)), raw_float(3));
    T_EQ_I(raw_write(&r, feature(GVF_GAIN), raw_float(300)), CAP_GVCP_INVALID_PARAMETER);
    T_EQ_I(raw_write(&r, feature(GVF_GAIN), 0x7fc00000 /* NaN */), CAP_GVCP_INVALID_PARAMETER);
    T_EQ_I(raw_write(&r, feature(GVF_SENSOR_WIDTH), 8), CAP_GVCP_WRITE_PROTECT);
    T_EQ_I(raw_write(&r, GVB_VERSION, 1), CAP_GVCP_WRITE_PROTECT);
    T_EQ_I(raw_write(&r, 0x9000, 1), CAP_GVCP_INVALID_ADDRESS);
    T_EQ_I(raw_write(&r, feature(GVF_WIDTH), BED_W + 4), CAP_GVCP_INVALID_PARAMETER);
    T_EQ_I(raw_write(&r, feature(GVF_PIXEL_FORMAT), 0x12345678), CAP_GVCP_INVALID_PARAMETER);
    T_EQ_I(raw_write(&r, feature(GVF_TRIGGER_SOURCE), 77), CAP_GVCP_INVALID_PARAMETER);
    /* two at once, the second is refused: one is written, and it says so */
    cap_put32(d, feature(GVF_GAIN));
    cap_put32(d + 4, raw_float(5));
    cap_put32(d + 8, feature(GVF_SENSOR_WIDTH));
    T_EQ_I(raw_command(&r, CAP_GVCP_WRITEREG, d, 16), CAP_GVCP_WRITE_PROTECT);
    T_EQ_I(r.a.n, 4);
    T_EQ_I(cap_get16(r.a.data + 2), 1);
    T_EQ_I(raw_read(&r, feature(GVF_GAIN)), raw_float(5));
    raw_leave(&r);
}

T_CASE(memory_in_blocks)
{
    struct raw r;
    uint8_t d[CAP_GVCP_MAX] = {0};
    raw_open(&r, bed_address[1]);
    cap_put32(d, GVB_URL_0);
    cap_put32(d + 4, 512);
    T_EQ_I(raw_command(&r, CAP_GVCP_READMEM, d, 8), CAP_GVCP_OK);
    T_EQ_I(r.a.n, 516);
    T_EQ_I(cap_get32(r.a.data), GVB_URL_0);
    T_CONTAINS((const char *)r.a.data + 4, "Local:pyrovox_simcam.xml;100000;");
    cap_put32(d + 4, 540); /* more than fits */
    T_EQ_I(raw_command(&r, CAP_GVCP_READMEM, d, 8), CAP_GVCP_INVALID_PARAMETER);
    T_EQ_I(r.a.n, 0);
    cap_put32(d + 4, 6);
    T_EQ_I(raw_command(&r, CAP_GVCP_READMEM, d, 8), CAP_GVCP_BAD_ALIGNMENT);
    cap_put32(d, 0xfffffffc); /* address + size goes round */
    cap_put32(d + 4, 512);
    T_EQ_I(raw_command(&r, CAP_GVCP_READMEM, d, 8), CAP_GVCP_INVALID_ADDRESS);
    T_EQ_I(raw_write(&r, GVB_CCP, GVCAM_CCP_CONTROL), CAP_GVCP_OK);
    cap_put32(d, GVB_USER_NAME);
    memcpy(d + 4, "renamed\0\0\0\0\0\0\0\0", 16);
    T_EQ_I(raw_command(&r, CAP_GVCP_WRITEMEM, d, 20), CAP_GVCP_OK);
    T_EQ_I(cap_get16(r.a.data + 2), 16);
    T_EQ_I(raw_command(&r, CAP_GVCP_DISCOVERY, NULL, 0), CAP_GVCP_OK);
    T_EQ_I(r.a.n, CAP_GVCP_DISCOVER);
    T_EQ_S((const char *)r.a.data + GVB_USER_NAME, "renamed");
    T_EQ_S((const char *)r.a.data + GVB_SERIAL, "T01");
    memset(d + 4, 'x', 16); /* no end: it is given one */
    T_EQ_I(raw_command(&r, CAP_GVCP_WRITEMEM, d, 20), CAP_GVCP_OK);
    T_EQ_I(raw_command(&r, CAP_GVCP_DISCOVERY, NULL, 0), CAP_GVCP_OK);
    T_EQ_S((const char *)r.a.data + GVB_USER_NAME, "xxxxxxxxxxxxxxx");
    raw_leave(&r);
}

T_CASE(privilege_is_one_clients)
{
    struct raw a, b;
    raw_open(&a, bed_address[0]);
    raw_open(&b, bed_address[0]);
    T_EQ_I(raw_write(&a, GVB_CCP, GVCAM_CCP_CONTROL), CAP_GVCP_OK);
    T_EQ_I(raw_write(&b, GVB_CCP, GVCAM_CCP_CONTROL), CAP_GVCP_ACCESS_DENIED);
    T_EQ_I(raw_write(&b, feature(GVF_GAIN), 0), CAP_GVCP_ACCESS_DENIED);
    T_EQ_I(raw_read(&b, GVB_CCP), GVCAM_CCP_CONTROL); /* to look is allowed */
    T_EQ_I(raw_write(&a, GVB_CCP, GVCAM_CCP_EXCLUSIVE), CAP_GVCP_OK);
    uint8_t d[4];
    cap_put32(d, GVB_CCP);
    T_EQ_I(raw_command(&b, CAP_GVCP_READREG, d, 4), CAP_GVCP_ACCESS_DENIED);
    T_EQ_I(raw_command(&b, CAP_GVCP_DISCOVERY, NULL, 0), CAP_GVCP_OK); /* always */
    T_EQ_I(raw_write(&b, GVB_CCP, 0), CAP_GVCP_ACCESS_DENIED);
    T_EQ_I(raw_write(&a, GVB_CCP, 0), CAP_GVCP_OK);
    T_EQ_I(raw_write(&b, GVB_CCP, GVCAM_CCP_CONTROL), CAP_GVCP_OK);
    T_EQ_I(raw_write(&b, GVB_CCP, 0), CAP_GVCP_OK);
    raw_close(&a);
    raw_close(&b);
}

T_CASE(force_ip_is_refused)
{
    struct raw r;
    uint8_t d[56] = {0}, p[CAP_GVCP_MAX];
    raw_open(&r, bed_address[0]);
    memcpy(d + 2, "\x02\x50\x7f\x00\x00\x02", 6);
    T_EQ_I(raw_command(&r, CAP_GVCP_FORCEIP, d, 56), CAP_GVCP_ACCESS_DENIED);
    d[7] = 99; /* another camera's: not a word */
    raw_send(&r, p, cap_gvcp_put_command(p, CAP_GVCP_ACK, CAP_GVCP_FORCEIP, 900, d, 56));
    T_EQ_I(raw_read(&r, GVB_IP), 0x7f000002); /* its answer is the first to come */
    raw_close(&r);
}

T_CASE(without_heartbeat_control_is_lost)
{
    struct raw r, watch;
    raw_open(&r, bed_address[0]);
    raw_open(&watch, bed_address[0]);
    uint64_t before = bed_stats(0).heartbeats;
    raw_prepare(&r, 32, 24, 576);
    raw_start(&r);
    int64_t t0 = pvx_now_mono();
    T_EQ_I(raw_write(&r, GVB_HEARTBEAT, 500), CAP_GVCP_OK);
    UNTIL (raw_read(&watch, GVB_CCP) == 0) /* no sign of life of the owner */
        usleep(20000);
    T_LE(500, (double)(pvx_now_mono() - t0) * 1e-6);
    T_EQ_I(raw_read(&watch, GVB_CCP), 0);
    T_EQ_I(bed_stats(0).heartbeats - before, 1);
    uint64_t frames = bed_stats(0).exposed;
    usleep(200000); /* five periods */
    T_EQ_I(bed_stats(0).exposed, frames);
    T_EQ_I(raw_read(&watch, GVB_SCP), 0);
    T_EQ_I(raw_write(&r, feature(GVF_ACQ_STOP), 1), CAP_GVCP_ACCESS_DENIED);
    /* a client that reads now and then keeps it */
    raw_drain(&r);
    raw_prepare(&r, 32, 24, 576);
    T_EQ_I(raw_write(&r, GVB_HEARTBEAT, 1500), CAP_GVCP_OK);
    for (int k = 0; k < 12; k++) {
        usleep(200000);
        raw_read(&r, GVB_CCP);
    }
    T_EQ_I(raw_read(&r, GVB_CCP), GVCAM_CCP_CONTROL);
    raw_leave(&r);
    raw_close(&watch);
}

/* ---- actions ---------------------------------------------------------------------------------- */

static void wait_for_action(struct raw *r, uint32_t device, uint32_t group, uint32_t mask)
{
    raw_prepare(r, 32, 24, 576);
    T_EQ_I(raw_write(r, GVB_ACTION_DEVICE_KEY, device), CAP_GVCP_OK);
    T_EQ_I(raw_write(r, GVB_ACTION_GROUP_KEY, group), CAP_GVCP_OK);
    T_EQ_I(raw_write(r, GVB_ACTION_GROUP_MASK, mask), CAP_GVCP_OK);
    raw_triggered(r, 2);
    raw_start(r);
}

/* The status of its acknowledge; silent when that of a command sent behind it is the first to come. */
static uint16_t act(struct raw *r, struct cap_gvcp_action a, uint16_t id)
{
    uint8_t p[CAP_GVCP_MAX], d[4];
    uint16_t status = CAP_GVCP_SILENT;
    cap_put32(d, GVB_VERSION);
    raw_send(r, p, cap_gvcp_put_action(p, &a, true, id));
    raw_send(r, p, cap_gvcp_put_command(p, CAP_GVCP_ACK, CAP_GVCP_READREG, 900, d, 4));
    do {
        if (!raw_ack(r, 10000, NULL))
            return CAP_GVCP_SILENT;
        if (r->a.command == CAP_GVCP_ACTION + 1 && r->a.id == id)
            status = r->a.status;
    } while (r->a.id != 900);
    return status;
}

static void finish(struct raw *r)
{
    raw_stop(r);
    T_EQ_I(raw_write(r, feature(GVF_TRIGGER_MODE), 0), CAP_GVCP_OK);
    T_EQ_I(raw_write(r, feature(GVF_PTP_ENABLE), 0), CAP_GVCP_OK);
    raw_leave(r);
}

T_CASE(action_needs_all_three_keys)
{
    struct raw r;
    struct packet p;
    struct cap_gvcp_action a = {7, 11, 0x10, false, 0};
    raw_open(&r, bed_address[0]);
    wait_for_action(&r, 7, 11, 0x30);
    uint64_t before = bed_stats(0).triggers;
    T_EQ_I(act(&r, a, 1001), CAP_GVCP_OK);
    T_OK(raw_leader(&r, &p));
    T_EQ_I(act(&r, a, 1001),
           CAP_GVCP_OK); /* the acknowledge was lost: again, but no second frame */
    T_EQ_I(bed_stats(0).triggers - before, 1);
    usleep(1000);
    T_EQ_I(act(&r, a, 1002), CAP_GVCP_OK);
    T_EQ_I(bed_stats(0).triggers - before, 2);
    a.device_key = 8;
    T_EQ_I(act(&r, a, 1003), CAP_GVCP_SILENT);
    a = (struct cap_gvcp_action){7, 12, 0x10, false, 0};
    T_EQ_I(act(&r, a, 1004), CAP_GVCP_SILENT);
    a = (struct cap_gvcp_action){7, 11, 0x08, false, 0};
    T_EQ_I(act(&r, a, 1005), CAP_GVCP_SILENT);
    T_EQ_I(bed_stats(0).triggers - before, 2);
    /* without the flag: no acknowledge, but a frame */
    uint8_t out[CAP_GVCP_MAX];
    a = (struct cap_gvcp_action){7, 11, 0x20, false, 0};
    raw_drain(&r);
    raw_send(&r, out, cap_gvcp_put_action(out, &a, false, 1006));
    T_OK(raw_leader(&r, &p));
    T_OK(!raw_ack(&r, 0, NULL));
    finish(&r);
}

T_CASE(broadcast_reaches_all)
{
    static const char *const to[] = {"255.255.255.255", "127.255.255.255"};
    struct raw r[BED_CAMERAS];
    struct packet p;
    for (int c = 0; c < BED_CAMERAS; c++) {
        raw_open(&r[c], bed_address[c]);
        wait_for_action(&r[c], 1, 2, 3);
    }
    for (uint16_t k = 0; k < 2; k++) {
        uint8_t out[CAP_GVCP_MAX];
        struct cap_gvcp_action a = {1, 2, 1, false, 0};
        struct sockaddr_in all = {.sin_family = AF_INET, .sin_port = htons(CAP_GVCP_PORT)}, from;
        inet_pton(AF_INET, to[k], &all.sin_addr);
        size_t n = cap_gvcp_put_action(out, &a, true, (uint16_t)(2000 + k));
        int64_t t0 = pvx_now_real();
        T_EQ_I(sendto(r[0].control, out, n, 0, (struct sockaddr *)&all, sizeof all), n);
        unsigned who = 0;
        for (int c = 0; c < BED_CAMERAS; c++) { /* each answers from its own address */
            T_OK(raw_ack(&r[0], 5000, &from));
            T_EQ_I(r[0].a.status, CAP_GVCP_OK);
            who |= 1u << (ntohl(from.sin_addr.s_addr) & 0xff);
        }
        T_EQ_I(who, ((1u << BED_CAMERAS) - 1) << 2);
        for (int c = 0; c < BED_CAMERAS; c++) {
            T_OK(raw_leader(&r[c], &p));
            T_OK((int64_t)p.l.ticks >= t0 && (int64_t)p.l.ticks <= pvx_now_real());
        }
        usleep(2000);
    }
    for (int c = 0; c < BED_CAMERAS; c++)
        finish(&r[c]);
}

/* ---- PTP and the clock ------------------------------------------------------------------------- */

static uint32_t ptp_status(struct raw *r)
{
    T_EQ_I(raw_write(r, feature(GVF_PTP_LATCH), 1), CAP_GVCP_OK);
    return raw_read(r, feature(GVF_PTP_STATUS));
}

static void become_slave(struct raw *r)
{
    T_EQ_I(raw_write(r, feature(GVF_PTP_ENABLE), 1), CAP_GVCP_OK);
    UNTIL (ptp_status(r) == 9)
        usleep(5000);
    T_EQ_I(ptp_status(r), 9);
}

T_CASE(ptp_settles_and_is_held)
{
    struct raw r;
    struct cap_gvcam_config config = bed_config(0);
    config.ptp_settle_ms = 600;
    config.tai_offset_s = 37;
    bed_restart(0, &config);
    bed_fault(0, (struct cap_gvcam_fault){.skew_us = 5e6});
    raw_open(&r, bed_address[0]);
    T_EQ_I(raw_write(&r, GVB_CCP, GVCAM_CCP_CONTROL), CAP_GVCP_OK);
    T_EQ_I(ptp_status(&r), 3); /* Disabled */
    T_EQ_I(raw_write(&r, feature(GVF_PTP_ENABLE), 1), CAP_GVCP_OK);
    uint32_t seen[10], n = 0;
    UNTIL (n > 0 && seen[n - 1] == 9) {
        uint32_t now = ptp_status(&r);
        if (n < 10 && (n == 0 || seen[n - 1] != now))
            seen[n++] = now;
        if (now != 9) { /* not yet synchronised: 5 s ahead of host time, TAI is 37 s ahead */
            int64_t off = (int64_t)raw_read64(&r, feature(GVF_PTP_OFFSET));
            T_NEAR((double)off, -32e9, 1e6);
        }
    }
    T_OK(n >= 1 && seen[n - 1] == 9);
    for (uint32_t k = 1; k < n; k++) /* Initializing 1, Listening 4, Uncalibrated 8, Slave 9 */
        T_OK(seen[k] > seen[k - 1]);
    int64_t off = (int64_t)raw_read64(&r, feature(GVF_PTP_OFFSET));
    T_LE(llabs(off), 100);
    int64_t t0 = pvx_now_real();
    T_EQ_I(raw_write(&r, feature(GVF_TIMESTAMP_LATCH), 1), CAP_GVCP_OK);
    int64_t t1 = pvx_now_real();
    int64_t v = (int64_t)raw_read64(&r, feature(GVF_TIMESTAMP_VALUE)) - 37 * PVX_NS_PER_S;
    T_OK(v >= t0 - 100 && v <= t1 + 100);
    T_EQ_I(raw_write(&r, feature(GVF_TIMESTAMP_RESET), 1), CAP_GVCP_ACCESS_DENIED);
    /* a bad slave says so; without a master it is none */
    bed_fault(0, (struct cap_gvcam_fault){.ptp_offset_us = 300});
    T_EQ_I(ptp_status(&r), 9);
    T_NEAR((double)(int64_t)raw_read64(&r, feature(GVF_PTP_OFFSET)), 300e3, 100);
    bed_fault(0, (struct cap_gvcam_fault){.no_ptp_master = true});
    T_EQ_I(ptp_status(&r), 4);
    bed_fault(0, (struct cap_gvcam_fault){0});
    raw_leave(&r);
}

T_CASE(scheduled_action_at_its_time)
{
    struct raw r;
    struct packet p;
    struct cap_gvcam_config config = bed_config(0);
    config.ptp_settle_ms = 50;
    config.tai_offset_s = 37;
    bed_restart(0, &config);
    raw_open(&r, bed_address[0]);
    wait_for_action(&r, 1, 1, 1);
    struct cap_gvcp_action a = {1, 1, 1, true, (uint64_t)pvx_now_real() + 60 * PVX_NS_PER_S};
    T_EQ_I(act(&r, a, 3000), CAP_GVCP_NO_REFERENCE_TIME); /* no PTP: it knows no such time */
    become_slave(&r);
    uint16_t sent = 3000;
    for (int in_time = 0; in_time < 3;) { /* taken by the camera before its time, that is */
        int64_t at = pvx_now_real() + 300 * PVX_NS_PER_MS;
        a.time = (uint64_t)(at + 37 * PVX_NS_PER_S);
        T_EQ_I(act(&r, a, ++sent), CAP_GVCP_OK);
        bool early = pvx_now_real() < at;
        if (!raw_leader(&r, &p))
            break;
        if (early)
            T_NEAR((double)((int64_t)p.l.ticks - (int64_t)a.time), 0, 200);
        T_OK(p.at >= at - 200); /* not sent before it was exposed */
        in_time += early;
    }
    a.time -= 10 * PVX_NS_PER_S; /* in the past: at once, stamped when it came */
    int64_t t0 = pvx_now_real() + 37 * PVX_NS_PER_S;
    T_EQ_I(act(&r, a, 4010), CAP_GVCP_OK);
    T_OK(raw_leader(&r, &p));
    T_OK((int64_t)p.l.ticks >= t0 - 100);
    a.time = 0;
    usleep(1000);
    T_EQ_I(act(&r, a, 4011), CAP_GVCP_OK);
    T_OK(raw_leader(&r, &p));
    uint16_t e = CAP_GVCP_OK;
    for (uint16_t k = 0; k < 17 && e == CAP_GVCP_OK; k++) { /* sixteen can wait */
        a.time = (uint64_t)(pvx_now_real() + (100 + k) * PVX_NS_PER_S);
        e = act(&r, a, (uint16_t)(4020 + k));
        T_EQ_I(e, k < 16 ? CAP_GVCP_OK : CAP_GVCP_OVERFLOW);
    }
    finish(&r);
}

T_CASE(clock_counts_its_own_ticks)
{
    struct raw r;
    struct packet p;
    struct cap_gvcam_config config = bed_config(0);
    config.tick_hz = 125e6;
    config.boot_clock = true;
    config.ptp_settle_ms = 10;
    int64_t born = pvx_now_real();
    bed_restart(0, &config);
    raw_open(&r, bed_address[0]);
    raw_prepare(&r, 32, 24, 576);
    T_EQ_I(raw_read64(&r, GVB_TICKS_HIGH), 125000000);
    raw_write(&r, feature(GVF_TIMESTAMP_LATCH), 1);
    double age = (double)(pvx_now_real() - born);
    double v = (double)raw_read64(&r, feature(GVF_TIMESTAMP_VALUE)) * 8;
    T_OK(v > 0 && v <= age);
    raw_start(&r);
    T_OK(raw_leader(&r, &p));
    T_OK((double)p.l.ticks * 8 >= v - 1e9 / BED_FPS && (double)p.l.ticks * 8 < 1e9 * 3600);
    raw_stop(&r);
    T_EQ_I(raw_write(&r, feature(GVF_TIMESTAMP_RESET), 1), CAP_GVCP_OK);
    int64_t t0 = pvx_now_real();
    T_EQ_I(raw_write(&r, GVB_TIMESTAMP_CONTROL, 2), CAP_GVCP_OK); /* latch, the bootstrap way */
    v = (double)raw_read64(&r, GVB_TIMESTAMP_HIGH) * 8;
    T_OK(v < age + (double)(pvx_now_real() - t0) + 5e9);
    cap_gvcam_do(bed_cam[0], CAP_GVCAM_CLOCK_JUMP, 1000);
    T_EQ_I(raw_write(&r, GVB_TIMESTAMP_CONTROL, 2), CAP_GVCP_OK);
    T_OK((double)raw_read64(&r, GVB_TIMESTAMP_HIGH) * 8 >= v + 1e12);
    become_slave(&r);
    T_EQ_I(raw_read64(&r, GVB_TICKS_HIGH), 1000000000); /* PTP counts ns */
    raw_leave(&r);
}

T_CASE(skewed_and_drifting)
{
    struct raw r;
    bed_fresh(0);
    raw_open(&r, bed_address[0]);
    T_EQ_I(raw_write(&r, GVB_CCP, GVCAM_CCP_CONTROL), CAP_GVCP_OK);
    int64_t before = pvx_now_real();
    bed_fault(0, (struct cap_gvcam_fault){.skew_us = -250e3, .drift_ppm = 1000});
    int64_t after = pvx_now_real();
    for (int k = 0; k < 3; k++) {
        usleep(100000);
        int64_t t0 = pvx_now_real();
        raw_write(&r, feature(GVF_TIMESTAMP_LATCH), 1);
        int64_t t1 = pvx_now_real();
        int64_t v = (int64_t)raw_read64(&r, feature(GVF_TIMESTAMP_VALUE)) + 250000000;
        T_OK(v >= t0 && v <= t1 + (t1 - before) / 1000);
        T_LE((double)(t0 - after) / 1000 - 1e3, (double)(v - t0)); /* runs ahead, 1 us per ms */
    }
    bed_fault(0, (struct cap_gvcam_fault){.stuck_clock = true});
    raw_write(&r, feature(GVF_TIMESTAMP_LATCH), 1);
    uint64_t v = raw_read64(&r, feature(GVF_TIMESTAMP_VALUE));
    usleep(20000);
    raw_write(&r, feature(GVF_TIMESTAMP_LATCH), 1);
    T_EQ_I(raw_read64(&r, feature(GVF_TIMESTAMP_VALUE)), v);
    bed_fault(0, (struct cap_gvcam_fault){0});
    raw_leave(&r);
}

/* ---- states ----------------------------------------------------------------------------------- */

T_CASE(streaming_locks_the_layout)
{
    struct raw r;
    raw_open(&r, bed_address[0]);
    raw_prepare(&r, 32, 24, 576);
    raw_start(&r);
    T_EQ_I(raw_write(&r, feature(GVF_WIDTH), 64), CAP_GVCP_ACCESS_DENIED);
    T_EQ_I(raw_write(&r, feature(GVF_PIXEL_FORMAT), cap_pixfmt_pfnc(CAP_RGB8)),
           CAP_GVCP_ACCESS_DENIED);
    T_EQ_I(raw_write(&r, GVB_SCPS, 1500), CAP_GVCP_ACCESS_DENIED);
    T_EQ_I(raw_write(&r, feature(GVF_EXPOSURE), raw_float(2000)), CAP_GVCP_OK);
    raw_stop(&r);
    T_EQ_I(raw_write(&r, feature(GVF_WIDTH), 64), CAP_GVCP_OK);
    T_EQ_I(raw_read(&r, feature(GVF_PAYLOAD_SIZE)), 64 * 24);
    /* user sets: saved, changed, loaded; "Default" is that of power-up */
    T_EQ_I(raw_write(&r, feature(GVF_USER_SET_SAVE), 1), CAP_GVCP_WRITE_PROTECT);
    T_EQ_I(raw_write(&r, feature(GVF_USER_SET_SELECTOR), 1), CAP_GVCP_OK);
    T_EQ_I(raw_write(&r, feature(GVF_USER_SET_SAVE), 1), CAP_GVCP_OK);
    T_EQ_I(raw_write(&r, feature(GVF_WIDTH), 32), CAP_GVCP_OK);
    T_EQ_I(raw_write(&r, feature(GVF_USER_SET_LOAD), 1), CAP_GVCP_OK);
    T_EQ_I(raw_read(&r, feature(GVF_WIDTH)), 64);
    T_EQ_I(raw_write(&r, feature(GVF_USER_SET_SELECTOR), 0), CAP_GVCP_OK);
    T_EQ_I(raw_write(&r, feature(GVF_USER_SET_LOAD), 1), CAP_GVCP_OK);
    T_EQ_I(raw_read(&r, feature(GVF_WIDTH)), BED_W);
    /* it is warm, and that changes */
    uint32_t warm = raw_read(&r, feature(GVF_TEMPERATURE));
    usleep(300000);
    T_OK(raw_read(&r, feature(GVF_TEMPERATURE)) != warm);
    raw_leave(&r);
}

T_CASE(reset_is_a_reboot)
{
    struct raw r;
    struct packet p;
    uint8_t out[CAP_GVCP_MAX];
    struct cap_gvcam_config config = bed_config(0);
    config.reboot_s = 0.7;
    bed_restart(0, &config);
    raw_open(&r, bed_address[0]);
    raw_prepare(&r, 32, 24, 576);
    raw_start(&r);
    T_OK(raw_leader(&r, &p));
    T_LE(65401, p.h.block);
    int64_t t0 = pvx_now_mono();
    T_EQ_I(raw_write(&r, feature(GVF_DEVICE_RESET), 1), CAP_GVCP_OK); /* acknowledged, then gone */
    uint16_t id = 5000;
    bool back = false;
    UNTIL (back) {
        raw_send(&r, out,
                 cap_gvcp_put_command(out, CAP_GVCP_ACK, CAP_GVCP_DISCOVERY, ++id, NULL, 0));
        back = raw_ack(&r, 50, NULL);
    }
    T_LE(0.7, (double)(pvx_now_mono() - t0) * 1e-9);
    raw_drain(&r);
    T_EQ_I(raw_read(&r, GVB_CCP), 0);
    T_EQ_I(raw_read(&r, feature(GVF_WIDTH)), BED_W);
    T_EQ_I(bed_stats(0).reboots, 1);
    raw_prepare(&r, 32, 24, 576);
    raw_drain(&r);
    raw_start(&r);
    T_OK(raw_leader(&r, &p));
    T_EQ_I(p.h.block, 1); /* numbers anew */
    raw_stop(&r);
    raw_leave(&r);
}

/* Anything at all may come in; it goes on serving. */
T_CASE(nonsense_is_survived)
{
    struct raw r;
    raw_open(&r, bed_address[0]);
    uint64_t refused = bed_stats(0).refused;
    for (int k = 0; k < 3000; k++) {
        uint8_t p[700];
        size_t n = t_rand() % (k % 10 == 0 ? sizeof p : 40);
        for (size_t j = 0; j < n; j++)
            p[j] = (uint8_t)(t_rand() >> 56);
        if (n >= 8 && k % 2 == 0) { /* half of them look like commands */
            static const uint16_t c[] = {2, 4, 0x40, 0x80, 0x82, 0x84, 0x86, 0x100, 0x89};
            p[0] = CAP_GVCP_CMD_KEY;
            cap_put16(p + 2, c[t_rand() % 9]);
            if (k % 4 == 0)
                cap_put16(p + 4, (uint16_t)(n - 8));
        }
        raw_send(&r, p, n);
        if (k % 50 == 0)
            raw_drain(&r);
    }
    UNTIL (bed_stats(0).refused - refused >= 100)
        raw_drain(&r);
    T_LE(100, bed_stats(0).refused - refused);
    raw_close(&r);
    raw_open(&r, bed_address[0]);
    T_EQ_I(raw_read(&r, GVB_VERSION), 0x00020000);
    raw_close(&r);
}

T_MAIN(bed_open(), bed_close())
