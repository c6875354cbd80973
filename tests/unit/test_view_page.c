/* A page at the other end of a socket pair: credits, what is newest, what is small; the shelf; the relay; the words. */
#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/clock.h"
#include "daemon/view/files.h"
#include "daemon/view/page.h"
#include "daemon/view/poses.h"
#include "recon/geom/rig.h"
#include "tests/t.h"

enum { N = 16, CELLS = N * N * N };
static const struct pvp_grid grid = {
    .n = {N, N, N}, .min = {0, 0, 0}, .max = {1, 1, 1}, .channels = 1};

/* An encoder, a shelf and a page whose other end is `mine`. */
struct bed {
    pvp_encoder *e;
    view_shelf *shelf;
    view_page *page;
    struct view_gate gate;
    int mine, its;
    uint64_t sequence;
    uint8_t *got; /* the last message that came */
    size_t len, room;
    int opcode;
};

static void bed_new(struct bed *b, enum pvp_compress comp)
{
    int fd[2];
    *b = (struct bed){.room = (size_t)1 << 20};
    b->got = malloc(b->room);
    memset(b->gate.token, 'a', VIEW_TOKEN_DIGITS);
    T_EQ_I(socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK, 0, fd), 0);
    b->mine = fd[0];
    b->its = fd[1];
    T_EQ_I(pvp_encoder_new(&grid, PVP_F32, comp, &b->e), PVX_OK);
    T_EQ_I(view_shelf_new(&b->shelf), PVX_OK);
    T_EQ_I(view_page_new(b->its, &b->gate, NULL, 0, &b->page), PVX_OK);
}

static void bed_free(struct bed *b)
{
    view_page_free(&b->page);
    view_shelf_free(&b->shelf);
    pvp_encoder_free(&b->e);
    close(b->mine);
    close(b->its);
    free(b->got);
}

static void put(struct bed *b, const void *msg, size_t len)
{
    struct pvp_header h;
    T_EQ_I(pvp_decode_header(msg, len, &h, NULL), PVX_OK);
    T_EQ_I(view_shelf_put(b->shelf, &h, msg, len, NULL), PVX_OK);
}

static void start(struct bed *b, uint64_t session)
{
    const struct pvp_start s = {.grid = grid, .session = session, .units = "1/m"};
    const void *msg;
    size_t len;
    T_EQ_I(pvp_encode_start(b->e, b->sequence++, &s, &msg, &len), PVX_OK);
    put(b, msg, len);
}

static void volume(struct bed *b, uint64_t session, uint64_t set)
{
    static int32_t index[CELLS];
    static float value[CELLS];
    const struct pvp_volume v = {.session = session, .set = set, .grid = grid};
    const void *msg;
    size_t len;
    for (int i = 0; i < CELLS; i++) {
        index[i] = i;
        value[i] = (float)(i % 7) + (float)set;
    }
    view_page_count(b->page, view_shelf_number(b->shelf, VIEW_VOLUME));
    T_EQ_I(pvp_encode_volume(b->e, b->sequence++, &v, &(struct pvp_voxels){CELLS, index, value, 1},
                             &msg, &len),
           PVX_OK);
    put(b, msg, len);
}

/* A masked text frame, as a client sends it. */
static void say(struct bed *b, const char *text)
{
    uint8_t frame[256] = {0x81, 0, 1, 2, 3, 4};
    size_t n = strlen(text);
    frame[1] = (uint8_t)(0x80 | n);
    for (size_t i = 0; i < n; i++)
        frame[6 + i] = (uint8_t)(text[i] ^ frame[2 + i % 4]);
    T_EQ_I(send(b->mine, frame, n + 6, MSG_NOSIGNAL), n + 6);
}

static bool turn(struct bed *b)
{
    struct view_words w;
    bool said = view_page_read(b->page, &w);
    view_page_write(b->page, b->shelf, "{}", 0);
    return said;
}

static bool bytes(struct bed *b, void *out, size_t n)
{
    for (size_t at = 0; at < n;) {
        ssize_t r = recv(b->mine, (uint8_t *)out + at, n - at, 0);
        if (r > 0)
            at += (size_t)r;
        else if (r == 0 || at == 0)
            return false;
        else
            turn(b);
    }
    return true;
}

