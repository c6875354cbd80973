/* What a stranger may send a page's socket: frames of any kind, words of any kind.  The input is what comes behind the
 * request, in pieces of a byte's length each; with the first bit of the first byte it comes behind a good token. */
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/clock.h"
#include "daemon/view/page.h"
#include "tests/fuzz/fuzz.h"

static view_shelf *shelf;
static struct view_gate gate = {.token = "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"};

static void begin(void)
{
    const struct pvp_start s = {.grid = {.n = {8, 8, 8}, .max = {1, 1, 1}, .channels = 1},
                                .session = 1};
    const struct pvp_volume v = {.session = 1, .set = 3, .grid = s.grid};
    const int32_t index[] = {5};
    const float value[] = {1};
    pvp_encoder *e;
    struct pvp_header h;
    const void *msg;
    size_t len;
    MUST(view_shelf_new(&shelf) == PVX_OK);
    MUST(pvp_encoder_new(&s.grid, PVP_F16, PVP_ZSTD, &e) == PVX_OK);
    MUST(pvp_encode_start(e, 0, &s, &msg, &len) == PVX_OK);
    MUST(pvp_decode_header(msg, len, &h, NULL) == PVX_OK);
    MUST(view_shelf_put(shelf, &h, msg, len, NULL) == PVX_OK);
    MUST(pvp_encode_volume(e, 1, &v, &(struct pvp_voxels){1, index, value, 1}, &msg, &len) ==
         PVX_OK);
    MUST(pvp_decode_header(msg, len, &h, NULL) == PVX_OK);
    MUST(view_shelf_put(shelf, &h, msg, len, NULL) == PVX_OK);
    pvp_encoder_free(&e);
}

static void turn(view_page *p, int mine)
{
    struct view_words w;
    char nothing[65536];
    view_page_read(p, &w);
    view_page_write(p, shelf, "{\"link\":{}}", 1);
    view_page_over(p, pvx_now_mono());
    while (recv(mine, nothing, sizeof nothing, MSG_DONTWAIT) > 0)
        continue;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const char token[] = "{\"token\":\"aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa\"}";
    uint8_t hello[6 + sizeof token - 1] = {0x81, 0x80 | (sizeof token - 1)};
    view_page *p;
    int fd[2];
    if (shelf == NULL)
        begin();
    if (size == 0)
        return 0;
    memcpy(hello + 6, token, sizeof token - 1); /* a mask of zeros */
    bool good = (data[0] & 1) != 0;
    MUST(socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK, 0, fd) == 0);
    MUST(view_page_new(fd[1], &gate, hello, good ? sizeof hello : 0, &p) == PVX_OK);
    turn(p, fd[0]);
    MUST(view_page_let_in(p) == good);
    for (size_t at = 1; at < size;) {
        size_t n = data[at++];
        n = n < size - at ? n : size - at;
        if (n > 0 && send(fd[0], data + at, n, MSG_NOSIGNAL) < 0)
            break;
        at += n;
        turn(p, fd[0]);
    }
    const struct view_page_stats *s = view_page_stats(p);
    fuzz_taken += s->drawn > 0;
    MUST(s->sent <= 1 && s->drawn <= s->sent);
    view_page_free(&p);
    close(fd[0]);
    close(fd[1]);
    return 0;
}
