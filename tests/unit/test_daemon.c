/* test_daemon.c - parts of the daemon on their own: JSON writer, control requests, stages, scene. */
#include "../t.h"

#include <cjson/cJSON.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>
#include <zmq.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/pixel/pixfmt.h"
#include "base/file.h"
#include "daemon/control/commands.h"
#include "daemon/control/control.h"
#include "daemon/control/journal.h"
#include "daemon/control/json.h"
#include "daemon/pipeline/scene.h"
#include "daemon/pipeline/stage.h"
#include "daemon/control/state.h"
#include "daemon/control/survive.h"
#include "tests/lib/scratch.h"

T_CASE(json_is_valid_and_comes_back)
{
    char text[600];
    struct dmn_json j;
    dmn_json_init(&j, text, sizeof text);
    dmn_json_open(&j, NULL, '{');
    dmn_json_str(&j, "text", "quote \" back \\ line \n bell \a bad \xff\xc0\x80 good \xc3\xa4");
    dmn_json_num(&j, "nan", NAN);
    dmn_json_num(&j, "x", 1.5e-7);
    dmn_json_int(&j, "i", -5);
    dmn_json_bool(&j, "b", true);
    dmn_json_open(&j, "list", '[');
    dmn_json_int(&j, NULL, 1);
    dmn_json_int(&j, NULL, 2);
    dmn_json_close(&j, ']');
    dmn_json_open(&j, "empty", '{');
    dmn_json_close(&j, '}');
    dmn_json_close(&j, '}');
    size_t n = dmn_json_end(&j);
    T_EQ_I(n, strlen(text));
    cJSON *c = cJSON_Parse(text);
    T_OK(c != NULL);
    T_EQ_S(cJSON_GetStringValue(cJSON_GetObjectItem(c, "text")),
           "quote \" back \\ line \n bell \a bad ??? good \xc3\xa4");
    T_OK(cJSON_IsNull(cJSON_GetObjectItem(c, "nan")));
    T_NEAR(cJSON_GetObjectItem(c, "x")->valuedouble, 1.5e-7, 1e-15);
    T_EQ_I(cJSON_GetArraySize(cJSON_GetObjectItem(c, "list")), 2);
    cJSON_Delete(c);
}

T_CASE(json_that_does_not_fit_says_so)
{
    char text[16] = "", guard = text[15];
    for (size_t size = 0; size < sizeof text; size++) {
        struct dmn_json j;
        dmn_json_init(&j, text, size);
        dmn_json_open(&j, NULL, '{');
        dmn_json_str(&j, "key", "value");
        dmn_json_close(&j, '}');
        T_EQ_I(dmn_json_end(&j), 0);
        T_EQ_I(text[15], guard);
    }
}

/* *what numbers. */
static void fill_many(struct dmn_json *j, const void *what)
{
    dmn_json_open(j, NULL, '[');
    for (int i = 0; i < *(const int *)what && !j->full; i++)
        dmn_json_int(j, NULL, i);
    dmn_json_close(j, ']');
}

/* Before those that leave a heap with room. */
T_CASE(json_without_memory_is_an_error)
{
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    T_SKIP("the sanitizers' allocator ends the program instead of giving NULL");
#else
    int n = INT32_MAX; /* to sizes that no heap has lying about */
    struct pvx_diag d = {""};
    struct rlimit old, none;
    FILE *f = fopen("/dev/null", "w");
    getrlimit(RLIMIT_AS, &old);
    none = (struct rlimit){.rlim_cur = 1, .rlim_max = old.rlim_max};
    setrlimit(RLIMIT_AS, &none);
    pvx_err e = dmn_json_print(f, fill_many, &n, &d);
    setrlimit(RLIMIT_AS, &old);
    T_EQ_I(e, PVX_ENOMEM);
    T_CONTAINS(d.text, "no memory");
    fclose(f);
#endif
}

T_CASE(json_of_any_length_is_printed)
{
    for (int n = 1; n <= 1000000; n *= 100) { /* 3 bytes to 6.9 MB */
        char *text = NULL;
        size_t len = 0;
        FILE *f = open_memstream(&text, &len);
        T_EQ_I(dmn_json_print(f, fill_many, &n, NULL), PVX_OK);
        fclose(f);
        T_OK(len > 0 && text[len - 1] == '\n');
        cJSON *c = cJSON_Parse(text);
        T_EQ_I(cJSON_GetArraySize(c), n);
        cJSON_Delete(c);
        free(text);
    }
}

