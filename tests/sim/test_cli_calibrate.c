/* test_cli_calibrate.c - `pyrovox calibrate solve` as a user runs it: rendered pictures of a board before four
 * known cameras in, a rig near the truth out; what should not be believed is refused and writes nothing. */
#include "../t.h"

#include <cjson/cJSON.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/file.h"
#include "capture/files/imgio.h"
#include "recon/board/spec.h"
#include "recon/calib/calib.h"
#include "recon/geom/rig.h"
#include "tests/lib/calib_bed.h"

/* What a wavy window before the lens does: waves of 1 px, 75 px long. */
static void window(const float *level, float *out)
{
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++) {
            double x = u + 1 - cos(v / 12.0), t = floor(x);
            int a = t >= W - 1 ? W - 2 : (int)t;
            out[v * W + u] =
                level[v * W + a] + (float)(x - t) * (level[v * W + a + 1] - level[v * W + a]);
        }
}

/* take/: all poses; after them a dark picture of cam0, and one that was cut off.  window/: the same,
 * but cam1 looks through one. */
static void record(void)
{
    struct pvx_diag d = {""};
    struct rec_board b;
    static float level[W * H], bent[W * H];
    T_EQ_I(rec_board_parse(BOARD, &b, &d), PVX_OK);
    for (int c = 0; c < CAMERAS; c++) {
        T_EQ_I(pvx_mkdirs(at("take/cam%d", c), &d), PVX_OK);
        T_EQ_I(pvx_mkdirs(at("window/cam%d", c), &d), PVX_OK);
        for (int p = 0; p < POSES; p++) {
            shoot(&b, c, p, 1, level);
            T_EQ_I(cap_image_save(at("take/cam%d/%06d.png", c, p), level, W, H, 1, &d), PVX_OK);
            if (c == 1)
                window(level, bent);
            T_EQ_I(cap_image_save(at("window/cam%d/%06d.png", c, p), c == 1 ? bent : level, W, H, 1,
                                  &d),
                   PVX_OK);
        }
    }
    for (size_t i = 0; i < W * H; i++)
        level[i] = 0.02f;
    T_EQ_I(cap_image_save(at("take/cam0/%06d.png", POSES), level, W, H, 1, &d), PVX_OK);
    T_EQ_I(pvx_file_write(at("take/cam0/%06d.png", POSES + 1), "\211PNG\r\n\032\n", 8, &d), PVX_OK);
    T_EQ_S(d.text, "");
}

/* px rms between projections of the volume's points, as they are. */
static double apart(const struct rec_rig *a, const struct rec_rig *b)
{
    double sum = 0;
    int n = 0;
    for (size_t c = 0; c < CAMERAS; c++)
        for (int i = 0; i < 125; i++) {
            double X[3] = {-0.2 + 0.1 * (i % 5), -0.2 + 0.1 * (i / 5 % 5), 0.1 * (i / 25)};
            double u[2], v[2];
            if (rec_camera_project(&a->cameras[c], X, u) &&
                rec_camera_project(&b->cameras[c], X, v)) {
                sum += (u[0] - v[0]) * (u[0] - v[0]) + (u[1] - v[1]) * (u[1] - v[1]);
                n++;
            }
        }
    return n > 0 ? sqrt(sum / n) : NAN;
}

static double number(const cJSON *o, const char *key)
{
    const cJSON *v = cJSON_GetObjectItem(o, key);
    return cJSON_IsNumber(v) ? v->valuedouble : NAN;
}

/* Numbers of a list; NAN where there are none. */
static void list(const cJSON *o, const char *key, double *out, int n)
{
    const cJSON *a = cJSON_GetObjectItem(o, key);
    for (int i = 0; i < n; i++) {
        const cJSON *v = cJSON_GetArrayItem(a, i);
        out[i] = cJSON_IsNumber(v) ? v->valuedouble : NAN;
    }
}

