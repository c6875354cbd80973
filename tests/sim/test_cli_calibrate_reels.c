/* test_cli_calibrate_reels.c - `pyrovox calibrate solve` from takes and videos: the same rig as from pictures, by the
 * instants in which the board stands still; what cannot be read is said in one sentence, and nothing is written. */
#include "../t.h"

#include <cjson/cJSON.h>

#include "capture/files/imgio.h"
#include "daemon/cli/calibrate/reel.h"
#include "recon/board/spec.h"
#include "recon/calib/calib.h"
#include "tests/lib/avi.h"
#include "tests/lib/calib_bed.h"
#include "tests/lib/take.h"

/* Frames of a pose: still ones, and one on the way to the next. */
enum { HELD = 4, FRAMES = POSES * HELD };

static float level[CAMERAS][POSES][W * H];

static uint8_t grey_at(int camera, int frame, int i)
{
    int pose = frame / HELD, next = pose + 1 < POSES ? pose + 1 : 0;
    float v = level[camera][pose][i];
    if (frame % HELD == HELD - 1) /* a ghost of both */
        v = 0.5f * (v + level[camera][next][i]);
    return (uint8_t)lrintf(255 * v);
}

static bool read_rig(const char *name, double *rms, double *worst)
{
    struct rec_rig rig = {0};
    struct pvx_diag d = {""};
    pvx_err e = rec_rig_load(at("%s", name), &rig, &d);
    T_CHECK_(e == PVX_OK, "%s", d.text);
    if (e == PVX_OK)
        e = rec_calib_distance(&truth, &rig, rms, worst);
    rec_rig_fini(&rig);
    return e == PVX_OK;
}

/* Numbers of the pictures that a report lists, each with what it is modulo HELD. */
static void looked_at(const char *report, int mod[HELD], int *n)
{
    cJSON *o = cJSON_Parse(slurp(report));
    const cJSON *p;
    *n = 0;
    memset(mod, 0, HELD * sizeof *mod);
    cJSON_ArrayForEach(p, cJSON_GetObjectItem(o, "pictures"))
    {
        mod[cJSON_GetObjectItem(p, "frame")->valueint % HELD]++;
        ++*n;
    }
    cJSON_Delete(o);
}

/* ---- takes ---- */

/* Frame f of a camera as its sensor sends it; each camera has another format. */
static const enum cap_pixfmt formats[CAMERAS] = {CAP_GREY8, CAP_GREY16, CAP_BAYER_RG8, CAP_RGB8};

static void fill(int camera, int f, uint8_t *mem)
{
    for (int i = 0; i < W * H; i++) {
        uint8_t v = grey_at(camera, f, i);
        int x = i % W, y = i / W, colour = x % 2 + y % 2; /* RG: 0 red, 1 green, 2 blue */
        switch (formats[camera]) {
        case CAP_GREY16:
            mem[2 * i] = 0;
            mem[2 * i + 1] = v;
            break;
        case CAP_RGB8:
            mem[3 * i] = (uint8_t)(v / 2); /* a reddish light would do as well */
            mem[3 * i + 1] = v;
            mem[3 * i + 2] = (uint8_t)(v / 4);
            break;
        case CAP_BAYER_RG8: mem[i] = colour == 1 ? v : (uint8_t)(v * 3 / 4); break;
        default: mem[i] = v;
        }
    }
}

