/* Any bytes as a message, of any type; volumes are unpacked as a client would. */
#include <math.h>

#include "proto/fields.h"
#include "tests/fuzz/fuzz.h"

/* The same, brick by brick, where cells outside the grid must be numbers too. */
static void bricks(pvp_decoder *dec, const struct pvp_view *view, bool good)
{
    size_t count = (size_t)view->n_bricks * 512 * view->v.grid.channels;
    uint32_t *ids = calloc(view->n_bricks + 1, sizeof *ids);
    float *brick = malloc((count + 1) * sizeof *brick);
    MUST(ids != NULL && brick != NULL);
    bool all = pvp_volume_bricks(dec, view, ids, brick, count, NULL) == PVX_OK;
    MUST(good || !all);
    for (size_t i = 0; all && i < count; i++)
        MUST(isfinite(brick[i]));
    free(ids);
    free(brick);
}

static void volume(const uint8_t *data, size_t size)
{
    struct pvp_view view;
    pvp_decoder *dec;
    uint32_t doubt;
    if (pvp_decode_volume(data, size, &view, NULL) != PVX_OK &&
        pvp_decode_bars(data, size, &view, &doubt, NULL) != PVX_OK)
        return;
    size_t count = pvp_grid_count(&view.v.grid);
    if (count > 1 << 18 || pvp_decoder_new(&dec) != PVX_OK) /* a client's own limit */
        return;
    float *dense = malloc(count * sizeof *dense);
    struct pvx_diag d = {""};
    bool good = dense != NULL && pvp_volume_unpack(dec, &view, dense, count, &d) == PVX_OK;
    for (size_t i = 0; good && i < count; i++)
        MUST(isfinite(dense[i]));
    fuzz_taken += good;
    free(dense);
    bricks(dec, &view, good);
    pvp_decoder_free(&dec);
}

/* Every byte that it lends is the message's. */
static void preview(const uint8_t *data, size_t size)
{
    static struct pvp_preview p;
    volatile uint8_t sum = 0;
    if (pvp_decode_preview(data, size, &p, NULL) != PVX_OK)
        return;
    for (uint32_t c = 0; c < p.n_cameras; c++) {
        const struct pvp_preview_camera *k = &p.camera[c];
        size_t bits = (size_t)k->down * ((k->across + 7) / 8);
        MUST(k->width <= PVP_PREVIEW_SIDE && k->height <= PVP_PREVIEW_SIDE);
        for (size_t i = 0; i < k->jpeg_len; i++)
            sum = (uint8_t)(sum + k->jpeg[i]);
        for (size_t i = 0; i < bits; i++)
            sum = (uint8_t)(sum + k->lit_bits[i]);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct pvp_header h;
    struct pvp_start start;
    struct pvx_diag d = {""};
    const char *json;
    size_t json_len;
    uint64_t session;
    char reason[PVP_REASON_MAX];
    if (pvp_decode_header(data, size, &h, &d) != PVX_OK)
        return 0;
    fuzz_taken +=
        pvp_check(h.type, data, size) == PVX_OK; /* a type that is new is tried here too */
    MUST(pvp_decode_start(data, size, &start, NULL) != PVX_OK || h.type == PVP_START);
    MUST(pvp_decode_status(data, size, &json, &json_len, NULL) != PVX_OK || json_len <= size);
    MUST(pvp_decode_event(data, size, &json, &json_len, NULL) != PVX_OK ||
         json_len <= PVP_EVENT_MAX);
    if (pvp_decode_rig(data, size, &session, &json, &json_len, NULL) == PVX_OK)
        MUST((const uint8_t *)json >= data && json_len <= size &&
             (const uint8_t *)json + json_len <= data + size);
    preview(data, size);
    MUST(pvp_decode_end(data, size, &session, reason, NULL) != PVX_OK || h.type == PVP_END);
    volume(data, size);
    return 0;
}
