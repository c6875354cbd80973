/* What the configuration asks of a GigE camera and what the camera has, on cameras of our own over real GVCP/GVSP.  A
 * feature is taken from a camera by giving it another name in its GenICam file. */
#include <arv.h>

#include "capture/gevsim/gevsim.h"
#include "tests/lib/arvbed.h"
#include "tests/lib/logged.h"

static const char *const no_names[] = {NULL};

/* Give these features names that are like no other. */
static void hide(int c, const char *const *name)
{
    char *xml = (char *)bed_cam[c]->reg.xml, *end = xml + bed_cam[c]->reg.xml_bytes;
    for (int k = 0; *name != NULL; name++, k++) {
        size_t n = strlen(*name), found = 0;
        for (char *p = xml + 1; p + n < end; p++)
            if (memcmp(p, *name, n) == 0 &&
                ((p[-1] == '"' && p[n] == '"') || (p[-1] == '>' && p[n] == '<'))) {
                memset(p, 'a' + k % 26, n); /* no word of a name */
                found++;
            }
        T_OK(found >= 2);
    }
}

static struct cap_source_config fresh_without(const char *const *name)
{
    bed_fresh(0);
    hide(0, name);
    struct cap_source_config c = bed_source(0);
    c.buffers = 8;
    return c;
}

/* It is refused, in these words. */
static void refused(const struct cap_source_config *c, const char *says)
{
    cap_source *src = NULL;
    struct pvx_diag d = {""};
    T_OK(ops->open(c, &src, &d) != PVX_OK);
    T_CONTAINS(d.text, "camera a (aravis:127.0.0.2): ");
    T_CONTAINS(d.text, says);
    if (src != NULL)
        ops->close(&src);
}

/* It gives good frames, and warns so often. */
static void warns(const struct cap_source_config *c, int warnings, const char *says)
{
    struct session s;
    log_begin(PVX_LOG_WARN);
    if (begin(&s, c))
        next_good(&s);
    end(&s);
    log_end();
    if (log_count("camera a") != warnings)
        printf("%s\n", log_text);
    T_EQ_I(log_count("camera a"), warnings);
    T_CONTAINS(log_text, says);
}

/* ---- features that the camera lacks ------------------------------------------------------------ */

static void works_without(const char *const *name)
{
    struct cap_source_config c = fresh_without(name);
    struct session s;
    log_begin(PVX_LOG_WARN);
    if (!begin(&s, &c) || !next_good(&s))
        printf("  without %s\n", name[0]);
    end(&s);
    log_end();
    T_OK(log_count("camera a") == 0 || log_count(name[0]) > 0);
}

/* Those that a start reads or sets without being told, one by one, then all others together. */
T_CASE(no_feature_is_needed_that_nobody_asked_for)
{
    const char *others[100] = {NULL};
    int n = 0;
    for (size_t i = 0; gvcam_features[i].category != NULL; i++) {
        const char *name[] = {gvcam_features[i].name, NULL}, *of = gvcam_features[i].category;
        if (name[0] == NULL || strcmp(name[0], "AcquisitionStart") == 0)
            continue;
        if (strcmp(of, "ImageFormatControl") == 0 || strcmp(of, "AcquisitionControl") == 0 ||
            strcmp(of, "TransportLayerControl") == 0)
            works_without(name);
        else
            others[n++] = name[0];
    }
    T_LE(20, n);
    works_without(others);
}

T_CASE(a_camera_with_hardly_a_feature)
{
    static const char *const thermal[] = {"AcquisitionMode",
                                          "AcquisitionFrameRateEnable",
                                          "AcquisitionFrameRate",
                                          "TriggerSelector",
                                          "TriggerMode",
                                          "TriggerSource",
                                          "TriggerActivation",
                                          "TriggerSoftware",
                                          "PixelFormat",
                                          "Width",
                                          "Height",
                                          "OffsetX",
                                          "OffsetY",
                                          "PayloadSize",
                                          "SensorWidth",
                                          "SensorHeight",
                                          "ExposureTime",
                                          "Gain",
                                          "ChunkModeActive",
                                          NULL};
    struct cap_source_config c = fresh_without(thermal);
    warns(&c, 6, "the camera has no AcquisitionFrameRate that can be set");
    T_CONTAINS(log_text, "(it has AcquisitionResultingFrameRate");
    T_CONTAINS(log_text, "the camera has no PixelFormat: every frame is checked for Mono8");
    c.fmt = CAP_FMT_NONE;
    refused(&c, "pixel_format: auto: the camera has no PixelFormat");
    c.fmt = CAP_GREY8;
    c.width = c.height = 0;
    refused(&c, "image size: the camera has no Width (it has ");
}