/* Sets 100, 101, ...; camera 1 is missing in those of pose 2. */
static void write_take(const char *name)
{
    struct cap_take_camera camera[CAMERAS];
    char names[CAMERAS][8];
    for (int c = 0; c < CAMERAS; c++) {
        snprintf(names[c], sizeof names[c], "cam%d", c);
        camera[c] = (struct cap_take_camera){.name = names[c], .uri = "test", .settings = ""};
    }
    struct cap_take_head head = take_head(camera, CAMERAS);
    struct pvx_diag d = {""};
    cap_take_writer *w = NULL;
    static uint8_t mem[CAMERAS][3 * W * H];
    T_EQ_I(cap_take_create(at("%s", name), &head, &w, &d), PVX_OK);
    for (int f = 0; w != NULL && f < FRAMES; f++) {
        struct cap_frame frame[CAMERAS];
        struct cap_set s = {.number = 100 + (uint64_t)f};
        for (int c = 0; c < CAMERAS; c++) {
            size_t row = cap_pixfmt_row(formats[c], W);
            fill(c, f, mem[c]);
            frame[c] = (struct cap_frame){.img = {.data = mem[c],
                                                  .size = row * H,
                                                  .width = W,
                                                  .height = H,
                                                  .stride = (ptrdiff_t)row,
                                                  .fmt = formats[c]},
                                          .camera = (uint32_t)c,
                                          .id = (uint64_t)f};
            if (c == 1 && f / HELD == 2)
                continue;
            s.frame[c] = &frame[c];
            s.n++;
        }
        T_EQ_I(cap_take_put_set(w, &s, &d), PVX_OK);
    }
    T_EQ_I(cap_take_close(&w, &d), PVX_OK);
    T_EQ_S(d.text, "");
}

T_CASE_OF_THREADS(a_take_gives_the_rig)
{
    double rms = NAN, worst = NAN;
    int mod[HELD], n;
    write_take("take.h5");
    T_EQ_I(pyrovox(SOLVE "take.h5 --every 4 --floor 102 --board " BOARD " " VOLUME
                         " --voxels 32 --out take.yaml --report take.json"),
           0);
    T_CONTAINS(slurp("out.txt"), "a take of 48 sets: of every 4 the one in which the least moves");
    looked_at("take.json", mod, &n);
    printf("  looked at %d pictures\n", n);
    T_EQ_I(mod[102 % HELD], CAMERAS); /* the floor, though 100 and 101 move less */
    T_EQ_I(mod[HELD - 1], 0);
    T_OK(strstr(slurp("take.json"), "take.h5: set 102 of cam1") != NULL);
    T_OK(strstr(slurp("take.json"), "set 109 of cam0") != NULL);
    T_OK(strstr(slurp("take.json"), "set 109 of cam1") == NULL); /* it is not there */
    T_EQ_I(pyrovox(SOLVE "take.h5 --every 4 --keep true.yaml --board " BOARD " " VOLUME
                         " --voxels 32 --out kept.yaml --report kept.json"),
           0);
    looked_at("kept.json", mod, &n);
    T_EQ_I(mod[102 % HELD] + mod[HELD - 1], 0); /* ghosts were left alone */
    T_EQ_I(n, CAMERAS * POSES - 1);
    if (read_rig("kept.yaml", &rms, &worst)) {
        printf("  volume error %.3f px rms, %.3f largest\n", rms, worst);
        T_LE(rms, 0.05);
        T_LE(worst, 0.15);
    }
}

T_CASE(some_of_the_sets)
{
    T_EQ_I(pyrovox(SOLVE "take.h5 --every 4 --keep true.yaml --from 104 --to 140 --board " BOARD
                         " " VOLUME " --voxels 32 --out some.yaml --report some.json"),
           0);
    T_OK(strstr(slurp("some.json"), "take.h5: set 102 of") == NULL);
    T_CONTAINS(text, "take.h5: set 1");
    T_EQ_I(pyrovox(SOLVE "take.h5 --keep true.yaml --from 4000 --board " BOARD " " VOLUME
                         " --out none.yaml"),
           1);
    T_CONTAINS(slurp("err"), "no picture has a number from 4000 to ");
}

T_CASE(threads_change_nothing)
{
    static char first[sizeof text];
    snprintf(first, sizeof first, "%s", slurp("kept.yaml"));
    T_OK(first[0] != '\0');
    T_EQ_I(pyrovox(SOLVE "take.h5 --threads 1 --every 4 --keep true.yaml --board " BOARD " " VOLUME
                         " --voxels 32 --out kept.yaml --force"),
           0);
    T_EQ_S(slurp("kept.yaml"), first);
}

