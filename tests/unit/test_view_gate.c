/* Who may come in: Host and Origin as addresses, the token, its file; listening addresses. */
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/stat.h>

#include "daemon/view/gate.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

static struct sockaddr_storage here(const char *text)
{
    struct sockaddr_storage a;
    socklen_t len;
    T_EQ_I(view_gate_address(text, &a, &len, NULL), PVX_OK);
    return a;
}

T_CASE(hosts)
{
    struct view_gate g = {.host = {"lab.example", "203.0.113.7"}, .n_hosts = 2};
    const struct {
        const char *host, *here;
        bool good;
    } cases[] = {
        {"127.0.0.1:8737", "127.0.0.1:8737", true},
        {"127.0.0.1", "127.0.0.1:8737", true},
        {"localhost:1", "127.0.0.1:8737", true},
        {"LocalHost", "[::1]:8737", true},
        {"[::1]:8737", "[::1]:8737", true},
        {"127.0.0.1:8737", "localhost:8737", true},
        {"[::ffff:127.0.0.1]:8737", "127.0.0.1:8737", true},
        {"lab.example:8737", "192.0.2.7:8737", true},
        {"LAB.example", "192.0.2.7:8737", true},
        {"192.0.2.7", "192.0.2.7:8737", true},
        {"localhost", "192.0.2.7:8737", false},
        {"127.0.0.1", "192.0.2.7:8737", false},
        {"127.0.0.1.evil.test", "127.0.0.1:8737", false},
        {"127.0.0.1.evil.test:8737", "127.0.0.1:8737", false},
        {"evil.test", "127.0.0.1:8737", false},
        {"lab.example.evil.test", "192.0.2.7:8737", false},
        {"203.0.113.7:8737", "192.0.2.7:8737", true}, /* a forwarded port */
        {"203.0.113.8", "192.0.2.7:8737", false},
        {"203.0.113.7.evil.test", "192.0.2.7:8737", false},
        {"xlab.example", "192.0.2.7:8737", false},
        {"127.0.0.2", "127.0.0.1:8737", false},
        {"127.1", "127.0.0.1:8737", false},
        {"0x7f000001", "127.0.0.1:8737", false},
        {"::1", "[::1]:8737", false},
        {"[::1", "[::1]:8737", false},
        {"[lab.example]", "192.0.2.7:8737", false},
        {"[localhost]", "127.0.0.1:8737", false},
        {"[::1]x", "[::1]:8737", false},
        {"127.0.0.1:", "127.0.0.1:8737", false},
        {"127.0.0.1:123456", "127.0.0.1:8737", false},
        {"127.0.0.1:80@evil", "127.0.0.1:8737", false},
        {":8737", "127.0.0.1:8737", false},
        {"", "127.0.0.1:8737", false},
        {NULL, "127.0.0.1:8737", false},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct sockaddr_storage a = here(cases[i].here);
        T_CHECK_(view_gate_host(&g, cases[i].host, &a) == cases[i].good, "%s at %s",
                 cases[i].host != NULL ? cases[i].host : "none", cases[i].here);
    }
    char longest[400];
    memset(longest, 'a', sizeof longest);
    longest[sizeof longest - 1] = '\0';
    struct sockaddr_storage a = here("127.0.0.1:1");
    T_OK(!view_gate_host(&g, longest, &a));
}

