/* pyrovox view - the flame in a browser: a daemon's volumes, or a recording's. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/running/status_cameras.h"
#include "daemon/config/endpoints.h"
#include "daemon/view/bridge.h"

struct args {
    const char *file, *endpoint, *previews, *key, *control, *listen, *cert, *cert_key, *token_file;
    const char *host[VIEW_HOSTS_MAX];
    size_t n_hosts;
    bool open, turn, quiet;
};

enum { OPT_PREVIEWS = 256, OPT_CONTROL, OPT_HOST, OPT_CERT, OPT_CERT_KEY, OPT_TOKEN, OPT_TURN };

static const struct argp_option options[] = {
    {"endpoint", 'e', "ENDPOINT", 0, "The daemon's volumes (default: those of a local one)", 0},
    {"previews", OPT_PREVIEWS, "ENDPOINT", 0,
     "The daemon's previews (default: ENDPOINT.previews of an ipc one); \"\": none", 0},
    {"key", 'k', "FILE", 0, "A .key file of `pyrovox keygen`, for a daemon that asks for one", 0},
    {"control", OPT_CONTROL, "ENDPOINT", OPTION_ARG_OPTIONAL,
     "Pages may record volumes and take snapshots, by the daemon's control.endpoint (default: that "
     "of a local one); without it they only look",
     0},
    {"open", 'o', NULL, 0, "Open the page in the desktop's browser", 0},
    {"turn", OPT_TURN, NULL, 0, "The page begins turning, unless its user asked for less motion",
     0},
    {"listen", 'l', "ADDRESS:PORT", 0,
     "Where the page is (127.0.0.1:8737); another host's browser reaches it only with --cert", 1},
    {"cert", OPT_CERT, "FILE", 0,
     "TLS certificate, PEM; a renewed file is used for the next connections", 1},
    {"cert-key", OPT_CERT_KEY, "FILE", 0, "Its key, PEM, readable by you alone", 1},
    {"host", OPT_HOST, "NAME", 0, "A name or address of the page for browsers; may be repeated", 1},
    {"token-file", OPT_TOKEN, "FILE", 0,
     "Keep the token in this file, so that a bookmark lasts; made if missing", 1},
    {"quiet", 'q', NULL, 0, "Print errors only", 0},
    {0}};

static error_t view_parse(int key, char *arg, struct argp_state *st)
{
    struct args *a = st->input;
    struct pvx_diag d = {""};
    switch (key) {
    case 'e': a->endpoint = arg; return 0;
    case OPT_PREVIEWS: a->previews = arg; return 0;
    case 'k': a->key = arg; return 0;
    case OPT_CONTROL: a->control = arg != NULL ? arg : dmn_client_endpoint(DMN_CONTROL); return 0;
    case OPT_TURN: a->turn = true; return 0;
    case 'o': a->open = true; return 0;
    case 'l': a->listen = arg; return 0;
    case OPT_CERT: a->cert = arg; return 0;
    case OPT_CERT_KEY: a->cert_key = arg; return 0;
    case OPT_HOST:
        if (a->n_hosts == VIEW_HOSTS_MAX)
            argp_error(st, "--host: %d names at most", VIEW_HOSTS_MAX);
        if (view_gate_name(arg, &d) != PVX_OK)
            argp_error(st, "%s", d.text);
        a->host[a->n_hosts++] = arg;
        return 0;
    case OPT_TOKEN: a->token_file = arg; return 0;
    case 'q': a->quiet = true; return 0;
    case ARGP_KEY_ARG:
        if (strstr(arg, "://") != NULL)
            argp_error(st, "'%s' is an endpoint, not a recording: --endpoint %s or --control=%s",
                       arg, arg, arg);
        cli_arg_one(st, "recording", arg, &a->file);
        return 0;
    case ARGP_KEY_END:
        if ((a->cert == NULL) != (a->cert_key == NULL))
            argp_error(st, "--cert and --cert-key go together");
        if (a->file != NULL &&
            (a->endpoint != NULL || a->previews != NULL || a->key != NULL || a->control != NULL))
            argp_error(st, "a recording has no --endpoint, --previews, --key or --control");
        return 0;
    default: return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp argp = {
    .options = options,
    .parser = view_parse,
    .args_doc = "[FILE]",
    .doc = "Show the flame in a browser: of a running daemon, or of a recording of "
           "volumes.\vExamples:\n"
           "  pyrovox view --open\n"
           "  pyrovox view flame.h5 --open\n"
           "  pyrovox view --listen 192.0.2.7:8737 --cert host.pem --cert-key host.key \\\n"
           "          --host lab.example --token-file token\n"
           "\n"
           "Prints the address of the page and serves it until Ctrl-C. The part of the address "
           "after # is a token. Requests without it are refused, also those of other users of this "
           "host. The token is never part of a request. The page needs WebGL2. Without it, the "
           "page shows three projections.\n"
           "\n"
           "A slow or hidden page receives fewer volumes, but always the newest. The daemon never "
           "waits.\n"
           "\n"
           "From a laptop: ssh -L 8737:127.0.0.1:8737 HOST, then open the address here.\n"
           "\n"
           "Exit: 0 or 130 stopped, 1 failed, 2 wrong usage.",
};

static bool view_stop(void *ctx)
{
    (void)ctx;
    return cli_stop != 0;
}

static void view_say(const char *line)
{
    fprintf(stderr, "pyrovox view: %s\n", line);
}

_Static_assert(STATUS_LINE <= VIEW_VERDICT_TEXT, "a verdict fits into a page's");
static void view_verdict(const char *json, size_t len, char out[VIEW_VERDICT_TEXT])
{
    cJSON *j = cJSON_ParseWithLength(json, len);
    if (j != NULL)
        (void)verdict_line(j, out);
    cJSON_Delete(j);
}

/* Write a file that only this user can read and that leads the browser to url.  The address contains the token, and
 * all users of the host can read command lines, so the browser must not get it there.  path "": there is no file. */
