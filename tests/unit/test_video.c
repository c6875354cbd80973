/* test_video.c - films as ffmpeg writes them: all bits, matrix, range, turn and times obeyed, the rest refused by name. */
#include "tests/t.h"

#include <stdlib.h>

#include "base/file.h"
#include "capture/files/imgio.h"
#include "tests/lib/plugins.h"
#include "tests/lib/scratch.h"

enum { W = 64, H = 48 };
static const uint8_t quarter[4][3] = {
    {255, 255, 255}, {40, 200, 60}, {20, 60, 220}, {128, 128, 128}};

/* q.ppm: four quarters of one colour each. */
static void write_picture(void)
{
    struct pvx_diag d = {""};
    static uint8_t b[32 + W * H * 6]; /* of 16 bits: from 8, ffmpeg makes 65280 of 255 */
    size_t n = (size_t)snprintf((char *)b, sizeof b, "P6 %d %d 65535\n", W, H);
    for (int i = 0; i < 3 * W * H; i++, n += 2)
        b[n] = b[n + 1] = quarter[i / 3 / W / (H / 2) * 2 + i / 3 % W / (W / 2)][i % 3];
    T_EQ_I(pvx_file_write(at("q.ppm"), b, n, &d), PVX_OK);
}

/* Run a command line in the scratch folder. */
static bool shell(const char *line)
{
    char all[2048];
    snprintf(all, sizeof all, "cd '%s' && %s", at("."), line);
    bool done = system(all) == 0;
    T_CHECK_(done, "%s", line);
    return done;
}

/* A film of n times that picture at 10 a second. */
static bool film(const char *out, int n, const char *options)
{
    char line[1024];
    snprintf(line, sizeof line,
             "ffmpeg -nostdin -v fatal -y -framerate 10 -loop 1 -i q.ppm -frames:v %d %s %s", n,
             options, out);
    return shell(line);
}

static double sample(const struct cap_image *img, size_t i)
{
    return img->fmt == CAP_GREY_F32 || img->fmt == CAP_RGB_F32
               ? (double)((const float *)img->data)[i]
           : cap_pixfmt_depth(img->fmt) == 16 ? ((const uint16_t *)img->data)[i] / 65535.0
                                              : ((const uint8_t *)img->data)[i] / 255.0;
}

static double luma(const uint8_t c[3])
{
    return (0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2]) / 255;
}

/* Its first frame has this format and the four colours. */
static void shows(const char *name, enum cap_pixfmt fmt, double within)
{
    struct pvx_diag d = {""};
    struct cap_video_info info = {0};
    struct cap_image img = {0};
    cap_video *v;
    T_CHECK_(cap_video_open(at("%s", name), &v, &info, &d) == PVX_OK, "%s", d.text);
    if (v == NULL)
        return;
    T_CHECK_(info.fmt == fmt, "%s is %s", name, cap_pixfmt_name(info.fmt));
    T_OK(info.width == W && info.height == H);
    T_NEAR(info.fps, 10, 1e-6);
    T_EQ_I(cap_video_next(v, &img, NULL, &d), PVX_OK);
    int nch = cap_pixfmt_channels(img.fmt);
    for (int q = 0; q < 4; q++)
        for (int c = 0; c < nch; c++) {
            size_t i = (size_t)((H / 4 + q / 2 * (H / 2)) * W + W / 4 + q % 2 * (W / 2));
            double got = sample(&img, i * (size_t)nch + (size_t)c);
            double want = nch == 1 ? luma(quarter[q]) : quarter[q][c % 3] / 255.0;
            T_CHECK_(fabs(got - want) <= within, "%s: quarter %d, channel %d: %.5f, want %.5f",
                     name, q, c, got, want);
        }
    cap_video_close(&v);
}