T_CASE_OF_THREADS(the_rig_comes_back)
{
    struct pvx_diag d = {""};
    struct rec_rig rig = {0};
    double rms = NAN, worst = NAN;
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " " VOLUME " --voxels 32 --keep true.yaml "
                         "--measured cam0,cam3,1.749 --out rig.yaml --report report.json"),
           0);
    slurp("out.txt");
    T_CONTAINS(text, " of 50 pictures of 4 cameras");
    T_CONTAINS(text, "cam0: 1 cannot be read");
    T_CONTAINS(text, "cam0: 1 without: ");
    T_CONTAINS(text, "expected volume error");
    T_OK(strstr(text, "of what was measured: measure the print") == NULL);
    T_EQ_I(rec_rig_load(at("rig.yaml"), &rig, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(rig.n_cameras, CAMERAS);
    T_EQ_I(rig.grid.n[0], 32);
    if (rig.n_cameras != CAMERAS)
        return;
    T_EQ_I(rec_calib_distance(&truth, &rig, &rms, &worst), PVX_OK);
    printf("  volume error %.3f px rms, %.3f largest; as it stands %.3f\n", rms, worst,
           apart(&truth, &rig));
    T_LE(rms, 0.05); /* 0.014, 0.04, 0.02 when this was written */
    T_LE(worst, 0.15);
    T_LE(apart(&truth, &rig), 0.06);
    for (size_t c = 0; c < CAMERAS; c++) {
        T_OK(rig.cameras[c].uncertainty.px > 0);
        T_LE(rig.cameras[c].uncertainty.px, 0.1);
    }
    rec_rig_fini(&rig);
    cJSON *o = cJSON_Parse(slurp("report.json"));
    T_EQ_I(cJSON_GetArraySize(cJSON_GetObjectItem(o, "cameras")), CAMERAS);
    T_EQ_I(cJSON_GetArraySize(cJSON_GetObjectItem(o, "pictures")), CAMERAS * POSES + 2);
    T_EQ_I(cJSON_GetArraySize(cJSON_GetObjectItem(o, "pairs")), 6);
    T_LE(number(o, "joint_px"), 0.2);
    T_OK(number(o, "expected_px") > 0);
    const cJSON *p = cJSON_GetArrayItem(cJSON_GetObjectItem(o, "pictures"), 0);
    T_EQ_I(cJSON_GetArraySize(cJSON_GetArrayItem(cJSON_GetObjectItem(p, "corners"), 0)), 5);
    cJSON_Delete(o);
}

T_CASE(the_same_bits_on_one_thread_and_nothing_written_over)
{
    static char first[sizeof text];
    snprintf(first, sizeof first, "%s", slurp("rig.yaml"));
    T_OK(first[0] != '\0');
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " " VOLUME " --keep true.yaml --out rig.yaml"), 1);
    T_CONTAINS(slurp("err"), "rig.yaml is there already");
    T_EQ_S(slurp("rig.yaml"), first);
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " " VOLUME " --voxels 32 --keep true.yaml "
                         "--out rig.yaml --force --threads 1"),
           0);
    T_EQ_S(slurp("rig.yaml"), first);
}

