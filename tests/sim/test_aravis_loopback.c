/* The aravis: source against simulated cameras over real GVCP/GVSP on loopback: bytes, numbers and stamps of what
 * comes, and one camera that is not of our own making: the fake of libaravis. */
#define BED_FMT  CAP_RGB8
#define BED_RING 16
#include <arv.h>

#include "tests/lib/arvbed.h"

#define N_CAM 3
#define W     BED_W
#define H     BED_H

static const enum cap_pixfmt formats[N_CAM] = {CAP_GREY8, CAP_RGB8, CAP_BAYER_RG8};

static size_t image_bytes(int cam)
{
    return cap_pixfmt_image(formats[cam], W, H);
}

/* The image that a stamp names. */
static const unsigned char *image_at(int cam, int64_t stamp)
{
    return bed_image[cam][cap_gvcam_index(stamp, BED_FPS) % BED_RING];
}

/* Camera c healthy, sending its format. */
static void fresh(int c)
{
    struct cap_gvcam_config k = bed_config(c);
    k.fmt = formats[c];
    bed_restart(c, &k);
}

static struct cap_source_config config_of(int cam)
{
    struct cap_source_config c = bed_source(cam);
    c.fmt = formats[cam];
    c.buffers = 8;
    return c;
}

static const struct cap_gvcam_fault healthy;

/* A good frame: the bytes are those of the ring image that its stamp names, number and stamp go up,
 * and every number between is accounted for.  False = none came. */
static bool next_exact(struct session *s)
{
    struct cap_frame *f = next_frame(&s->box);
    T_OK(f != NULL);
    if (f == NULL)
        return false;
    T_EQ_I(f->img.width, W);
    T_EQ_I(f->img.height, H);
    T_EQ_I(f->img.fmt, formats[s->cam]);
    T_EQ_I(f->img.size, image_bytes(s->cam));
    T_EQ_I(f->img.stride, (int)cap_pixfmt_row(formats[s->cam], W));
    T_EQ_I(f->camera, s->cam);
    T_OK(f->img.size == image_bytes(s->cam) &&
         memcmp(f->img.data, image_at(s->cam, f->t_device_ns), f->img.size) == 0);
    T_OK(f->t_arrival_ns > f->t_device_ns);
    follows(s, f);
    cap_frame_release(f);
    return true;
}

/* After stop: numbers from the first to the last good frame = good ones + all that were counted.
 * Incomplete ones, and those without a buffer, may also have come before the first or after the last, hence
 * the two bounds. */
static void check_sum(struct session *s)
{
    while (s->box.n_held > 0)
        next_exact(s);
    uint64_t span = s->last_id - s->first_id + 1;
    uint64_t sum = s->good + s->box.count[CAP_ID_GAP];
    T_LE(span, sum + s->box.count[CAP_INCOMPLETE] + s->box.count[CAP_UNDERRUN]);
    T_LE(sum, span);
}

T_CASE(pixels_numbers_stamps)
{
    static const char *const uri[N_CAM] = {"127.0.0.2", "T01", "view2"}; /* address, serial, name */
    for (int c = 0; c < N_CAM; c++) {
        struct session s;
        struct cap_source_config config = config_of(c);
        config.uri = uri[c];
        if (begin(&s, &config)) {
            for (int k = 0; k < 12 && next_exact(&s); k++)
                ;
            ops->stop(s.src);
            T_EQ_I(s.last_stamp % (PVX_NS_PER_S / (int64_t)BED_FPS), 0); /* on the ring's grid */
            check_sum(&s);
            T_EQ_I(s.box.lost, 0);
        }
        end(&s);
    }
}

T_CASE(dropped_frames_are_gaps)
{
    struct session s;
    struct cap_source_config config = config_of(1);
    if (begin(&s, &config)) {
        next_exact(&s);
        bed_fault(1, (struct cap_gvcam_fault){.drop = 0.5});
        for (int k = 0; k < 200 && counted(&s.box, CAP_ID_GAP) < 5 && next_exact(&s); k++)
            ;
        bed_fault(1, healthy);
        for (int k = 0; k < 2; k++)
            next_exact(&s);
        T_LE(5, counted(&s.box, CAP_ID_GAP));
        T_LE(5, bed_stats(1).dropped);
        ops->stop(s.src);
        check_sum(&s);
    }
    end(&s);
}

