/* pyrovox cameras: formats in few words; the judgement of `cameras test`; wrapped text. */
#include "tests/t.h"
#include "daemon/cli/cameras/list.c"
#include "daemon/cli/cameras/judge.c"
#include "base/file.h"
#include "daemon/doctor/wrap.h"

T_CASE(formats)
{
    char out[256];
    cameras_formats(
        "YUYV 320x240 15 30 Hz\nYUYV 640x480 15 30 Hz\nYUYV 160x120 30 Hz\nJPEG 1920x1080 30 "
        "Hz\nMono8 640x480\n",
        out, sizeof out);
    T_EQ_S(out, "YUYV 640x480 15 30 Hz (+2 sizes); JPEG 1920x1080 30 Hz; Mono8 640x480");
    cameras_formats("Mono8 64x48 5 Hz\nMono8 32x24 5 Hz\nsomething else\n\n", out, sizeof out);
    T_EQ_S(out, "Mono8 64x48 5 Hz (+1 size); something else");
    cameras_formats("Mono8 64x48 5 Hz\nRGB8 64x48 5 Hz\nRGB16 32x24 5 Hz\nBGR8 64x48 5 Hz\n", out,
                    sizeof out);
    T_EQ_S(out, "Mono8, RGB8, BGR8 64x48 5 Hz; RGB16 32x24 5 Hz");
    cameras_formats("", out, sizeof out);
    T_EQ_S(out, "");
    char small[12];
    cameras_formats("Mono8 640x480 1 Hz\nMono16 640x480 1 Hz", small, sizeof small);
    T_LE(strlen(small), sizeof small - 1);
    char many[8000] = "";
    for (int i = 0; i < 200; i++)
        snprintf(many + strlen(many), sizeof many - strlen(many), "F%d 64x48 1 Hz\n", i);
    cameras_formats(many, out, sizeof out); /* cut, not overrun */
    T_LE(strlen(out), sizeof out - 1);
}

T_CASE(series)
{
    struct camtest_series s = {0};
    const double v[] = {2, 4, 4, 4, 5, 5, 7, 9};
    for (size_t i = 0; i < 8; i++)
        camtest_add(&s, v[i]);
    T_NEAR(s.mean, 5, 1e-12);
    T_NEAR(camtest_std(&s), sqrt(32.0 / 7), 1e-12);
    T_NEAR(camtest_worst(&s), 4, 1e-12);
    s = (struct camtest_series){0};
    T_NEAR(camtest_std(&s) + camtest_worst(&s), 0, 0);
}

/* A test in which two cameras gave 100 good frames each at 20 Hz. */
static struct camtest t;
static void good(void)
{
    memset(&t, 0, sizeof t);
    t.n = 2;
    t.fps = 20;
    t.sets = t.by_size[2] = 100;
    for (uint32_t i = 0; i < 2; i++) {
        struct camtest_camera *c = &t.camera[i];
        snprintf(c->name, sizeof c->name, "cam%u", i);
        c->frames = 100;
        c->count[CAP_RECEIVED] = 100;
        c->bytes = 100 * 921600;
        c->first_mono_ns = 1;
        c->last_mono_ns = 1 + 99 * 50000000LL;
        for (int k = 0; k < 99; k++)
            camtest_add(&c->device, 0.05);
        c->stats.health = cap_health_unknown;
    }
    for (int k = 0; k < 100; k++)
        camtest_add(&t.spread, 0.0002);
}
static void expect(uint32_t camera, enum camtest_verdict v, const char *what, const char *remedy)
{
    camtest_judge(&t);
    const struct camtest_camera *c = &t.camera[camera];
    T_CHECK_(c->verdict == v, "verdict %d (%s), want %d", (int)c->verdict, c->what, (int)v);
    T_CONTAINS(c->what, what);
    T_CONTAINS(c->remedy, remedy);
}

