/* keys.h - key pairs and lists of permitted clients: files of CURVE keys (Z85 text, as libzmq takes them).
 *
 *   NAME.key   public KEY, secret KEY, and for a client server KEY, a line each; mode 0600
 *   NAME.pub   NAME ROLE KEY, the line that goes into the list of permitted clients
 *   a list     such lines; ROLE is read or control, and control may read too
 * Empty lines, and lines that begin with # and a space, are ignored.
 * Threads: pure, except for the files. */
#ifndef PVP_KEYS_H
#define PVP_KEYS_H
#include <stddef.h>
#include "base/err.h"

#define PVP_KEY_TEXT    41 /* 40 characters and a 0 */
#define PVP_KEY_NAME    64 /* with the 0 */
#define PVP_CLIENTS_MAX 256

enum pvp_role { PVP_ROLE_NONE, PVP_ROLE_READ, PVP_ROLE_CONTROL };

struct pvp_key_pair {
    char public_key[PVP_KEY_TEXT], secret_key[PVP_KEY_TEXT];
    char server[PVP_KEY_TEXT]; /* public key of the daemon; "": not given */
};

struct pvp_client {
    char name[PVP_KEY_NAME], key[PVP_KEY_TEXT];
    enum pvp_role role;
};
struct pvp_client_list {
    size_t n;
    struct pvp_client client[PVP_CLIENTS_MAX];
};

/* A fresh pair by libzmq.  PVX_EUNSUP: libzmq was built without CURVE. */
PVX_MUST_CHECK pvx_err pvp_key_make(struct pvp_key_pair *out, struct pvx_diag *d);
/* PATH.key and PATH.pub; the name in the latter is PATH's last part.  No file is overwritten, and no half of a
 * pair is left.  PVX_EBUSY: one of them exists; PVX_EINVAL: that part is not a valid name. */
PVX_MUST_CHECK pvx_err pvp_key_write(const char *path, enum pvp_role role,
                                     const struct pvp_key_pair *k, struct pvx_diag *d);
/* A .key file.  PVX_EPERM: others may read it; below $CREDENTIALS_DIRECTORY the group may. */
PVX_MUST_CHECK pvx_err pvp_key_read(const char *path, struct pvp_key_pair *out, struct pvx_diag *d);
/* A list; a .pub file is a list of one line.  Errors: PVX_EFORMAT (line is named), PVX_EINVAL (a key twice),
 * PVX_ERANGE (too many). */
PVX_MUST_CHECK pvx_err pvp_clients_read(const char *path, struct pvp_client_list *out,
                                        struct pvx_diag *d);

/* The same from memory; `name`: name of the file in messages. */
PVX_MUST_CHECK pvx_err pvp_key_parse(char *text, const char *name, struct pvp_key_pair *out,
                                     struct pvx_diag *d);
PVX_MUST_CHECK pvx_err pvp_clients_parse(char *text, const char *name, struct pvp_client_list *out,
                                         struct pvx_diag *d);
#endif
