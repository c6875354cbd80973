/* imgio.h - images and arrays in files: TIFF by libtiff (a module that is loaded on first use), PNG by libpng, JPEG by
 * libjpeg-turbo, films and animated PNG through FFmpeg, .npy here.  README.md lists what a file may say of its samples.
 * Samples are linear, except those of JPEG files, which are gamma-coded (img.yuv).
 * Ownership: the caller owns cap_loaded and frees it with cap_loaded_free. */
#ifndef CAP_IMGIO_H
#define CAP_IMGIO_H
#include "base/err.h"
#include "capture/pixel/image.h"

struct cap_loaded {
    struct cap_image img;
    void *mem;
};

/* By extension .npy .png .tif .tiff .jpg .jpeg.  .npy: [h][w] or [h][w][1|3], little-endian f4, u1, u2, f8
 * (narrowed), C order.  For the others the bytes decide the type.  They have at most 16384 pixels each way, and no
 * more pixels for the size of the file than picture.h allows.  Waits for the writer of a named pipe
 * (pvx_file_await).  Errors name the file and the reason. */
PVX_MUST_CHECK pvx_err cap_image_load(const char *path, struct cap_loaded *out, struct pvx_diag *d);
/* How many pictures the file holds: the pages of a TIFF file (tiff.h), else 1.  Does not read a named pipe.
 * cap_image_load refuses a file of several. */
PVX_MUST_CHECK pvx_err cap_image_pages(const char *path, uint32_t *pages, struct pvx_diag *d);
/* Page 0 is the first.  PVX_ERANGE: there is no such page. */
PVX_MUST_CHECK pvx_err cap_image_load_page(const char *path, uint32_t page, struct cap_loaded *out,
                                           struct pvx_diag *d);
void cap_loaded_free(struct cap_loaded *l);

/* .png (8-bit, linear, values clipped to 0..1) or .npy float32. */
PVX_MUST_CHECK pvx_err cap_image_save(const char *path, const float *pix, int32_t w, int32_t h,
                                      int nch, struct pvx_diag *d);

/* Writes samples without loss to .png: 8 or 16 bits (uint8_t, uint16_t), 1 channel or RGB, tightly packed; atomic
 * write. */
PVX_MUST_CHECK pvx_err cap_image_write(const char *path, const void *samples, int32_t w, int32_t h,
                                       int nch, int depth, struct pvx_diag *d);

/* n-dimensional float32 .npy, C order. ndim 1..4; atomic write. */
PVX_MUST_CHECK pvx_err cap_npy_save(const char *path, const float *data, const size_t *shape,
                                    int ndim, struct pvx_diag *d);
/* Any supported dtype to float32; owner: caller, free(). shape[4], unused = 1. */
PVX_MUST_CHECK pvx_err cap_npy_load(const char *path, float **data, size_t shape[4], int *ndim,
                                    struct pvx_diag *d);
/* The same on bytes in memory (fuzzed). */
PVX_MUST_CHECK pvx_err cap_npy_parse(const void *bytes, size_t len, const char *name, float **data,
                                     size_t shape[4], int *ndim, struct pvx_diag *d);

/* Films, frame by frame: MP4, MOV, Matroska, AVI, animated PNG, at most 16384 pixels each way.  The pictures have all
 * bits of the film, turned as it says.  README.md has what is obeyed and what is refused. */
typedef struct cap_video cap_video;
struct cap_video_info {
    int32_t width, height; /* turned */
    enum cap_pixfmt fmt;   /* grey or RGB of 8 or 16 bits or float */
    double fps;            /* the mean rate; 0: not known */
};
/* The first frame is decoded, so most that is refused is refused here.  info may be NULL. */
PVX_MUST_CHECK pvx_err cap_video_open(const char *path, cap_video **out,
                                      struct cap_video_info *info, struct pvx_diag *d);
/* PVX_ECLOSED at the end.  img is borrowed until the next call; NULL: skip the frame.  All have the size and the format
 * of the first.  t_ns (or NULL): its time of presentation from the film's own zero, which may lie before its first
 * frame.  Times ascend.  PVX_ECORRUPT: this frame is damaged or missing, and the film ends. */
PVX_MUST_CHECK pvx_err cap_video_next(cap_video *v, struct cap_image *img, int64_t *t_ns,
                                      struct pvx_diag *d);
/* The times of all frames, ascending, as cap_video_next gives them; nothing is decoded.  *n >= 1.  Owner: caller,
 * free(). */
PVX_MUST_CHECK pvx_err cap_video_times(const char *path, int64_t **t_ns, size_t *n,
                                       struct pvx_diag *d);
void cap_video_close(cap_video **v);
#endif