T_CASE(json_that_cannot_be_printed_is_an_error)
{
    struct pvx_diag d = {""};
    int n = 10, endless = INT32_MAX;
    FILE *f = fopen("/dev/full", "w");
    T_EQ_I(dmn_json_print(f, fill_many, &n, &d), PVX_ENOSPC);
    T_CONTAINS(d.text, "cannot be written");
    fclose(f);
    f = fopen("/dev/null", "w");
    d = (struct pvx_diag){""};
    T_EQ_I(dmn_json_print(f, fill_many, &endless, &d), PVX_ERANGE);
    T_CONTAINS(d.text, "64 MiB");
    fclose(f);
}

static int stops, resets;
static size_t fake_status(void *ctx, char *out, size_t size)
{
    return *(int *)ctx ? (size_t)snprintf(out, size, "{\"up\":1}") : 0;
}
static void fake_stop(void *ctx)
{
    (void)ctx;
    stops++;
}
static void fake_reset(void *ctx)
{
    (void)ctx;
    resets++;
}

static pvx_err fake_record(void *ctx, bool start, const char *path, char *where, size_t size,
                           struct pvx_diag *d)
{
    (void)ctx;
    snprintf(where, size, "%s", path != NULL ? path : "/default.h5");
    return start ? PVX_OK : pvx_fail(d, PVX_ENOENT, "nothing is being recorded");
}

static struct dmn_control_ops fake_ops(void *ctx)
{
    return (struct dmn_control_ops){.status = fake_status,
                                    .reset_latency = fake_reset,
                                    .stop = fake_stop,
                                    .record = fake_record,
                                    .ctx = ctx};
}

static void answers(const struct dmn_control_ops *ops, const char *request, const char *part)
{
    static char reply[DMN_REPLY_MAX];
    size_t n = dmn_control_handle(ops, request, strlen(request), reply, sizeof reply);
    T_EQ_I(n, strlen(reply));
    T_CONTAINS(reply, part);
}

static void answer_is(const char *request, const char *part)
{
    int fits = 1;
    const struct dmn_control_ops ops = fake_ops(&fits);
    answers(&ops, request, part);
}

T_CASE(control_answers)
{
    answer_is("{\"cmd\":\"ping\"}", "\"ok\":true");
    answer_is("{\"cmd\":\"status\"}", "\"up\":1}");
    answer_is("{\"cmd\":\"stop\"}", "\"ok\":true");
    T_EQ_I(stops, 1);
    answer_is("{\"cmd\":\"reset-latency\"}", "\"ok\":true");
    T_EQ_I(resets, 1);
    enum pvx_log_level before = pvx_log_get_level();
    answer_is("{\"cmd\":\"log-level\",\"level\":\"error\"}", "\"ok\":true");
    T_EQ_I(pvx_log_get_level(), PVX_LOG_ERROR);
    pvx_log_set_level(before);
    answer_is("{\"cmd\":\"log-level\",\"level\":\"loud\"}", "error");
    answer_is("{\"cmd\":\"log-level\"}", "error");
    answer_is("{\"cmd\":\"record\",\"action\":\"start\"}", "\"path\":\"/default.h5\"");
    answer_is("{\"cmd\":\"record\",\"action\":\"start\",\"path\":\"/a.h5\"}", "\"/a.h5\"");
    answer_is("{\"cmd\":\"record\",\"action\":\"stop\"}", "nothing is being recorded");
    answer_is("{\"cmd\":\"record\",\"action\":\"start\",\"path\":\"a.h5\"}", "absolute");
    answer_is("{\"cmd\":\"record\",\"action\":\"go\"}", "should be");
    answer_is("{\"cmd\":\"record\"}", "should be");
    answer_is("{\"cmd\":\"fly\"}", "unknown command");
    answer_is("{\"cmd\":5}", "error");
    answer_is("{}", "error");
    answer_is("[]", "error");
    answer_is("", "error");
    answer_is("{\"cmd\":\"ping\"", "error");
    char long_one[DMN_REQUEST_MAX + 2];
    memset(long_one, ' ', sizeof long_one);
    long_one[sizeof long_one - 1] = '\0';
    answer_is(long_one, "longer than");
    /* a status that does not fit is an answer too */
    int fits = 0;
    struct dmn_control_ops ops = fake_ops(&fits);
    answers(&ops, "{\"cmd\":\"status\"}", "does not fit");
    /* over the network nobody says which file to write */
    ops.remote = true;
    answers(&ops, "{\"cmd\":\"record\",\"action\":\"start\",\"path\":\"/a.h5\"}",
            "goes to the folder of record.path");
    answers(&ops, "{\"cmd\":\"snapshot\",\"path\":\"/a\"}", "goes to the folder of record.path");
    answers(&ops, "{\"cmd\":\"snapshot\",\"name\":\"../a\"}", "name should be");
}