T_CASE(all_bits)
{
    static const struct {
        const char *name, *options;
        enum cap_pixfmt fmt;
        double within;
    } k[] = {
        {"g8.mkv", "-c:v ffv1 -pix_fmt gray", CAP_GREY8, 0.003},
        {"g10.mkv", "-c:v ffv1 -pix_fmt gray10le", CAP_GREY16, 0.002},
        {"g12.mkv", "-c:v ffv1 -pix_fmt gray12le", CAP_GREY16, 0.002},
        {"g16.mkv", "-c:v ffv1 -pix_fmt gray16le", CAP_GREY16, 0.002},
        {"g16be.mov", "-c:v rawvideo -pix_fmt gray16be", CAP_GREY16, 0.002},
        {"r8.mkv", "-c:v ffv1 -pix_fmt bgra", CAP_RGB8, 0.005},
        {"r10.mkv", "-c:v ffv1 -pix_fmt gbrp10le", CAP_RGB16, 0.001},
        {"r16.mkv", "-c:v ffv1 -pix_fmt rgb48le", CAP_RGB16, 2e-5},
        {"r48be.mov", "-c:v rawvideo -pix_fmt rgb48be", CAP_RGB16, 2e-5},
        {"r565.mov", "-c:v rawvideo -pix_fmt rgb565le", CAP_RGB8, 0.02},
        {"y10.mp4", "-c:v libx264 -qp 0 -pix_fmt yuv420p10le", CAP_RGB16, 0.005},
        {"y12.mp4", "-c:v libx265 -x265-params lossless=1:log-level=none -pix_fmt yuv422p12le",
         CAP_RGB16, 0.005},
        {"y10.mov", "-c:v prores_ks -profile:v 4 -pix_fmt yuv444p10le", CAP_RGB16, 0.004},
        {"uyvy.avi", "-c:v rawvideo -pix_fmt uyvy422", CAP_RGB8, 0.01},
        {"j.avi", "-c:v mjpeg -q:v 1", CAP_RGB8, 0.01},
        {"f.mov", "-c:v exr -pix_fmt gbrpf32le", CAP_RGB_F32, 0.005},
        {"a16.apng", "-f apng -pix_fmt rgb48be", CAP_RGB16, 2e-5},
    };
    for (size_t i = 0; i < sizeof k / sizeof *k; i++)
        if (film(k[i].name, 5, k[i].options))
            shows(k[i].name, k[i].fmt, k[i].within);
    for (int white = 0; white < 2; white++) { /* the first is white, the third is black */
        struct pvx_diag d = {""};
        struct cap_image img;
        cap_video *v;
        if (!film("m.mov", 2,
                  white ? "-c:v rawvideo -pix_fmt monow" : "-c:v rawvideo -pix_fmt monob"))
            return;
        T_EQ_I(cap_video_open(at("m.mov"), &v, NULL, &d), PVX_OK);
        T_EQ_I(cap_video_next(v, &img, NULL, &d), PVX_OK);
        T_EQ_I(img.fmt, CAP_GREY8);
        T_EQ_I(((const uint8_t *)img.data)[0], 255);
        cap_video_close(&v);
    }
}

/* A film of raw pixels in a file, in a container that names what they are. */
static bool raw_film(const char *out, const char *format, const void *bytes, size_t n,
                     const char *options)
{
    struct pvx_diag d = {""};
    char line[512];
    T_EQ_I(pvx_file_write(at("raw"), bytes, n, &d), PVX_OK);
    snprintf(
        line, sizeof line,
        "ffmpeg -nostdin -v fatal -y -f rawvideo -framerate 10 -video_size %dx%d -pixel_format %s "
        "-i raw %s %s",
        W, H, format, options, out);
    return shell(line);
}

T_CASE(matrix_and_range)
{
    static const char *const matrix[][2] = {
        {"bt601", "smpte170m"}, {"bt709", "bt709"}, {"bt2020", "bt2020nc"}, {"bt601", "unknown"}};
    for (int m = 0; m < 4; m++)
        for (int full = 0; full < 2; full++) {
            char o[256];
            snprintf(o, sizeof o,
                     "-vf scale=out_color_matrix=%s:out_range=%s:flags=accurate_rnd,format=yuv444p "
                     "-c:v ffv1 -colorspace %s -color_range %s",
                     matrix[m][0], full ? "pc" : "tv", matrix[m][1], full ? "pc" : "tv");
            if (film("m.mkv", 2, o))
                shows("m.mkv", CAP_RGB8, 0.007);
        }
    static uint8_t yuv[3 * W * H];
    memset(yuv, 100, W * H);
    memset(yuv + W * H, 140, W * H);
    memset(yuv + 2 * W * H, 120, W * H);
    struct pvx_diag d = {""};
    struct cap_image img;
    cap_video *v;
    if (!raw_film("ycgco.mkv", "yuv444p", yuv, sizeof yuv, "-c:v ffv1 -colorspace ycgco"))
        return;
    T_EQ_I(cap_video_open(at("ycgco.mkv"), &v, NULL, &d), PVX_OK);
    T_EQ_I(cap_video_next(v, &img, NULL, &d), PVX_OK);
    double y = 84 / 219.0, cg = 12 / 224.0, co = -8 / 224.0;
    T_NEAR(sample(&img, 0), y - cg + co, 0.003);
    T_NEAR(sample(&img, 1), y + cg, 0.003);
    T_NEAR(sample(&img, 2), y - cg - co, 0.003);
    cap_video_close(&v);
}