/* The next message; 0: none is there, else its type, -1 a close, and 1 a text. */
static int next(struct bed *b)
{
    uint8_t head[10];
    turn(b);
    if (!bytes(b, head, 2))
        return 0;
    b->len = head[1];
    if (b->len == 126 && bytes(b, head, 2))
        b->len = (size_t)head[0] << 8 | head[1];
    else if (b->len == 127 && bytes(b, head, 8))
        b->len = (size_t)head[5] << 16 | (size_t)head[6] << 8 | head[7];
    b->opcode = 0;
    if (b->len > b->room || (b->len > 0 && !bytes(b, b->got, b->len)))
        return 0;
    if (b->len >= 4 && memcmp(b->got, "PVX1", 4) == 0)
        return b->got[4] | b->got[5] << 8;
    return b->len >= 2 && b->got[0] != '{' ? -1 : 1;
}

static uint64_t set_got(const struct bed *b)
{
    struct pvp_view v;
    T_EQ_I(pvp_decode_volume(b->got, b->len, &v, NULL), PVX_OK);
    return v.v.set;
}

#define TOKEN "\"token\":\"aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa\""

T_CASE(newest_for_a_credit)
{
    struct bed b;
    bed_new(&b, PVP_RAW);
    start(&b, 7);
    volume(&b, 7, 1);
    T_EQ_I(next(&b), 0); /* nothing without the token */
    say(&b, "{" TOKEN "}");
    T_EQ_I(next(&b), PVP_START);
    T_EQ_I(next(&b), 0); /* no credit */
    volume(&b, 7, 2);
    volume(&b, 7, 3);
    say(&b, "{\"credits\":1}");
    T_EQ_I(next(&b), PVP_VOLUME);
    T_EQ_I(set_got(&b), 3);
    T_EQ_I(next(&b), 0);
    volume(&b, 7, 4);
    T_EQ_I(next(&b), 0);
    say(&b, "{\"credits\":2}");
    T_EQ_I(next(&b), PVP_VOLUME);
    T_EQ_I(set_got(&b), 4);
    T_EQ_I(next(&b), 0); /* not the same one twice */
    const struct view_page_stats *st = view_page_stats(b.page);
    T_EQ_I(st->sent, 2);
    T_EQ_I(st->superseded, 2);
    say(&b, "{\"drawn\":4}");
    say(&b, "{\"drawn\":4}");
    turn(&b);
    T_EQ_I(st->drawn, 1);
    T_OK(isnan(
        view_page_recent(b.page, VIEW_WHOLE, 0.5,
                         pvx_now_mono()))); /* published in 1970, says its clock: not believed */
    bed_free(&b);
}

T_CASE(hidden_pages_get_none)
{
    struct bed b;
    bed_new(&b, PVP_RAW);
    start(&b, 7);
    say(&b, "{" TOKEN ",\"hidden\":true,\"credits\":8}");
    T_EQ_I(next(&b), PVP_START);
    volume(&b, 7, 1);
    T_EQ_I(next(&b), 0);
    volume(&b, 7, 2);
    T_EQ_I(view_page_stats(b.page)->hidden, 1);
    T_OK(!view_page_looks(b.page) && view_page_let_in(b.page));
    say(&b, "{\"hidden\":false}");
    T_EQ_I(next(&b), PVP_VOLUME);
    T_EQ_I(set_got(&b), 2);
    bed_free(&b);
}

/* Who does not read is sent the volume under way, and then the newest: what is held for it does not grow. */
T_CASE(stalled_pages_hold_nothing)
{
    struct bed b;
    int small = 4096;
    bed_new(&b, PVP_RAW);
    setsockopt(b.its, SOL_SOCKET, SO_SNDBUF, &small, sizeof small);
    start(&b, 7);
    say(&b, "{" TOKEN ",\"credits\":8}");
    for (uint64_t set = 1; set <= 50; set++) {
        volume(&b, 7, set);
        turn(&b);
    }
    T_EQ_I(view_page_stats(b.page)->sent, 1);
    T_EQ_I(next(&b), PVP_START);
    T_EQ_I(next(&b), PVP_VOLUME);
    T_EQ_I(set_got(&b), 1);
    T_EQ_I(next(&b), PVP_VOLUME);
    T_EQ_I(set_got(&b), 50);
    bed_free(&b);
}

T_CASE(sessions)
{
    struct bed b;
    bed_new(&b, PVP_RAW);
    start(&b, 7);
    volume(&b, 7, 1);
    start(&b, 7); /* as each second: not sent again */
    say(&b, "{" TOKEN ",\"credits\":8}");
    T_EQ_I(next(&b), PVP_START);
    T_EQ_I(next(&b), PVP_VOLUME);
    T_EQ_I(next(&b), 0);
    start(&b, 8);
    T_EQ_I(next(&b), PVP_START);
    T_EQ_I(next(&b), 0); /* the volume was another session's */
    volume(&b, 8, 1);
    T_EQ_I(next(&b), PVP_VOLUME);
    bed_free(&b);
}