static pvx_err fake_background(void *ctx, uint32_t sets, struct pvx_diag *d)
{
    *(uint32_t *)ctx = sets;
    return sets == 3 ? pvx_fail(d, PVX_EINVAL, "a flame") : PVX_OK;
}

static void fake_background_state(void *ctx, struct dmn_background_state *out)
{
    *out = (struct dmn_background_state){.request = 7, .sets = *(uint32_t *)ctx, .have = 1};
    out->state = *(uint32_t *)ctx == 3 ? DMN_TAKING_FAILED : DMN_TAKING_NOW;
    snprintf(out->why.text, sizeof out->why.text, "it \"moves\"");
}

T_CASE(background_requests)
{
    uint32_t sets = 99;
    const struct dmn_control_ops cannot = fake_ops(&sets);
    struct dmn_control_ops ops = cannot;
    ops.background = fake_background;
    ops.background_state = fake_background_state;
    static const struct {
        const char *request, *answer;
        uint32_t sets;
    } of[] = {
        {"{\"cmd\":\"background\",\"sets\":16}", "\"ok\":true,\"request\":7}", 16},
        {"{\"cmd\":\"background\"}",
         "\"ok\":true,\"request\":7,\"state\":\"taking\",\"sets\":16,\"have\":1}", 16},
        {"{\"cmd\":\"background\",\"sets\":0}", "\"ok\":true,\"request\":7}", 0},
        {"{\"cmd\":\"background\",\"sets\":3}", "a flame", 3},
        {"{\"cmd\":\"background\",\"sets\":1.5}", "whole number", 3},
        {"{\"cmd\":\"background\",\"sets\":-1}", "whole number", 3},
        {"{\"cmd\":\"background\",\"sets\":null}", "whole number", 3},
        {"{\"cmd\":\"background\"}", "\"failed\",\"sets\":3,\"have\":1,\"why\":\"it \\\"moves", 3}};
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        answers(&ops, of[i].request, of[i].answer);
        T_EQ_I(sets, of[i].sets);
    }
    answers(&cannot, of[0].request, "not possible here");
}

static int checks_begun;
static pvx_err fake_check(void *ctx, struct pvx_diag *d)
{
    checks_begun++;
    return ctx == NULL ? pvx_fail(d, PVX_ENOENT, "fewer than 4 cameras") : PVX_OK;
}

static void fake_check_state(void *ctx, struct dmn_check_request *out)
{
    *out = *(struct dmn_check_request *)ctx;
}

T_CASE(check_requests)
{
    static struct dmn_check_request is = {.request = 4, .state = DMN_TAKING_NOW, .n_cameras = 3};
    const struct dmn_control_ops cannot = fake_ops(&is);
    struct dmn_control_ops ops = cannot;
    ops.check = fake_check;
    ops.check_state = fake_check_state;
    answers(&cannot, "{\"cmd\":\"check\"}", "not possible here");
    answers(&ops, "{\"cmd\":\"check\"}", "\"ok\":true,\"request\":4,\"state\":\"taking\"}");
    T_EQ_I(checks_begun, 1);
    snprintf(is.camera[1], sizeof is.camera[1], "left");
    snprintf(is.camera[2], sizeof is.camera[2], "right");
    is.state = DMN_TAKING_DONE;
    is.found.verdict = (struct rec_plausible_verdict){
        .cause = REC_CAUSE_SWAPPED, .cameras = 6, .text = "swapped", .next = "exchange"};
    answers(&ops, "{\"cmd\":\"check\",\"request\":4}",
            "\"good\":false,\"cause\":\"swapped\",\"cameras\":[\"left\",\"right\"],"
            "\"meaningless\":false,\"text\":\"swapped\",\"next\":\"exchange\"");
    is.state = DMN_TAKING_FAILED;
    snprintf(is.why.text, sizeof is.why.text, "no set");
    answers(&ops, "{\"cmd\":\"check\",\"request\":4}", "\"failed\",\"why\":\"no set\"}");
    T_EQ_I(checks_begun, 1);
    ops.ctx = NULL;
    answers(&ops, "{\"cmd\":\"check\"}", "fewer than 4 cameras");
}

