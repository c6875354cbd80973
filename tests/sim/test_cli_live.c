/* test_cli_live.c - the whole chain as a user runs it: simulated GigE cameras are shown a board, `calibrate live`
 * takes pictures by itself and writes a rig, and the flame that the same cameras see is as near the truth with
 * that rig as with the true one.  The board moves on when its pose was taken: no step depends on time. */
#include "../t.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/file.h"
#include "daemon/cli/simcams/ring.h"
#include "daemon/pipeline/volume_file.h"
#include "recon/calib/calib.h"
#include "recon/view/metrics.h"
#include "tests/lib/cli.h"
#include "tests/lib/patience.h"

#define BOARD  "charuco:5x6:0.14:0.105:two-sided"
#define VOLUME "--volume -0.5,-0.5,0,0.5,0.5,1 --voxels 32"
#define RIG    "--cameras 4 --size 400x300 --radius 1.6 --height 0.9 --voxels 32"

enum { FIRST = 8, ALL = 12, IMAGES = 2, FPS = 5 };

/* `simcams SIM` runs `calibrate live ARGS`, in the background.  *orders: the descriptor that orders go to. */
static pid_t live(const char *sim, const char *args, int *orders)
{
    char cmd[1500];
    snprintf(
        cmd, sizeof cmd,
        "cd %s && exec %s/pyrovox simcams --private-net " RIG " --board " BOARD
        " --poses 40 --hold 0 --noise 1 --format mono8 --control %s -- %s/pyrovox calibrate live "
        "--config live.yaml --board " BOARD " " VOLUME " --out rig.yaml %s < orders > out.txt "
        "2> err",
        dir, exe, sim, exe, args);
    (void)remove(at("orders"));
    (void)remove(at("out.txt"));
    *orders = -1;
    if (mkfifo(at("orders"), 0600) != 0)
        return -1;
    pid_t pid = fork();
    if (pid == 0) {
        execl("/bin/sh", "sh", "-c", cmd, (char *)NULL);
        _exit(99);
    }
    int status;
    while (*orders < 0 && waitpid(pid, &status, WNOHANG) == 0) {
        *orders = open(at("orders"), O_WRONLY | O_NONBLOCK | O_CLOEXEC);
        usleep(2000);
    }
    return pid;
}

/* "number N taken" is there, or the program has ended (its status). */
static bool taken(int number, pid_t pid, int *status, bool *ended)
{
    char want[40];
    snprintf(want, sizeof want, "number %d taken", number);
    UNTIL (false) {
        if (strstr(slurp("out.txt"), want) != NULL)
            return true;
        if (!*ended && waitpid(pid, status, WNOHANG) == pid)
            *ended = true;
        if (*ended)
            return strstr(slurp("out.txt"), want) != NULL;
        usleep(20000);
    }
    return false;
}

