/* fuzz_config.c - any bytes as pyrovoxd.yaml: refused with a message, or read and printed back to
 * the same configuration. */
#include <string.h>

#include "daemon/config/config.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct dmn_config a, b;
    struct pvx_diag d = {0};
    if (dmn_config_parse((const char *)data, size, "fuzz", &a, &d) != PVX_OK) {
        MUST(d.text[0] != '\0');
        return 0;
    }
    fuzz_taken++;
    char *text = dmn_config_format(&a);
    MUST(text != NULL && dmn_config_parse(text, strlen(text), "again", &b, &d) == PVX_OK);
    char *again = dmn_config_format(&b);
    MUST(again != NULL && strcmp(text, again) == 0);
    char uri[DMN_WORD_MAX];
    for (size_t i = 0; i < 3; i++)
        if (dmn_config_source(&a, "cam0", i, uri, sizeof uri, &d) == PVX_OK &&
            memchr(uri, '\0', sizeof uri) == NULL)
            abort();
    struct rec_frame_params p;
    dmn_config_frame(&a, &p);
    MUST(dmn_config_deadline(&a) >= 0);
    free(again);
    free(text);
    return 0;
}