T_CASE(well)
{
    good();
    expect(0, CAMTEST_OK, "", "");
    T_EQ_I(t.verdict, CAMTEST_OK);
    T_EQ_I(t.whole, 100);
    T_NEAR(t.camera[0].hz, 20, 1e-9);
}

T_CASE(frames_lost)
{
    good();
    t.camera[1].count[CAP_INCOMPLETE] = 1;
    expect(1, CAMTEST_WARN, "1 of 101 frames incomplete", "pyrovox doctor");
    t.camera[1].count[CAP_INCOMPLETE] = 20;
    expect(1, CAMTEST_FAIL, "20 of 120", "packet_delay_ns");
    good();
    t.camera[0].count[CAP_ID_GAP] = 5;
    expect(0, CAMTEST_FAIL, "never came", "bandwidth");
    good();
    t.camera[0].count[CAP_OVERFLOW] = 5;
    expect(0, CAMTEST_WARN, "too slow", "buffers");
    good();
    t.camera[0].count[CAP_BAD_SIZE] = 5;
    expect(0, CAMTEST_FAIL, "another size", "MTU");
    good();
    t.camera[0].count[CAP_BAD_STAMP] = 1;
    expect(0, CAMTEST_FAIL, "clock", "PTP");
    good();
    t.camera[0].count[CAP_LOST_CAMERA] = 2;
    t.camera[0].count[CAP_INCOMPLETE] = 1; /* the worse one is said */
    expect(0, CAMTEST_FAIL, "stopped answering 2 times", "cable");
}

T_CASE(blacks_are_clipped)
{
    good();
    t.camera[1].cut = 0.03; /* too little to matter */
    t.camera[1].pedestal = 0.02;
    expect(1, CAMTEST_OK, "", "");
    t.camera[1].cut = 0.5;
    t.camera[1].pedestal = 0.0296;
    expect(1, CAMTEST_WARN, "black is clipped: 50 % of the noise of its dark is cut off at 0",
           "raise the camera's black level by 2.96 % of full scale (8 steps of 8 bits");
    T_OK(strchr(t.camera[1].what, ';') == NULL);
    t.camera[1].count[CAP_LOST_CAMERA] = 2; /* the worse one is said */
    expect(1, CAMTEST_FAIL, "stopped answering", "cable");
}

T_CASE(nothing_came)
{
    good();
    t.camera[1].frames = 0;
    t.by_size[2] = 0;
    t.by_size[1] = 100;
    expect(1, CAMTEST_FAIL, "no frame came", "firewall");
    T_EQ_I(t.verdict, CAMTEST_OK); /* of the one that works */
    T_EQ_I(t.whole, 100);
    t.triggered = true;
    expect(1, CAMTEST_FAIL, "waits for a trigger", "SYNC.md");
    t.camera[1].count[CAP_RECEIVED] = 0;
    snprintf(t.camera[1].stats.error, sizeof t.camera[1].stats.error, "nobody answers");
    expect(1, CAMTEST_FAIL, "nobody answers", "");
    t.camera[1].stats.error[0] = '\0';
    t.camera[1].count[CAP_INCOMPLETE] = 7;
    expect(1, CAMTEST_FAIL, "not one whole frame, 7", "MTU");
}

T_CASE(rhythm)
{
    good();
    t.fps = 30;
    expect(0, CAMTEST_WARN, "20.00 Hz instead of 30.00", "exposure");
    t.fps = 10;
    expect(0, CAMTEST_WARN, "20.00 Hz instead of 10.00", "AcquisitionFrameRateEnable");
    good();
    camtest_add(&t.camera[0].device, 0.08);
    expect(0, CAMTEST_WARN, "off their rhythm", "hardware line");
}