static void lacks(const struct cap_source_config *c, const char *feature, const char *says)
{
    const char *name[] = {feature, NULL};
    bed_fresh(0);
    hide(0, name);
    refused(c, says);
}

T_CASE(what_was_asked_for_is_refused_by_name)
{
    struct cap_source_config c = fresh_without(no_names), plain = c;
    c.exposure_us = 500;
    lacks(&c, "ExposureTime",
          "exposure_us: the camera has no ExposureTime (it has ChunkExposureTime, ExposureMode");
    c = plain;
    c.gain = 3;
    lacks(&c, "Gain", "gain: the camera has no Gain");
    c = plain;
    c.chunks = true;
    lacks(&c, "ChunkModeActive", "chunks: the camera has no ChunkModeActive");
    c = plain;
    c.lines = true;
    lacks(&c, "ChunkModeActive", "triggers: when: line: the camera has no ChunkModeActive");
    lacks(&c, "ChunkLineStatusAll", "the camera does not send ChunkLineStatusAll");
    c = plain;
    c.trigger = CAP_TRIGGER_LINE;
    lacks(&c, "TriggerMode", "cannot be triggered: the camera has no TriggerMode (it has Trigger");
    lacks(&c, "TriggerSource", "cannot be triggered: the camera has no TriggerSource (it has Tri");
    c.trigger = CAP_TRIGGER_SOFTWARE;
    lacks(&c, "TriggerSoftware", "the camera has no TriggerSoftware (it has TriggerSource");
    c.trigger = CAP_TRIGGER_ACTION;
    lacks(&c, "ActionGroupMask", "the camera has no ActionGroupMask (it has ActionGroupKey");
    c = plain;
    c.ptp = true;
    lacks(&c, "PtpStatus",
          "ptp: the camera has no PtpStatus (it has LineStatus, LineStatusAll, GevIEEE1588Status");
    static const char *const both[] = {"PtpEnable", "GevIEEE1588", NULL};
    c = fresh_without(both);
    c.ptp = true;
    refused(&c, "neither PtpEnable nor GevIEEE1588 (it has PtpStatus");
    c = plain;
    c.fmt = CAP_RGB8;
    bed_fresh(0);
    refused(&c, "format RGB8 refused: the camera has Mono8 and offers Mono8");
    struct cap_feature wrong[] = {{"ExposreTime", "5"}, {"PixelFormat", "Mono7"}};
    c = plain;
    c.n_features = 1;
    c.features = &wrong[0];
    refused(&c, "the camera has no feature ExposreTime (it has ExposureTime");
    c.features = &wrong[1];
    refused(&c, "feature PixelFormat = Mono7 refused: the camera offers Mono8");
}

/* ---- ours and the person's --------------------------------------------------------------------- */

T_CASE(an_offset_that_was_asked_for_stays)
{
    static struct cap_feature at[] = {{"OffsetY", "20"}, {"OffsetX", "40"}};
    struct cap_source_config c = fresh_without(no_names);
    for (int times = 0; times < 2; times++) { /* the second time the camera has it already */
        struct session s;
        c.width = 80;
        c.height = 60;
        c.features = at;
        c.n_features = 2;
        if (begin(&s, &c)) {
            struct cap_frame *f = next_frame(&s.box);
            const unsigned char *p = f->img.data;
            int i = 0; /* which image? the one whose window this is */
            while (i < BED_RING && memcmp(p, bed_image[0][i] + 20 * BED_W + 40, 80) != 0)
                i++;
            T_OK(i < BED_RING && f->img.size == 80 * 60);
            for (int y = 0; y < 60 && i < BED_RING; y++)
                T_OK(memcmp(p + y * 80, bed_image[0][i] + (size_t)(20 + y) * BED_W + 40, 80) == 0);
            cap_frame_release(f);
        }
        end(&s);
    }
    c.n_features = 0; /* now nobody asks for it */
    log_begin(PVX_LOG_WARN);
    struct session s;
    begin(&s, &c);
    end(&s);
    log_end();
    T_CONTAINS(log_text, "its OffsetX was 40 and is now 0; `features: { OffsetX: 40 }` keeps it");
    T_CONTAINS(log_text, "its OffsetY was 20 and is now 0");
    at[1].value[0] = '9'; /* 90 + 80 > 160 */
    c.n_features = 2;
    refused(&c, "OffsetX");
    c.width = c.height = 0; /* the size of `features` */
    struct cap_feature window[] = {
        {"OffsetX", "40"}, {"Width", "80"}, {"OffsetY", "20"}, {"Height", "60"}};
    c.features = window;
    c.n_features = 4;
    T_OK(begin(&s, &c));
    end(&s);
}

