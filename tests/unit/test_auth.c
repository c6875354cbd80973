/* Keys, lists of them, and who comes in: over real sockets, nobody without a listed key gets a byte. */
#include <arpa/inet.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zmq.h>

#include "base/clock.h"
#include "base/file.h"
#include "proto/clients/sub.h"
#include "proto/pub.h"
#include "tests/lib/patience.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

static struct pvx_diag d;
static char endpoint[64];
static int reserved = -1; /* holds the port while nothing listens on it */

static const struct pvp_grid grid = {.n = {8, 8, 8}, .max = {1, 1, 1}, .channels = 1};

static void write_text(const char *path, const char *text, mode_t mode)
{
    T_EQ_I(pvx_file_write(path, text, strlen(text), NULL), PVX_OK);
    T_EQ_I(chmod(path, mode), 0);
}

/* NAME.key and NAME.pub in the scratch folder; a client's knows the daemon "lab". */
static struct pvp_key_pair make(const char *name, enum pvp_role role)
{
    struct pvp_key_pair k, lab;
    T_EQ_I(pvp_key_make(&k, &d), PVX_OK);
    if (strcmp(name, "lab") != 0) {
        T_EQ_I(pvp_key_read(at("lab.key"), &lab, &d), PVX_OK);
        memcpy(k.server, lab.public_key, sizeof k.server);
    }
    d.text[0] = '\0';
    T_EQ_I(pvp_key_write(at("%s", name), role, &k, &d), PVX_OK);
    T_EQ_S(d.text, "");
    return k;
}

/* A list of these keys' .pub files. */
static void list(const char *const *names, size_t n)
{
    char text[4096] = "# who may come in\n\n";
    size_t at_end = strlen(text);
    for (size_t i = 0; i < n; i++) {
        char *line;
        size_t len;
        T_EQ_I(pvx_file_read(at("%s.pub", names[i]), 512, &line, &len, &d), PVX_OK);
        at_end += (size_t)snprintf(text + at_end, sizeof text - at_end, "%s", line);
        free(line);
    }
    write_text(at("clients.keys"), text, 0644);
}

static void begin(void)
{
    scratch_new();
    struct sockaddr_in a = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t len = sizeof a;
    int yes = 1;
    reserved = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (reserved < 0 || setsockopt(reserved, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) != 0 ||
        bind(reserved, (struct sockaddr *)&a, sizeof a) != 0 ||
        getsockname(reserved, (struct sockaddr *)&a, &len) != 0)
        exit(1);
    snprintf(endpoint, sizeof endpoint, "tcp://127.0.0.1:%d", ntohs(a.sin_port));
    make("lab", PVP_ROLE_READ);
    make("anna", PVP_ROLE_READ);
    make("bert", PVP_ROLE_CONTROL);
    make("eve", PVP_ROLE_READ);
}
static void end(void)
{
    close(reserved);
    scratch_remove();
}

/* ---- files ---- */

T_CASE(a_pair_comes_back)
{
    struct pvp_key_pair k = make("some.one", PVP_ROLE_CONTROL), back;
    struct pvp_client_list l;
    struct stat st;
    T_EQ_I(pvp_key_read(at("some.one.key"), &back, &d), PVX_OK);
    T_OK(memcmp(&k, &back, sizeof k) == 0);
    T_EQ_I(stat(at("some.one.key"), &st), 0);
    T_EQ_I(st.st_mode & 0777, 0600);
    T_EQ_I(pvp_clients_read(at("some.one.pub"), &l, &d), PVX_OK);
    T_EQ_I(l.n, 1);
    T_EQ_S(l.client[0].name, "some.one");
    T_EQ_S(l.client[0].key, k.public_key);
    T_EQ_I(l.client[0].role, PVP_ROLE_CONTROL);
}