static struct dmn_config in_effect;
static int applied;
static const struct dmn_config *fake_config(void *ctx)
{
    (void)ctx;
    return &in_effect;
}
static pvx_err fake_apply(void *ctx, const struct dmn_config *c, struct pvx_diag *d)
{
    (void)ctx;
    if (c->floor > 0.5)
        return pvx_fail(d, PVX_EBUSY, "not now");
    in_effect = *c;
    applied++;
    return PVX_OK;
}
static pvx_err fake_reload(void *ctx, struct pvx_diag *d)
{
    (void)ctx;
    return pvx_fail(d, PVX_EFORMAT, "line 3 of it");
}

T_CASE(options_are_read_and_set)
{
    struct dmn_control_ops ops = fake_ops(NULL);
    ops.config = fake_config;
    ops.apply = fake_apply;
    ops.reload_keys = fake_reload;
    static const struct {
        const char *request, *answer;
        int applied; /* by then */
    } of[] = {
        {"{\"cmd\":\"get\",\"key\":\"solver.lambda\"}",
         "\"value\":\"-1\",\"default\":\"-1\",\"live\":true", 0},
        {"{\"cmd\":\"get\",\"key\":\"fps\"}", "\"live\":false", 0},
        {"{\"cmd\":\"get\"}", "\"key\":\"sim.period_s\"", 0},
        {"{\"cmd\":\"get\",\"key\":\"solver.lamda\"}", "the nearest is solver.lambda", 0},
        {"{\"cmd\":\"get\",\"key\":3}", "key should be text", 0},
        {"{\"cmd\":\"set\",\"key\":\"solver.lambda\",\"value\":0.5}",
         "\"value\":\"0.5\",\"before\":\"-1\"", 1},
        {"{\"cmd\":\"set\",\"key\":\"photometry.despeckle\",\"value\":false}",
         "\"before\":\"true\"", 2},
        {"{\"cmd\":\"set\",\"key\":\"publish.compress\",\"value\":\"lz4\"}", "\"value\":\"lz4\"",
         3},
        {"{\"cmd\":\"set\",\"key\":\"log_level\",\"value\":\"warn\"}", "\"ok\":true", 4},
        {"{\"cmd\":\"log-level\",\"level\":\"info\"}", "\"ok\":true", 5},
        {"{\"cmd\":\"set\",\"key\":\"solver.name\",\"value\":\"cgls\"}", "needs a restart", 5},
        {"{\"cmd\":\"set\",\"key\":\"fps\",\"value\":30}", "fps needs a restart", 5},
        {"{\"cmd\":\"set\",\"key\":\"compress\",\"value\":1}", "the nearest is publish.compress",
         5},
        {"{\"cmd\":\"set\",\"key\":\"solver.lambda\",\"value\":\"much\"}", "error", 5},
        {"{\"cmd\":\"set\",\"key\":\"solver.lambda\",\"value\":1e300}", "error", 5},
        {"{\"cmd\":\"set\",\"key\":\"solver.lambda\",\"value\":\"\"}", "error", 5},
        {"{\"cmd\":\"set\",\"key\":\"solver.lambda\",\"value\":[1]}", "set needs", 5},
        {"{\"cmd\":\"set\",\"key\":\"solver.lambda\"}", "set needs", 5},
        {"{\"cmd\":\"set\",\"value\":1}", "set needs", 5},
        {"{\"cmd\":\"set\",\"key\":\"photometry.floor\",\"value\":0.9}", "not now", 5},
        {"{\"cmd\":\"reload-keys\"}", "line 3 of it", 5},
        {"{\"cmd\":\"ping\",\"version\":1}", "{\"version\":1,\"ok\":true", 5},
        {"{\"cmd\":\"ping\",\"version\":2}", "no other", 5},
        {"{\"cmd\":\"ping\",\"version\":\"1\"}", "no other", 5},
        {"{\"cmd\":\"stop\",\"now\":1}", "unknown key \\\"now\\\"", 5},
        {"{\"cmd\":\"set\",\"key value\":1}", "unknown key", 5},
        {"{\"cmd\":\"set\",\"\":1}", "unknown key", 5}};
    dmn_config_defaults(&in_effect);
    applied = 0;
    int before = stops;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        answers(&ops, of[i].request, of[i].answer);
        T_EQ_I(applied, of[i].applied);
    }
    T_EQ_I(stops, before);
    T_OK(in_effect.lambda == 0.5 && !in_effect.despeckle && in_effect.compress == 2);
    T_OK(in_effect.log_level == PVX_LOG_INFO && in_effect.floor < 0.5);
}