T_CASE(late_frames_keep_their_stamps)
{
    struct session s;
    struct cap_source_config config = config_of(0);
    if (begin(&s, &config)) {
        next_exact(&s);
        bed_fault(0, (struct cap_gvcam_fault){.delay_ms = 150});
        int64_t least = INT64_MAX, from = pvx_now_real();
        for (int late = 0; late < 10;) {
            struct cap_frame *f = next_frame(&s.box);
            T_OK(f != NULL);
            if (f == NULL)
                break;
            T_OK(memcmp(f->img.data, image_at(0, f->t_device_ns), image_bytes(0)) == 0);
            T_OK(f->t_device_ns > s.last_stamp);
            s.last_stamp = f->t_device_ns;
            int64_t age = f->t_arrival_ns - f->t_device_ns;
            if (f->t_device_ns > from) { /* the first ones were under way already */
                late++;
                least = age < least ? age : least;
            }
            cap_frame_release(f);
        }
        T_LE(120, (double)least * 1e-6);
        bed_fault(0, healthy);
    }
    end(&s);
}

T_CASE(software_trigger)
{
    struct session s;
    struct cap_source_config config = config_of(1);
    config.trigger = CAP_TRIGGER_SOFTWARE;
    config.exposure_us = 1000;
    if (begin(&s, &config)) {
        for (int k = 0; k < 8; k++) {
            usleep(2000); /* the exposure before is over */
            int64_t before = pvx_now_real();
            T_EQ_I(ops->trigger(s.src), PVX_OK);
            if (!next_exact(&s))
                break;
            T_OK(s.last_stamp >= before);
        }
        ops->stop(s.src);
        T_EQ_I(s.good, 8);
        T_EQ_I(s.last_id - s.first_id + 1, 8); /* one each, none on its own */
    }
    end(&s);
}

T_CASE(slow_consumer_is_an_underrun)
{
    struct session s;
    struct cap_source_config config = config_of(0);
    config.buffers = 4;
    if (begin(&s, &config)) {
        T_OK(wait_count(&s.box, &s.box.count[CAP_UNDERRUN], 3)); /* nothing is released */
        T_EQ_I(s.box.n_held, 4);
        for (int k = 0; k < 8 && next_exact(&s); k++)
            ;
        ops->stop(s.src);
        check_sum(&s);
    }
    end(&s);
}

T_CASE(frames_outlive_their_source)
{
    struct session s;
    struct cap_source_config config = config_of(1);
    if (begin(&s, &config)) {
        struct cap_frame *a = next_frame(&s.box), *b = next_frame(&s.box);
        ops->stop(s.src);
        struct cap_sink sink = SINK_OF(&s.box);
        struct pvx_diag d = {""};
        T_EQ_I(ops->start(s.src, &sink, &d), PVX_OK); /* and again, with two buffers out */
        empty_box(&s.box);
        struct cap_frame *c = next_frame(&s.box);
        ops->stop(s.src);
        ops->close(&s.src);
        struct cap_frame *all[] = {a, b, c};
        for (int k = 0; k < 3; k++) {
            T_OK(all[k] != NULL);
            if (all[k] == NULL)
                continue;
            T_OK(memcmp(all[k]->img.data, image_at(1, all[k]->t_device_ns), image_bytes(1)) == 0);
        }
        for (int k = 0; k < 3; k++)
            cap_frame_release(all[k]);
    }
    end(&s);
}

static void refuse(struct cap_source_config c, pvx_err want, const char *says)
{
    char who[64];
    snprintf(who, sizeof who, "camera a (aravis:%s)", c.uri);
    cap_source *src = NULL;
    struct pvx_diag d = {""};
    T_EQ_I(ops->open(&c, &src, &d), want);
    T_OK(src == NULL);
    T_CONTAINS(d.text, who);
    T_CONTAINS(d.text, says);
    if (src != NULL)
        ops->close(&src);
}

T_CASE(refusals_have_reasons)
{
    struct cap_source_config c = config_of(0);
    c.width = 4000;
    refuse(c, PVX_EINVAL, "sensor 160x120");
    c = config_of(0);
    c.fmt = CAP_RGB_F32;
    refuse(c, PVX_EUNSUP, "RGB32f");
    c = config_of(0);
    c.fps = 1e5;
    refuse(c, PVX_EINVAL, "frame rate");
    c = config_of(0);
    c.exposure_us = 1e9;
    refuse(c, PVX_EINVAL, "exposure time");
    c = config_of(0);
    c.gige.packet_size = 100000;
    refuse(c, PVX_EINVAL, "MTU");
    c = config_of(0);
    c.trigger = CAP_TRIGGER_LINE;
    c.trigger_line = "Line7";
    refuse(c, PVX_EINVAL, "cannot be triggered by Line7: the trigger sources that it offers are:");
    struct cap_feature none = {"NoSuchThing", "1"}, high = {"Gain", "99"}, fine = {"Gain", "3"};
    c = config_of(0);
    c.n_features = 1;
    c.features = &none;
    refuse(c, PVX_EINVAL, "no feature NoSuchThing");
    c.features = &high;
    refuse(c, PVX_EINVAL, "Gain");
    c.uri = "nobody";
    refuse(c, PVX_ENOENT, "no camera answers");
    c = config_of(0);
    c.n_features = 1;
    c.features = &fine;
    cap_source *first = NULL;
    struct pvx_diag d = {""};
    T_EQ_I(ops->open(&c, &first, &d), PVX_OK);
    T_EQ_S(d.text, "");
    refuse(config_of(0), PVX_EBUSY, "another program");
    if (first != NULL)
        ops->close(&first);
}