T_CASE(nothing_is_written_over)
{
    struct pvp_key_pair k, old;
    T_EQ_I(pvp_key_read(at("anna.key"), &old, &d), PVX_OK);
    T_EQ_I(pvp_key_make(&k, &d), PVX_OK);
    d.text[0] = '\0';
    T_EQ_I(pvp_key_write(at("anna"), PVP_ROLE_READ, &k, &d), PVX_EBUSY);
    T_CONTAINS(d.text, "anna.pub is there already");
    T_EQ_I(unlink(at("anna.pub")), 0);
    d.text[0] = '\0';
    T_EQ_I(pvp_key_write(at("anna"), PVP_ROLE_READ, &k, &d), PVX_EBUSY);
    T_CONTAINS(d.text, "anna.key is there already");
    T_OK(access(at("anna.pub"), F_OK) != 0); /* no half of a pair */
    T_EQ_I(pvp_key_read(at("anna.key"), &k, &d), PVX_OK);
    T_OK(memcmp(&k, &old, sizeof k) == 0);
    char line[256];
    snprintf(line, sizeof line, "anna read %s\n", old.public_key);
    write_text(at("anna.pub"), line, 0644);
    d.text[0] = '\0';
    T_EQ_I(pvp_key_write(at("no name"), PVP_ROLE_READ, &k, &d), PVX_EINVAL);
}

T_CASE(secrets_that_others_read_are_refused)
{
    struct pvp_key_pair k;
    make("open", PVP_ROLE_READ);
    T_EQ_I(chmod(at("open.key"), 0640), 0);
    d.text[0] = '\0';
    T_EQ_I(pvp_key_read(at("open.key"), &k, &d), PVX_EPERM);
    T_CONTAINS(d.text, "chmod 600");
}

T_CASE(what_is_no_key_file)
{
#define KEY "rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7"
    static const struct {
        const char *text, *says;
    } keys[] =
        {
            {"", "has no public key"},
            {"public " KEY "\n", "has no secret key"},
            {"public " KEY "\nsecret " KEY "x\n", ":2:"},
            {"public " KEY "\npublic " KEY "\n", ":2:"},
            {"# a\n\nsecret\n", ":3:"},
            {"private " KEY "\n", ":1:"},
        },
      lists[] = {
          {"anna " KEY "\n", ":1:"},
          {"anna write " KEY "\n", ":1:"},
          {"an/na read " KEY "\n", ":1:"},
          {"anna read " KEY " x\n", ":1:"},
          {"anna read abc\n", ":1:"},
          {"# a\nanna read " KEY "\nbert control " KEY "\n", ":3: the key of anna again"},
      };
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++) {
        struct pvp_key_pair k;
        write_text(at("bad.key"), keys[i].text, 0600);
        d.text[0] = '\0';
        T_EQ_I(pvp_key_read(at("bad.key"), &k, &d), PVX_EFORMAT);
        T_CONTAINS(d.text, keys[i].says);
    }
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        struct pvp_client_list l;
        write_text(at("bad.keys"), lists[i].text, 0644);
        d.text[0] = '\0';
        T_OK(pvp_clients_read(at("bad.keys"), &l, &d) != PVX_OK);
        T_CONTAINS(d.text, lists[i].says);
    }
}

/* ---- sockets ---- */

static pvp_pub *publisher(pvp_auth *a)
{
    const char *where = endpoint;
    struct pvp_pub_params p = {.sample = PVP_F32, .comp = PVP_RAW, .auth = a};
    if (a != NULL)
        p.guarded = &where, p.n_guarded = 1;
    else
        p.endpoints = &where, p.n_endpoints = 1;
    struct pvp_start start = {.grid = grid, .session = 7};
    pvp_pub *out;
    d.text[0] = '\0';
    T_EQ_I(pvp_pub_new(&p, &start, &out, &d), PVX_OK);
    T_EQ_S(d.text, "");
    return out;
}

static pvp_auth *guard(void)
{
    static const char *const both[] = {"anna", "bert"};
    pvp_auth *a;
    list(both, 2);
    T_EQ_I(pvp_auth_new(at("lab.key"), at("clients.keys"), &a, &d), PVX_OK);
    return a;
}

static pvp_sub *subscriber(const char *key)
{
    pvp_sub *s;
    struct pvp_sub_options o = {.key = key != NULL ? at("%s.key", key) : NULL};
    T_EQ_I(pvp_sub_new(endpoint, &o, &s, &d), PVX_OK);
    return s;
}

static uint64_t publish(pvp_pub *p)
{
    struct pvp_volume v = {.set = pvp_pub_sequence(p), .grid = grid};
    int32_t index = 0;
    float value = 1;
    T_EQ_I(pvp_pub_volume(p, &v, &(struct pvp_voxels){1, &index, &value, 1}, NULL), PVX_OK);
    return v.set;
}

