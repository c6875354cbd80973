/* Publisher and subscriber over real sockets.
 *
 * `test_pub --publish ENDPOINT VOLUMES SKIP [no-end]` is the system tests' publisher: it waits for a
 * subscriber, then sends start, VOLUMES synthetic volumes (-1: without end, as fast as they are read) and end, leaving
 * out every SKIP-th volume (0 = none) though it takes a sequence number, as a drop on the way would. */
#include <errno.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>
#include <zmq.h>

#include "base/clock.h"
#include "proto/clients/sub.h"
#include "proto/pub.h"
#include "tests/lib/patience.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

static char endpoint[128];

static const struct pvp_grid small = {
    .n = {10, 9, 8}, .min = {-0.5, -0.5, 0}, .max = {0.5, 0.4, 0.8}, .channels = 1};

static struct pvp_start start_of(uint64_t session)
{
    return (struct pvp_start){.grid = small,
                              .session = session,
                              .n_cameras = 8,
                              .fps = 15,
                              .units = "1/m",
                              .software = "test_pub"};
}

static pvx_err open_deep(const char *at, uint64_t session, int hwm, pvp_pub **out,
                         struct pvx_diag *d)
{
    struct pvp_start s = start_of(session);
    struct pvp_pub_params p = {
        .endpoints = &at, .n_endpoints = 1, .send_hwm = hwm, .sample = PVP_F32, .comp = PVP_RAW};
    d->text[0] = '\0';
    return pvp_pub_new(&p, &s, out, d);
}

static pvx_err open_pub(const char *at, uint64_t session, pvp_pub **out, struct pvx_diag *d)
{
    return open_deep(at, session, 0, out, d);
}

static bool exists(const char *suffix)
{
    return access(at("volumes%s", suffix), F_OK) == 0;
}

/* Ticks until the subscriber has the start message. */
static bool joined(pvp_pub *p, pvp_sub *s)
{
    int64_t until = pvx_now_mono() + PATIENCE_NS;
    while (pvx_now_mono() < until) {
        struct pvp_header h;
        const void *msg;
        size_t len;
        pvp_pub_tick(p);
        if (pvp_sub_next(s, 20 * PVX_NS_PER_MS, &h, &msg, &len, NULL) == PVX_OK &&
            h.type == PVP_START)
            return true;
    }
    return false;
}

static pvx_err publish_voxel(pvp_pub *p, uint64_t set, float value)
{
    struct pvp_volume v = {.set = set, .grid = small};
    int32_t index = (int32_t)(set % 720);
    return pvp_pub_volume(p, &v, &(struct pvp_voxels){1, &index, &value, 1}, NULL);
}

/* The socket's file of a daemon that was killed does not stop the next. */
T_CASE(killed_publisher) /* first: forks before there are any threads */
{
    fflush(stdout);
    pid_t child = fork();
    if (child == 0) {
        pvp_pub *p;
        struct pvx_diag d;
        if (open_pub(endpoint, 1, &p, &d) == PVX_OK)
            raise(SIGKILL);
        _exit(1);
    }
    int status = 0;
    T_EQ_I(waitpid(child, &status, 0), child);
    T_OK(WIFSIGNALED(status));
    T_OK(exists("") && exists(".lock"));
    pvp_pub *p;
    struct pvx_diag d;
    T_EQ_I(open_pub(endpoint, 2, &p, &d), PVX_OK);
    pvp_pub_free(&p);
    T_OK(!exists("") && !exists(".lock"));
}

static long resident_kib(void)
{
    long pages = 0, ignored;
    FILE *f = fopen("/proc/self/statm", "r");
    if (f == NULL || fscanf(f, "%ld %ld", &ignored, &pages) != 2)
        pages = 0;
    if (f != NULL)
        fclose(f);
    return pages * (sysconf(_SC_PAGESIZE) / 1024);
}

enum { CROWD = 17, CROWD_SIDE = 32, CROWD_VOLUMES = 200 };

/* A process that says each volume that it has, by a byte. */
static int reads_on(int to)
{
    pvp_sub *s;
    struct pvp_header h;
    struct pvp_sub_stats st;
    const void *msg;
    size_t len;
    int volumes = 0;
    if (pvp_sub_new(endpoint, NULL, &s, NULL) != PVX_OK)
        return 1;
    while (pvp_sub_next(s, -1, &h, &msg, &len, NULL) == PVX_OK && h.type != PVP_END)
        if (h.type == PVP_VOLUME && ++volumes > 0 && write(to, "v", 1) != 1)
            return 2;
    pvp_sub_stats(s, &st);
    return volumes == CROWD_VOLUMES && st.lost == 0 && st.malformed == 0 ? 0 : 3;
}

