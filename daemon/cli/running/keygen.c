/* keygen.c - `pyrovox keygen`: make a key for a daemon that is reached over the network, or for a client of it. */
#include <stdio.h>
#include <string.h>

#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "proto/keys.h"

struct args {
    const char *name, *server;
    bool control;
};

#define AT(field) CLI_AT(struct args, field)

static const struct cli_row rows[] = {
    {"s|server", "FILE.pub", AT(server), 0, 0,
     "the key is a client's: FILE.pub is that of the daemon, which it is for"},
    {"control", NULL, AT(control), 0, 0, "NAME.pub asks for control, not only to read volumes"},
    {0}};

static const char doc[] = "Make NAME.key, which stays with its owner (mode 0600), and NAME.pub, a "
                          "line for the daemon's list of clients.\vExamples:\n"
                          "  pyrovox keygen /etc/pyrovox/lab\n"
                          "      on the daemon's host; in pyrovoxd.yaml:\n"
                          "      keys: {server: lab.key, clients: clients.keys}\n"
                          "      (a key that only the service can read: systemd/README.md)\n"
                          "  pyrovox keygen me --server lab.pub\n"
                          "      on the client's host, with the daemon's lab.pub\n"
                          "  cat me.pub >> /etc/pyrovox/clients.keys; systemctl reload pyrovoxd\n"
                          "      lets the client in\n"
                          "  pyrovox record --key me.key --endpoint tcp://lab:5555\n"
                          "\n"
                          "No file is overwritten.";

static error_t keygen_parse(int key, char *arg, struct argp_state *state)
{
    struct args *a = state->input;
    switch (key) {
    case ARGP_KEY_ARG: cli_arg_one(state, "name", arg, &a->name); return 0;
    case ARGP_KEY_END:
        if (a->name == NULL)
            argp_error(state, "no name given");
        return 0;
    default: return cli_row(rows, key, arg, state, a);
    }
}

/* Read the key of a .pub file, which is a list of one line. */
static pvx_err server_key(const char *path, char out[PVP_KEY_TEXT], struct pvx_diag *d)
{
    static struct pvp_client_list l;
    PVX_TRY(pvp_clients_read(path, &l, d));
    if (l.n != 1)
        return pvx_fail(d, PVX_EFORMAT, "%s: has %zu keys; give the daemon's .pub file", path, l.n);
    memcpy(out, l.client[0].key, PVP_KEY_TEXT);
    return PVX_OK;
}

static int keygen_run(int argc, char **argv)
{
    struct args a = {0};
    const struct argp argp = {.parser = keygen_parse, .args_doc = "NAME", .doc = doc};
    cli_parse(rows, &argp, 0, argc, argv, &a);
    struct pvp_key_pair k;
    struct pvx_diag d = {""};
    pvx_err e = pvp_key_make(&k, &d);
    if (e == PVX_OK && a.server != NULL)
        e = server_key(a.server, k.server, &d);
    PVX_THEN(e, pvp_key_write(a.name, a.control ? PVP_ROLE_CONTROL : PVP_ROLE_READ, &k, &d));
    explicit_bzero(&k, sizeof k);
    if (e != PVX_OK)
        return cli_error(&d, e);
    printf("%s.key  keep it secret: it opens the daemon\n%s.pub  %s\n", a.name, a.name,
           a.server != NULL ? "add its line to the daemon's keys.clients"
                            : "for clients: pyrovox keygen ME --server this file");
    return 0;
}

const struct cli_command cmd_keygen = {
    "keygen", "a key for a daemon that is reached over the network", keygen_run};