static pvx_err write_door(const char *url, char *path, size_t size, struct pvx_diag *d)
{
    const char *dir = getenv("XDG_RUNTIME_DIR");
    snprintf(path, size, "%s/pyrovox-view-XXXXXX.html",
             dir != NULL && dir[0] == '/' ? dir : "/tmp");
    int fd = mkostemps(path, 5, O_CLOEXEC); /* mode 0600 */
    if (fd >= 0 &&
        dprintf(fd,
                "<!doctype html><meta charset=\"utf-8\"><meta name=\"referrer\" "
                "content=\"no-referrer\"><title>Pyrovox</title><meta http-equiv=\"refresh\" "
                "content=\"0; url=%s\"><a href=\"%s\">Pyrovox</a>\n",
                url, url) > 0 &&
        close(fd) == 0)
        return PVX_OK;
    pvx_err e = pvx_fail(d, PVX_EIO, "--open: %s: %s", path, strerror(errno));
    if (fd >= 0)
        unlink(path);
    path[0] = '\0';
    return e;
}

/* Open the browser in the background.  It has its own session, so a terminal's Ctrl-C does not reach it, and it is no
 * child of this process. */
static void open_browser(const char *path)
{
    pid_t p = fork();
    if (p == 0) {
        setsid();
        if (fork() == 0) {
            if (freopen("/dev/null", "w", stdout) != NULL &&
                freopen("/dev/null", "w", stderr) != NULL)
                execlp("xdg-open", "xdg-open", path, (char *)NULL);
            _exit(127);
        }
        _exit(0);
    }
    if (p > 0)
        while (waitpid(p, NULL, 0) < 0 && errno == EINTR)
            continue;
}

static pvx_err view_open_source(const struct args *a, struct view_source *out, struct pvx_diag *d)
{
    char previews[256];
    if (a->file != NULL)
        return view_film_new(a->file, out, d);
    const char *at = a->endpoint != NULL ? a->endpoint : dmn_client_endpoint(DMN_VOLUMES);
    snprintf(previews, sizeof previews, "%s.previews", at);
    const char *second = a->previews;
    if (second == NULL && strncmp(at, "ipc://", 6) == 0)
        second = previews;
    if (second != NULL && second[0] == '\0')
        second = NULL;
    return view_live_new(at, second, a->key, out, d);
}