/* A volume of this set or later comes while more are published. */
static bool reads(pvp_pub *p, pvp_sub *s, uint64_t since)
{
    for (int64_t until = pvx_now_mono() + PATIENCE_NS; pvx_now_mono() < until;) {
        struct pvp_header h;
        struct pvp_view v;
        const void *msg;
        size_t len;
        publish(p);
        if (pvp_sub_next(s, 20 * PVX_NS_PER_MS, &h, &msg, &len, NULL) == PVX_OK &&
            h.type == PVP_VOLUME && pvp_decode_volume(msg, len, &v, NULL) == PVX_OK &&
            v.v.set >= since)
            return true;
    }
    return false;
}

static uint64_t received(const pvp_sub *s)
{
    struct pvp_sub_stats st;
    pvp_sub_stats(s, &st);
    return st.received + st.malformed;
}

/* Takes whatever has come; how many messages since `before`. */
static uint64_t drain(pvp_sub *s, uint64_t before)
{
    struct pvp_header h;
    const void *msg;
    size_t len;
    while (pvp_sub_next(s, 50 * PVX_NS_PER_MS, &h, &msg, &len, NULL) == PVX_OK)
        continue;
    return received(s) - before;
}

T_CASE(listed_keys_come_in_and_nobody_else)
{
    struct pvp_key_pair k;
    pvp_auth *a = guard();
    pvp_pub *p = publisher(a);
    /* a key of ours for another daemon */
    T_EQ_I(pvp_key_read(at("anna.key"), &k, &d), PVX_OK);
    memcpy(k.server, k.public_key, sizeof k.server);
    T_EQ_I(pvp_key_write(at("astray"), PVP_ROLE_READ, &k, &d), PVX_OK);
    pvp_sub *none = subscriber(NULL), *eve = subscriber("eve"), *astray = subscriber("astray");
    pvp_sub *anna = subscriber("anna"), *bert = subscriber("bert");
    T_OK(reads(p, anna, 0));
    T_OK(reads(p, bert, 0)); /* who may control may read */
    int64_t until = pvx_now_mono() + PATIENCE_NS;
    while (pvp_auth_refused(a) == 0 && pvx_now_mono() < until)
        publish(p);
    T_OK(pvp_auth_refused(a) >= 1);
    T_OK(reads(p, anna, publish(p)));
    T_EQ_I(drain(none, 0), 0);
    T_EQ_I(drain(eve, 0), 0);
    T_EQ_I(drain(astray, 0), 0);
    T_EQ_I(pvp_pub_subscribers(p), 2);
    pvp_sub *all[] = {none, eve, astray, anna, bert};
    for (size_t i = 0; i < 5; i++)
        pvp_sub_free(&all[i]);
    pvp_pub_free(&p);
    pvp_auth_free(&a);
}

/* Who is turned away hears why, instead of waiting for ever; and the daemon counts those without a key too. */
static void told(pvp_pub *p, const char *key, const char *says)
{
    struct pvp_header h;
    const void *msg;
    size_t len;
    pvp_sub *s = subscriber(key);
    pvx_err e = PVX_ETIMEDOUT;
    d.text[0] = '\0';
    for (int64_t end = pvx_now_mono() + PATIENCE_NS; e == PVX_ETIMEDOUT && pvx_now_mono() < end;
         publish(p))
        e = pvp_sub_next(s, 20 * PVX_NS_PER_MS, &h, &msg, &len, &d);
    T_EQ_I(e, PVX_EPERM);
    T_CONTAINS(d.text, says);
    T_CONTAINS(d.text, endpoint);
    T_EQ_I(received(s), 0);
    pvp_sub_free(&s);
}

T_CASE(who_is_refused_is_told)
{
    struct pvp_key_pair k;
    pvp_auth *a = guard();
    pvp_pub *p = publisher(a);
    T_EQ_I(pvp_key_read(at("anna.key"), &k, &d), PVX_OK);
    memcpy(k.server, k.public_key, sizeof k.server);
    T_EQ_I(pvp_key_write(at("lost"), PVP_ROLE_READ, &k, &d), PVX_OK);
    told(p, "eve", "refuses this key");
    uint64_t before = pvp_auth_refused(a);
    told(p, NULL, "asks for a key");
    for (int64_t end = pvx_now_mono() + PATIENCE_NS;
         pvp_auth_refused(a) == before && pvx_now_mono() < end;)
        publish(p);
    T_LE(before + 1, pvp_auth_refused(a));
    told(p, "lost", "another key than the file says");
    pvp_pub_free(&p);
    pvp_auth_free(&a);
}

