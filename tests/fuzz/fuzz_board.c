/* Any text as a board: refused with a message, or a board that is sound and reads back the same. */
#include <math.h>
#include <string.h>

#include "recon/board/spec.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char text[512], said[REC_BOARD_TEXT], again[REC_BOARD_TEXT];
    struct rec_board b, c;
    struct pvx_diag d = {""};
    if (size >= sizeof text)
        return 0;
    memcpy(text, data, size);
    text[size] = '\0';
    if (rec_board_parse(text, &b, &d) != PVX_OK) {
        MUST(d.text[0] != '\0' && strchr(d.text, '\n') == NULL);
        MUST(b.cols == 0);
        return 0;
    }
    fuzz_taken++;
    rec_board_text(&b, said);
    MUST(rec_board_parse(said, &c, &d) == PVX_OK);
    rec_board_text(&c, again);
    MUST(strcmp(said, again) == 0);
    MUST(rec_board_corners(&b) > 0);
    double p[3];
    rec_board_point(&b, REC_BACK, rec_board_corners(&b) - 1, p);
    MUST(p[0] > 0 && p[1] > 0 && p[0] < 2 * REC_BOARD_MAX * 10 && isfinite(p[2]));
    return 0;
}