/* All cameras of the rig but `c` are those of `old`, bit for bit, and c is within `near` m of where it truly is. */
static void only_one_new(const char *file, const struct rec_rig *old, size_t c, double near)
{
    struct pvx_diag d = {""};
    struct rec_rig rig = {0};
    double from[3], to[3];
    T_EQ_I(rec_rig_load(at("%s", file), &rig, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(rig.n_cameras, CAMERAS);
    T_OK(memcmp(&rig.grid, &old->grid, sizeof rig.grid) == 0);
    for (size_t i = 0; i < rig.n_cameras; i++) {
        const struct rec_camera *k = &rig.cameras[i], *was = &old->cameras[i];
        T_EQ_S(k->name, truth.cameras[i].name);
        if (i != c)
            T_OK(memcmp(k->R, was->R, sizeof k->R) == 0 && k->t[0] == was->t[0] &&
                 k->t[1] == was->t[1] && k->t[2] == was->t[2] && k->fx == was->fx &&
                 k->gain[1] == was->gain[1] && k->uncertainty.px == was->uncertainty.px);
    }
    rec_camera_centre(&rig.cameras[c], from);
    rec_camera_centre(&truth.cameras[c], to);
    for (int i = 0; i < 3; i++)
        T_NEAR(from[i], to[i], near);
    T_OK(rig.cameras[c].uncertainty.px > 0);
    rec_rig_fini(&rig);
}

/* cam2's tripod was moved since the rig was made: it is found again; a camera that the rig lacks is added.  Cameras
 * that stay need no pictures. */
T_CASE(one_camera_among_others_that_stay)
{
    struct rec_rig old, less;
    struct pvx_diag d = {""};
    T_EQ_I(rec_rig_copy(&truth, &old), PVX_OK);
    old.cameras[1].gain[1] = 0.75F;
    old.cameras[3].uncertainty = (struct rec_uncertainty){0.01, 0.02, 0.03, 0.04};
    old.cameras[2].t[0] += 0.05;
    write_rig("moved.yaml", &old);
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD
                         " --keep moved.yaml --recover cam2 --out recovered.yaml"),
           0);
    only_one_new("recovered.yaml", &old, 2, 1e-3);
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " " VOLUME
                         " --keep moved.yaml --recover cam2 --out x.yaml"),
           2);
    T_CONTAINS(slurp("err"), "leave out --volume");
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " --recover cam2 --out x.yaml"), 2);
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " --keep moved.yaml --add cam2 --out x.yaml"), 1);
    T_CONTAINS(slurp("err"), "--recover cam2");
    old.cameras[2].t[0] -= 0.05;
    T_EQ_I(rec_rig_copy(&old, &less), PVX_OK);
    T_EQ_I(rec_rig_select(&less, "cam0,cam1,cam2", &d), PVX_OK);
    write_rig("three.yaml", &less);
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " --keep three.yaml --recover cam9 --out x.yaml"),
           1);
    T_CONTAINS(slurp("err"), "cam9: there are no pictures of it");
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " --keep three.yaml --recover cam2 --out x.yaml"),
           1);
    T_CONTAINS(slurp("err"), "--add cam3 too");
    T_EQ_I(pvx_mkdirs(at("two"), &d), PVX_OK);
    T_EQ_I(symlink(at("take/cam2"), at("two/cam2")), 0);
    T_EQ_I(symlink(at("take/cam3"), at("two/cam3")), 0);
    T_EQ_I(pyrovox(SOLVE "two --board " BOARD " --keep three.yaml --add cam3 --out added.yaml"), 0);
    only_one_new("added.yaml", &old, 3, 5e-3); /* its focal length is from 11 poses */
    /* two entries that are one camera */
    memcpy(old.cameras[2].R, old.cameras[1].R, sizeof old.cameras[2].R);
    memcpy(old.cameras[2].t, old.cameras[1].t, sizeof old.cameras[2].t);
    write_rig("copied.yaml", &old);
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " --keep copied.yaml --recover cam0 --out x.yaml"),
           1);
    T_CONTAINS(slurp("err"), "cam1 and cam2 at one place");
    T_OK(!there("x.yaml"));
    rec_rig_fini(&old);
    rec_rig_fini(&less);
}

/* A tetrahedron. */
static void write_mesh(const char *name)
{
#define FACET(a, b, c)                                                                    \
    "facet normal 0 0 0\nouter loop\nvertex " a "\nvertex " b "\nvertex " c "\nendloop\n" \
    "endfacet\n"
    static const char stl[] = "solid rod\n" FACET("0 0 0", "0 .01 0", ".01 0 0")
        FACET("0 0 0", ".01 0 0", "0 0 .01") FACET("0 0 0", "0 0 .01", "0 .01 0")
            FACET(".01 0 0", "0 .01 0", "0 0 .01") "endsolid rod\n";
    T_EQ_I(pvx_file_write(at("%s", name), stl, strlen(stl), NULL), PVX_OK);
}