/* Which end notices first that only one of them has keys is a matter of luck; what is said is not. */
T_CASE(a_key_where_none_is_asked_for)
{
    pvp_pub *p = publisher(NULL);
    for (int i = 0; i < 20; i++)
        told(p, "anna", "asks for no key: leave --key out");
    pvp_pub_free(&p);
}

T_CASE(a_revoked_key_is_out)
{
    static const char *const one[] = {"bert"}, *const more[] = {"bert", "eve"};
    pvp_auth *a = guard();
    pvp_pub *p = publisher(a);
    pvp_sub *anna = subscriber("anna"), *bert = subscriber("bert");
    T_OK(reads(p, anna, 0));
    T_OK(reads(p, bert, 0));
    list(one, 1);
    T_EQ_I(pvp_auth_reload(a, &d), PVX_OK);
    T_EQ_I(pvp_auth_clients(a), 1);
    uint64_t since = publish(p); /* the first after it */
    uint64_t refused = pvp_auth_refused(a);
    T_OK(reads(p, bert, since + 1));
    int64_t until = pvx_now_mono() + PATIENCE_NS;
    while (pvp_auth_refused(a) == refused &&
           pvx_now_mono() < until) /* she came back, and was refused */
        publish(p);
    T_OK(pvp_auth_refused(a) > refused);
    drain(anna, 0); /* what was on its way to her when she was put out */
    uint64_t before = received(anna);
    T_OK(reads(p, bert, publish(p)));
    T_EQ_I(drain(anna, before), 0);
    /* Who is added comes in without anybody being put out; a list that cannot be read changes nothing. */
    uint64_t generation = pvp_auth_generation(a);
    list(more, 2);
    T_EQ_I(pvp_auth_reload(a, &d), PVX_OK);
    write_text(at("clients.keys"), "nonsense\n", 0644);
    d.text[0] = '\0';
    T_EQ_I(pvp_auth_reload(a, &d), PVX_EFORMAT);
    T_EQ_I(pvp_auth_generation(a), generation);
    pvp_sub *eve = subscriber("eve");
    T_OK(reads(p, eve, 0));
    pvp_sub_free(&eve);
    pvp_sub_free(&anna);
    pvp_sub_free(&bert);
    pvp_pub_free(&p);
    pvp_auth_free(&a);
}

/* The daemon's own key is changed while it runs: who knows the new one comes in, who knows the old one is told. */
T_CASE(another_key_of_the_daemon)
{
    struct pvp_key_pair anna, lab;
    pvp_auth *a = guard();
    pvp_pub *p = publisher(a);
    pvp_sub *before = subscriber("bert");
    T_OK(reads(p, before, 0));
    T_EQ_I(pvp_key_read(at("anna.key"), &anna, &d), PVX_OK);
    T_EQ_I(rename(at("lab.key"), at("first.key")) + unlink(at("lab.pub")), 0);
    lab = make("lab", PVP_ROLE_READ);
    T_EQ_I(pvp_auth_reload(a, &d), PVX_OK);
    told(p, "anna", "another key than the file says");
    memcpy(anna.server, lab.public_key,
           sizeof anna.server); /* her key stays hers, and in the list */
    T_EQ_I(pvp_key_write(at("anna2"), PVP_ROLE_READ, &anna, &d), PVX_OK);
    pvp_sub *s = subscriber("anna2");
    T_OK(reads(p, s, 0));
    drain(before, 0); /* what was on its way when the key was changed */
    uint64_t had = received(before);
    T_OK(reads(p, s, publish(p)));
    T_EQ_I(drain(before, had), 0);
    /* One that cannot be read changes nothing, nor does the list beside it. */
    uint64_t generation = pvp_auth_generation(a);
    write_text(at("lab.key"), "nonsense\n", 0600);
    write_text(at("clients.keys"), "", 0644);
    d.text[0] = '\0';
    T_EQ_I(pvp_auth_reload(a, &d), PVX_EFORMAT);
    T_EQ_I(pvp_auth_generation(a), generation);
    T_EQ_I(pvp_auth_clients(a), 2);
    T_OK(reads(p, s, publish(p)));
    T_EQ_I(rename(at("first.key"), at("lab.key")), 0); /* what others' keys know */
    pvp_sub_free(&s);
    pvp_sub_free(&before);
    pvp_pub_free(&p);
    pvp_auth_free(&a);
}

