/* The traps of GigE cameras behind Aravis, each one made to happen by a camera of our own. */
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include "tests/lib/arvbed.h"
#include "capture/gev/ids.h"

/* Frames until so many good ones have come or the time is over; how many. */
static int next_many(struct session *s, int n)
{
    int k = 0;
    while (k < n && next_good(s))
        k++;
    return k;
}

static bool set_lo_mtu(int mtu)
{
    struct ifreq r = {.ifr_name = "lo"};
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    r.ifr_mtu = mtu;
    bool ok = ioctl(fd, SIOCSIFMTU, &r) == 0;
    close(fd);
    return ok;
}

static struct rig r;

/* So many more good sets of one camera: every byte right, exposures going up.  False = they do not come. */
static bool more_sets(int n, int64_t *last)
{
    for (int k = 0; k < n; k++) {
        struct cap_set *set;
        if (cap_capture_next(r.cap, PATIENCE_NS, &set) != PVX_OK)
            return false;
        T_OK(bed_truth(set->frame[0], 0) >= 0);
        T_OK(set->frame[0]->t_device_ns > *last);
        *last = set->frame[0]->t_device_ns;
        cap_set_release(set);
    }
    return true;
}

/* Packets above the MTU go out in fragments; a packet socket sees the first of each only, and Aravis
 * says SUCCESS for a frame with holes.  Asked for, it is refused; when the MTU falls while the camera
 * runs, the frames are counted as what they are and none with holes is handed out. */