/* Sixteen read, a seventeenth is stopped: the others have every volume, and what it does not take costs what its queue
 * holds.  The next volume goes out when all sixteen have the one before, so nothing depends on how fast they are. */
T_CASE(one_of_seventeen_is_stopped) /* forks, before there are any threads */
{
    enum { CELLS = CROWD_SIDE * CROWD_SIDE * CROWD_SIDE };
    static int32_t index[CELLS];
    static float value[CELLS];
    struct pvp_start start = start_of(17);
    start.grid.n[0] = start.grid.n[1] = start.grid.n[2] = CROWD_SIDE;
    struct pvp_volume v = {.grid = start.grid};
    const char *where = endpoint;
    struct pvp_pub_params params = {
        .endpoints = &where, .n_endpoints = 1, .send_hwm = 4, .sample = PVP_F32, .comp = PVP_RAW};
    pvp_pub *p;
    struct pvx_diag d = {""};
    pid_t who[CROWD];
    int ends[CROWD][2], status;
    char byte;
    for (int i = 0; i < CELLS; i++) {
        index[i] = i;
        value[i] = (float)i;
    }
    fflush(stdout);
    for (int i = 0; i < CROWD; i++) {
        T_EQ_I(pipe(ends[i]), 0);
        who[i] = fork();
        if (who[i] == 0)
            _exit(reads_on(ends[i][1]));
        close(ends[i][1]);
    }
    T_EQ_I(pvp_pub_new(&params, &start, &p, &d), PVX_OK);
    while (pvp_pub_subscribers(p) < CROWD) {
        pvp_pub_tick(p);
        usleep(1000);
    }
    T_EQ_I(kill(who[CROWD - 1], SIGSTOP), 0);
    long before = 0;
    for (v.set = 0; v.set < CROWD_VOLUMES; v.set++) {
        T_EQ_I(pvp_pub_volume(p, &v, &(struct pvp_voxels){CELLS, index, value, 1}, NULL), PVX_OK);
        for (int i = 0; i < CROWD - 1; i++)
            T_EQ_I(read(ends[i][0], &byte, 1), 1);
        if (v.set == 0)
            before = resident_kib();
    }
    long grown = resident_kib() - before;
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    T_LE(grown,
         8 * 1024); /* all are 25 MiB; the queue holds 4 of 128 KiB, and the sockets a little */
#else
    T_LE(0, grown + (1 << 30)); /* sanitizers keep freed memory */
#endif
    T_EQ_I(kill(who[CROWD - 1], SIGKILL), 0);
    T_EQ_I(pvp_pub_say(p, PVP_END, "done"), PVX_OK);
    for (int i = 0; i < CROWD; i++) {
        T_EQ_I(waitpid(who[i], &status, 0), who[i]);
        T_OK(i < CROWD - 1 ? WIFEXITED(status) && WEXITSTATUS(status) == 0 : WIFSIGNALED(status));
        close(ends[i][0]);
    }
    pvp_pub_free(&p);
}

/* Nobody listened when the first start went out; it comes again. */
T_CASE(late_joiner)
{
    pvp_pub *p;
    pvp_sub *s;
    struct pvx_diag d;
    struct pvp_header h;
    const void *msg;
    size_t len;
    T_EQ_I(pvp_sub_new(endpoint, NULL, &s, NULL), PVX_OK); /* before the daemon is there */
    T_EQ_I(pvp_sub_next(s, 0, &h, &msg, &len, NULL), PVX_ETIMEDOUT);
    T_OK(pvp_sub_start(s) == NULL);
    T_EQ_I(open_pub(endpoint, 1, &p, &d), PVX_OK);
    for (uint64_t i = 0; i < 5; i++)
        T_EQ_I(publish_voxel(p, i, 1), PVX_OK);
    T_OK(joined(p, s));
    T_OK(pvp_sub_start(s) != NULL);
    if (pvp_sub_start(s) != NULL) {
        T_EQ_I(pvp_sub_start(s)->session, 1);
        T_EQ_S(pvp_sub_start(s)->software, "test_pub");
    }
    T_EQ_I(publish_voxel(p, 77, 2.5f), PVX_OK);
    T_EQ_I(pvp_pub_say(p, PVP_STATUS, "{\"a\":1}"), PVX_OK);
    T_EQ_I(pvp_pub_say(p, PVP_END, "done"), PVX_OK);
    T_EQ_I(pvp_sub_next(s, PATIENCE_NS, &h, &msg, &len, NULL), PVX_OK);
    T_EQ_I(h.type, PVP_VOLUME);
    struct pvp_view view;
    pvp_decoder *dec;
    static float dense[720];
    T_EQ_I(pvp_decode_volume(msg, len, &view, NULL), PVX_OK);
    T_EQ_I(view.v.session, 1); /* the publisher's, though the volume named none */
    T_EQ_I(view.v.set, 77);
    T_EQ_I(pvp_decoder_new(&dec), PVX_OK);
    T_EQ_I(pvp_volume_unpack(dec, &view, dense, 719, NULL), PVX_EINVAL);
    T_EQ_I(pvp_volume_unpack(dec, &view, dense, 720, NULL), PVX_OK);
    pvp_decoder_free(&dec);
    T_NEAR(dense[77], 2.5, 0);
    T_EQ_I(pvp_sub_next(s, PATIENCE_NS, &h, &msg, &len, NULL), PVX_OK);
    T_EQ_I(h.type, PVP_STATUS);
    T_EQ_I(pvp_sub_next(s, PATIENCE_NS, &h, &msg, &len, NULL), PVX_OK);
    T_EQ_I(h.type, PVP_END);
    T_EQ_I(h.sequence + 1, pvp_pub_sequence(p));
    struct pvp_sub_stats st;
    pvp_sub_stats(s, &st);
    T_EQ_I(st.lost, 0); /* what went before we came is not lost */
    T_EQ_I(st.malformed, 0);
    pvp_pub_free(&p);
    T_OK(!exists("") && !exists(".lock"));
    pvp_sub_free(&s);
}

