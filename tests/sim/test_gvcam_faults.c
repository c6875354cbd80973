/* What is broken on request is broken as asked for, and counted: the truth that receivers are held
 * against.  Every packet is looked at. */
#include "tests/lib/gvraw.h"

#define FW        32 /* small frames: 768 bytes, */
#define FH        24
#define FP        236 /* in packets of 200: leader, 4 data, trailer */
#define PER_FRAME 6

/* A fresh camera with the fault, streaming to r; triggers by software when fast is false. */
static void begin(struct raw *r, struct cap_gvcam_fault f, bool triggered)
{
    struct cap_gvcam_config config = bed_config(0);
    config.first_id = 65530;
    bed_restart(0, &config);
    bed_fault(0, f);
    raw_open(r, bed_address[0]);
    raw_prepare(r, FW, FH, FP);
    if (triggered)
        raw_triggered(r, 0);
    else
        T_EQ_I(raw_write(r, feature(GVF_RATE), raw_float(200)), CAP_GVCP_OK);
    raw_start(r);
}

static struct cap_gvcam_stats end(struct raw *r)
{
    raw_stop(r);
    struct cap_gvcam_stats st = bed_stats(0);
    T_EQ_I(raw_write(r, GVB_CCP, 0), CAP_GVCP_OK);
    bed_fault(0, (struct cap_gvcam_fault){0});
    raw_close(r);
    return st;
}

static void trigger(struct raw *r)
{
    T_EQ_I(raw_write(r, feature(GVF_TRIGGER_SOFTWARE), 1), CAP_GVCP_OK);
    usleep(50); /* exposure: 10 us */
}

/* All packets of n triggers; what was seen. */
struct seen {
    uint64_t packets, leaders, trailers, late, twice, overlong, oddhead, width, rows;
    uint64_t ids[600];
    uint64_t ticks[600];
    size_t n;
};

static void look(struct seen *s, const struct packet *p, uint64_t *last_block,
                 uint32_t *last_packet)
{
    s->packets++;
    if (p->h.content == CAP_GVSP_LEAD && p->h.packet == 0) {
        s->leaders++;
        s->width += p->l.width != FW;
        if (s->n < 600) {
            s->ids[s->n] = p->h.block;
            s->ticks[s->n++] = p->l.ticks;
        }
    } else if (p->h.content == CAP_GVSP_TRAIL) {
        s->trailers++;
        s->rows += cap_get32(p->data + p->head + 4) != FH;
    } else if (p->h.content != CAP_GVSP_DATA || p->h.packet > 100) {
        s->oddhead++;
        return;
    }
    s->overlong += p->bytes > FP - CAP_GVSP_UDP_IP;
    if (p->h.block == *last_block) {
        s->late += p->h.packet < *last_packet;
        s->twice += p->h.packet == *last_packet;
    }
    *last_block = p->h.block;
    *last_packet = p->h.packet;
}

/* Everything that the camera has sent, once it has sent all that it took. */
static void collect(struct raw *r, struct seen *s)
{
    uint64_t block = UINT64_MAX;
    uint32_t number = 0;
    struct packet p;
    bool all = false;
    UNTIL (all) {
        struct cap_gvcam_stats st = bed_stats(0);
        all = st.frames + st.dropped == st.exposed;
        while (raw_packet(r, all ? 0 : 5, &p)) /* on loopback, what is sent has arrived */
            look(s, &p, &block, &number);
    }
    T_OK(all);
}

static struct cap_gvcam_stats triggers(struct cap_gvcam_fault f, int n, struct seen *s)
{
    struct raw r;
    memset(s, 0, sizeof *s);
    begin(&r, f, true);
    for (int k = 0; k < n; k++) {
        trigger(&r);
        if (k % 20 == 19)
            collect(&r, s);
    }
    collect(&r, s);
    return end(&r);
}

T_CASE(healthy_is_complete_and_in_order)
{
    struct seen s;
    struct cap_gvcam_stats st = triggers((struct cap_gvcam_fault){0}, 40, &s);
    T_EQ_I(s.packets, 40 * PER_FRAME);
    T_EQ_I(s.leaders, 40);
    T_EQ_I(s.trailers, 40);
    T_EQ_I(s.late + s.twice + s.overlong + s.oddhead + s.width + s.rows, 0);
    T_EQ_I(st.exposed, 40);
    T_EQ_I(st.frames, 40);
    T_EQ_I(st.triggers, 40);
    T_EQ_I(st.packets, 40 * PER_FRAME);
    T_EQ_I(st.lost + st.cut + st.torn + st.dropped + st.missed + st.too_fast + st.send_errors, 0);
}