T_CASE(origins)
{
    const struct {
        bool tls;
        const char *origin, *host;
        bool good;
    } cases[] = {
        {false, NULL, "127.0.0.1:8737", true},
        {false, "http://127.0.0.1:8737", "127.0.0.1:8737", true},
        {false, "http://localhost", "localhost", true},
        {false, "http://localhost:80", "localhost", true},
        {true, "https://lab.example", "lab.example:443", true},
        {true, "https://[::1]:1", "[::1]:1", true},
        {true, "http://lab.example", "lab.example", false},
        {false, "https://127.0.0.1:8737", "127.0.0.1:8737", false},
        {false, "http://127.0.0.1:8738", "127.0.0.1:8737", false},
        {false, "http://localhost:8737", "127.0.0.1:8737", false},
        {false, "http://127.0.0.1:8737.evil.test", "127.0.0.1:8737", false},
        {false, "http://127.0.0.1:8737/", "127.0.0.1:8737", false},
        {false, "http://u@127.0.0.1:8737", "127.0.0.1:8737", false},
        {false, "null", "127.0.0.1:8737", false},
        {false, "", "127.0.0.1:8737", false},
        {false, "http://", "127.0.0.1:8737", false},
        {false, "http://127.0.0.1:8737", NULL, false},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct view_gate g = {.tls = cases[i].tls};
        T_CHECK_(view_gate_origin(&g, cases[i].origin, cases[i].host) == cases[i].good, "%s",
                 cases[i].origin != NULL ? cases[i].origin : "none");
    }
}

T_CASE(addresses)
{
    struct sockaddr_storage a = here("8737");
    socklen_t len;
    T_EQ_I(ntohs(((struct sockaddr_in *)(void *)&a)->sin_port), 8737);
    T_OK(view_gate_loopback(&a));
    a = here("[::1]:0");
    T_OK(view_gate_loopback(&a));
    a = here("0.0.0.0:1");
    T_OK(!view_gate_loopback(&a));
    a = here("[::]:1");
    T_OK(!view_gate_loopback(&a));
    const char *const bad[] = {"",           "x:1",    "127.0.0.1", "127.0.0.1:65536", "1.2.3:4",
                               "[::1]",      "::1:80", "localhost", "127.0.0.1:-1",    "99999",
                               "1.2.3.4:1:1"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct pvx_diag d = {""};
        T_CHECK_(view_gate_address(bad[i], &a, &len, &d) == PVX_EINVAL, "%s", bad[i]);
        T_OK(strstr(d.text, "127.0.0.1:8737") != NULL);
    }
}

T_CASE(tokens)
{
    struct view_gate g = {0};
    char other[VIEW_TOKEN_DIGITS + 1];
    T_EQ_I(view_gate_make_token(g.token, NULL), PVX_OK);
    T_EQ_I(view_gate_make_token(other, NULL), PVX_OK);
    T_EQ_I(strspn(g.token, "0123456789abcdef"), VIEW_TOKEN_DIGITS);
    T_OK(strcmp(g.token, other) != 0);
    T_OK(view_gate_token(&g, g.token));
    T_OK(!view_gate_token(&g, other));
    T_OK(!view_gate_token(&g, ""));
    other[VIEW_TOKEN_DIGITS - 1] = '\0';
    T_OK(!view_gate_token(&g, other));
}

T_CASE(token_file)
{
    char path[128], first[VIEW_TOKEN_DIGITS + 1], again[VIEW_TOKEN_DIGITS + 1];
    struct stat st;
    struct pvx_diag d = {""};
    scratch_new();
    snprintf(path, sizeof path, "%s/token", dir);
    T_EQ_I(view_gate_read_token(path, first, &d), PVX_OK);
    T_EQ_I(view_gate_read_token(path, again, &d), PVX_OK);
    T_OK(strcmp(first, again) == 0);
    T_OK(stat(path, &st) == 0);
    T_EQ_I(st.st_mode & 0777, 0600);
    T_EQ_I(chmod(path, 0604), 0);
    T_EQ_I(view_gate_read_token(path, again, &d), PVX_EPERM);
    T_EQ_I(chmod(path, 0640), 0);
    const char *const bad[] = {"", "00", "0123456789abcdef0123456789abcdeg\n",
                               "0123456789abcdef0123456789abcdef0\n"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        FILE *f = fopen(path, "w");
        if (f == NULL)
            exit(1);
        fputs(bad[i], f);
        fclose(f);
        T_EQ_I(view_gate_read_token(path, again, NULL), PVX_EFORMAT);
    }
    T_EQ_I(view_gate_read_token("/nowhere/token", again, NULL), PVX_ENOENT);
    T_EQ_I(view_gate_read_token(dir, again, NULL), PVX_EFORMAT);
    scratch_remove();
}