/* ---- videos ---- */

static void write_videos(void)
{
    static uint8_t rgb[3 * W * H];
    struct pvx_diag d = {""};
    T_EQ_I(pvx_mkdirs(at("videos"), &d), PVX_OK);
    for (int c = 0; c < CAMERAS; c++) {
        FILE *f = avi_begin(at("videos/cam%d.avi", c), W, H, FRAMES, 25);
        T_OK(f != NULL);
        for (int k = 0; f != NULL && k < FRAMES; k++) {
            for (int i = 0; i < W * H; i++)
                memset(rgb + 3 * i, grey_at(c, k, i), 3);
            avi_frame(f, rgb, W, H);
        }
        T_OK(f == NULL || fclose(f) == 0);
    }
}

T_CASE(videos_give_the_rig)
{
#ifdef __SANITIZE_THREAD__
    T_SKIP("libraries under OpenCV order their own locks in ways that ThreadSanitizer reports");
#endif
    double rms = NAN, worst = NAN;
    int mod[HELD], n;
    write_videos();
    T_EQ_I(pyrovox(SOLVE "videos --every 4 --keep true.yaml --board " BOARD " " VOLUME
                         " --voxels 32 --out videos.yaml --report videos.json"),
           0);
    T_CONTAINS(slurp("out.txt"),
               "videos of 48 frames: of every 4 the one in which the least moves");
    looked_at("videos.json", mod, &n);
    T_EQ_I(n, CAMERAS * POSES);
    T_EQ_I(mod[HELD - 1], 0);
    T_CONTAINS(slurp("videos.json"), "videos/cam0.avi: frame ");
    if (read_rig("videos.yaml", &rms, &worst)) {
        printf("  volume error %.3f px rms, %.3f largest\n", rms, worst);
        T_LE(rms, 0.05);
        T_LE(worst, 0.15);
    }
    /* another rate, another length */
    FILE *f = avi_begin(at("videos/cam9.avi"), 16, 8, 0, 30);
    T_OK(f != NULL && fclose(f) == 0);
    T_EQ_I(pyrovox(SOLVE "videos --board " BOARD " " VOLUME " --out x.yaml"), 1);
    T_CONTAINS(slurp("err"), "videos/cam9.avi: ");
    T_OK(!there("x.yaml"));
}

/* ---- what cannot be read ---- */

static const char *sentence(const char *what)
{
    char cmd[600];
    snprintf(cmd, sizeof cmd, SOLVE "%s --board " BOARD " " VOLUME " --out x.yaml --report x.html",
             what);
    T_EQ_I(pyrovox(cmd), 1);
    T_OK(!there("x.yaml"));
    slurp("err");
    /* libpng has its own line before it */
    char *line = strncmp(text, "libpng ", 7) == 0 ? strchr(text, '\n') + 1 : text;
    while (strncmp(line, "pyrovox: camera ", 16) == 0) /* what is odd about its pictures */
        line = strchr(line, '\n') + 1;
    T_OK(strncmp(line, "pyrovox: ", 9) == 0);
    T_EQ_I(strchr(line, '\n') - line, (long)strlen(line) - 1); /* one sentence, whatever is in it */
    T_OK(strchr(text, '\x1b') == NULL);
    return line;
}

static void put(const char *name, const char *bytes, size_t n)
{
    struct pvx_diag d = {""};
    pvx_err e = pvx_file_write(at("%s", name), bytes, n, &d);
    T_CHECK_(e == PVX_OK, "%s", d.text);
}

static void folder(const char *name)
{
    struct pvx_diag d = {""};
    T_EQ_I(pvx_mkdirs(at("%s", name), &d), PVX_OK);
}