/* A restarted daemon is a new session: counting starts anew, and volumes wait for its start. */
T_CASE(restart)
{
    pvp_pub *p;
    pvp_sub *s;
    struct pvx_diag d;
    struct pvp_sub_stats st;
    T_EQ_I(pvp_sub_new(endpoint, NULL, &s, NULL), PVX_OK);
    for (uint64_t session = 5; session <= 6; session++) {
        T_EQ_I(open_pub(endpoint, session, &p, &d), PVX_OK);
        if (session == 5)
            for (uint64_t i = 0; i < 50; i++)
                T_EQ_I(publish_voxel(p, i, 1), PVX_OK);
        T_OK(joined(p, s));
        T_OK(pvp_sub_start(s) != NULL && pvp_sub_start(s)->session == session);
        pvp_sub_stats(s, &st);
        T_EQ_I(st.sessions, session - 4);
        T_EQ_I(st.lost, 0);
        pvp_pub_free(&p);
    }
    pvp_sub_free(&s);
}

/* A subscriber that never reads: the publisher goes on, memory stays bounded, and when the
 * subscriber wakes up it can tell exactly how much it has missed. */
T_CASE(slow_subscriber)
{
    enum { SIDE = 32, CELLS = SIDE * SIDE * SIDE, N = 500 };
    static int32_t index[CELLS];
    static float value[CELLS];
    struct pvp_start start = start_of(9);
    start.grid.n[0] = start.grid.n[1] = start.grid.n[2] = SIDE;
    const char *at = endpoint;
    struct pvp_pub_params params = {
        .endpoints = &at, .n_endpoints = 1, .send_hwm = 4, .sample = PVP_F32, .comp = PVP_RAW};
    struct pvp_volume v = {.grid = start.grid};
    struct pvx_diag d = {""};
    pvp_pub *p;
    pvp_sub *s;
    for (int i = 0; i < CELLS; i++) {
        index[i] = i;
        value[i] = (float)i;
    }
    T_EQ_I(pvp_pub_new(&params, &start, &p, &d), PVX_OK);
    T_EQ_I(pvp_sub_new(endpoint, NULL, &s, NULL), PVX_OK);
    T_OK(joined(p, s));
    long before = resident_kib();
    size_t bytes = 0;
    for (v.set = 0; v.set < N; v.set++)
        T_EQ_I(pvp_pub_volume(p, &v, &(struct pvp_voxels){CELLS, index, value, 1}, &bytes), PVX_OK);
    T_LE(CELLS * 4, bytes);
    long grown = resident_kib() - before;
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    /* N messages are 64 MiB; the two queues hold 4 + 16, and the sockets a little. */
    T_LE(grown, 16 * 1024);
#else
    T_LE(0, grown + (1 << 30)); /* sanitizers keep freed memory */
#endif
    struct pvp_header h;
    struct pvp_sub_stats st;
    const void *msg;
    size_t len;
    uint64_t last = 0;
    while (pvp_sub_next(s, 200 * PVX_NS_PER_MS, &h, &msg, &len, NULL) == PVX_OK)
        last = h.sequence;
    /* The next start tells of the gap even if all volumes after it were dropped. */
    T_OK(joined(p, s));
    pvp_sub_stats(s, &st);
    T_OK(st.lost > 0);
    T_OK(st.received < N);
    T_OK(last < pvp_pub_sequence(p));
    T_LE(st.received + st.lost, pvp_pub_sequence(p));
    T_LE(N, st.received + st.lost);
    T_EQ_I(st.malformed, 0);
    pvp_sub_free(&s);
    pvp_pub_free(&p);
}