static void *connected(void *ctx)
{
    void *client = zmq_socket(ctx, ZMQ_SUB);
    const int linger = 0;
    T_EQ_I(zmq_setsockopt(client, ZMQ_LINGER, &linger, sizeof linger), 0);
    T_EQ_I(pvp_auth_client(client, at("anna.key"), &d), PVX_OK);
    T_EQ_I(zmq_setsockopt(client, ZMQ_SUBSCRIBE, "", 0), 0);
    T_EQ_I(zmq_connect(client, endpoint), 0);
    return client;
}

static int hears(void *server, int ms)
{
    char hello[16];
    T_EQ_I(zmq_setsockopt(server, ZMQ_RCVTIMEO, &ms, sizeof ms), 0);
    return zmq_recv(server, hello, sizeof hello, 0);
}

/* Nobody comes in while there is no handler, rather than everybody; nor once it is gone. */
T_CASE(closed_when_nobody_answers)
{
    pvp_auth *a = guard();
    pvp_zap *zap;
    void *ctx = zmq_ctx_new(), *server = zmq_socket(ctx, ZMQ_XPUB);
    T_EQ_I(pvp_auth_guard(a, server, PVP_ROLE_READ), PVX_OK);
    T_EQ_I(zmq_bind(server, endpoint), 0);
    void *early = connected(ctx);
    T_EQ_I(hears(server, 300), -1);
    T_EQ_I(pvp_zap_new(a, ctx, &zap, &d), PVX_OK);
    void *meanwhile = connected(ctx); /* it was that and nothing else */
    T_EQ_I(hears(server, 30000), 1);
    pvp_zap_free(&zap);
    while (hears(server, 0) >= 0)
        continue;
    void *late = connected(ctx);
    T_EQ_I(hears(server, 300), -1);
    zmq_close(early);
    zmq_close(meanwhile);
    zmq_close(late);
    zmq_close(server);
    zmq_ctx_term(ctx);
    pvp_auth_free(&a);
}

/* Connections that say nothing, or rubbish, do not disturb who has a key. */
T_CASE(a_crowd_at_the_door)
{
    enum { CROWD = 200 };
    static int crowd[CROWD];
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    to.sin_port = htons((uint16_t)atoi(strrchr(endpoint, ':') + 1));
    pvp_auth *a = guard();
    pvp_pub *p = publisher(a);
    pvp_sub *anna = subscriber("anna");
    T_OK(reads(p, anna, 0));
    for (int i = 0; i < CROWD; i++) {
        unsigned char rubbish[64];
        crowd[i] = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        T_EQ_I(connect(crowd[i], (struct sockaddr *)&to, sizeof to), 0);
        for (size_t k = 0; k < sizeof rubbish; k++)
            rubbish[k] = (unsigned char)t_rand();
        if (i % 2 == 0)
            T_OK(send(crowd[i], rubbish, sizeof rubbish, MSG_NOSIGNAL) > 0);
    }
    T_OK(reads(p, anna, publish(p)));
    T_EQ_I(pvp_pub_subscribers(p), 1);
    for (int i = 0; i < CROWD; i++)
        close(crowd[i]);
    pvp_sub_free(&anna);
    pvp_pub_free(&p);
    pvp_auth_free(&a);
}

T_CASE(what_a_client_lacks)
{
    pvp_sub *s;
    d.text[0] = '\0';
    T_EQ_I(pvp_sub_new(endpoint, &(struct pvp_sub_options){.key = at("lab.key")}, &s, &d),
           PVX_EFORMAT);
    T_CONTAINS(d.text, "server KEY");
    d.text[0] = '\0';
    T_EQ_I(pvp_sub_new(endpoint, &(struct pvp_sub_options){.key = at("nobody.key")}, &s, &d),
           PVX_ENOENT);
    T_CONTAINS(d.text, "nobody.key");
    d.text[0] = '\0';
    const char *guarded = endpoint;
    struct pvp_pub_params p = {.guarded = &guarded, .n_guarded = 1, .sample = PVP_F32};
    pvp_pub *out;
    T_EQ_I(pvp_pub_new(&p, &(struct pvp_start){.grid = grid}, &out, &d), PVX_EINVAL);
}

T_MAIN(begin(), end())
