#include "proto/keys.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zmq.h>

#include "base/file.h"

#define FILE_MAX ((size_t)64 << 10)

static const char *const role_names[] = {[PVP_ROLE_READ] = "read", [PVP_ROLE_CONTROL] = "control"};

pvx_err pvp_key_make(struct pvp_key_pair *out, struct pvx_diag *d)
{
    *out = (struct pvp_key_pair){0};
    if (zmq_curve_keypair(out->public_key, out->secret_key) != 0)
        return pvx_fail(d, PVX_EUNSUP, "this libzmq makes no keys: %s", zmq_strerror(errno));
    return PVX_OK;
}

/* ---- reading ---- */

static bool is_key(const char *text)
{
    uint8_t key[32];
    return text != NULL && strlen(text) == PVP_KEY_TEXT - 1 && zmq_z85_decode(key, text) != NULL;
}

static bool is_name(const char *text)
{
    size_t n = strlen(text);
    return n > 0 && n < PVP_KEY_NAME &&
           strspn(text, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._@-") == n;
}

/* The next line that is not empty or a comment, cut into at most three words; false at the end. */
struct lines {
    char *rest;
    int line;
};
static bool next_line(struct lines *l, char *word[3], int *words)
{
    for (char *line; (line = strsep(&l->rest, "\n")) != NULL;) {
        char *save = NULL;
        l->line++;
        *words = 0;
        for (char *w = strtok_r(line, " \t\r", &save); w != NULL;
             w = strtok_r(NULL, " \t\r", &save)) {
            if (*words < 3)
                word[*words] = w;
            ++*words;
        }
        if (*words > 0 && strcmp(word[0], "#") != 0)
            return true;
    }
    return false;
}

pvx_err pvp_key_parse(char *text, const char *name, struct pvp_key_pair *out, struct pvx_diag *d)
{
    struct lines l = {.rest = text};
    char *word[3];
    int words;
    *out = (struct pvp_key_pair){0};
    while (next_line(&l, word, &words)) {
        char *to = strcmp(word[0], "public") == 0   ? out->public_key
                   : strcmp(word[0], "secret") == 0 ? out->secret_key
                   : strcmp(word[0], "server") == 0 ? out->server
                                                    : NULL;
        if (to == NULL || words != 2 || !is_key(word[1]) || to[0] != '\0')
            return pvx_fail(d, PVX_EFORMAT,
                            "%s:%d: should be public, secret or server, each once, and a key of 40 "
                            "characters; pyrovox keygen makes such files",
                            name, l.line);
        memcpy(to, word[1], PVP_KEY_TEXT);
    }
    if (out->public_key[0] == '\0' || out->secret_key[0] == '\0')
        return pvx_fail(d, PVX_EFORMAT,
                        "%s: has no %s key, is it cut short? pyrovox keygen makes such files", name,
                        out->public_key[0] == '\0' ? "public" : "secret");
    return PVX_OK;
}

pvx_err pvp_clients_parse(char *text, const char *name, struct pvp_client_list *out,
                          struct pvx_diag *d)
{
    struct lines l = {.rest = text};
    char *word[3];
    int words;
    out->n = 0;
    while (next_line(&l, word, &words)) {
        enum pvp_role role = PVP_ROLE_NONE;
        for (int r = PVP_ROLE_READ; words == 3 && r <= PVP_ROLE_CONTROL; r++)
            if (strcmp(word[1], role_names[r]) == 0)
                role = (enum pvp_role)r;
        if (role == PVP_ROLE_NONE || !is_name(word[0]) || !is_key(word[2]))
            return pvx_fail(
                d, PVX_EFORMAT,
                "%s:%d: should be NAME read KEY or NAME control KEY, the line of a .pub "
                "file of pyrovox keygen",
                name, l.line);
        for (size_t i = 0; i < out->n; i++)
            if (strcmp(out->client[i].key, word[2]) == 0)
                return pvx_fail(d, PVX_EINVAL, "%s:%d: the key of %s again", name, l.line,
                                out->client[i].name);
        if (out->n == PVP_CLIENTS_MAX)
            return pvx_fail(d, PVX_ERANGE, "%s:%d: more than %d clients", name, l.line,
                            PVP_CLIENTS_MAX);
        struct pvp_client *c = &out->client[out->n++];
        c->role = role;
        snprintf(c->name, sizeof c->name, "%s", word[0]);
        memcpy(c->key, word[2], PVP_KEY_TEXT);
    }
    return PVX_OK;
}

/* A file that systemd gives to this process alone.  The right to read it is in an ACL, whose mask stat(2) shows as
 * the group's rights. */
static bool is_credential(const char *path)
{
    const char *dir = getenv("CREDENTIALS_DIRECTORY");
    size_t n = dir != NULL ? strlen(dir) : 0;
    return n > 0 && strncmp(path, dir, n) == 0 && path[n] == '/';
}

pvx_err pvp_key_read(const char *path, struct pvp_key_pair *out, struct pvx_diag *d)
{
    struct stat st;
    char *text;
    size_t len;
    if (stat(path, &st) == 0 && (st.st_mode & (is_credential(path) ? 007 : 077)) != 0)
        return pvx_fail(d, PVX_EPERM,
                        "%s: others may read this secret key; chmod 600 it, and make a new one if "
                        "somebody did",
                        path);
    PVX_TRY(pvx_file_read(path, FILE_MAX, &text, &len, d));
    pvx_err e = pvp_key_parse(text, path, out, d);
    explicit_bzero(text, len);
    free(text);
    return e;
}

pvx_err pvp_clients_read(const char *path, struct pvp_client_list *out, struct pvx_diag *d)
{
    char *text;
    size_t len;
    PVX_TRY(pvx_file_read(path, FILE_MAX, &text, &len, d));
    pvx_err e = pvp_clients_parse(text, path, out, d);
    free(text);
    return e;
}

/* ---- writing ---- */

static pvx_err write_new(const char *path, mode_t mode, const char *text, struct pvx_diag *d)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
    if (fd < 0 && errno == EEXIST)
        return pvx_fail(d, PVX_EBUSY, "%s is there already and is not written over", path);
    size_t n = strlen(text);
    bool ok = fd >= 0 && write(fd, text, n) == (ssize_t)n && fsync(fd) == 0;
    int why = errno;
    if (fd >= 0 && (close(fd) != 0 || !ok))
        unlink(path);
    return ok ? PVX_OK : pvx_fail(d, pvx_err_from_errno(why), "%s: %s", path, strerror(why));
}