T_CASE(second_publisher)
{
    pvp_pub *p, *q;
    pvp_sub *s;
    struct pvx_diag d;
    T_EQ_I(open_pub(endpoint, 1, &p, &d), PVX_OK);
    T_EQ_I(open_pub(endpoint, 2, &q, &d), PVX_EBUSY);
    T_OK(q == NULL);
    T_CONTAINS(d.text, endpoint);
    char pid[32];
    snprintf(pid, sizeof pid, "process %ld", (long)getpid());
    T_CONTAINS(d.text, pid);
    /* ... and the first is untouched */
    T_EQ_I(pvp_sub_new(endpoint, NULL, &s, NULL), PVX_OK);
    T_OK(joined(p, s));
    T_OK(pvp_sub_start(s) != NULL && pvp_sub_start(s)->session == 1);
    pvp_sub_free(&s);
    pvp_pub_free(&p);
    T_EQ_I(open_pub(endpoint, 2, &p, &d), PVX_OK);
    pvp_pub_free(&p);
}

/* A program that knows nothing of the lock is not cut off either. */
T_CASE(foreign_listener)
{
    struct sockaddr_un a = {.sun_family = AF_UNIX};
    snprintf(a.sun_path, sizeof a.sun_path, "%.100s", endpoint + 6);
    int fd = socket(AF_UNIX, SOCK_STREAM, 0);
    T_EQ_I(bind(fd, (struct sockaddr *)&a, sizeof a), 0);
    T_EQ_I(listen(fd, 4), 0);
    pvp_pub *p;
    struct pvx_diag d;
    T_EQ_I(open_pub(endpoint, 1, &p, &d), PVX_EBUSY);
    T_CONTAINS(d.text, "in use");
    T_OK(exists("") && !exists(".lock"));
    close(fd);
    T_EQ_I(open_pub(endpoint, 1, &p, &d), PVX_OK);
    pvp_pub_free(&p);
}

T_CASE(port_in_use)
{
    void *ctx = zmq_ctx_new(), *other = zmq_socket(ctx, ZMQ_REP);
    char at[64];
    size_t n = sizeof at;
    T_EQ_I(zmq_bind(other, "tcp://127.0.0.1:*"), 0);
    T_EQ_I(zmq_getsockopt(other, ZMQ_LAST_ENDPOINT, at, &n), 0);
    pvp_pub *p;
    struct pvx_diag d;
    T_EQ_I(open_pub(at, 1, &p, &d), PVX_EBUSY);
    T_OK(p == NULL);
    T_CONTAINS(d.text, at);
    T_CONTAINS(d.text, "configure another endpoint");
    zmq_close(other);
    zmq_ctx_term(ctx);
}

T_CASE(bad_endpoints)
{
    static const struct {
        const char *at, *says;
        pvx_err e;
    } bad[] = {
        {"volumes", "not an endpoint", PVX_EINVAL},
        {"", "not an endpoint", PVX_EINVAL},
        {"http://127.0.0.1:5555", "not an endpoint", PVX_EINVAL},
        {"tcp://127.0.0.1", "not an endpoint", PVX_EINVAL},
        {"tcp://192.0.2.77:5555", "no network interface", PVX_EINVAL},
        {"ipc:///nonexistent-folder/volumes", "/nonexistent-folder/volumes", PVX_ENOENT},
        {"ipc:///tmp/0123456789012345678901234567890123456789012345678901234567890123456789"
         "0123456789012345678901234567890123456789",
         "path longer", PVX_EINVAL},
    };
    pvp_pub *p;
    struct pvx_diag d;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        T_EQ_I(open_pub(bad[i].at, 1, &p, &d), bad[i].e);
        T_CONTAINS(d.text, bad[i].says);
    }
    struct pvp_pub_params none = {.sample = PVP_F32};
    struct pvp_start s = start_of(1);
    T_EQ_I(pvp_pub_new(&none, &s, &p, &d), PVX_EINVAL);
    pvp_sub *sub;
    d.text[0] = '\0';
    T_EQ_I(pvp_sub_new("nonsense", NULL, &sub, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "nonsense");
}