T_CASE(a_take_is_named_without_its_folder)
{
    answer_is("{\"cmd\":\"record\",\"action\":\"start\",\"name\":\"a.h5\"}", "\"path\":\"a.h5\"");
    static const char *const bad[] = {"", ".", "..", ".a", "a/b", "/a", "../a"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char request[100];
        snprintf(request, sizeof request,
                 "{\"cmd\":\"record\",\"action\":\"start\",\"name\":\"%s\"}", bad[i]);
        answer_is(request, "name should be");
    }
    answer_is("{\"cmd\":\"record\",\"action\":\"start\",\"name\":\"a\",\"path\":\"/a\"}",
              "not both");
    answer_is("{\"cmd\":\"record\",\"action\":\"start\",\"what\":\"sound\"}", "what should be");
}

T_CASE(control_md_has_every_command)
{
    char *text, want[80];
    size_t len;
    T_EQ_I(pvx_file_read("daemon/CONTROL.md", 1 << 20, &text, &len, NULL), PVX_OK);
    for (size_t i = 0; i < dmn_n_commands; i++) {
        snprintf(want, sizeof want, "`{\"cmd\":\"%s\"", dmn_commands[i].name);
        T_CONTAINS(text, want);
    }
    free(text);
}

T_CASE(the_fullest_state_fits_and_parses)
{
    static struct dmn_state s;
    static char text[DMN_STATE_JSON_MAX];
    memset(&s, 0, sizeof s);
    s.n_cameras = CAP_MAX_CAMERAS;
    s.report.solve.solver = "pcg";
    s.latency_p99_ms = INFINITY;
    for (size_t c = 0; c < s.n_cameras; c++) {
        memset(s.camera[c], 'n', sizeof s.camera[c] - 1);
        memset(s.capture.camera[c].error, 'e', sizeof s.capture.camera[c].error - 1);
        for (int i = 0; i < CAP_N_COUNT; i++)
            s.capture.camera[c].count[i] = INT64_MAX;
        for (int i = 0; i < DMN_N_IMAGE; i++)
            s.images[c][i] = INT64_MAX;
        struct cap_camera_stats *k = &s.capture.camera[c];
        k->fps = k->drift_ppm = k->hz = k->phase_us = k->walk_us_per_s = k->clock_delay_us =
            -1e-5 / 3;
        for (int i = 0; i < CAP_SKEW_BINS; i++)
            k->skew.bin[i] = INT64_MAX;
        k->n_troubles = CAP_TROUBLES_MAX;
        for (int i = 0; i < CAP_TROUBLES_MAX; i++) {
            k->trouble[i].cause = CAP_BANDWIDTH; /* the longest text */
            memset(k->trouble[i].detail, 'd', CAP_DETAIL_MAX - 1);
        }
        struct rec_check_camera *o = &s.checks.camera[c].figures;
        o->wrong = REC_WRONG_MOVED; /* the longest text */
        o->sets = UINT32_MAX;
        o->shift[0] = o->shift[1] = o->sigma[0] = o->sigma[1] = o->roll = o->size = o->rho =
            o->rho_moved = o->rho_mirrored = o->still = o->gain = o->blur = o->explained = o->lit =
                o->area = o->saturated = o->residual = o->with_it = -1e-5 / 3;
        for (int i = 0; i < REC_CHECK_LAGS; i++)
            o->rho_late[i] = -1e-5 / 3;
        k->health.temperature_c = k->health.link_mbps = k->health.ptp_offset_ns = -1e-5 / 3;
        memset(k->health.ptp, 'p', sizeof k->health.ptp - 1);
        k->action =
            (struct cap_action_answers){INT64_MAX, INT64_MAX, INT64_MAX, INT64_MAX, INT64_MAX};
    }
    s.uptime_s = s.record.seconds = 34712345.678; /* 402 days */
    size_t n = dmn_state_json(&s, text, sizeof text);
    T_OK(n > 1000);
    printf("  %zu of %zu bytes\n", n, sizeof text);
    cJSON *j = cJSON_ParseWithLength(text, n);
    T_OK(j != NULL);
    T_EQ_I(cJSON_GetArraySize(cJSON_GetObjectItem(j, "cameras")), CAP_MAX_CAMERAS);
    T_EQ_I(cJSON_GetArraySize(cJSON_GetObjectItem(j, "drops")), DMN_N_DROP + 2);
    T_CONTAINS(text, "\"uptime_s\":34712345.678,");
    T_CONTAINS(text, "\"seconds\":34712345.678,");
    cJSON_Delete(j);
    for (int i = 0; i < DMN_N_DROP; i++)
        T_OK(dmn_drop_defs[i].name != NULL && dmn_drop_defs[i].help != NULL);
}