pvx_err pvp_key_write(const char *path, enum pvp_role role, const struct pvp_key_pair *k,
                      struct pvx_diag *d)
{
    const char *slash = strrchr(path, '/'), *name = slash != NULL ? slash + 1 : path;
    char secret[4096], open[4096], text[512];
    if (!is_name(name))
        return pvx_fail(d, PVX_EINVAL, "%s: a name has up to %d letters, digits, dots, @, - and _",
                        path, PVP_KEY_NAME - 1);
    if (snprintf(secret, sizeof secret, "%s.key", path) >= (int)sizeof secret)
        return pvx_fail(d, PVX_EINVAL, "%.100s...: too long a path", path);
    snprintf(open, sizeof open, "%s.pub", path);
    if (access(open, F_OK) == 0)
        return pvx_fail(d, PVX_EBUSY, "%s is there already and is not written over", open);
    snprintf(text, sizeof text,
             "# Key of %s for Pyrovox. It lets in whoever has it: show it to nobody.\n"
             "public %s\nsecret %s\n%s%s%s",
             name, k->public_key, k->secret_key, k->server[0] != '\0' ? "server " : "", k->server,
             k->server[0] != '\0' ? "\n" : "");
    pvx_err e = write_new(secret, 0600, text, d);
    explicit_bzero(text, sizeof text);
    if (e != PVX_OK)
        return e;
    snprintf(text, sizeof text, "%s %s %s\n", name, role_names[role], k->public_key);
    e = write_new(open, 0644, text, d);
    if (e != PVX_OK)
        unlink(secret);
    return e;
}