/* What is not a message is counted and skipped. */
T_CASE(malformed)
{
    void *ctx = zmq_ctx_new(), *raw = zmq_socket(ctx, ZMQ_XPUB);
    T_EQ_I(zmq_bind(raw, endpoint), 0);
    pvp_sub *s;
    pvp_encoder *e;
    struct pvp_header h;
    const void *msg;
    size_t len;
    char hello[64];
    T_EQ_I(pvp_sub_new(endpoint, NULL, &s, NULL), PVX_OK);
    zmq_recv(raw, hello, sizeof hello, 0); /* the subscription */
    struct pvp_start start = start_of(3);
    T_EQ_I(pvp_encoder_new(&small, PVP_F32, PVP_RAW, &e), PVX_OK);
    T_EQ_I(pvp_encode_start(e, 0, &start, &msg, &len), PVX_OK);
    zmq_send(raw, "PVX1", 4, 0);
    zmq_send(raw, msg, len - 1, 0);
    zmq_send(raw, msg, len, ZMQ_SNDMORE);
    zmq_send(raw, "PVX1", 4, 0);
    uint8_t later[48];
    memcpy(later, msg, 48);
    later[5] = 0x7f; /* a type nobody knows, without a body */
    memset(later + 40, 0, 8);
    zmq_send(raw, later, 48, 0);
    T_EQ_I(pvp_encode_start(e, 4, &start, &msg, &len), PVX_OK);
    zmq_send(raw, msg, len, 0);
    int64_t until = pvx_now_mono() + PATIENCE_NS;
    pvx_err err;
    while ((err = pvp_sub_next(s, PVX_NS_PER_S, &h, &msg, &len, NULL)) != PVX_OK &&
           pvx_now_mono() < until)
        continue;
    T_EQ_I(err, PVX_OK);
    T_EQ_I(h.sequence, 4);
    struct pvp_sub_stats st;
    pvp_sub_stats(s, &st);
    T_EQ_I(st.malformed, 4); /* two short ones and both parts of the multipart */
    T_EQ_I(st.received, 2);
    T_EQ_I(st.lost, 3);
    pvp_encoder_free(&e);
    pvp_sub_free(&s);
    zmq_close(raw);
    zmq_ctx_term(ctx);
    unlink(endpoint + 6); /* libzmq leaves it */
}

static void send_start(void *raw, uint64_t sequence, const struct pvp_grid *g)
{
    struct pvp_start start = start_of(3);
    pvp_encoder *e;
    const void *msg;
    size_t len;
    start.grid = *g;
    T_EQ_I(pvp_encoder_new(g, PVP_F32, PVP_RAW, &e), PVX_OK);
    T_EQ_I(pvp_encode_start(e, sequence, &start, &msg, &len), PVX_OK);
    zmq_send(raw, msg, len, 0);
    pvp_encoder_free(&e);
}

static void send_volume(void *raw, uint64_t sequence, const struct pvp_grid *g)
{
    struct pvp_volume v = {.session = 3, .set = sequence, .grid = *g};
    int32_t index = 0;
    float value = 1;
    pvp_encoder *e;
    const void *msg;
    size_t len;
    T_EQ_I(pvp_encoder_new(g, PVP_F32, PVP_RAW, &e), PVX_OK);
    T_EQ_I(
        pvp_encode_volume(e, sequence, &v, &(struct pvp_voxels){1, &index, &value, 1}, &msg, &len),
        PVX_OK);
    zmq_send(raw, msg, len, 0);
    pvp_encoder_free(&e);
}

static pvx_err next_message(pvp_sub *s, struct pvp_header *h, struct pvx_diag *d)
{
    const void *msg;
    size_t len;
    pvx_err e = PVX_ETIMEDOUT;
    for (int64_t until = pvx_now_mono() + PATIENCE_NS;
         e == PVX_ETIMEDOUT && pvx_now_mono() < until;)
        e = pvp_sub_next(s, PVX_NS_PER_S, h, &msg, &len, d);
    return e;
}

/* Who takes room for the start's grid has room for every volume that comes out, and nobody is made to
 * ask for more than they allow. */
T_CASE(a_claim_of_room)
{
    struct pvp_grid other = small, vast = small;
    other.n[0]++;
    vast.n[0] = vast.n[1] = vast.n[2] = PVP_GRID_MAX;
    void *ctx = zmq_ctx_new(), *raw = zmq_socket(ctx, ZMQ_XPUB);
    T_EQ_I(zmq_bind(raw, endpoint), 0);
    pvp_sub *s;
    struct pvp_header h;
    struct pvp_sub_stats st;
    struct pvx_diag d = {""};
    char hello[64];
    T_EQ_I(pvp_sub_new(endpoint, &(struct pvp_sub_options){.memory = 1 << 20}, &s, NULL), PVX_OK);
    zmq_recv(raw, hello, sizeof hello, 0); /* the subscription */
    send_start(raw, 0, &small);
    send_volume(raw, 1, &vast);
    send_volume(raw, 2, &other);
    send_volume(raw, 3, &small);
    send_start(raw, 4, &vast);
    send_volume(raw, 5, &vast);
    send_start(raw, 6, &small);
    T_EQ_I(next_message(s, &h, &d), PVX_OK);
    T_EQ_I(h.type, PVP_START);
    T_EQ_I(next_message(s, &h, &d), PVX_OK);
    T_EQ_I(h.sequence, 3);
    pvp_sub_stats(s, &st);
    T_EQ_I(st.malformed, 2);
    T_EQ_I(next_message(s, &h, &d), PVX_ERANGE);
    T_CONTAINS(d.text, "1024 x 1024 x 1024 voxels need 4096 MiB");
    T_OK(pvp_sub_start(s) == NULL);
    T_EQ_I(next_message(s, &h, &d), PVX_OK);
    T_EQ_I(h.sequence, 6);
    pvp_sub_stats(s, &st);
    T_EQ_I(st.malformed, 2);
    T_EQ_I(st.lost, 0);
    pvp_sub_free(&s);
    zmq_close(raw);
    zmq_ctx_term(ctx);
    unlink(endpoint + 6); /* libzmq leaves it */
}

