/* fuzz_films.c - any bytes as a film in a file: refused with a line that names the file, or read: pictures of one size and
 * format at times that ascend, and that cap_video_times gives, too. */
#include <stdbool.h>

#include "capture/files/imgio.h"
#include "tests/fuzz/input_file.h"

#define SIDE_MAX 16384
#define FRAMES   8
#define FAR      (INT64_MAX / 4) /* times, so that others may subtract them */

static void check(const struct cap_image *img, const struct cap_video_info *info)
{
    MUST(img->width >= 1 && img->width <= SIDE_MAX && img->height >= 1 && img->height <= SIDE_MAX);
    MUST(img->stride == (ptrdiff_t)cap_pixfmt_row(img->fmt, img->width));
    MUST(img->size == (size_t)img->stride * (size_t)img->height);
    MUST(img->fmt == info->fmt && img->width == info->width && img->height == info->height);
    unsigned sum = 0;
    for (size_t i = 0; i < img->size; i++)
        sum += ((const uint8_t *)img->data)[i];
    static volatile unsigned keep;
    keep = sum;
    (void)keep;
}

/* Where time t is, from place k on; damaged films leave frames out. */
static size_t find(const int64_t *times, size_t n, size_t k, int64_t t)
{
    while (k < n && times[k] < t)
        k++;
    MUST(k < n && times[k] == t);
    return k;
}

/* The first frames; the second is skipped. */
static void frames(cap_video *v, const struct cap_video_info *info, const int64_t *times, size_t n)
{
    struct pvx_diag d = {""};
    pvx_err e = PVX_OK;
    for (size_t k = 0, at = 0; k < FRAMES; k++) {
        struct cap_image img;
        int64_t t;
        if ((e = cap_video_next(v, k == 1 ? NULL : &img, &t, &d)) != PVX_OK) {
            MUST(e != PVX_ECLOSED || times == NULL || k == n);
            break;
        }
        if (times != NULL)
            at = find(times, n, at, t) + 1;
        if (k != 1)
            check(&img, info);
        fuzz_taken++;
    }
    if (e != PVX_OK && e != PVX_ECLOSED)
        input_refused(e, &d);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    input_write("film.avi", data, size);
    struct pvx_diag d = {""};
    struct cap_video_info info;
    cap_video *v;
    int64_t *times;
    size_t n;
    pvx_err e = cap_video_times(input_file, &times, &n, &d);
    if (e != PVX_OK) {
        MUST(times == NULL && n == 0);
        input_refused(e, &d);
    }
    for (size_t i = 0; i < n; i++)
        MUST(times[i] >= -FAR && times[i] <= FAR && (i == 0 || times[i] > times[i - 1]));
    e = cap_video_open(input_file, &v, &info, &d);
    if (e == PVX_OK) {
        MUST(info.fps >= 0 && info.fps < 1e6);
        frames(v, &info, times, n);
        cap_video_close(&v);
    } else {
        MUST(v == NULL);
        input_refused(e, &d);
    }
    free(times);
    return 0;
}