/* In the old world bodies stay, with meshes that are found from the new file; in another one it is said. */
T_CASE(bodies_are_kept_or_missed)
{
    static char yaml[1 << 16];
    struct rec_rig old = {0}, rig = {0};
    struct pvx_diag d = {""};
    T_EQ_I(mkdir(at("parts"), 0755), 0);
    T_EQ_I(mkdir(at("else"), 0755), 0);
    write_mesh("parts/rod.stl");
    snprintf(yaml, sizeof yaml, "%sbodies:\n  - { name: rod, mesh: parts/rod.stl }\n",
             slurp("true.yaml"));
    T_EQ_I(pvx_file_write(at("bodies.yaml"), yaml, strlen(yaml), NULL), PVX_OK);
    T_EQ_I(rec_rig_load(at("bodies.yaml"), &old, &d), PVX_OK);
    static const char *const out[] = {"kept.yaml", "else/kept.yaml"};
    for (int i = 0; i < 2; i++) {
        char arg[256];
        snprintf(arg, sizeof arg,
                 SOLVE "take --board " BOARD " " VOLUME " --voxels 32 --keep bodies.yaml --out %s",
                 out[i]);
        T_EQ_I(pyrovox(arg), 0);
        T_OK(strstr(slurp("err"), "left out") == NULL);
        T_OK((strstr(slurp(out[i]), "mesh: \"parts/rod.stl\"") != NULL) == (i == 0));
        T_OK((strstr(slurp(out[i]), "mesh: \"/") != NULL) == (i == 1));
        T_EQ_I(rec_rig_load(at("%s", out[i]), &rig, &d), PVX_OK);
        T_EQ_S(d.text, "");
        T_EQ_I(rig.bodies.n, 1);
        if (rig.bodies.n == 1)
            T_EQ_S(rig.bodies.body[0].file, old.bodies.body[0].file);
        rec_rig_fini(&rig);
    }
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " " VOLUME
                         " --voxels 32 --fix-intrinsics bodies.yaml --out lenses.yaml --accept"),
           0);
    T_CONTAINS(slurp("err"), "the bodies of bodies.yaml are left out");
    T_CONTAINS(slurp("err"), "--keep bodies.yaml");
    T_OK(strstr(slurp("lenses.yaml"), "rod") == NULL);
    rec_rig_fini(&old);
}

T_CASE(some_of_the_frames)
{
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " " VOLUME
                         " --keep true.yaml --from 2 --to 10 --out some.yaml"),
           0);
    slurp("out.txt");
    T_CONTAINS(text, "of 36 pictures of 4 cameras");
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " " VOLUME " --from 90 --out x.yaml"), 1);
    T_CONTAINS(slurp("err"), "cam0: no picture has a number from 90");
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " " VOLUME " --floor 0 --from 2 --out x.yaml"), 1);
    T_CONTAINS(slurp("err"), "--floor 0 is not among");
}

T_CASE(the_wrong_board_is_named)
{
    struct pvx_diag d = {""};
    T_EQ_I(pvx_mkdirs(at("few/cam0"), &d), PVX_OK);
    for (int p = 0; p < 6; p++)
        T_EQ_I(symlink(at("take/cam0/%06d.png", p), at("few/cam0/%06d.png", p)), 0);
    T_EQ_I(pyrovox(SOLVE "few --board charuco:8x11:0.03:0.0225 " VOLUME " --out wrong.yaml"), 1);
    T_CONTAINS(slurp("err"), "not 8x11");
    T_OK(!there("wrong.yaml"));
    T_EQ_I(pyrovox(SOLVE "few --board charuco:8x11:0.03:0.0225 " VOLUME
                         " --out wrong.yaml --report wrong.html --report wrong.json"),
           1);
    T_CONTAINS(slurp("wrong.html"), "<b>No rig</b><p>cam0: the board is in none of 6 pictures");
    T_CONTAINS(slurp("wrong.html"), "few/cam0/000005.png");
    T_CONTAINS(slurp("wrong.json"), "\"failure\":\"cam0: the board is in none of 6 pictures");
    T_EQ_I(pyrovox(SOLVE "few --board " BOARD " " VOLUME " --out wrong.yaml --report wrong.pdf"),
           1);
    T_CONTAINS(slurp("err"), "wrong.pdf: a report is written as .html or .json");
}

T_CASE(hostile_folders)
{
    struct pvx_diag d = {""};
    T_EQ_I(pvx_mkdirs(at("odd/cam 0;\033[2J"), &d), PVX_OK);
    T_EQ_I(symlink(at("take/cam0/000000.png"), at("odd/cam 0;\033[2J/000000.png")), 0);
    T_EQ_I(pyrovox(SOLVE "odd --board " BOARD " " VOLUME " --out x.yaml"), 1);
    T_CONTAINS(slurp("err"), "a name that no camera can have: letters, digits");
    T_OK(strchr(text, '\033') == NULL);
    T_EQ_I(pvx_mkdirs(at("none/cam0"), &d), PVX_OK);
    T_EQ_I(pvx_file_write(at("none/cam0/000000.png"), "", 0, &d), PVX_OK);
    T_EQ_I(pyrovox(SOLVE "none --board " BOARD " " VOLUME " --out x.yaml"), 1);
    T_CONTAINS(slurp("err"), "cam0: none of its 1 pictures can be read");
    T_OK(!there("x.yaml"));
}