T_CASE(second_control_socket_is_refused)
{
    char endpoint[80];
    scratch_new();
    snprintf(endpoint, sizeof endpoint, "ipc://%s/control", dir);
    int fits = 1;
    const struct dmn_control_ops ops = fake_ops(&fits);
    dmn_control *a = NULL, *b = NULL;
    struct pvx_diag d = {0};
    T_EQ_I(dmn_control_new(endpoint, NULL, &ops, &a, &d), PVX_OK);
    T_EQ_I(dmn_control_new(endpoint, NULL, &ops, &b, &d), PVX_EBUSY);
    T_CONTAINS(d.text, endpoint);
    T_OK(b == NULL);
    dmn_control_free(&a);
    d.text[0] = '\0';
    T_EQ_I(dmn_control_new(endpoint, NULL, &ops, &a, &d), PVX_OK); /* free again */
    dmn_control_free(&a);
    T_EQ_I(dmn_control_new("nonsense", NULL, &ops, &a, &d), PVX_EINVAL);
    T_EQ_I(rmdir(dir), 0); /* nothing left behind */
}

static size_t slow_status(void *ctx, char *out, size_t size)
{
    atomic_bool *go = ctx;
    while (!atomic_load(go))
        usleep(1000);
    return (size_t)snprintf(out, size, "{\"ok\":true}");
}

static void *request(void *zmq, const char *endpoint, const char *text)
{
    int none = 0, patience_ms = 600000;
    void *s = zmq_socket(zmq, ZMQ_REQ);
    zmq_setsockopt(s, ZMQ_LINGER, &none, sizeof none);
    zmq_setsockopt(s, ZMQ_RCVTIMEO, &patience_ms, sizeof patience_ms);
    T_OK(zmq_connect(s, endpoint) == 0 && zmq_send(s, text, strlen(text), 0) > 0);
    return s;
}

static bool is_answered(void *s)
{
    char reply[64];
    int n = zmq_recv(s, reply, sizeof reply, 0);
    zmq_close(s);
    T_OK(n > 0 && memcmp(reply, "{\"version\":1,\"ok\":true", 22) == 0);
    return n > 0;
}

/* While the daemon is at a long request, somebody of ZMTP 1.0 says one frame that is no request, and goes;
 * then somebody asks. */
T_CASE(a_reply_is_not_lost_by_what_another_peer_did)
{
    static const char not_a_request[] = {1, 0, 2, 0, 'x'}; /* no name; one byte, no more */
    char endpoint[80];
    scratch_new();
    snprintf(endpoint, sizeof endpoint, "ipc://%s/control", dir);
    atomic_bool go;
    struct dmn_control_ops ops = {.status = slow_status,
                                  .reset_latency = fake_reset,
                                  .stop = fake_stop,
                                  .record = fake_record,
                                  .ctx = &go};
    struct pvx_diag d = {0};
    dmn_control *c = NULL;
    T_EQ_I(dmn_control_new(endpoint, NULL, &ops, &c, &d), PVX_OK);
    void *zmq = zmq_ctx_new();
    bool answered = c != NULL;
    for (int k = 0; answered && k < 20; k++) {
        atomic_init(&go, false);
        void *first = request(zmq, endpoint, "{\"cmd\":\"status\"}");
        struct sockaddr_un a = {.sun_family = AF_UNIX};
        snprintf(a.sun_path, sizeof a.sun_path, "%s/control", dir);
        int fd = socket(AF_UNIX, SOCK_STREAM, 0);
        T_EQ_I(connect(fd, (struct sockaddr *)&a, sizeof a), 0);
        T_EQ_I(write(fd, not_a_request, sizeof not_a_request), sizeof not_a_request);
        close(fd);
        void *second = request(zmq, endpoint, "{\"cmd\":\"ping\"}");
        usleep(20000); /* all of this is with the daemon when it looks */
        atomic_store(&go, true);
        answered = is_answered(first);
        answered = is_answered(second) && answered;
    }
    zmq_ctx_term(zmq);
    dmn_control_free(&c);
    T_EQ_I(rmdir(dir), 0);
}

