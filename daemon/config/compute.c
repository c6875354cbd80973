#include "daemon/config/compute.h"

#include <string.h>

bool dmn_compute_parse(const char *word, enum dmn_compute_where *where, const char **name)
{
    static const char opencl[] = "opencl";
    const size_t n = sizeof opencl - 1;
    *name = "";
    if (strcmp(word, "cpu") == 0) {
        *where = DMN_COMPUTE_CPU;
    } else if (strcmp(word, "auto") == 0) {
        *where = DMN_COMPUTE_AUTO;
    } else if (strncmp(word, opencl, n) == 0 && (word[n] == '\0' || word[n] == ':')) {
        *where = DMN_COMPUTE_OPENCL;
        *name = word[n] == ':' ? word + n + 1 : "";
        return word[n] == '\0' || (*name)[0] != '\0';
    } else {
        return false;
    }
    return true;
}

pvx_err dmn_compute_allowed(const char *what, const char *word, const char *refused,
                            struct pvx_diag *d)
{
    enum dmn_compute_where where;
    const char *name;
    if (!dmn_compute_parse(word, &where, &name))
        return pvx_fail(d, PVX_EINVAL, "%s: '%.40s' is not one of " DMN_COMPUTE_WORDS, what, word);
    if (where == DMN_COMPUTE_OPENCL && refused != NULL)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: %s: only the processors can do this: %s; say cpu or auto, or leave it "
                        "out",
                        what, word, refused);
    return PVX_OK;
}