T_CASE(a_camera_behind_a_wavy_window_is_refused)
{
    T_EQ_I(pyrovox(SOLVE "window --board " BOARD " " VOLUME " --keep true.yaml --out window.yaml "
                         "--report window.json --report window.html"),
           1);
    T_CONTAINS(slurp("out.txt"), "refused: cam1: ");
    T_CONTAINS(slurp("err"), "--accept");
    T_OK(!there("window.yaml"));
    T_CONTAINS(slurp("window.html"), "<b>Refused</b>");
    T_OK(there("window.json"));
    T_EQ_I(pyrovox(SOLVE "window --board " BOARD " " VOLUME " --floor 0 --out window.yaml --accept "
                         "--report window.json"),
           0);
    T_OK(there("window.yaml"));
    /* --floor: the middle of that frame's board is the middle of the floor, its print upwards */
    cJSON *o = cJSON_Parse(slurp("window.json"));
    const cJSON *first = cJSON_GetArrayItem(cJSON_GetObjectItem(o, "boards"), 0);
    double R[9], t[3];
    list(first, "R", R, 9);
    list(first, "t", t, 3);
    T_EQ_I(number(first, "frame"), 0);
    for (int i = 0; i < 3; i++)
        T_NEAR(R[3 * i] * 0.09 + R[3 * i + 1] * 0.12 + t[i], 0, 1e-6);
    T_NEAR(R[8], -1, 1e-9);
    cJSON_Delete(o);
}

/* Stopped while it waits for a picture that somebody still writes. */
T_CASE_OF_THREADS(ctrl_c_writes_nothing)
{
    struct pvx_diag d = {""};
    char name[400];
    int fd = -1, status = 0;
    bool ended = false;
    T_EQ_I(pvx_mkdirs(at("slow/cam0"), &d), PVX_OK);
    T_EQ_I(mkfifo(at("slow/cam0/000000.png"), 0600), 0);
    T_EQ_I(symlink(at("take/cam0/000001.png"), at("slow/cam0/000001.png")), 0);
    snprintf(name, sizeof name, "%s/pyrovox", exe);
    pid_t pid = fork();
    if (pid == 0) {
        if (chdir(dir) == 0 && freopen("err", "w", stderr) != NULL)
            execl(name, "pyrovox", "calibrate", "solve", "--frames", "slow", "--board", BOARD,
                  "--volume", "-1,-1,0,1,1,1", "--out", "slow.yaml", "--report", "slow.json",
                  "--threads", "1", (char *)NULL);
        _exit(99);
    }
    while (fd < 0 && !ended) { /* until it reads */
        fd = open(at("slow/cam0/000000.png"), O_WRONLY | O_NONBLOCK);
        ended = fd < 0 && waitpid(pid, &status, WNOHANG) == pid;
        usleep(2000);
    }
    T_OK(!ended);
    if (!ended) {
        kill(pid, SIGINT);
        close(fd);
        T_EQ_I(waitpid(pid, &status, 0), pid);
    }
    T_EQ_I(WIFEXITED(status) ? WEXITSTATUS(status) : -1, 130);
    T_CONTAINS(slurp("err"), "nothing was written");
    T_OK(!there("slow.yaml") && !there("slow.json"));
}

T_CASE(usage)
{
    T_EQ_I(pyrovox("calibrate solve --frames take --board " BOARD " --out x.yaml"), 2);
    T_CONTAINS(slurp("err"), "where will the flame burn?");
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " --volume 0,0,0,1,1 --out x.yaml"), 2);
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " " VOLUME " --floor 0 --up 0,-1,0 --out x.yaml"),
           2);
    T_EQ_I(pyrovox(SOLVE "nowhere --board " BOARD " " VOLUME " --out x.yaml"), 1);
    T_CONTAINS(slurp("err"), "nowhere");
    T_EQ_I(pyrovox(SOLVE "take --board " BOARD " " VOLUME " --up 0,-1,0,cam9 --out x.yaml"), 1);
    T_CONTAINS(slurp("err"), "cam9");
    T_EQ_I(pyrovox("calibrate solve --help"), 0);
    T_CONTAINS(slurp("out.txt"), "The five steps");
    T_OK(!there("x.yaml"));
}

T_MAIN((bed_begin(), record()), bed_end())