/* The transfer function that a film names is that of its pictures; without one they are linear. */
T_CASE(transfer)
{
    static const struct {
        const char *name;
        int yuv;
    } k[] = {{"unknown", 0},
             {"linear", 0},
             {"iec61966-2-1", CAP_YUV_CODED},
             {"bt709", CAP_YUV_CODED | CAP_YUV_TRANSFER_709}};
    for (size_t i = 0; i < sizeof k / sizeof *k; i++) {
        struct pvx_diag d = {""};
        struct cap_image img;
        cap_video *v;
        char o[128];
        snprintf(o, sizeof o, "-c:v ffv1 -color_trc %s", k[i].name);
        if (!film("t.mkv", 1, o))
            return;
        T_EQ_I(cap_video_open(at("t.mkv"), &v, NULL, &d), PVX_OK);
        T_EQ_I(cap_video_next(v, &img, NULL, &d), PVX_OK);
        T_EQ_I(img.yuv, k[i].yuv);
        cap_video_close(&v);
    }
}

/* Bits that fill their depth are full scale exactly, and others in proportion. */
T_CASE(full_scale)
{
    static const struct {
        const char *format, *options;
        int channels, depth;
    } k[] = {{"gray10le", "", 1, 10},
             {"gray12le", "", 1, 12},
             {"gray16le", "", 1, 16},
             {"gbrp10le", "", 3, 10},
             {"gbrp12le", "", 3, 12},
             {"yuv444p10le", "-color_range pc", 3, 10},
             {"yuv444p12le", "-color_range pc", 3, 12}};
    static uint16_t px[3 * W * H];
    for (size_t i = 0; i < sizeof k / sizeof *k; i++) {
        struct pvx_diag d = {""};
        struct cap_image img;
        cap_video *v;
        char o[64];
        int full = (1 << k[i].depth) - 1, planes = k[i].channels;
        bool yuv = k[i].format[0] == 'y';
        for (int x = 0; x < planes * W * H; x++)
            px[x] = (uint16_t)(yuv && x >= W * H ? (full + 1) / 2 : x % (W * H) == 0 ? full : 500);
        snprintf(o, sizeof o, "-c:v ffv1 %s", k[i].options);
        if (!raw_film("full.mkv", k[i].format, px, sizeof *px * (size_t)planes * W * H, o))
            return;
        T_EQ_I(cap_video_open(at("full.mkv"), &v, NULL, &d), PVX_OK);
        T_EQ_I(cap_video_next(v, &img, NULL, &d), PVX_OK);
        T_EQ_I(img.fmt, planes == 1 ? CAP_GREY16 : CAP_RGB16);
        const uint16_t *got = img.data;
        T_EQ_I(got[0], 65535);
        T_EQ_I(got[planes], (int)(500 * 65535.0 / full + 0.5));
        cap_video_close(&v);
    }
}

/* A palette of greys is grey, and one that is missing is none. */
T_CASE(palette)
{
    static uint8_t px[W * H + 1024];
    for (int i = 0; i < W * H; i++)
        px[i] = (uint8_t)(i * 7);
    for (int i = 0; i < 256; i++)
        memset(px + W * H + 4 * i, i, 4);
    for (int missing = 0; missing < 2; missing++) {
        struct pvx_diag d = {""};
        struct cap_image img;
        cap_video *v;
        if (missing)
            memset(px + W * H, 0, 1024);
        if (!raw_film("p.avi", "pal8", px, sizeof px, "-c:v rawvideo"))
            return;
        pvx_err e = cap_video_open(at("p.avi"), &v, NULL, &d);
        T_CHECK_(e == (missing ? PVX_EUNSUP : PVX_OK), "%d: %s", missing, d.text);
        if (e != PVX_OK)
            continue;
        T_EQ_I(cap_video_next(v, &img, NULL, &d), PVX_OK);
        T_EQ_I(img.fmt, CAP_GREY8);
        T_EQ_I(memcmp(img.data, px, W * H), 0);
        cap_video_close(&v);
    }
}