struct listed {
    int n, formats, used;
    char text[N_CAM][512];
};

static void on_found(void *ctx, const struct cap_found *f)
{
    struct listed *l = ctx;
    char want[48];
    unsigned c = 99;
    if (sscanf(f->uri, "aravis:127.0.0.%u", &c) != 1 || c < 2 || c >= 2 + N_CAM)
        return;
    snprintf(want, sizeof want, "%s 160x120", cap_pixfmt_name(formats[c - 2]));
    l->n++;
    l->used += strstr(f->text, "in use") != NULL;
    l->formats += f->formats != NULL && strstr(f->formats, want) != NULL;
    snprintf(l->text[c - 2], sizeof l->text[0], "%s", f->text);
}

/* What a listing says, and that it leaves a camera that streams alone. */
T_CASE(listing)
{
    struct session s;
    struct cap_source_config config = config_of(1);
    config.gige.frame_retention_ms = 5000; /* on a busy machine a frame may be long on its way */
    struct listed l = {0};
    struct pvx_diag d = {""};
    if (begin(&s, &config)) {
        next_exact(&s);
        T_EQ_I(ops->list(on_found, &l, &d), PVX_OK);
        T_EQ_I(l.n, N_CAM);
        T_EQ_I(l.used, 1);
        T_EQ_I(l.formats, N_CAM - 1);
        T_CONTAINS(l.text[0], "serial T00, name view0, GigEVision");
        T_CONTAINS(l.text[1], "in use");
        for (int k = 0; k < 18 && next_exact(&s); k++) /* 8 that waited, 10 from now on */
            ;
        ops->stop(s.src);
        T_EQ_I(s.box.lost, 0);
        check_sum(&s);
        T_EQ_I(s.box.count[CAP_INCOMPLETE] + s.box.count[CAP_ID_GAP], 0);
    }
    end(&s);
}

/* Without a word: nobody waits for Aravis to see it, and the camera is usable as soon as it is back. */
T_CASE(silent_and_back)
{
    struct session s;
    struct cap_source_config config = config_of(1);
    config.name = "a"; /* as refuse expects */
    if (begin(&s, &config)) {
        next_exact(&s);
        cap_gvcam_free(&bed_cam[1]);
    }
    int64_t before = pvx_now_mono();
    end(&s);
    printf("  given up in %.2f s; 5 to 7.5 when Aravis is asked\n",
           (double)(pvx_now_mono() - before) * 1e-9);
    refuse(config, PVX_ENOENT, "no camera answers there");
    fresh(1);
    if (begin(&s, &config)) /* while the old one is still being given up */
        for (int k = 0; k < 3; k++)
            T_OK(next_exact(&s));
    end(&s);
}

/* ---- all cameras under supervision ------------------------------------------------------------ */

static struct rig r;

/* So many sets of so many members, one after the other. */
static bool sets_until(uint32_t members, int how_many)
{
    int n = 0;
    UNTIL (n >= how_many) {
        struct cap_set *set;
        if (cap_capture_next(r.cap, PVX_NS_PER_S, &set) != PVX_OK)
            continue;
        n = set->n == members ? n + 1 : 0;
        for (int c = 0; c < N_CAM; c++) {
            if (set->frame[c] == NULL)
                continue;
            const struct cap_frame *f = set->frame[c];
            T_EQ_I(f->t_exposure_ns, set->t_exposure_ns); /* one instant, all cameras */
            T_OK(memcmp(f->img.data, image_at(c, set->t_exposure_ns), image_bytes(c)) == 0);
        }
        T_EQ_I(set->spread_ns, 0);
        cap_set_release(set);
    }
    return n == how_many;
}

