/* Any bytes as key frames: refused in one line, or a way whose every camera is sound or refused in one line. */
#include <math.h>
#include <string.h>

#include "recon/view/key_frames.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const struct rec_key_frame base = {
        .look_at = {0, 0, 0.5}, .up = {0, 0, 1}, .fov_deg = 40};
    static struct rec_rig rig;
    struct rec_key_frames k;
    struct pvx_diag d = {""};
    if (rig.n_cameras == 0)
        MUST(rec_rig_ring(5, 2.2, 64, 48, 20, &rig) == PVX_OK);
    if (rec_key_frames_parse((const char *)data, size, "way.yaml", &base, &rig, &k, &d) != PVX_OK) {
        MUST(d.text[0] != '\0' && strchr(d.text, '\n') == NULL);
        MUST(k.key == NULL && k.n == 0);
        return 0;
    }
    fuzz_taken++;
    size_t n = rec_key_frames_pictures(&k, 100);
    MUST(n >= 1 && n <= REC_KEY_PICTURES_MAX + 1);
    for (size_t i = 0; i < n; i += 1 + n / 64) {
        struct rec_camera c;
        d.text[0] = '\0';
        if (rec_key_frames_camera(&k, i, 100, 64, 48, &c, &d) != PVX_OK) {
            MUST(d.text[0] != '\0' && strchr(d.text, '\n') == NULL);
            continue;
        }
        MUST(isfinite(c.fx) && c.fx > 0);
        for (int a = 0; a < 9; a++)
            MUST(fabs(c.R[a]) <= 1 + 1e-9);
        for (int a = 0; a < 3; a++)
            MUST(isfinite(c.t[a]));
    }
    rec_key_frames_fini(&k);
    return 0;
}