/* Put a display matrix into an MP4: a b, c d of 16.16 bits in its box tkhd. */
static void put_matrix(const char *name, const double m[4])
{
    struct pvx_diag d = {""};
    char *b;
    size_t n;
    T_EQ_I(pvx_file_read(at("%s", name), 1 << 20, &b, &n, &d), PVX_OK);
    char *box = memmem(b, n, "tkhd", 4);
    T_OK(box != NULL);
    for (int i = 0; box != NULL && i < 4; i++) {
        int32_t v = (int32_t)(65536 * m[i]);
        char *to = box + 44 + (i / 2 * 3 + i % 2) * 4;
        for (int k = 0; k < 4; k++)
            to[k] = (char)(v >> (24 - 8 * k));
    }
    T_EQ_I(pvx_file_write(at("turned.mov"), b, n, &d), PVX_OK);
    free(b);
}

T_CASE(turned_as_ffmpeg_turns)
{
    static const double m[8][4] = {{1, 0, 0, 1},  {0, 1, -1, 0}, {-1, 0, 0, -1}, {0, -1, 1, 0},
                                   {-1, 0, 0, 1}, {1, 0, 0, -1}, {0, 1, 1, 0},   {0, -1, -1, 0}};
    struct pvx_diag d = {""};
    struct cap_video_info info;
    struct cap_image img;
    cap_video *v;
    if (!film("up.mov", 1, "-c:v png -pix_fmt rgb24"))
        return;
    for (int i = 0; i < 8; i++) {
        char *b;
        size_t n;
        put_matrix("up.mov", m[i]);
        shell("ffmpeg -nostdin -v fatal -y -i turned.mov -frames:v 1 -pix_fmt rgb24 -f rawvideo "
              "shown");
        T_EQ_I(pvx_file_read(at("shown"), 1 << 20, &b, &n, &d), PVX_OK);
        T_EQ_I(cap_video_open(at("turned.mov"), &v, &info, &d), PVX_OK);
        T_EQ_I(cap_video_next(v, &img, NULL, &d), PVX_OK);
        T_OK(info.width == (m[i][0] != 0 ? W : H) && img.width == info.width);
        T_CHECK_(img.size == n && memcmp(img.data, b, n) == 0, "matrix %d", i);
        free(b);
        cap_video_close(&v);
    }
    put_matrix("up.mov", (double[4]){0.7071, 0.7071, -0.7071, 0.7071});
    T_EQ_I(cap_video_open(at("turned.mov"), &v, &info, &d), PVX_EUNSUP);
    T_CONTAINS(d.text, "turned by 45 degrees");
}

T_CASE(refused_by_name)
{
    static const struct {
        const char *name, *options, *says;
    } k[] = {
        {"a.mkv", "-c:v ffv1 -color_trc smpte2084", "smpte2084"},
        {"a.mkv", "-c:v ffv1 -color_trc arib-std-b67", "zscale=transfer"},
        {"a.mkv", "-c:v ffv1 -pix_fmt yuv444p -colorspace bt2020c", "colour matrix (bt2020c)"},
        {"a.mkv", "-c:v ffv1 -pix_fmt gray -color_range tv", "-color_range pc"},
        {"a.mkv", "-c:v ffv1 -pix_fmt bgr0 -color_range tv", "limited range"},
        {"a.mov", "-c:v prores_ks -vf setfield=tff -flags +ildct", "interlaced"},
        {"a.mp4", "-c:v libx264 -vf setsar=4/3", "4:3"},
        {"a.avi", "-c:v libx264 -bf 2", "B-frames"},
        {"a.mkv", "-c:v ffv1 -map 0:v -map 0:v", "2 videos"},
        {"a.mp4", "-c:v mjpeg -map 0:v -disposition:v:0 attached_pic", "only a cover picture"},
        {"a.nut", "-c:v ffv1", "films are MP4"},
        {"a.avi", "-c:v rawvideo -pix_fmt gray16le", "grey of 16 bits so, too"},
    };
    for (size_t i = 0; i < sizeof k / sizeof *k; i++) {
        struct pvx_diag d = {""};
        cap_video *v;
        if (!film(k[i].name, 12, k[i].options))
            return;
        T_OK(cap_video_open(at("%s", k[i].name), &v, NULL, &d) != PVX_OK);
        T_OK(v == NULL);
        T_CONTAINS(d.text, k[i].name);
        T_CONTAINS(d.text, k[i].says);
    }
}

