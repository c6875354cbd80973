/* fuzz_config.c - any bytes as pyrovoxd.yaml: refused with a message, or read and printed back to
 * the same configuration. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/config/config.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct dmn_config a, b;
    struct pvx_diag d = {0};
    if (dmn_config_parse((const char *)data, size, "fuzz", &a, &d) != PVX_OK) {
        if (d.text[0] == '\0')
            abort();
        return 0;
    }
    char *text = dmn_config_format(&a);
    if (text == NULL || dmn_config_parse(text, strlen(text), "again", &b, &d) != PVX_OK)
        abort();
    char *again = dmn_config_format(&b);
    if (again == NULL || strcmp(text, again) != 0)
        abort();
    char uri[DMN_WORD_MAX];
    for (size_t i = 0; i < 3; i++)
        if (dmn_config_source(&a, "cam0", i, uri, sizeof uri, &d) == PVX_OK &&
            memchr(uri, '\0', sizeof uri) == NULL)
            abort();
    struct rec_frame_params p;
    dmn_config_frame(&a, &p);
    if (dmn_config_deadline(&a) < 0)
        abort();
    free(again);
    free(text);
    return 0;
}