/* The setting and the line disagree, and the refusal names both. */
static void disagree(struct cap_source_config c, const char *name, const char *value,
                     const char *says)
{
    struct cap_feature f = {"", ""};
    snprintf(f.name, sizeof f.name, "%s", name);
    snprintf(f.value, sizeof f.value, "%s", value);
    c.features = &f;
    c.n_features = 1;
    refused(&c, says);
}

T_CASE(a_conflict_is_a_sentence_with_both)
{
    struct cap_source_config plain = fresh_without(no_names), c = plain;
    disagree(c, "AcquisitionFrameRate", "30",
             "fps: 25 and `features: AcquisitionFrameRate: 30` disagree: the camera now has 25");
    disagree(c, "AcquisitionFrameRateEnable", "0",
             "fps: 25 and `features: AcquisitionFrameRateEnable: 0` disagree");
    disagree(c, "Width", "80", "the rig's size 160x120 and `features: Width: 80` disagree");
    disagree(c, "AcquisitionMode", "SingleFrame", "needs Continuous, and `features: Acquisition");
    c.exposure_us = 500;
    disagree(c, "ExposureTime", "2000", "exposure_us: 500 and `features: ExposureTime: 2000`");
    c = plain;
    c.gain = 3;
    disagree(c, "Gain", "6", "gain: 3 and `features: Gain: 6` disagree: the camera now has 3");
    c = plain;
    c.gige.packet_delay = 10000;
    disagree(c, "GevSCPD", "70", "gige.packet_delay_ns: 10000 and `features: GevSCPD: 70`");
    disagree(c, "GevSCPD", "10005", "gige.packet_delay_ns: 10000 and `features: GevSCPD: 10005`");
    c = plain;
    c.chunks = true;
    disagree(c, "ChunkModeActive", "0", "chunks: true and `features: ChunkModeActive: 0`");
    c = plain;
    c.ptp = true;
    disagree(c, "PtpEnable", "0", "ptp: true and `features: PtpEnable` disagree");
    c = plain;
    c.trigger = CAP_TRIGGER_LINE;
    disagree(c, "TriggerMode", "Off", "the configured trigger disagree: TriggerMode is Off");
    disagree(c, "TriggerSource", "Software", "disagree: TriggerSource is Software instead of Line");
    struct cap_feature undone[] = {{"Gain", "6"}, {"UserSetLoad", "1"}};
    c = plain;
    c.features = undone;
    c.n_features = 2;
    refused(&c, "`features: Gain: 6` did not stay: a later setting made it 0");
}

T_CASE(what_agrees_is_no_conflict)
{
    struct cap_source_config c = fresh_without(no_names);
    struct cap_feature same[] = {{"AcquisitionFrameRate", "25"},
                                 {"ExposureTime", "500"},
                                 {"Gain", "6"},
                                 {"Gain", "3"},
                                 {"PixelFormat", "Mono8"},
                                 {"Width", "160"},
                                 {"AcquisitionMode", "Continuous"},
                                 {"ActionDeviceKey", "7"}, /* can only be written */
                                 {"TriggerSelector", "FrameStart"},
                                 {"TriggerMode", "Off"}};
    c.exposure_us = 500;
    c.gain = 3;
    c.features = same;
    c.n_features = sizeof same / sizeof same[0];
    warns(&c, 0, "");
    struct cap_feature waits[] = {{"TriggerSource", "Line1"}, {"TriggerMode", "On"},
                                  {"ChunkModeActive", "1"},   {"ChunkSelector", "Gain"},
                                  {"ChunkEnable", "1"},       {"GevSCPD", "70"}};
    struct session s;
    c.features = waits;
    c.n_features = sizeof waits / sizeof waits[0];
    log_begin(PVX_LOG_WARN);
    begin(&s, &c);
    end(&s);
    log_end();
    T_CONTAINS(log_text,
               "by `features` its TriggerMode is On instead of Off: it exposes only when");
}

T_MAIN(bed_open(), bed_close())