static void append_time(char *list, size_t size, int64_t ns)
{
    size_t n = strlen(list);
    snprintf(list + n, size - n, " %lld", (long long)((ns + 10000000) / 100000000));
}

/* The times of all frames, with and without decoding, in units of 0.1 s. */
static void times_are(const char *name, const char *want)
{
    struct pvx_diag d = {""};
    char list[2][512] = {"", ""};
    int64_t *t, at_ns;
    size_t n;
    cap_video *v;
    pvx_err e = PVX_OK;
    T_CHECK_(cap_video_times(at("%s", name), &t, &n, &d) == PVX_OK, "%s", d.text);
    for (size_t i = 0; i < n; i++)
        append_time(list[0], sizeof list[0], t[i]);
    T_CHECK_(cap_video_open(at("%s", name), &v, NULL, &d) == PVX_OK, "%s", d.text);
    for (size_t i = 0; v != NULL && (e = cap_video_next(v, NULL, &at_ns, &d)) == PVX_OK; i++) {
        append_time(list[1], sizeof list[1], at_ns);
        T_OK(i < n && t[i] == at_ns);
    }
    T_EQ_I(e, PVX_ECLOSED);
    T_EQ_S(list[0], want);
    T_EQ_S(list[1], want);
    free(t);
    cap_video_close(&v);
}

T_CASE(times)
{
    static const char drop[] = "-vf \"select='not(eq(n,2)+eq(n,5))'\" -vsync vfr ";
    char o[256];
    static const struct {
        const char *name, *options;
        bool dropped;
        const char *want;
    } k[] = {
        {"b.mp4", "-c:v libx264 -bf 3", false, " 0 1 2 3 4 5 6 7"},
        {"d.mkv", "-c:v ffv1", true, " 0 1 3 4 6 7 8 9"},
        {"d.mp4", "-c:v libx264 -bf 3", true, " 0 1 3 4 6 7 8 9"},
        {"d.avi", "-c:v mjpeg", true, " 0 1 3 4 6 7 8 9"},
        {"n.avi", "-c:v libx264 -bf 0", false, " 0 1 2 3 4 5 6 7"},
    };
    for (size_t i = 0; i < sizeof k / sizeof *k; i++) {
        snprintf(o, sizeof o, "%s%s", k[i].dropped ? drop : "", k[i].options);
        if (film(k[i].name, 8, o))
            times_are(k[i].name, k[i].want);
    }
    /* a late start, by an edit list and by the times themselves */
    if (shell("ffmpeg -nostdin -v fatal -y -itsoffset 0.7 -i b.mp4 -c copy late.mp4") &&
        shell("ffmpeg -nostdin -v fatal -y -itsoffset 0.7 -i d.mkv -c copy late.mkv")) {
        times_are("late.mp4", " 7 8 9 10 11 12 13 14");
        times_are("late.mkv", " 7 8 10 11 13 14 15 16");
    }
    /* an edit list that leaves out the first frame, which some decoders give nevertheless */
    if (film("j%d.jpg", 3, "-q:v 2") &&
        shell("ffmpeg -nostdin -v fatal -y -framerate 10 -i j%d.jpg -c copy -bsf:v "
              "'setts=ts=TS-0.1/TB' -avoid_negative_ts disabled edit.mov"))
        times_are("edit.mov", " 0 1");
}

/* Neither of 64 bits in ns, nor one that others could not subtract. */
T_CASE(times_too_far)
{
    static const char *const late[] = {"9.2e9", "1e11"};
    if (!film("f.mov", 1, "-c:v png"))
        return;
    for (int i = 0; i < 2; i++) {
        struct pvx_diag d[2] = {{""}, {""}};
        char line[256];
        int64_t *t;
        size_t n;
        cap_video *v;
        snprintf(line, sizeof line,
                 "ffmpeg -nostdin -v fatal -y -i f.mov -c copy -copyts -bsf:v 'setts=ts=TS+%s/TB' "
                 "far.mkv",
                 late[i]);
        if (!shell(line))
            return;
        T_EQ_I(cap_video_times(at("far.mkv"), &t, &n, &d[0]), PVX_ERANGE);
        T_EQ_I(cap_video_open(at("far.mkv"), &v, NULL, &d[1]), PVX_ERANGE);
        T_OK(t == NULL && n == 0 && v == NULL);
        T_CONTAINS(d[0].text, "far.mkv: frame 0 is shown at");
        T_EQ_S(d[0].text, d[1].text);
    }
}