T_CASE(health)
{
    good();
    t.camera[0].stats.health.temperature_c = 74;
    expect(0, CAMTEST_WARN, "74 degrees", "metal");
    t.camera[0].stats.health.temperature_c = 90;
    expect(0, CAMTEST_FAIL, "90 degrees", "metal");
    good();
    t.camera[0].stats.health.link_mbps = 1000;
    expect(0, CAMTEST_OK, "", "");
    t.camera[0].stats.health.link_mbps = 150;
    expect(0, CAMTEST_WARN, "147 of 150 Mb/s", "lower fps");
}

/* What capture found by itself is told with its own remedy. */
T_CASE(troubles_of_capture)
{
    good();
    t.camera[1].stats.n_troubles = 1;
    t.camera[1].stats.trouble[0] =
        (struct cap_trouble){.cause = CAP_MISSED_TRIGGER, .n = 3, .detail = "3 of 100"};
    expect(1, CAMTEST_WARN, "misses exposures: 3 of 100", "exposure and readout");
    t.camera[1].stats.trouble[0].cause = CAP_INCOMPLETE; /* told by its count */
    expect(1, CAMTEST_OK, "", "");
}

T_CASE(sets)
{
    good();
    t.by_size[2] = 95;
    t.by_size[1] = 5;
    camtest_judge(&t);
    T_EQ_I(t.verdict, CAMTEST_WARN);
    T_CONTAINS(t.what, "5 % of the sets lack");
    t.by_size[2] = 10;
    t.by_size[1] = 90;
    camtest_judge(&t);
    T_EQ_I(t.verdict, CAMTEST_FAIL);
    T_CONTAINS(t.remedy, "SYNC.md");
    good();
    for (int k = 0; k < 1000; k++)
        camtest_add(&t.spread, 0.011);
    camtest_judge(&t);
    T_EQ_I(t.verdict, CAMTEST_WARN);
    T_CONTAINS(t.what, "ms apart");
}

/* The page for the lab explains everything that the daemon may say. */
T_CASE(every_trouble_is_explained)
{
    char *page = NULL;
    size_t len;
    T_EQ_I(pvx_file_read("capture/SYNC.md", 1 << 20, &page, &len, NULL), PVX_OK);
    for (int k = 0; k < CAP_N_COUNT && page != NULL; k++) {
        char word[64];
        snprintf(word, sizeof word, "`%s`", cap_count_defs[k].name);
        if (cap_trouble_defs[k].what != NULL)
            T_CHECK_(strstr(page, word) != NULL, "%s is not in capture/SYNC.md", word);
    }
    free(page);
}

/* What it tells people to write into pyrovoxd.yaml can be read. */
T_CASE(its_configurations_are_read)
{
    char *page = NULL;
    size_t len;
    struct dmn_config *c = calloc(1, sizeof *c);
    T_EQ_I(pvx_file_read("capture/SYNC.md", 1 << 20, &page, &len, NULL), PVX_OK);
    int n = 0;
    for (const char *p = page; p != NULL && (p = strstr(p, "```yaml\n")) != NULL; n++) {
        p += 8;
        const char *end = strstr(p, "```");
        T_OK(end != NULL);
        if (end == NULL)
            break;
        struct pvx_diag d = {""};
        dmn_config_defaults(c);
        pvx_err e = dmn_config_parse(p, (size_t)(end - p), "SYNC.md", c, &d);
        T_CHECK_(e == PVX_OK, "block %d: %s", n, d.text);
        p = end + 3;
    }
    T_LE(6, n);
    free(c);
    free(page);
}

T_CASE(wrapped)
{
    char *text = NULL;
    size_t len;
    FILE *f = open_memstream(&text, &len);
    fputs("ab ", f);
    dmn_wrap(f, "one two  three \xc2\xb5\xc2\xb5\xc2\xb5 muchlongerthanaline end", 3, 2, 12);
    fclose(f);
    T_EQ_S(text, "ab one two\n  three \xc2\xb5\xc2\xb5\xc2\xb5\n  muchlongerthanaline\n  end\n");
    free(text);
}