T_CASE(broken_takes_and_videos)
{
    put("no.h5", "not a take", 10);
    T_CONTAINS(sentence("no.h5"), "no.h5");
    T_EQ_I(truncate(at("kept.json"), 0), 0);
    T_CONTAINS(sentence("kept.json"), "kept.json");
    T_EQ_I(truncate(at("take.h5"), 100000), 0);
    T_CONTAINS(sentence("take.h5"), "take.h5");
    folder("film");
    put("film/cam0.mp4", "not a film", 10);
    T_CONTAINS(sentence("film"), "film/cam0.mp4");
    put("film/cam0.mp4", "", 0);
    T_CONTAINS(sentence("film"), "film/cam0.mp4");
    put("film/\x1b[31m\nred.mp4", "", 0);
    T_CONTAINS(sentence("film"), "a name that no camera can have");
}

T_CASE(broken_pictures)
{
    struct pvx_diag d = {""};
    static float nan[W * H];
    for (int i = 0; i < W * H; i++)
        nan[i] = NAN;
    folder("bad/cam0");
    put("bad/cam0/000000.png", "", 0);
    put("bad/cam0/\x1b[J\n000001.png", "\211PNG\r\n\032\n", 8);
    T_CONTAINS(sentence("bad"), "cam0: none of its 2 pictures can be read: bad/cam0/000000.png: ");
    T_EQ_I(cap_image_save(at("bad/cam0/000002.npy"), nan, W, H, 1, &d), PVX_OK);
    T_CONTAINS(sentence("bad"), "cam0: the board is in none of 3 pictures");
    T_CONTAINS(slurp("x.html"), "?[J?000001.png");
    T_OK(strchr(slurp("out.txt"), '\x1b') == NULL);
    T_EQ_I(cap_image_save(at("bad/cam0/000003.npy"), nan, W, H - 2, 1, &d), PVX_OK);
    T_CONTAINS(sentence("bad"),
               "bad/cam0/000003.npy: 320 x 238 pixels, but other pictures of cam0");
    T_CONTAINS(sentence("bad --every 2"), "--every is for videos and takes");
    put("bad/cam1.mp4", "", 0);
    T_CONTAINS(sentence("bad"), "side by side");
    folder("name/<i>\n");
    put("name/<i>\n/000000.png", "", 0);
    T_CONTAINS(sentence("name"), "a name that no camera can have");
}

/* ---- which instants ---- */

T_CASE(the_stillest_of_every_few)
{
    float a[9] = {NAN, 5, 1, 1, 5, 5, 5, 0.5f, 0.5f};
    float b[9] = {NAN, 5, 1, 1, 5, CALIBRATE_LACKS, CALIBRATE_LACKS, 0.5f, 0.5f};
    const struct calibrate_motion m[2] = {{9, a}, {9, b}};
    size_t chosen[10];
    T_EQ_I(calibrate_choose(m, 2, 3, chosen), 3);
    T_EQ_I(chosen[0], 2); /* still before and after */
    T_EQ_I(chosen[1], 3); /* what comes after it moves, but both cameras have it */
    T_EQ_I(chosen[2], 7);
    T_EQ_I(calibrate_choose(m, 2, 1, chosen), 9);
    for (size_t i = 0; i < 9; i++)
        T_EQ_I(chosen[i], i);
    T_EQ_I(calibrate_choose(m, 2, 100, chosen), 1);
    T_EQ_I(chosen[0], 7);
    const struct calibrate_motion shorter[2] = {{9, a}, {3, b}};
    T_EQ_I(calibrate_choose(shorter, 2, 9, chosen), 1);
    T_EQ_I(chosen[0], 2); /* the other has ended later on */
}

static void shoot_all(void)
{
    struct rec_board b;
    struct pvx_diag d = {""};
    if (rec_board_parse(BOARD, &b, &d) != PVX_OK)
        exit(1);
    for (int c = 0; c < CAMERAS; c++)
        for (int p = 0; p < POSES; p++)
            shoot(&b, c, p, 1, level[c][p]);
}

T_MAIN((bed_begin(), shoot_all()), bed_end())