/* The first frame that is shown is wider than that of the film's head. */
T_CASE(too_wide)
{
    struct pvx_diag d = {""};
    cap_video *v;
    if (!shell("for w in 16 20000; do ffmpeg -nostdin -v fatal -y -f lavfi -i "
               "color=gray:size=${w}x16 -frames:v 1 -pix_fmt gray w$w.png; done && "
               "ffmpeg -nostdin -v fatal -y -framerate 10 -pattern_type glob -i 'w*.png' -c copy "
               "-bsf:v 'setts=ts=TS-0.1/TB' -avoid_negative_ts disabled wide.mov"))
        return;
    T_EQ_I(cap_video_open(at("wide.mov"), &v, NULL, &d), PVX_ERANGE);
    T_OK(v == NULL);
    T_CONTAINS(d.text, "wide.mov: says it has 20000x16 pixels");
}

/* How many frames come, and what is said then. */
static int frames_of(const char *name, struct pvx_diag *d)
{
    cap_video *v;
    int n = 0;
    d->text[0] = '\0';
    if (cap_video_open(at("%s", name), &v, NULL, d) != PVX_OK)
        return -1;
    while (cap_video_next(v, NULL, NULL, d) == PVX_OK)
        n++;
    cap_video_close(&v);
    return n;
}

/* No picture stands for another: a checksum that is wrong, a cut, another size, a film that begins between key frames. */
T_CASE(damage_is_told)
{
    struct pvx_diag d = {""};
    char *b;
    size_t n;
    if (!film("c.avi", 4, "-c:v ffv1 -level 3 -slicecrc 1") || !film("c.mkv", 4, "-c:v ffv1") ||
        !film("j.mjpeg", 2, "-c:v mjpeg -f mjpeg") ||
        !film("k.mjpeg", 2, "-c:v mjpeg -vf scale=32:24 -f mjpeg") ||
        !film("p.mp4", 8, "-c:v mpeg4 -g 20") || !film("h.mp4", 8, "-c:v libx264 -bf 0") ||
        !shell(
            "ffmpeg -nostdin -v fatal -y -i h.mp4 -bsf:v noise=amount=0:drop='eq(n\\,4)' -c copy "
            "h.mkv") ||
        !shell("cat j.mjpeg k.mjpeg > l.mjpeg && ffmpeg -nostdin -v fatal -y -f mjpeg -i l.mjpeg "
               "-c copy s.avi && "
               "ffmpeg -nostdin -v fatal -y -i p.mp4 -bsf:v noise=amount=0:drop='eq(n\\,0)' -c "
               "copy p.mkv"))
        return;
    T_EQ_I(frames_of("c.mkv", &d), 4);
    T_EQ_S(d.text, "");
    T_EQ_I(pvx_file_read(at("c.mkv"), 1 << 20, &b, &n, &d), PVX_OK);
    T_EQ_I(pvx_file_write(at("cut.mkv"), b, n - 300, &d), PVX_OK);
    T_EQ_I(frames_of("cut.mkv", &d), -1);
    T_CONTAINS(d.text, "cut.mkv: cut: says it has");
    free(b);
    T_EQ_I(pvx_file_read(at("c.avi"), 1 << 20, &b, &n, &d), PVX_OK);
    char *frame = memmem(b, n, "movi", 4);
    for (int k = 0; k < 3; k++) /* the third */
        frame = (char *)memmem(frame, n - (size_t)(frame - b), "00dc", 4) + 4;
    frame[40] ^= 0x55;
    T_EQ_I(pvx_file_write(at("c.avi"), b, n, &d), PVX_OK);
    free(b);
    T_EQ_I(frames_of("c.avi", &d), 2);
    T_CONTAINS(d.text, "c.avi: frame 2: damaged or cut (slice CRC mismatch");
    T_EQ_I(frames_of("s.avi", &d), 2);
    T_CONTAINS(d.text, "s.avi: frame 2 is 32x24");
    T_EQ_I(frames_of("h.mp4", &d), 8);
    int got = frames_of("h.mkv", &d);
    T_OK(got >= 2 && got <= 4);
    T_CONTAINS(d.text, "Frame num gap");
    T_EQ_I(frames_of("p.mkv", &d), -1);
    T_CONTAINS(d.text, "no key frame");
}

T_MAIN((scratch_new(), plugins_of_this_build(), write_picture()), scratch_remove())