/* ---- a mapped file that is cut ----------------------------------------------------------------- */

static void *touch(void *page)
{
    static atomic_int ready;
    atomic_fetch_add(&ready, 1);
    while (atomic_load(&ready) < 4) /* all of them at once */
        ;
    return *(volatile char *)page != 0 ? page : NULL;
}

/* Ends: 1 and nothing else. */
static void map_cut_and_touch(int out)
{
    pthread_t t[4];
    int fd = open(at("matrix"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    void *page = ftruncate(fd, 4096) == 0 ? mmap(NULL, 4096, PROT_READ, MAP_SHARED, fd, 0) : NULL;
    if (page == NULL || page == MAP_FAILED || ftruncate(fd, 0) != 0)
        _exit(2);
    dup2(out, STDERR_FILENO);
    dmn_survive();
    for (int k = 0; k < 4; k++)
        pthread_create(&t[k], NULL, touch, page);
    for (;;)
        pause();
}

T_CASE(a_file_that_is_cut_is_named_once_however_many_threads_see_it)
{
    scratch_new();
    for (int k = 0; k < 20; k++) {
        char said[1024];
        int out[2], status = 0;
        ssize_t n = 0, more;
        T_EQ_I(pipe(out), 0);
        pid_t child = fork();
        if (child == 0)
            map_cut_and_touch(out[1]);
        close(out[1]);
        while ((more = read(out[0], said + n, sizeof said - 1 - (size_t)n)) > 0)
            n += more;
        said[n] = '\0';
        close(out[0]);
        T_EQ_I(waitpid(child, &status, 0), child);
        T_OK(WIFEXITED(status) && WEXITSTATUS(status) == 1);
        T_CONTAINS(said, at("matrix"));
        const char *text = strstr(said, "a file that is mapped was cut");
        T_OK(text != NULL && strstr(text + 1, "a file that is mapped was cut") == NULL);
    }
    scratch_remove();
}

static bool count_to_five(void *ctx)
{
    return ++*(int *)ctx < 5;
}
T_CASE(stage_runs_until_it_is_finished)
{
    struct dmn_stage s = {0};
    int n = 0;
    int64_t t0 = pvx_now_mono();
    T_EQ_I(dmn_stage_start(&s, "count", count_to_five, &n), PVX_OK);
    dmn_stage_join(&s);
    T_EQ_I(n, 5);
    T_OK(atomic_load(&s.done));
    T_OK(atomic_load(&s.beat_ns) >= t0);
    dmn_stage_join(&s); /* twice is fine */
}

T_CASE(pictures_in_every_format)
{
    /* 2x2 pixels: red, green, blue, grey beyond the range */
    const float image[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 2, -1, 0.5f};
    uint8_t u8[12];
    uint16_t u16[12];
    float f[12];
    dmn_scene_pack(image, 2, 2, CAP_RGB8, u8);
    T_EQ_I(u8[0], 255);
    T_EQ_I(u8[1], 0);
    T_EQ_I(u8[9], 255);
    T_EQ_I(u8[10], 0);
    T_EQ_I(u8[11], 128);
    dmn_scene_pack(image, 2, 2, CAP_GREY16, u16);
    T_EQ_I(u16[0], 21845);
    dmn_scene_pack(image, 2, 2, CAP_RGB_F32, f);
    T_NEAR(f[9], 2, 0);
    /* every format that can be packed comes back, within its step, through capture's conversion */
    enum { W = 258, H = 2 }; /* wider than what is packed at a time */
    static float big[W * H * 3], back[W * H * 4];
    for (int i = 0; i < W * H * 3; i++) /* the same in the pairs of YUV */
        big[i] = (float)fmod((double)(i / 3 % W / 2 * (1 + i % 3)) / (W / 2), 1);
    for (enum cap_pixfmt fmt = CAP_GREY8; fmt < CAP_N_FMT; fmt++) {
        if (fmt == CAP_JPEG)
            continue;
        size_t n = cap_pixfmt_image(fmt, W, H);
        void *raw = malloc(n);
        dmn_scene_pack(big, W, H, fmt, raw);
        struct cap_image img = {raw, n, W, H, (ptrdiff_t)cap_pixfmt_row(fmt, W), fmt, 0};
        T_EQ_I(cap_bin(&img, 1, 3, 0, H, back), PVX_OK);
        const uint8_t *cell = cap_pixfmt_bayer(fmt);
        double worst = 0;
        for (int i = 0; i < W * H; i++)
            for (int k = 0; k < 3; k++) {
                const float *p = big + i * 3;
                double want = cap_pixfmt_channels(fmt) == 1 ? (p[0] + p[1] + p[2]) / 3 : p[k];
                if (cell == NULL || cell[i / W % 2 * 2 + i % W % 2] == k)
                    worst = fmax(worst, fabs((double)back[i * 4 + k] - want));
            }
        bool yuv = cap_pixfmt_layout(fmt) == CAP_LAYOUT_YUV;
        int bits = cap_pixfmt_depth(fmt) > 16 ? 16 : cap_pixfmt_depth(fmt);
        T_CHECK_(worst <= (yuv ? 0.03 : 0.5001 / ((1 << bits) - 1)), "%s: %g", cap_pixfmt_name(fmt),
                 worst);
        free(raw);
    }
    static const struct {
        enum cap_pixfmt fmt;
        uint8_t want[4];
    } bayer[] = {{CAP_BAYER_RG8, {255, 255, 0, 128}},
                 {CAP_BAYER_GR8, {0, 0, 255, 0}},
                 {CAP_BAYER_GB8, {0, 0, 0, 0}},
                 {CAP_BAYER_BG8, {0, 255, 0, 255}}};
    for (size_t i = 0; i < 4; i++) {
        dmn_scene_pack(image, 2, 2, bayer[i].fmt, u8);
        for (int k = 0; k < 4; k++)
            T_EQ_I(u8[k], bayer[i].want[k]);
    }
}

/* What a line is in the journal. */
T_CASE(journal_fields)
{
    struct dmn_journal_room room;
    struct iovec f[DMN_JOURNAL_FIELDS];
    const char *want[] = {"MESSAGE=recon: set 7",       "PRIORITY=4",
                          "SYSLOG_IDENTIFIER=pyrovoxd", "PYROVOX_CAUSE=late",
                          "PYROVOX_CAMERA=c 1",         "PYROVOX_SET=0"};
    T_EQ_I(dmn_journal_fields(PVX_LOG_WARN, ABOUT(.cause = "late", .camera = "c 1", .of_set = true),
                              "recon: set 7", &room, f),
           6);
    for (int i = 0; i < 6; i++)
        T_OK(f[i].iov_len == strlen(want[i]) && memcmp(f[i].iov_base, want[i], f[i].iov_len) == 0);
    T_EQ_I(dmn_journal_fields(PVX_LOG_ERROR, NULL, "x", &room, f), 3);
    T_OK(memcmp(f[1].iov_base, "PRIORITY=3", f[1].iov_len) == 0);
    T_EQ_I(dmn_journal_fields(PVX_LOG_INFO, ABOUT(.camera = ""), "x", &room, f), 3);
}

T_CASE(one_line_for_systemd)
{
    static struct dmn_state s;
    char line[1024], small[24];
    s = (struct dmn_state){
        .sets_per_s = 29.94, .published = 12, .latency_p99_ms = 12, .n_cameras = 4};
    for (int c = 0; c < 4; c++) {
        snprintf(s.camera[c], sizeof s.camera[c], "cam%d", c);
        s.capture.camera[c].state = CAP_RUNNING;
    }
    dmn_state_sentence(&s, line, sizeof line);
    T_EQ_S(line, "29.9 sets/s, 12 published, latency p99 12 ms");
    s.capture.camera[1].state = CAP_LOST;
    s.capture.camera[3].state = CAP_OPENING;
    s.votes.out = 1;
    s.votes.why[0] = REC_WRONG_DARK;
    s.rig[2].moved = true;
    s.record.state = CAP_REC_FAILED;
    snprintf(s.record.error, sizeof s.record.error, "disk is full\nREADY=1");
    dmn_state_sentence(&s, line, sizeof line);
    T_EQ_S(line,
           "29.9 sets/s, 12 published, latency p99 12 ms; not there: cam1, cam3 (2 of 4 cameras); "
           "cam0 is left out (dark); cam2 has moved; recording ended: disk is full READY=1");
    dmn_state_sentence(&s, small, sizeof small);
    T_EQ_S(small, "29.9 sets/s, 12 publish");
}