T_CASE(a_short_buffer_that_says_success)
{
    bed_all(25);
    struct cap_source_config config = bed_source(0);
    cap_source *src = NULL;
    struct pvx_diag d = {""};
    if (!set_lo_mtu(1500))
        T_SKIP("the MTU of lo cannot be set here");
    config.gige.packet_size = 9000;
    T_EQ_I(ops->open(&config, &src, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "packet_size 9000 is more than the interface's MTU 1500");
    T_OK(set_lo_mtu(65536));
    bed_rig(&r, 1, 25);
    r.cam[0].gige.packet_size = 9000;
    rig_start(&r);
    int good = 0;
    uint64_t bad = 0;
    UNTIL (good >= 5 && bad >= 5) {
        struct cap_set *set;
        if (good == 5)
            T_OK(set_lo_mtu(1500));
        if (cap_capture_next(r.cap, PVX_NS_PER_S / 10, &set) == PVX_OK) {
            T_OK(bed_truth(set->frame[0], 0) >= 0); /* to the last byte, always */
            good++;
            cap_set_release(set);
        }
        rig_stats(&r);
        bad = r.st.camera[0].count[CAP_BAD_SIZE] + r.st.camera[0].count[CAP_INCOMPLETE] +
              bed_stats(0).send_errors;
    }
    T_OK(set_lo_mtu(65536));
    T_LE(5, good);
    T_LE(5, bad);
    printf("  fragments: %d good frames, %llu of the wrong size, %llu incomplete, %llu packets not "
           "sent "
           "by the camera's kernel\n",
           good, (unsigned long long)r.st.camera[0].count[CAP_BAD_SIZE],
           (unsigned long long)r.st.camera[0].count[CAP_INCOMPLETE],
           (unsigned long long)bed_stats(0).send_errors);
    rig_end(&r);
}

/* Lost leaders leave the numbers and stamps of an earlier frame in the buffer: of bad buffers nothing is
 * used, so stamps only go up and every number is accounted for. */
T_CASE(stale_stamps_on_bad_buffers)
{
    struct session s;
    bed_all(100);
    struct cap_source_config config = bed_source(1);
    config.gige.packet_size = 1500; /* 14 packets a frame */
    config.gige.resend = CAP_RESEND_NEVER;
    config.gige.frame_retention_ms = 5;
    if (begin(&s, &config)) {
        next_many(&s, 3);
        bed_fault(1, (struct cap_gvcam_fault){.packet_loss = 0.05});
        UNTIL (counted(&s.box, CAP_INCOMPLETE) >= 60 || !next_good(&s))
            ;
        bed_fault(1, (struct cap_gvcam_fault){0});
        next_many(&s, 20);
        T_LE(60, counted(&s.box, CAP_INCOMPLETE));
        T_LE(1, bed_stats(1).torn);
        ops->stop(s.src);
        while (s.box.n_held > 0)
            next_good(&s);
        /* from the first to the last good frame: nothing is counted twice or not at all */
        uint64_t span = s.last_id - s.first_id + 1, gaps = s.box.count[CAP_ID_GAP];
        T_LE(span, s.good + gaps + s.box.count[CAP_INCOMPLETE]);
        T_LE(s.good + gaps, span);
    }
    end(&s);
}

/* The first frame after the start may be bad: the next ones are not waited for in vain, and what is
 * discarded is not counted as lost. */
T_CASE(the_bad_first_frame)
{
    bed_all(25);
    bed_fault(0, (struct cap_gvcam_fault){.packet_loss = 0.4});
    bed_rig(&r, 1, 25);
    r.cam[0].gige.packet_size = 1500;
    r.cam[0].gige.resend = CAP_RESEND_NEVER;
    r.cfg.discard_first = 1;
    rig_start(&r);
    UNTIL (r.st.camera[0].count[CAP_INCOMPLETE] > 0)
        rig_wait(&r);
    bed_fault(0, (struct cap_gvcam_fault){0});
    T_OK(more_sets(10, &(int64_t){0}));
    rig_end(&r);
    T_LE(1, r.st.camera[0].count[CAP_INCOMPLETE]);
    T_EQ_I(r.st.camera[0].count[CAP_BAD_STAMP], 0);
    T_EQ_I(r.st.camera[0].count[CAP_LOST_CAMERA], 0);
}

/* A camera that loses the packets that it sends again, too, keeps its frame open until the retention is
 * over, and the good frames behind it with it: not longer. */
T_CASE(good_frames_behind_an_unanswered_resend)
{
    bed_all(100);
    double most[2] = {0, 0};
    for (int k = 0; k < 2; k++) {
        struct session s;
        struct cap_source_config config = bed_source(2);
        config.gige.packet_size = 1500;
        config.gige.resend = CAP_RESEND_ALWAYS;
        config.gige.frame_retention_ms = k == 0 ? 600 : 20;
        if (begin(&s, &config)) {
            next_many(&s, 3);
            /* Most packets of a few frames: too many to be asked for, so they time out. */
            bed_fault(2, (struct cap_gvcam_fault){.packet_loss = 0.6});
            UNTIL (counted(&s.box, CAP_INCOMPLETE) >= 3)
                usleep(1000);
            bed_fault(2, (struct cap_gvcam_fault){0});
            for (int n = 0; n < 40; n++) {
                struct cap_frame *f = next_frame(&s.box);
                T_OK(f != NULL && bed_truth(f, 2) >= 0);
                if (f == NULL)
                    break;
                double held = (double)(f->t_arrival_ns - f->t_device_ns) * 1e-6;
                most[k] = held > most[k] ? held : most[k];
                cap_frame_release(f);
            }
        }
        end(&s);
    }
    printf("  longest held back: %.0f ms with a retention of 600 ms, %.0f ms with 20\n", most[0],
           most[1]);
    T_LE(300, most[0]); /* this is the trap */
    T_LE(most[1], 400);
}

T_CASE(sixteen_bit_numbers_skip_zero)
{
    struct session s;
    bed_ring_fps = 50;
    struct cap_gvcam_config k = bed_config(0);
    k.first_id = 65520;
    bed_restart(0, &k);
    struct cap_source_config config = bed_source(0);
    config.gige.frame_retention_ms = 5000; /* none is given up, however busy the machine */
    if (begin(&s, &config)) {
        T_EQ_I(next_many(&s, 40), 40);
        T_EQ_I(counted(&s.box, CAP_ID_GAP), 0); /* 65535 is followed by 1, and that is no gap */
        T_EQ_I(s.last_id - s.first_id + 1, 40);
        T_LE(65536, s.last_id);
    }
    end(&s);
    /* 64-bit numbers (GigE Vision 2) do not skip */
    struct aravis_ids ids = {0};
    aravis_ids_next(&ids, 65535);
    T_EQ_I(aravis_ids_next(&ids, 65536), 65536);
    T_EQ_I(aravis_ids_next(&ids, 65537), 65537);
}

/* ---- what the network does -------------------------------------------------------------------- */

/* But what the camera itself says was never sent, or was there no more when it was asked for again: both
 * may be on a machine that is too busy for them, and every frame is accounted for all the same. */
static void nothing_is_lost(struct session *s, int c)
{
    uint64_t missing = counted(&s->box, CAP_INCOMPLETE) + counted(&s->box, CAP_ID_GAP);
    T_LE(missing, bed_stats(c).gone + bed_stats(c).overrun);
    T_LE(s->last_id - s->first_id + 1, s->good + missing + counted(&s->box, CAP_UNDERRUN));
}

T_CASE(loss_with_resend_loses_nothing)
{
    struct session s;
    bed_all(50);
    struct cap_source_config config = bed_source(3);
    config.gige.packet_size = 1500;
    config.gige.frame_retention_ms = 1000;
    if (begin(&s, &config)) {
        next_many(&s, 2);
        bed_fault(3, (struct cap_gvcam_fault){.packet_loss = 0.01});
        T_EQ_I(next_many(&s, 100), 100);
        bed_fault(3, (struct cap_gvcam_fault){0});
        next_many(&s, 5);
        T_LE(5, bed_stats(3).lost);
        T_LE(5, bed_stats(3).resent);
        nothing_is_lost(&s, 3);
        struct cap_health h;
        ops->health(s.src, &h);
        T_LE(5, h.packets_resent);
        T_OK(h.packets_missing == 0 || bed_stats(3).gone > 0);
        printf("  %llu packets lost, %llu sent again\n", (unsigned long long)bed_stats(3).lost,
               (unsigned long long)bed_stats(3).resent);
    }
    end(&s);
}

T_CASE(reorder_loses_nothing)
{
    struct session s;
    bed_all(50);
    struct cap_source_config config = bed_source(1);
    config.gige.packet_size = 1500;
    if (begin(&s, &config)) {
        next_many(&s, 2);
        bed_fault(1, (struct cap_gvcam_fault){.reorder = 0.1, .duplicate = 0.05});
        T_EQ_I(next_many(&s, 60), 60);
        bed_fault(1, (struct cap_gvcam_fault){0});
        T_LE(10, bed_stats(1).reordered);
        T_LE(10, bed_stats(1).duplicated);
        nothing_is_lost(&s, 1);
    }
    end(&s);
}

/* Malformed GVCP answers and GVSP packets before good frames, from the camera's own address and port.
 * Aravis 0.8.26 says SUCCESS for what it makes of them (no leader, no bytes, an old stamp), and most cost
 * the frame that they come before.  None of that is handed out, and the frames behind are good. */
static uint64_t spoiled(void)
{
    rig_stats(&r);
    return r.st.camera[0].count[CAP_ID_GAP] + r.st.camera[0].count[CAP_INCOMPLETE];
}

/* Twenty sets in a row of which none was spoiled, in the end: nothing is left of it. */
static bool gets_over_it(int64_t *last)
{
    for (int i = 0; i < 25; i++) {
        uint64_t before = spoiled();
        if (!more_sets(20, last))
            return false;
        if (spoiled() == before)
            return true;
    }
    return false;
}

T_CASE(hostile_packets_spoil_no_other_frame)
{
    for (int k = 0; k < 2; k++) {
        bed_all(50);
        bed_rig(&r, 1, 50);
        r.cam[0].gige.packet_size = k == 0 ? 0 : 1500;
        int64_t last = 0;
        rig_start(&r);
        T_OK(more_sets(3, &last));
        uint64_t exposed = bed_stats(0).exposed;
        bed_fault(0, (struct cap_gvcam_fault){.hostile = 0.3});
        T_OK(more_sets(40, &last));
        bed_fault(0, (struct cap_gvcam_fault){0});
        exposed = bed_stats(0).exposed - exposed;
        uint64_t hostile = bed_stats(0).hostile;
        usleep(300000);
        T_OK(more_sets(10, &last));
        T_OK(gets_over_it(&last));
        rig_end(&r);
        /* Aravis may take good frames for late ones for a second or two: opened anew then */
        T_LE(r.st.camera[0].count[CAP_LOST_CAMERA], 5);
        T_LE(15, hostile);
        T_LE((double)exposed - 40, 2 * (double)hostile + 10);
        printf("  %llu hostile packets: 40 of %llu frames, %llu of the wrong size, %llu with bad "
               "stamps, %llu incomplete\n",
               (unsigned long long)hostile, (unsigned long long)exposed,
               (unsigned long long)r.st.camera[0].count[CAP_BAD_SIZE],
               (unsigned long long)r.st.camera[0].count[CAP_BAD_STAMP],
               (unsigned long long)r.st.camera[0].count[CAP_INCOMPLETE]);
    }
}

/* Aravis 0.8.26 spends a buffer on a packet of an unknown kind and puts it out without a word.  Whoever
 * takes one buffer for each that it announces is a frame further behind with every such packet, for good:
 * then the last frames that this camera sends do not come. */
T_CASE(frames_do_not_fall_behind)
{
    struct session s;
    bed_ring_fps = 100;
    struct cap_gvcam_config k = bed_config(0);
    k.first_id = 1;
    bed_restart(0, &k);
    struct cap_source_config config = bed_source(0);
    if (begin(&s, &config)) {
        keep_box(&s.box, false);
        bed_fault(0, (struct cap_gvcam_fault){.hostile = 1});
        while (bed_stats(0).hostile < 100)
            usleep(10000);
        /* Aravis may take good frames for late ones for a second or two, and this machine be too busy for the
         * last one: so the last of fifty comes at some time. */
        bool came = false;
        UNTIL (came) {
            bed_fault(0, (struct cap_gvcam_fault){0});
            uint64_t dropped = bed_stats(0).dropped;
            for (uint64_t n = bed_stats(0).frames + 50; bed_stats(0).frames < n;)
                usleep(10000);
            bed_fault(0, (struct cap_gvcam_fault){.drop = 1});
            usleep(500000);
            struct cap_gvcam_stats st = bed_stats(0);
            pthread_mutex_lock(&s.box.lock);
            came = s.box.last_id == st.exposed - (st.dropped - dropped);
            pthread_mutex_unlock(&s.box.lock);
        }
        T_OK(came);
    }
    end(&s);
}

/* Frames of another size or cut short, and garbled packets: none is handed out as good. */
T_CASE(wrong_frames_are_counted)
{
    bed_all(50);
    bed_rig(&r, 1, 50);
    bed_fault(0, (struct cap_gvcam_fault){.wrong_size = 0.3, .corrupt = 0.2});
    rig_start(&r);
    int good = 0;
    uint64_t bad = 0;
    UNTIL (good >= 30 && bad >= 20) {
        struct cap_set *set;
        if (cap_capture_next(r.cap, PVX_NS_PER_S, &set) == PVX_OK) {
            T_OK(bed_truth(set->frame[0], 0) >= 0);
            good++;
            cap_set_release(set);
        }
        rig_stats(&r);
        bad = r.st.camera[0].count[CAP_BAD_SIZE] + r.st.camera[0].count[CAP_INCOMPLETE];
    }
    rig_end(&r);
    T_LE(30, good);
    T_LE(1, r.st.camera[0].count[CAP_BAD_SIZE]);
    T_LE(20, bad);
    printf("  %d good, %llu of the wrong size, %llu incomplete\n", good,
           (unsigned long long)r.st.camera[0].count[CAP_BAD_SIZE],
           (unsigned long long)r.st.camera[0].count[CAP_INCOMPLETE]);
}

/* ---- gone and back ---------------------------------------------------------------------------- */

/* A camera that restarts, and a switch whose cameras have not. */
T_CASE(cameras_come_back)
{
    bed_all(25);
    bed_rig(&r, 2, 25);
    snprintf(r.uri[1], sizeof r.uri[1], "aravis:T01"); /* by address and by serial number */
    r.cfg.sets.max_wait_ns = 300 * MS;
    rig_start(&r);
    T_OK(rig_whole_after(&r, 0) > 0);
    for (uint32_t c = 0; c < 2; c++) {
        int64_t back = pvx_now_mono() + (c == 0 ? 1200 : 2500) * MS;
        cap_gvcam_do(bed_cam[c], CAP_GVCAM_REBOOT, c == 0 ? 1.2 : 2.5);
        T_OK(rig_whole_after(&r, back) > 0);
        T_LE(1, rig_stats(&r)->camera[c].count[CAP_LOST_CAMERA]);
    }
    int64_t back = pvx_now_mono() + 1800 * MS;
    cap_gvnet_reboot(bed_net, 1.8);
    T_OK(rig_whole_after(&r, back) > 0);
    rig_end(&r);
    for (int c = 0; c < 2; c++)
        T_LE(1, r.st.camera[c].count[CAP_LOST_CAMERA]);
}

T_MAIN(bed_open(), bed_close())
