/* The brightest voxel of every volume of a daemon.
 *
 *     cc example.c $(pkg-config --cflags --libs pyrovox-client) -o example
 *     ./example ipc:///run/pyrovox/volumes */
#include <proto/clients/sub.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv)
{
    struct pvx_diag why = {""};
    struct pvp_header h;
    struct pvp_view v;
    pvp_sub *sub = NULL;
    pvp_decoder *dec = NULL;
    const void *msg;
    size_t len, n = 0;
    float *dense = NULL;
    pvx_err e = pvp_sub_new(argc > 1 ? argv[1] : "ipc:///run/pyrovox/volumes", NULL, &sub, &why);
    PVX_THEN(e, pvp_decoder_new(&dec));
    while (e == PVX_OK && (e = pvp_sub_next(sub, -1, &h, &msg, &len, &why)) == PVX_OK &&
           h.type != PVP_END) {
        if (h.type == PVP_START) { /* room for every volume of this session */
            n = pvp_grid_count(&pvp_sub_start(sub)->grid);
            free(dense);
            dense = malloc(n * sizeof *dense);
        } else if (h.type == PVP_VOLUME && dense != NULL &&
                   (e = pvp_decode_volume(msg, len, &v, &why)) == PVX_OK &&
                   (e = pvp_volume_unpack(dec, &v, dense, n, &why)) == PVX_OK) {
            size_t best = 0;
            for (size_t i = 0; i < n; i++)
                best = dense[i] > dense[best] ? i : best;
            printf("set %llu: %g at %zu\n", (unsigned long long)v.v.set, dense[best], best);
        }
    }
    if (e != PVX_OK)
        fprintf(stderr, "%s\n", pvx_diag_text(&why, e));
    free(dense);
    pvp_decoder_free(&dec);
    pvp_sub_free(&sub);
    return e != PVX_OK;
}