T_CASE(dropped_frames_leave_gaps)
{
    struct seen s;
    struct cap_gvcam_stats st = triggers((struct cap_gvcam_fault){.drop = 0.3}, 100, &s);
    uint64_t gaps = 0;
    for (size_t k = 1; k < s.n; k++) {
        uint64_t step = s.ids[k] - s.ids[k - 1];
        gaps += (s.ids[k] < s.ids[k - 1] ? step + 65535 : step) - 1; /* 0 is left out */
    }
    T_EQ_I(st.exposed, 100);
    T_EQ_I(st.dropped + st.frames, 100);
    T_EQ_I(s.leaders, st.frames);
    T_OK(st.dropped > 10 && st.dropped < 60);
    T_LE(gaps, st.dropped); /* but for those before the first and after the last */
    T_LE(st.dropped, gaps + 12);
}

T_CASE(missed_triggers_leave_none)
{
    struct seen s;
    struct cap_gvcam_stats st = triggers((struct cap_gvcam_fault){.miss = 0.3}, 100, &s);
    T_EQ_I(st.triggers, 100);
    T_EQ_I(st.missed + st.exposed, 100);
    T_OK(st.missed > 10 && st.missed < 60);
    T_EQ_I(s.n, st.exposed);
    for (size_t k = 1; k < s.n; k++)
        T_EQ_I(s.ids[k], s.ids[k - 1] == 65535 ? 1 : s.ids[k - 1] + 1);
}

T_CASE(packets_lost_doubled_overtaken)
{
    struct seen s;
    struct cap_gvcam_stats st = triggers((struct cap_gvcam_fault){.packet_loss = 0.1}, 60, &s);
    T_EQ_I(s.packets + st.lost, 60 * PER_FRAME);
    T_OK(st.lost > 12 && st.lost < 90);
    T_OK(st.torn > 5 && st.torn <= st.lost);
    T_EQ_I(st.packets, s.packets);
    st = triggers((struct cap_gvcam_fault){.duplicate = 0.2}, 60, &s);
    T_EQ_I(s.packets, 60 * PER_FRAME + st.duplicated);
    T_EQ_I(s.twice, st.duplicated);
    T_OK(st.duplicated > 20);
    T_EQ_I(st.torn, 0);
    st = triggers((struct cap_gvcam_fault){.reorder = 0.2}, 60, &s);
    T_EQ_I(s.packets, 60 * PER_FRAME);
    T_EQ_I(s.late, st.reordered);
    T_OK(st.reordered > 10);
}

T_CASE(frames_of_wrong_size_and_garbled)
{
    struct seen s;
    struct cap_gvcam_stats st = triggers((struct cap_gvcam_fault){.wrong_size = 0.5}, 60, &s);
    T_OK(s.width > 5 && s.rows > 5);
    T_EQ_I(s.width + s.rows, st.wrong_size);
    st = triggers((struct cap_gvcam_fault){.corrupt = 0.5}, 60, &s);
    T_OK(s.overlong > 5 && s.oddhead > 5);
    T_EQ_I(s.overlong + s.oddhead, st.corrupt);
}

T_CASE(frozen_stuck_and_renumbered)
{
    struct seen s;
    (void)triggers((struct cap_gvcam_fault){.freeze = true}, 10, &s);
    T_EQ_I(s.n, 10);
    for (size_t k = 1; k < s.n; k++) {
        T_EQ_I(s.ticks[k], s.ticks[0]);
        T_OK(s.ids[k] != s.ids[k - 1]); /* the numbers go on */
    }
    (void)triggers((struct cap_gvcam_fault){.stuck_clock = true}, 10, &s);
    T_EQ_I(s.n, 10);
    for (size_t k = 1; k < s.n; k++)
        T_EQ_I(s.ticks[k], s.ticks[0]);
    struct raw r;
    struct packet p, q;
    begin(&r, (struct cap_gvcam_fault){0}, true);
    trigger(&r);
    T_OK(raw_leader(&r, &p));
    cap_gvcam_do(bed_cam[0], CAP_GVCAM_CLOCK_JUMP, -3600);
    cap_gvcam_do(bed_cam[0], CAP_GVCAM_RESTART_IDS, 0);
    trigger(&r);
    T_OK(raw_leader(&r, &q));
    T_EQ_I(q.h.block, 1);
    T_NEAR((double)((int64_t)q.l.ticks - (int64_t)p.l.ticks), -3600e9, 30e9);
    (void)end(&r);
}