static pvx_err open_with_rig(const char *rig, pvp_pub **out)
{
    const char *at = endpoint;
    struct pvp_start start = start_of(4);
    start.rig_hash = 77;
    return pvp_pub_new(&(struct pvp_pub_params){.endpoints = &at,
                                                .n_endpoints = 1,
                                                .rig = rig,
                                                .send_hwm = 10000,
                                                .sample = PVP_F32,
                                                .comp = PVP_RAW},
                       &start, out, NULL);
}

/* Messages of a type until it has come `n` times; the number of rigs seen. */
static unsigned until(pvp_pub *p, pvp_sub *s, enum pvp_type type, unsigned n)
{
    struct pvp_header h = {0};
    const void *msg;
    size_t len;
    unsigned rigs = 0;
    for (int64_t end = pvx_now_mono() + PATIENCE_NS; n > 0 && pvx_now_mono() < end;) {
        pvp_pub_tick(p);
        if (pvp_sub_next(s, 20 * PVX_NS_PER_MS, &h, &msg, &len, NULL) != PVX_OK)
            continue;
        rigs += h.type == PVP_RIG;
        n -= h.type == type;
    }
    T_EQ_I(n, 0);
    return rigs;
}

/* Whoever comes is told the rig behind the start, once a second at most however many come, but before a volume. */
T_CASE(newcomers_get_the_rig)
{
    pvp_pub *p;
    pvp_sub *s, *other;
    uint64_t hash = 0;
    T_EQ_I(open_with_rig("cameras: []\n", &p), PVX_OK);
    T_EQ_I(pvp_sub_new(endpoint, NULL, &s, NULL), PVX_OK);
    T_OK(pvp_sub_rig(s, NULL) == NULL);
    until(p, s, PVP_RIG, 1);
    T_EQ_S(pvp_sub_rig(s, &hash), "cameras: []\n");
    T_EQ_I(hash, 77);
    T_OK(pvp_sub_start(s) != NULL);
    T_EQ_I(until(p, s, PVP_START, 2), 0); /* nobody has come: nobody is told again */
    T_EQ_I(pvp_sub_new(endpoint, NULL, &other, NULL), PVX_OK);
    until(p, other, PVP_RIG, 1);
    T_EQ_S(pvp_sub_rig(other, NULL), "cameras: []\n");
    for (int i = 0; i < 3; i++) { /* each within a second of the one before */
        pvp_sub_free(&other);
        T_EQ_I(pvp_sub_new(endpoint, NULL, &other, NULL), PVX_OK);
        T_OK(joined(p, other));
        T_EQ_I(publish_voxel(p, (uint64_t)i + 1, 1), PVX_OK);
        until(p, other, PVP_VOLUME, 1);
        T_EQ_S(pvp_sub_rig(other, NULL), "cameras: []\n");
    }
    T_EQ_I(pvp_pub_say(p, PVP_EVENT, "{\"version\":1}"), PVX_OK);
    until(p, s, PVP_EVENT, 1);
    pvp_sub_free(&other);
    pvp_sub_free(&s);
    pvp_pub_free(&p);
}