T_CASE(tokens)
{
    const char *const bad[] = {"{\"token\":\"\"}", "{\"credits\":1}", "{}", "[]", "{\"token\":1}"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct bed b;
        bed_new(&b, PVP_RAW);
        start(&b, 7);
        say(&b, bad[i]);
        T_EQ_I(next(&b), -1);
        T_EQ_I(b.got[0] << 8 | b.got[1], i < 3 ? VIEW_CLOSE_TOKEN : VIEW_CLOSE_WORDS);
        T_OK(view_page_refused(b.page) && !view_page_let_in(b.page));
        bed_free(&b);
    }
    struct bed b;
    bed_new(&b, PVP_RAW);
    T_OK(!view_page_over(b.page, pvx_now_mono()));
    (void)view_page_over(b.page, pvx_now_mono() + VIEW_HELLO_NS + PVX_NS_PER_S);
    T_EQ_I(next(&b), -1);
    T_EQ_I(b.got[0] << 8 | b.got[1], VIEW_CLOSE_SILENT);
    T_OK(view_page_refused(b.page));
    bed_free(&b);
}

/* Zstandard and, where it is asked for, uncompressed volumes come out as LZ4 with the same values and words. */
T_CASE(relay)
{
    for (int comp = PVP_RAW; comp <= PVP_ZSTD; comp++)
        for (int small = 0; small < 2; small++) {
            struct bed b;
            struct view_msg m;
            struct pvp_view was, is;
            static float want[CELLS], got[CELLS];
            pvp_decoder *d;
            bed_new(&b, comp);
            start(&b, 7);
            volume(&b, 7, 5);
            T_EQ_I(view_shelf_get(b.shelf, VIEW_VOLUME, small, &m, NULL), PVX_OK);
            T_EQ_I(m.set, 5);
            T_EQ_I(pvp_decode_volume(m.data, m.len, &is, NULL), PVX_OK);
            T_EQ_I(is.comp, comp == PVP_RAW && !small ? PVP_RAW : PVP_LZ4);
            T_EQ_I(pvp_decoder_new(&d), PVX_OK);
            T_EQ_I(pvp_volume_unpack(d, &is, got, CELLS, NULL), PVX_OK);
            for (int i = 0; i < CELLS; i++)
                want[i] = (float)(i % 7) + 5;
            T_OK(memcmp(want, got, sizeof want) == 0);
            T_EQ_I(is.v.session, 7);
            T_EQ_I(is.n_bricks, 8);
            (void)was;
            pvp_decoder_free(&d);
            bed_free(&b);
        }
}

/* The bars of set `set`, then its volume. */
static void volume_with_bars(struct bed *b, uint64_t set)
{
    static const int32_t index[] = {3};
    static const float sd[] = {0.5f};
    const struct pvp_volume v = {.session = 7, .set = set, .grid = grid};
    const void *msg;
    size_t len;
    T_EQ_I(pvp_encode_bars(b->e, b->sequence++, &v, 0, &(struct pvp_voxels){1, index, sd, 1}, &msg,
                           &len),
           PVX_OK);
    T_EQ_I(view_shelf_put_bars(b->shelf, msg, len, NULL), PVX_OK);
    volume(b, 7, set);
}

static uint64_t bars_got(const struct bed *b)
{
    struct pvp_view v;
    uint32_t doubt;
    T_EQ_I(pvp_decode_bars(b->got, b->len, &v, &doubt, NULL), PVX_OK);
    T_OK(v.comp != PVP_ZSTD);
    return v.v.set;
}

/* Bars go to who asks for them, with their volume and no other; a volume without bars takes them away. */
T_CASE(bars_for_who_asks)
{
    struct bed b;
    bed_new(&b, PVP_ZSTD);
    start(&b, 7);
    say(&b, "{" TOKEN ",\"credits\":1}");
    T_EQ_I(next(&b), PVP_START);
    volume_with_bars(&b, 1);
    T_EQ_I(next(&b), PVP_VOLUME);
    T_EQ_I(next(&b), 0);
    say(&b, "{\"bars\":true}"); /* of the volume that it has */
    T_EQ_I(next(&b), PVP_BARS);
    T_EQ_I(bars_got(&b), 1);
    volume_with_bars(&b, 2);
    T_EQ_I(next(&b), 0); /* neither without a credit */
    volume_with_bars(&b, 3);
    say(&b, "{\"credits\":2}");
    T_EQ_I(next(&b), PVP_BARS);
    T_EQ_I(bars_got(&b), 3);
    T_EQ_I(next(&b), PVP_VOLUME);
    T_EQ_I(set_got(&b), 3);
    T_EQ_I(view_shelf_put_bars(b.shelf, NULL, 0, NULL), PVX_OK);
    volume(&b, 7, 4);
    T_EQ_I(view_shelf_number(b.shelf, VIEW_BARS), 0);
    T_EQ_I(next(&b), PVP_VOLUME);
    T_EQ_I(next(&b), 0);
    say(&b, "{\"bars\":false,\"credits\":1}");
    volume_with_bars(&b, 5);
    T_EQ_I(next(&b), PVP_VOLUME);
    T_EQ_I(set_got(&b), 5);
    T_EQ_I(next(&b), 0);
    bed_free(&b);
}

