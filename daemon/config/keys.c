#include "daemon/config/keys.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define CREDENTIAL "credential:"

static const char *credential(const char *value)
{
    size_t n = strlen(CREDENTIAL);
    return strncmp(value, CREDENTIAL, n) == 0 ? value + n : NULL;
}

bool dmn_keys_hidden(const struct dmn_config *cfg)
{
    return credential(cfg->key_server) != NULL && getenv("CREDENTIALS_DIRECTORY") == NULL;
}

static pvx_err key_path(const struct dmn_config *cfg, const char *key, const char *value, char *out,
                        size_t size, struct pvx_diag *d)
{
    const char *name = credential(value);
    const char *dir = getenv("CREDENTIALS_DIRECTORY");
    if (name == NULL) {
        dmn_config_path(cfg, value, out, size);
        return PVX_OK;
    }
    if (name[0] == '\0' || strchr(name, '/') != NULL)
        return pvx_fail(d, PVX_EINVAL, "%s: %s: %s: should be " CREDENTIAL "NAME", cfg->name, key,
                        value);
    snprintf(out, size, "%s/%s", dir != NULL ? dir : "", name);
    if (dir == NULL || access(out, F_OK) != 0)
        return pvx_fail(d, PVX_ENOENT,
                        "%s: %s: systemd gives no credential %s: LoadCredential=%s:FILE in the "
                        "unit (systemctl edit pyrovoxd) does, systemd/README.md more",
                        cfg->name, key, name, name);
    return PVX_OK;
}

pvx_err dmn_keys_open(const struct dmn_config *cfg, pvp_auth **out, struct pvx_diag *d)
{
    char server[PATH_MAX], clients[PATH_MAX];
    if (cfg->key_server[0] == '\0')
        return PVX_OK;
    PVX_TRY(key_path(cfg, "keys.server", cfg->key_server, server, sizeof server, d));
    PVX_TRY(key_path(cfg, "keys.clients", cfg->key_clients, clients, sizeof clients, d));
    return pvp_auth_new(server, clients, out, d);
}