/* Who subscribes without end gets no more rigs than seconds and volumes have passed. */
T_CASE(subscriptions_without_end)
{
    pvp_pub *p;
    pvp_sub *s;
    void *ctx = zmq_ctx_new(), *crowd = zmq_socket(ctx, ZMQ_SUB);
    const int linger = 0;
    T_EQ_I(open_with_rig("cameras: []\n", &p), PVX_OK);
    T_EQ_I(pvp_sub_new(endpoint, NULL, &s, NULL), PVX_OK);
    until(p, s, PVP_RIG, 1);
    T_EQ_I(zmq_setsockopt(crowd, ZMQ_LINGER, &linger, sizeof linger), 0);
    T_EQ_I(zmq_connect(crowd, endpoint), 0);
    int64_t t0 = pvx_now_mono();
    uint64_t before = pvp_pub_sequence(p);
    for (int i = 0; i < 3000; i++) {
        char prefix[16];
        int n = snprintf(prefix, sizeof prefix, "PVX1%d", i);
        T_EQ_I(zmq_setsockopt(crowd, ZMQ_SUBSCRIBE, prefix, (size_t)n), 0);
        pvp_pub_tick(p);
    }
    T_EQ_I(publish_voxel(p, 1, 1), PVX_OK);
    unsigned rigs = until(p, s, PVP_VOLUME, 1);
    T_LE(rigs, (pvx_now_mono() - t0) / PVX_NS_PER_S + 2);
    T_LE(pvp_pub_sequence(p) - before, 2 * 3000 + 100);
    zmq_close(crowd);
    zmq_ctx_term(ctx);
    pvp_sub_free(&s);
    pvp_pub_free(&p);
}

/* Of what waits only the last volume; all that is not a volume, in its place. */
T_CASE(newest_only)
{
    pvp_pub *p;
    pvp_sub *s;
    struct pvp_header h;
    struct pvp_view v;
    struct pvp_sub_stats st;
    const void *msg;
    size_t len;
    struct pvx_diag d = {""};
    T_EQ_I(open_deep(endpoint, 4, 100, &p, &d), PVX_OK); /* nothing may be dropped on the way */
    T_EQ_I(pvp_sub_new(endpoint, &(struct pvp_sub_options){.newest = true}, &s, NULL), PVX_OK);
    T_OK(joined(p, s));
    T_OK(pvp_sub_fd(s) >= 0);
    for (uint64_t set = 0; set < 6; set++)
        T_EQ_I(publish_voxel(p, set, 1), PVX_OK);
    T_EQ_I(pvp_pub_say(p, PVP_EVENT, "{}"), PVX_OK);
    for (uint64_t set = 6; set < 8; set++)
        T_EQ_I(publish_voxel(p, set, 1), PVX_OK);
    T_EQ_I(pvp_pub_say(p, PVP_END, "done"), PVX_OK);
    pvp_pub_free(&p); /* all of it is on its way, or there */
    uint64_t last = 0, volumes = 0, events = 0;
    while (pvp_sub_next(s, PATIENCE_NS, &h, &msg, &len, NULL) == PVX_OK && h.type != PVP_END) {
        events += h.type == PVP_EVENT;
        if (h.type != PVP_VOLUME)
            continue;
        T_EQ_I(pvp_decode_volume(msg, len, &v, NULL), PVX_OK);
        T_OK(volumes == 0 || v.v.set > last);
        last = v.v.set;
        volumes++;
    }
    T_EQ_I(h.type, PVP_END);
    T_EQ_I(last, 7);
    T_EQ_I(events, 1);
    pvp_sub_stats(s, &st);
    T_EQ_I(st.skipped + volumes, 8);
    T_EQ_I(st.lost, 0);
    pvp_sub_free(&s);
}

static pvx_err publish_bars(pvp_pub *p, uint64_t set, float value)
{
    struct pvp_volume v = {.set = set, .grid = small};
    int32_t index = (int32_t)(set % 720);
    return pvp_pub_bars(p, &v, PVP_DOUBT_LATE, &(struct pvp_voxels){1, &index, &value, 1}, NULL);
}

/* Bars come with their volume and with no other, also where volumes are passed over; they are no message of their own. */
static void bars_come(bool newest)
{
    pvp_pub *p;
    pvp_sub *s;
    struct pvp_header h;
    struct pvp_view v, b;
    struct pvp_sub_stats st;
    const void *msg, *bars;
    size_t len;
    uint32_t doubt;
    struct pvx_diag d = {""};
    T_EQ_I(open_deep(endpoint, 5, 100, &p, &d), PVX_OK);
    T_EQ_I(pvp_sub_new(endpoint, &(struct pvp_sub_options){.newest = newest}, &s, NULL), PVX_OK);
    T_OK(joined(p, s));
    T_OK(pvp_sub_bars(s, &len) == NULL);
    for (uint64_t set = 0; set < 9; set++) {
        if (set % 3 != 1) /* each third has none; the last has those of another set */
            T_EQ_I(publish_bars(p, set < 8 ? set : 700, 0.5f), PVX_OK);
        T_EQ_I(publish_voxel(p, set, 1), PVX_OK);
    }
    T_EQ_I(pvp_pub_say(p, PVP_END, "done"), PVX_OK);
    pvp_pub_free(&p);
    uint64_t volumes = 0, last = 99;
    while (pvp_sub_next(s, PATIENCE_NS, &h, &msg, &len, NULL) == PVX_OK && h.type != PVP_END) {
        bars = pvp_sub_bars(s, &len);
        T_OK(h.type != PVP_BARS);
        if (h.type != PVP_VOLUME) {
            T_OK(bars == NULL);
            continue;
        }
        T_EQ_I(pvp_decode_volume(msg, h.head + h.body, &v, NULL), PVX_OK);
        last = v.v.set;
        volumes++;
        T_EQ_I(bars != NULL, last % 3 != 1 && last < 8);
        if (bars == NULL)
            continue;
        T_EQ_I(pvp_decode_bars(bars, len, &b, &doubt, NULL), PVX_OK);
        T_EQ_I(b.v.set, last);
        T_EQ_I(doubt, PVP_DOUBT_LATE);
    }
    T_EQ_I(h.type, PVP_END);
    T_EQ_I(last, 8);
    pvp_sub_stats(s, &st);
    T_EQ_I(st.skipped + volumes, 9);
    T_EQ_I(st.lost + st.malformed, 0);
    pvp_sub_free(&s);
}

