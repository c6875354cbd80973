/* keys.h - the daemon's keys, from the places in the configuration.
 *
 * keys.server and keys.clients are files, or "credential:NAME": a file in $CREDENTIALS_DIRECTORY, which systemd gives
 * to the service alone (LoadCredential=). */
#ifndef DMN_KEYS_H
#define DMN_KEYS_H
#include <stdbool.h>

#include "daemon/config/config.h"
#include "proto/auth.h"

/* Without keys *out is left unchanged.  Errors: those of pvp_auth_new; PVX_ENOENT: no such credential. */
PVX_MUST_CHECK pvx_err dmn_keys_open(const struct dmn_config *cfg, pvp_auth **out,
                                     struct pvx_diag *d);
/* Whether the key is a credential, but this process is given none, as in a check by hand. */
bool dmn_keys_hidden(const struct dmn_config *cfg);
#endif