static void farewell(const struct args *a, const view_bridge *b)
{
    struct view_bridge_stats s;
    view_bridge_stats(b, &s);
    const struct {
        uint64_t n;
        const char *what;
    } lines[] = {{s.refused_token, "without the right token"},
                 {s.refused_full, "for which there was no room"},
                 {s.http.refused_host, "requests by a name that is not this host's"},
                 {s.http.refused_origin, "requests of another site's page"},
                 {s.http.late, "connections that asked for nothing in time"},
                 {s.source.lost, "messages lost on the way from the daemon"},
                 {s.source.malformed, "messages or volumes that could not be read"}};
    uint64_t wrong = 0;
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++)
        wrong += lines[i].n;
    if (a->quiet && wrong == 0)
        return;
    fprintf(stderr, "%llu pages", (unsigned long long)s.pages_ever);
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++)
        if (lines[i].n > 0)
            fprintf(stderr, ", %llu %s", (unsigned long long)lines[i].n, lines[i].what);
    fputc('\n', stderr);
}

/* The address of the page.  A wildcard is replaced, because a browser cannot open it. */
static void view_address_of(const struct args *a, const view_bridge *b, char *out, size_t size)
{
    const char *at = view_bridge_at(b), *port = strrchr(at, ':');
    bool any = strncmp(at, "0.0.0.0:", 8) == 0 || strncmp(at, "[::]:", 5) == 0;
    if (a->n_hosts > 0)
        snprintf(out, size, "%s%s", a->host[0], port);
    else
        snprintf(out, size, "%s%s",
                 !any           ? ""
                 : at[0] == '[' ? "[::1]"
                                : "127.0.0.1",
                 any ? port : at);
}

static pvx_err view_serve(const struct args *a, struct pvx_diag *d)
{
    struct view_gate gate = {.tls = a->cert != NULL, .n_hosts = a->n_hosts};
    struct view_source source;
    view_orders *orders = NULL;
    view_bridge *b;
    char at[300], url[400], door[300] = "";
    memcpy(gate.host, a->host, sizeof gate.host);
    PVX_TRY(a->token_file != NULL ? view_gate_read_token(a->token_file, gate.token, d)
                                  : view_gate_make_token(gate.token, d));
    if (a->control != NULL)
        PVX_TRY(view_orders_new(a->control, a->key, &orders, d));
    pvx_err e = view_open_source(a, &source, d);
    if (e != PVX_OK) {
        view_orders_free(&orders);
        return e;
    }
    const struct view_http_params p = {
        .gate = &gate, .listen = a->listen, .cert = a->cert, .key = a->cert_key, .say = view_say};
    PVX_TRY(view_bridge_new(&p, &source, orders, &b, d));
    view_address_of(a, b, at, sizeof at);
    snprintf(url, sizeof url, "%s://%s/%s#%s", gate.tls ? "https" : "http", at,
             a->turn ? "?turn" : "", gate.token);
    if (!a->quiet) {
        puts(url);
        fflush(stdout);
        fputs("Ctrl-C ends it\n", stderr);
    }
    if (a->open && write_door(url, door, sizeof door, d) == PVX_OK)
        open_browser(door);
    else if (a->open)
        view_say(d->text);
    view_bridge_verdict(b, view_verdict);
    view_bridge_run(b, view_stop, view_say, NULL);
    if (door[0] != '\0')
        unlink(door);
    farewell(a, b);
    view_bridge_free(&b);
    return PVX_OK;
}

static int view_run(int argc, char **argv)
{
    struct args a = {.listen = "127.0.0.1:8737"};
    struct pvx_diag d = {""};
    argp_parse(&argp, argc, argv, 0, NULL, &a);
    cli_catch_stop();
    pvx_err e = view_serve(&a, &d);
    return e != PVX_OK ? cli_error(&d, e) : 130;
}

const struct cli_command cmd_view = {"view", "the flame in a browser, live or from a recording",
                                     view_run};