T_CASE(bars_with_their_volumes)
{
    bars_come(false);
}

T_CASE(bars_of_the_newest)
{
    bars_come(true);
}

/* --- the system tests' publisher --- */
static int publish(const char *at, int volumes, int skip, bool say_end)
{
    enum { CELLS = 10 * 9 * 8 };
    int32_t index[CELLS];
    float value[CELLS * 3];
    struct pvp_start start = start_of((uint64_t)getpid());
    start.grid.channels = 3;
    void *ctx = zmq_ctx_new(), *s = zmq_socket(ctx, ZMQ_XPUB);
    /* Nothing is lost but what we leave out.  Without an end it waits for the subscriber. */
    int hwm = volumes < 0 ? 100 : 0, wait = 1;
    pvp_encoder *e;
    const void *msg;
    size_t len;
    char hello[64];
    zmq_setsockopt(s, ZMQ_SNDHWM, &hwm, sizeof hwm);
    zmq_setsockopt(s, ZMQ_XPUB_NODROP, &wait, sizeof wait);
    if (zmq_bind(s, at) != 0 || pvp_encoder_new(&start.grid, PVP_F16, PVP_LZ4, &e) != PVX_OK) {
        fprintf(stderr, "%s: %s\n", at, zmq_strerror(errno));
        return 1;
    }
    zmq_recv(s, hello, sizeof hello, 0);
    uint64_t sequence = 0;
    if (pvp_encode_start(e, sequence++, &start, &msg, &len) != PVX_OK)
        return 1;
    zmq_send(s, msg, len, 0);
    for (int set = 0; volumes < 0 || set < volumes; set++) {
        struct pvp_volume v = {.session = start.session,
                               .set = (uint64_t)set,
                               .t_exposure_ns = 1767225600000000000 + set * 66666667LL,
                               .t_publish_ns = 1767225600020000000 + set * 66666667LL,
                               .latency_ns = 20000000,
                               .cameras_present = 8,
                               .camera_mask = 255,
                               .grid = start.grid,
                               .report = {.solver = "mrnsd",
                                          .iterations = 12,
                                          .rel_residual = 0.05,
                                          .active_voxels = CELLS / 3}};
        uint32_t n = 0;
        for (int i = set % 3; i < CELLS; i += 3, n++) {
            index[n] = i;
            for (int c = 0; c < 3; c++)
                value[n * 3 + (uint32_t)c] =
                    (float)(set % 64) + (float)(i % 8) / 8 + (float)(64 * c);
        }
        if (pvp_encode_volume(e, sequence++, &v, &(struct pvp_voxels){n, index, value, 3}, &msg,
                              &len) != PVX_OK)
            return 1;
        if (skip == 0 || (set + 1) % skip != 0)
            zmq_send(s, msg, len, 0);
    }
    if (pvp_encode_end(e, sequence++, start.session, "all sent", &msg, &len) != PVX_OK)
        return 1;
    if (say_end)
        zmq_send(s, msg, len, 0);
    zmq_recv(s, hello, sizeof hello, 0); /* the subscriber leaves */
    pvp_encoder_free(&e);
    zmq_close(s);
    zmq_ctx_term(ctx);
    if (strncmp(at, "ipc://", 6) == 0)
        unlink(at + 6);
    return 0;
}

int main(int argc, char **argv)
{
    if (argc >= 5 && strcmp(argv[1], "--publish") == 0)
        return publish(argv[2], atoi(argv[3]), atoi(argv[4]), argc == 5);
    scratch_new();
    snprintf(endpoint, sizeof endpoint, "ipc://%s/volumes", dir);
    t_run();
    rmdir(dir);
    if (access(dir, F_OK) == 0) {
        printf("FAIL test_pub: left something in %s\n", dir);
        return 1;
    }
    return t_done();
}
