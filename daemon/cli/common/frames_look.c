/* frames_look.c - what kind of pictures the cameras have: some of each are looked at before the first set is read. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/frames_in_impl.h"

#define LOOKS 8 /* sets, spread over the recording */

/* What pictures of a camera showed of it. */
struct frames_in_seen {
    enum cap_pixfmt fmt;     /* NONE: no picture could be read */
    enum cap_transfer curve; /* of the first picture */
    size_t equal, different; /* pixels whose three samples are alike, and not */
    pvx_err e;               /* of the last one */
};

/* A sample as a number; full: its full scale, 0 for floats. */
static double frames_in_sample(const struct cap_image *img, int32_t x, int32_t y, int s,
                               double *full)
{
    const char *at = (const char *)img->data + y * img->stride;
    size_t i = (size_t)x * 3 + (size_t)s;
    uint16_t word;
    float f;
    if (cap_pixfmt_layout(img->fmt) == CAP_LAYOUT_8) {
        *full = 255;
        return (uint8_t)at[i];
    }
    if (cap_pixfmt_layout(img->fmt) == CAP_LAYOUT_16) {
        *full = 65535;
        memcpy(&word, at + i * sizeof word, sizeof word);
        return word;
    }
    *full = 0;
    memcpy(&f, at + i * sizeof f, sizeof f);
    return (double)f;
}

/* Count the pixels of a picture with three samples.  Black, white and what repeats its neighbour say nothing: a dark
 * picture of a colour camera has three equal samples too. */
static void frames_in_compare(const struct cap_image *img, struct frames_in_seen *s)
{
    for (int32_t y = 0; y < img->height; y += 1 + img->height / 256)
        for (int32_t x = 1; x < img->width; x++) {
            double full, v[3];
            for (int k = 0; k < 3; k++)
                v[k] = frames_in_sample(img, x, y, k, &full);
            bool same = v[0] == v[1] && v[1] == v[2];
            s->different += !same;
            s->equal += same && v[0] != 0 && v[0] != full &&
                        v[0] != frames_in_sample(img, x - 1, y, 0, &full);
        }
}

/* Note a picture.  Returns whether more pictures of this camera can say more. */
static bool frames_in_note(const struct cap_image *img, struct frames_in_seen *s,
                           struct cap_depth *depth)
{
    enum cap_layout l = cap_pixfmt_layout(img->fmt);
    bool words = cap_pixfmt_depth(img->fmt) == 16;
    bool three = cap_pixfmt_channels(img->fmt) == 3 && cap_pixfmt_bayer(img->fmt) == NULL &&
                 (l == CAP_LAYOUT_8 || l == CAP_LAYOUT_16 || l == CAP_LAYOUT_F32);
    s->curve = s->fmt == CAP_FMT_NONE ? cap_transfer_declared(img) : s->curve;
    s->fmt = s->fmt == CAP_FMT_NONE ? img->fmt : s->fmt;
    if (three)
        frames_in_compare(img, s);
    if (words)
        cap_depth_look(depth, img, 0, img->height, 1);
    return words || (three && s->different == 0);
}

/* Look at some of camera c's pictures, at least one that can be read. */
static void look_piece(void *ctx, size_t c)
{
    struct frames_in *f = ctx;
    struct frames_in_seen *s = &f->seen[c];
    size_t have = 0, k = 0;
    bool more = true;
    f->why[c].text[0] = '\0';
    for (size_t i = 0; i < f->n; i++)
        have += frames_in_there(f, i, c);
    for (size_t i = 0; i < f->n && more && !cli_stop; i++) {
        struct cap_loaded l;
        struct pvx_diag why = {""};
        if (!frames_in_there(f, i, c))
            continue;
        size_t parts = have > LOOKS ? have - 1 : 1;
        bool chosen = have <= LOOKS || k * (LOOKS - 1) % parts < LOOKS - 1;
        if (f->reel != NULL && f->reel[c].kind == CAP_REEL_FILM) /* read in order */
            chosen = k < LOOKS;
        k++;
        if (!chosen && s->fmt != CAP_FMT_NONE)
            continue;
        s->e = frames_in_load_one(f, frames_in_set_of(f, i), c, &l, &why);
        if (s->e != PVX_OK) {
            f->why[c] = f->why[c].text[0] == '\0' ? why : f->why[c];
            continue;
        }
        more = frames_in_note(&l.img, s, &f->depth[c]);
        cap_loaded_free(&l);
    }
}

/* Names of the cameras whose pictures are of that kind: 1 grey, 2 with colour, 3 grey in three samples. */
static int frames_in_kind(const struct frames_in_seen *s)
{
    bool grey = s->equal >= 64 && s->different == 0;
    return s->fmt == CAP_FMT_NONE ? 0 : cap_pixfmt_channels(s->fmt) == 1 ? 1 : grey ? 3 : 2;
}
static const char *frames_in_names(const struct frames_in *f, const struct frames_in_seen *seen,
                                   int kind, char *out, size_t size)
{
    out[0] = '\0';
    for (size_t c = 0; c < f->rig->n_cameras; c++)
        if (frames_in_kind(&seen[c]) == kind && strlen(out) + REC_NAME_MAX < size)
            snprintf(out + strlen(out), size - strlen(out), "%s%s", out[0] == '\0' ? "" : ", ",
                     f->rig->cameras[c].name);
    return out;
}

