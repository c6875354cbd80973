/* Any text as a key file and as a list of clients: what is taken has whole keys and names, and no key twice. */
#include <string.h>

#include "proto/keys.h"
#include "tests/fuzz/fuzz.h"

static void whole(const char key[PVP_KEY_TEXT])
{
    if (memchr(key, 0, PVP_KEY_TEXT) != key + PVP_KEY_TEXT - 1)
        abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct pvp_client_list l;
    struct pvp_key_pair k;
    struct pvx_diag d = {""};
    char *text = malloc(size + 1);
    if (text == NULL)
        return 0;
    memcpy(text, data, size);
    text[size] = 0;
    if (pvp_key_parse(text, "fuzz", &k, &d) == PVX_OK) {
        fuzz_taken++;
        whole(k.public_key);
        whole(k.secret_key);
    } else if (d.text[0] == 0)
        abort();
    memcpy(text, data, size);
    text[size] = 0;
    d.text[0] = 0;
    if (pvp_clients_parse(text, "fuzz", &l, &d) == PVX_OK) {
        for (size_t i = 0; i < l.n; i++) {
            whole(l.client[i].key);
            if (l.client[i].name[0] == 0 || memchr(l.client[i].name, 0, PVP_KEY_NAME) == NULL)
                abort();
            for (size_t j = 0; j < i; j++)
                if (strcmp(l.client[i].key, l.client[j].key) == 0)
                    abort();
        }
    } else if (d.text[0] == 0)
        abort();
    free(text);
    return 0;
}