T_CASE(late_by_as_much_as_asked)
{
    struct raw r;
    struct packet p;
    begin(&r, (struct cap_gvcam_fault){.delay_ms = 150, .jitter_ms = 50}, false);
    double least = 1e9, most = 0;
    for (int k = 0; k < 40; k++) {
        T_OK(raw_leader(&r, &p));
        double late = (double)(p.at - (int64_t)p.l.ticks) * 1e-6;
        least = late < least ? late : least;
        most = late > most ? late : most;
    }
    T_LE(150 - 1e-3, least); /* never early; the machine may add to it */
    T_LE(160, most);
    (void)end(&r);
}

T_CASE(packet_delay_is_kept)
{
    struct raw r;
    struct packet p;
    begin(&r, (struct cap_gvcam_fault){0}, true);
    for (int with = 0; with < 2; with++) {
        int64_t last = 0, shortest = INT64_MAX;
        T_EQ_I(raw_write(&r, GVB_SCPD, with ? 3000000 : 0), CAP_GVCP_OK); /* ticks of 1 ns */
        for (int k = 0; k < 5; k++) {
            trigger(&r);
            for (int n = 0; n < PER_FRAME; n++) {
                T_OK(raw_packet(&r, 10000, &p));
                if (n > 0 && p.at - last < shortest)
                    shortest = p.at - last;
                last = p.at;
            }
        }
        if (with)
            T_LE(3000000, shortest);
        else
            T_LE(shortest, 1000000);
    }
    (void)end(&r);
}

T_CASE(line_triggers_all_at_one_instant)
{
    struct raw r[BED_CAMERAS];
    struct packet p;
    for (int c = 0; c < BED_CAMERAS; c++) {
        bed_fresh(c);
        raw_open(&r[c], bed_address[c]);
        raw_prepare(&r[c], FW, FH, FP);
        raw_triggered(&r[c], 1);
        raw_start(&r[c]);
    }
    cap_gvnet_pulse(bed_net);
    uint64_t at = 0;
    for (int c = 0; c < BED_CAMERAS; c++) {
        T_OK(raw_leader(&r[c], &p));
        if (c > 0)
            T_EQ_I(p.l.ticks, at);
        at = p.l.ticks;
    }
    cap_gvnet_line(bed_net, 50);
    uint64_t ticks[BED_CAMERAS][10];
    for (int c = 0; c < BED_CAMERAS; c++)
        for (int k = 0; k < 10; k++) {
            T_OK(raw_leader(&r[c], &p));
            ticks[c][k] = p.l.ticks;
            T_EQ_I(p.l.ticks % 20000000, 0); /* on the grid of the pulses */
            T_EQ_I(ticks[c][k], ticks[0][k]);
        }
    cap_gvnet_line(bed_net, 0);
    for (int c = 0; c < BED_CAMERAS; c++) {
        raw_stop(&r[c]);
        raw_leave(&r[c]);
    }
}

T_CASE(too_fast_is_not_exposed)
{
    struct raw r;
    begin(&r, (struct cap_gvcam_fault){0}, true);
    T_EQ_I(raw_write(&r, feature(GVF_EXPOSURE), raw_float(1e6)), CAP_GVCP_OK);
    uint64_t n = 0;
    for (; bed_stats(0).too_fast == 0 && n < 1000; n++)
        trigger(&r); /* the second within the second that the first takes, on most machines */
    struct cap_gvcam_stats st = end(&r);
    T_EQ_I(st.triggers, n);
    T_EQ_I(st.exposed + st.too_fast, n);
    T_LE(1, st.too_fast);
}

T_CASE(narrow_link_cuts_frames)
{
    struct seen s;
    cap_gvnet_link(bed_net, 0.05, 2000); /* 6 kB/s, room for a frame and a half */
    struct cap_gvcam_stats st = triggers((struct cap_gvcam_fault){0}, 20, &s);
    cap_gvnet_link(bed_net, 0, 0);
    T_LE(1, st.cut);
    T_EQ_I(s.packets + st.cut, 20 * PER_FRAME);
    T_LE(1, st.torn);
}

T_CASE(switch_that_reboots)
{
    struct raw r;
    struct packet p;
    begin(&r, (struct cap_gvcam_fault){0}, false);
    T_OK(raw_leader(&r, &p));
    cap_gvnet_reboot(bed_net, 0.4);
    int64_t gap = 0; /* then by itself, when the switch is back: control was not lost */
    for (int64_t last = p.at; gap < 200 * MS && raw_leader(&r, &p); last = p.at)
        gap = p.at - last;
    T_LE(200 * MS, gap);
    struct cap_gvcam_stats st = end(&r);
    T_LE(PER_FRAME * 20, st.cut);
    T_EQ_I(st.heartbeats, 0);
}

T_MAIN(bed_open(), bed_close())