static pvx_err frames_in_two_kinds(const struct frames_in *f, const struct frames_in_seen *seen,
                                   int grey, struct pvx_diag *d)
{
    char a[200], b[200];
    return pvx_fail(d, PVX_EINVAL,
                    "%s: the pictures of %s are grey%s, those of %s have colour: solve one channel "
                    "from all (reconstruct --grey), or leave one kind out (--cameras A,B,...)",
                    f->dir, frames_in_names(f, seen, grey, a, sizeof a),
                    grey == 3 ? " (three equal samples in a pixel)" : "",
                    frames_in_names(f, seen, 2, b, sizeof b));
}

/* Say where a sample of one camera is another light than that of another: sRGB or floats beside linear integers. */
static void frames_in_say_scales(const struct frames_in *f, const struct frames_in_seen *seen)
{
    const char *coded = NULL, *linear = NULL, *floats = NULL, *whole = NULL;
    for (size_t c = 0; c < f->rig->n_cameras; c++) {
        const char *name = f->rig->cameras[c].name;
        if (seen[c].fmt == CAP_FMT_NONE)
            continue;
        *(seen[c].curve == CAP_TRANSFER_LINEAR ? &linear : &coded) = name;
        *(cap_pixfmt_layout(seen[c].fmt) == CAP_LAYOUT_F32 ? &floats : &whole) = name;
    }
    if (coded != NULL && linear != NULL && f->how.transfer == CAP_TRANSFER_AUTO)
        fprintf(stderr,
                "pyrovox: %s: samples of %s are decoded (JPEG, and films that name a transfer "
                "function), those of %s are taken as light; if all cameras code alike, say "
                "--transfer srgb or linear\n",
                f->dir, coded, linear);
    if (floats != NULL && whole != NULL)
        fprintf(
            stderr,
            "pyrovox: %s: samples of %s are floats, taken as they are, those of %s are integers, "
            "where 1.0 is full scale; they must have one unit\n",
            f->dir, floats, whole);
}

pvx_err frames_in_look(struct frames_in *f, struct pvx_diag *d)
{
    struct frames_in_seen seen[REC_MAX_CAMERAS] = {0};
    bool has[4] = {false};
    size_t bad = REC_MAX_CAMERAS;
    f->seen = seen;
    pvx_pool_run(f->pool, f->rig->n_cameras, look_piece, f);
    f->seen = NULL;
    for (int bits = 10; bits < 16; bits++) {
        uint64_t which = 0;
        enum cap_pixfmt fmt = CAP_FMT_NONE;
        for (size_t c = 0; c < f->rig->n_cameras; c++)
            if (cap_depth_bits(&f->depth[c], 1) == bits) {
                which |= 1ull << c;
                fmt = seen[c].fmt;
            }
        if (which != 0)
            frames_in_say_bits(f, which, bits, fmt);
    }
    for (size_t c = 0; c < f->rig->n_cameras; c++) {
        enum cap_pixfmt fmt = seen[c].fmt;
        bad = bad == REC_MAX_CAMERAS && f->why[c].text[0] != '\0' ? c : bad;
        has[frames_in_kind(&seen[c])] = true;
        if (f->black > 1 && fmt != CAP_FMT_NONE && cap_pixfmt_layout(fmt) != CAP_LAYOUT_F32)
            return pvx_fail(d, PVX_EINVAL,
                            "--black %g: should be 0 to 1, a share of full scale, for the %s "
                            "pictures of %s",
                            f->black, cap_pixfmt_name(fmt), f->rig->cameras[c].name);
    }
    frames_in_say_scales(f, seen);
    if (!has[1] && !has[2] && !has[3])
        return bad == REC_MAX_CAMERAS ? PVX_ECANCELED
                                      : pvx_fail(d, seen[bad].e, "%s", f->why[bad].text);
    f->nch = f->kinds == FRAMES_IN_GREY || !(has[2] || has[3]) ? 1 : 3;
    f->grey = 0;
    for (size_t c = 0; c < f->rig->n_cameras && has[2]; c++)
        f->grey |= (uint64_t)(frames_in_kind(&seen[c]) % 2) << c; /* 1 or 3 */
    if (f->kinds == FRAMES_IN_SAME && f->grey != 0)
        return frames_in_two_kinds(f, seen, has[1] ? 1 : 3, d);
    if (f->kinds == FRAMES_IN_SAME && has[1] && has[3])
        f->kinds = FRAMES_IN_EACH; /* all are grey */
    return PVX_OK;
}