T_CASE(sets_of_one_instant)
{
    rig_init(&r, N_CAM, BED_FPS, config_of(0));
    for (int c = 0; c < N_CAM; c++) {
        r.cam[c] = config_of(c);
        r.cam[c].uri = r.uri[c];
        r.cam[c].buffers = 16;
        snprintf(r.uri[c], sizeof r.uri[c], "aravis:127.0.0.%d", 2 + c);
    }
    r.cfg.shared_clock = true;
    r.cfg.discard_first = 1;
    r.cfg.sets.max_wait_ns = 500 * PVX_NS_PER_MS;
    r.cfg.sets.min_cameras = 2;
    rig_start(&r);
    T_OK(sets_until(N_CAM, 10));
    bed_fault(2, (struct cap_gvcam_fault){.freeze = true});
    T_OK(sets_until(N_CAM - 1, 5));
    bed_fault(2, healthy);
    T_OK(sets_until(N_CAM, 5));
    T_LE(1, rig_stats(&r)->camera[2].count[CAP_BAD_STAMP]);
    cap_gvcam_free(&bed_cam[1]);
    T_OK(sets_until(N_CAM - 1, 5));
    fresh(1);
    T_OK(sets_until(N_CAM, 5));
    rig_end(&r);
    T_LE(1, r.st.camera[1].count[CAP_LOST_CAMERA]);
    T_EQ_I(r.st.camera[0].count[CAP_LOST_CAMERA], 0);
}

/* ---- a camera of others ------------------------------------------------------------------------ */

/* Its frames are numbered in their pixels. */
static void fill(ArvBuffer *b, void *unused, guint32 exposure_us, guint32 gain, ArvPixelFormat fmt)
{
    static unsigned number;
    int x, y, w, h;
    (void)unused, (void)exposure_us, (void)gain, (void)fmt;
    arv_buffer_get_image_region(b, &x, &y, &w, &h);
    memset((void *)(uintptr_t)arv_buffer_get_data(b, NULL), (int)(number++ % 251),
           (size_t)w * (size_t)h);
}

static void next_numbered(struct session *s)
{
    struct cap_frame *f = next_frame(&s->box);
    T_OK(f != NULL);
    if (f == NULL)
        return;
    const unsigned char *p = f->img.data;
    T_EQ_I(f->img.size, (size_t)W * H);
    T_OK(memcmp(p, p + 1, f->img.size - 1) == 0);
    if (s->good > 0)
        T_EQ_I(p[0], (s->last_image + (int)(f->id - s->last_id)) % 251);
    s->last_image = p[0];
    follows(s, f);
    cap_frame_release(f);
}

T_CASE(the_fake_of_libaravis)
{
    cap_gvcam_free(&bed_cam[0]);
    ArvGvFakeCamera *fake = arv_gv_fake_camera_new(bed_address[0], "F00");
    T_OK(fake != NULL && arv_gv_fake_camera_is_running(fake));
    if (fake == NULL || !arv_gv_fake_camera_is_running(fake))
        return;
    arv_fake_camera_set_fill_pattern(arv_gv_fake_camera_get_fake_camera(fake), fill, NULL);
    struct cap_source_config c = config_of(0);
    struct session s;
    struct cap_feature high = {"GainRaw", "99"}, fine = {"GainRaw", "3"};
    c.trigger = CAP_TRIGGER_ACTION;
    refuse(c, PVX_EINVAL, "cannot be triggered by action commands");
    c.trigger = CAP_TRIGGER_FREE_RUN;
    c.n_features = 1;
    c.features = &high;
    refuse(c, PVX_EINVAL, "GainRaw");
    c.features = &fine;
    if (begin(&s, &c)) {
        for (int k = 0; k < 12; k++)
            next_numbered(&s);
        refuse(config_of(0), PVX_EBUSY, "another program");
    }
    end(&s);
    T_EQ_I(s.box.lost, 0);
    T_EQ_I(s.box.count[CAP_INCOMPLETE] + s.box.count[CAP_ID_GAP], 0);
    c.trigger = CAP_TRIGGER_SOFTWARE;
    c.uri = "F00"; /* by its serial number */
    if (begin(&s, &c))
        for (int k = 0; k < 4; k++) {
            T_EQ_I(ops->trigger(s.src), PVX_OK);
            next_numbered(&s);
        }
    end(&s);
    T_EQ_I(s.last_id - s.first_id + 1, 4); /* one each, none on its own */
    g_object_unref(fake);
}

static void set_up(void)
{
    bed_open();
    for (int c = 0; c < N_CAM && bed_usable; c++)
        fresh(c);
}

T_MAIN(set_up(), bed_close())