/* The board from pose `from` to before `until`, each until it was taken.  Exit code; interrupt: by Ctrl-C. */
static int session(const char *sim, const char *args, int from, int until, bool interrupt)
{
    int orders, status = -1;
    bool ended = false, all = true;
    pid_t pid = live(sim, args, &orders);
    for (int k = from; k < until && all; k++) {
        char line[20];
        int n = snprintf(line, sizeof line, "pose %d\n", k);
        if (k > 0 && write(orders, line, (size_t)n) != n)
            break;
        all = taken(k, pid, &status, &ended);
        T_CHECK_(all, "pose %d was not taken", k);
    }
    if (!ended && (interrupt || !all))
        kill(pid, SIGINT);
    if (!ended)
        waitpid(pid, &status, 0);
    close(orders);
    if (!all)
        printf("%s\n%s\n", slurp("out.txt"), slurp("err"));
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/* Mean relative L2 distance of the volumes in a folder from the flame. */
static double error_of(const char *folder, const struct rec_rig *rig)
{
    static float truth[32 * 32 * 32 * 3];
    struct rec_flame flame;
    double sum = 0;
    simcams_flame(rig, IMAGES, FPS, 1, &flame);
    for (int i = 0; i < IMAGES; i++) {
        struct rec_flame_pose p;
        struct rec_grid g = rig->grid;
        struct pvx_diag d = {""};
        float *v = NULL;
        int nch = 0;
        T_EQ_I(dmn_volume_load(at("%s/%06d.npy", folder, i), &g, &nch, &v, &d), PVX_OK);
        T_EQ_S(d.text, "");
        T_EQ_I(nch, 3);
        rec_flame_at(&flame, (double)i / FPS, &p);
        rec_flame_voxels(&p, &g, 0, 32, truth);
        sum += nch == 3 ? rec_rel_l2(v, truth, sizeof truth / sizeof *truth) : NAN;
        free(v);
    }
    return sum / IMAGES;
}

T_CASE(takes_poses_by_itself_and_writes_a_rig)
{
    T_NOT_UNDER_TSAN();
    T_EQ_I(session("", "--poses 8", 0, FIRST, false), 0);
    T_CONTAINS(slurp("out.txt"), "8 poses in rig-frames, 8 of them new");
    T_CONTAINS(text, "\nnext: ");
    T_CONTAINS(text, "rig.yaml: 4 cameras");
    T_CONTAINS(text, "more pictures: pyrovox calibrate live");
    T_CONTAINS(text, " --force\n");
}

T_CASE(goes_on_and_ctrl_c_keeps_everything)
{
    T_NOT_UNDER_TSAN();
    T_EQ_I(pyrovox("calibrate live --config live.yaml --board " BOARD " " VOLUME " --out rig.yaml"),
           1);
    T_CONTAINS(slurp("err"), "rig.yaml is there already");
    T_EQ_I(session("", "--force", FIRST, ALL, true), 0);
    T_CONTAINS(slurp("out.txt"), "12 poses in rig-frames, 4 of them new");
    T_OK(access(at("rig-frames/cam3/000011.png"), F_OK) == 0);
}

/* What solve makes of the pictures is what live made of them. */
T_CASE(solve_finds_the_same_rig)
{
    T_NOT_UNDER_SANITIZERS();
    T_EQ_I(pyrovox("calibrate solve --quiet --frames rig-frames --board " BOARD " " VOLUME
                   " --floor 0 --out same.yaml"),
           0);
    static char first[sizeof text];
    snprintf(first, sizeof first, "%s", slurp("rig.yaml"));
    T_OK(first[0] != '\0');
    T_EQ_S(slurp("same.yaml"), first);
}

T_CASE(the_flame_is_as_near_as_with_the_true_rig)
{
    T_NOT_UNDER_SANITIZERS();
    struct rec_rig truth, rig;
    struct pvx_diag d = {""};
    double rms = NAN, worst = NAN;
    T_EQ_I(pyrovox("simcams " RIG " --noise 1 --ring 2 --fps 5 --write-rig true.yaml "
                   "--write-frames flame"),
           0);
    T_EQ_I(rec_rig_load(at("true.yaml"), &truth, &d), PVX_OK);
    T_EQ_I(rec_rig_load(at("rig.yaml"), &rig, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(rec_calib_distance(&truth, &rig, &rms, &worst), PVX_OK);
    T_EQ_I(pyrovox("reconstruct --quiet --binning 2 --basis trilinear --rig true.yaml --frames "
                   "flame --black "
                   "0.02 --out by-true"),
           0);
    T_EQ_I(pyrovox("reconstruct --quiet --binning 2 --basis trilinear --rig rig.yaml --frames "
                   "flame --black "
                   "0.02 --out by-live"),
           0);
    truth.grid.basis = REC_TRILINEAR;
    double by_true = error_of("by-true", &truth), by_live = error_of("by-live", &truth);
    printf("  volume error %.4f px rms, %.4f largest; flame %.4f with the true rig, %.4f with this "
           "one\n",
           rms, worst, by_true, by_live);
    T_LE(rms, 0.05); /* 0.01 when this was written */
    T_LE(by_true, 0.5);
    T_LE(by_live, 1.1 * by_true);
    rec_rig_fini(&truth);
    rec_rig_fini(&rig);
}

/* The second of four cameras never sends a frame: it is named, and the rig has the other three. */
T_CASE(a_silent_camera_is_left_out)
{
    T_NOT_UNDER_TSAN();
    struct rec_rig rig;
    struct pvx_diag d = {""};
    T_EQ_I(session("--set 'kill cam1'", "--out three.yaml --poses 12", 0, ALL, false), 0);
    T_CONTAINS(slurp("err"), "cam1 gave no picture: the rig is made without it");
    T_CONTAINS(slurp("out.txt"), "three.yaml: 3 cameras");
    T_EQ_I(rec_rig_load(at("three.yaml"), &rig, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(rig.n_cameras, 3);
    T_EQ_S(rig.cameras[0].name, "cam0");
    T_EQ_S(rig.cameras[1].name, "cam2");
    T_EQ_S(rig.cameras[2].name, "cam3");
    rec_rig_fini(&rig);
    /* an option names it */
    T_EQ_I(session("--set 'kill cam1'",
                   "--out none.yaml --frames three-frames --measured cam0,cam1,1 --poses 13", ALL,
                   ALL + 1, false),
           1);
    T_CONTAINS(slurp("err"), "cam1: no picture was taken with it: is it connected?");
    T_OK(access(at("none.yaml"), F_OK) != 0);
}

static void write_text(const char *name, const char *what)
{
    T_EQ_I(pvx_file_write(at("%s", name), what, strlen(what), NULL), PVX_OK);
}

T_CASE(usage)
{
    T_EQ_I(pyrovox("calibrate live --board " BOARD " " VOLUME " --out x.yaml"), 2);
    T_CONTAINS(slurp("err"), "which cameras?");
    T_EQ_I(pyrovox("calibrate live --config live.yaml --board " BOARD " --out x.yaml"), 1);
    T_CONTAINS(slurp("err"), "where will the flame burn?");
    write_text("all.yaml", "cameras: \"aravis:127.0.0.2+\"\n");
    T_EQ_I(pyrovox("calibrate live --config all.yaml --board " BOARD " " VOLUME " --out x.yaml"),
           1);
    T_CONTAINS(slurp("err"), "name each one");
    write_text("sim.yaml", "cameras: {cam0: \"sim:\"}\n");
    T_EQ_I(pyrovox("calibrate live --config sim.yaml --board " BOARD " " VOLUME " --out x.yaml"),
           1);
    T_CONTAINS(slurp("err"), "look at a flame");
    T_EQ_I(pyrovox("calibrate live --config live.yaml --frames other --board " BOARD " " VOLUME
                   " --out x.yaml --threads 1 --keep nowhere.yaml"),
           1);
    T_CONTAINS(slurp("err"), "nowhere.yaml");
    T_EQ_I(pyrovox("calibrate live --config live.yaml --frames other --board " BOARD
                   " --out x.yaml --threads 1 --keep nowhere.yaml --recover cam1"),
           1);
    T_CONTAINS(slurp("err"), "nowhere.yaml");
    T_OK(access(at("other"), F_OK) != 0); /* refused before there is anything to keep */
    write_text("up.yaml", "cameras: {..: \"aravis:127.0.0.2\"}\n");
    T_EQ_I(pyrovox("calibrate live --config up.yaml --board " BOARD " " VOLUME " --out x.yaml"), 1);
    T_CONTAINS(slurp("err"), "no camera can have");
    T_EQ_I(pyrovox("calibrate live --help"), 0);
    T_CONTAINS(slurp("out.txt"), "simcams --private-net");
    T_OK(access(at("x.yaml"), F_OK) != 0);
}

static int begin(void)
{
    static const char config[] =
        "cameras: {cam0: \"aravis:127.0.0.2\", cam1: \"aravis:127.0.0.3\", cam2: "
        "\"aravis:127.0.0.4\", cam3: \"aravis:127.0.0.5\"}\nfps: 10\nshared_clock: true\n";
    cli_begin();
    write_text("live.yaml", config);
    if (pyrovox("simcams --private-net --cameras 1 --size 16x12 --ring 1 -- true") != 0)
        t_skip_all = "no private network here";
    return 0;
}

int main(void)
{
    if (begin() != 0)
        return 1;
    t_run();
    scratch_remove();
    return t_done();
}
