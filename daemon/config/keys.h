/* keys.h - the daemon's keys, from the places in the configuration.
 *
 * keys.server and keys.clients are files, or "credential:NAME": what systemd gives to the service alone
 * (LoadCredential=), a file in $CREDENTIALS_DIRECTORY. */
#ifndef DMN_KEYS_H
#define DMN_KEYS_H
#include <stdbool.h>

#include "daemon/config/config.h"
#include "proto/auth.h"

/* *out stays what it is where there are no keys.  Errors: those of pvp_auth_new; PVX_ENOENT: no such credential. */
PVX_MUST_CHECK pvx_err dmn_keys_open(const struct dmn_config *cfg, pvp_auth **out,
                                     struct pvx_diag *d);
/* The key is a credential, and this process is given none: a check by hand. */
bool dmn_keys_hidden(const struct dmn_config *cfg);
#endif