T_CASE(events_in_order)
{
    struct bed b;
    const void *msg;
    size_t len;
    char text[64];
    bed_new(&b, PVP_RAW);
    start(&b, 7);
    for (int i = 0; i < VIEW_EVENTS + 5; i++) {
        snprintf(text, sizeof text, "{\"kind\":\"%d\"}", i);
        T_EQ_I(pvp_encode_event(b.e, b.sequence++, text, &msg, &len), PVX_OK);
        put(&b, msg, len);
    }
    say(&b, "{" TOKEN "}");
    T_EQ_I(next(&b), PVP_START); /* of their session first */
    for (int i = 5; i < VIEW_EVENTS + 5; i++) {
        size_t n;
        const char *json;
        T_EQ_I(next(&b), PVP_EVENT);
        T_EQ_I(pvp_decode_event(b.got, b.len, &json, &n, NULL), PVX_OK);
        snprintf(text, sizeof text, "{\"kind\":\"%d\"}", i);
        T_OK(n == strlen(text) && memcmp(json, text, n) == 0);
    }
    T_EQ_I(next(&b), 0);
    bed_free(&b);
}

T_CASE(words)
{
    struct view_words w;
    const char *good = "{\"credits\":3,\"drawn\":9007199254740992,\"speed\":0.5,\"order\":"
                       "\"snapshot\",\"x\":[{}]}";
    T_OK(view_words_read(good, strlen(good), &w));
    T_EQ_I(w.said, VIEW_SAID_CREDITS | VIEW_SAID_DRAWN | VIEW_SAID_SPEED | VIEW_SAID_ORDER);
    T_EQ_I(w.drawn, 9007199254740992);
    T_NEAR(w.speed, 0.5, 0);
    T_EQ_I(w.order, VIEW_ORDER_SNAPSHOT);
    const char *const bad[] = {"",
                               "{",
                               "null",
                               "[]",
                               "{\"credits\":-1}",
                               "{\"credits\":1.5}",
                               "{\"credits\":1e300}",
                               "{\"hidden\":0}",
                               "{\"speed\":0}",
                               "{\"order\":\"\"}",
                               "{\"order\":\"Stop\"}",
                               "{\"order\":2}",
                               "{\"speed\":101}",
                               "{\"seek\":\"1\"}",
                               "{\"token\":\"0123456789012345678901234567890123\"}"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        T_CHECK_(!view_words_read(bad[i], strlen(bad[i]), &w), "%s", bad[i]);
}

T_CASE(files)
{
    size_t n, total = 0;
    const struct view_file *f = view_files(&n);
    for (size_t i = 0; i < n; i++) {
        T_OK(f[i].end > f[i].begin);
        total += (size_t)(f[i].end - f[i].begin);
    }
    T_OK(total > 40000 && total < 150000);
    T_OK(view_file_find("/") == f && view_file_find("/index.html") == f);
    T_OK(view_file_find("") == NULL && view_file_find("main.js") == NULL);
    T_OK(view_file_find("//main.js") == NULL && view_file_find("/../main.js") == NULL);
}

T_CASE(poses)
{
    struct rec_rig rig;
    char *yaml, *text;
    size_t len;
    T_EQ_I(rec_rig_ring(REC_MAX_CAMERAS, 2.5, 640, 480, 16, &rig), PVX_OK);
    T_EQ_I(rec_rig_format(&rig, &yaml, &len), PVX_OK);
    T_EQ_I(view_poses(yaml, len, &text, NULL), PVX_OK);
    int n = 0;
    for (const char *p = text; (p = strstr(p, "\"corner\":[[")) != NULL; p++)
        n++;
    T_EQ_I(n, REC_MAX_CAMERAS);
    T_OK(strcmp(text + strlen(text) - 4, "]}}") != 0 && text[strlen(text) - 1] == '}');
    free(text);
    T_EQ_I(view_poses("nothing", 7, &text, NULL), PVX_EFORMAT);
    free(yaml);
    rec_rig_fini(&rig);
}
