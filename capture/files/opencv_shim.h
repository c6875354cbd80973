/* opencv_shim.h - the OpenCV module (lib/pyrovox/pyrovox-opencv.so) as plain C.
 *
 * The module is C++.  imgio.c loads it with dlopen on first use.  It exports one function, cap_cv_module, and no
 * exception leaves it.  Every entry returns a pvx_err value as int, and puts a line into `err` when that is not 0.
 * Buffers that it returns are from malloc.
 * Images: rows without padding, channel innermost, RGB order; depth 8, 16 (unsigned) or 32 (float). */
#ifndef CAP_OPENCV_SHIM_H
#define CAP_OPENCV_SHIM_H
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#define CAP_CV_NOEXCEPT noexcept
#else
#define CAP_CV_NOEXCEPT
#endif

#define CAP_CV_VERSION 4

struct cap_cv_image {
    void *data; /* malloc */
    size_t size;
    int32_t width, height, channels, depth;
};

struct cap_cv_video; /* opaque */
struct cap_cv_apng;

/* Pictures of 1 or 3 channels of 8 bits into the bytes of an animated PNG of fps pictures a second, in memory (at
 * most 2 GB).  end returns the bytes and frees, also on failure; drop frees. */
struct cap_cv_apng_ops {
    int (*begin)(int32_t width, int32_t height, int32_t channels, int32_t fps,
                 struct cap_cv_apng **out, char *err, size_t err_size) CAP_CV_NOEXCEPT;
    int (*add)(struct cap_cv_apng *a, const void *pixels, char *err,
               size_t err_size) CAP_CV_NOEXCEPT;
    int (*end)(struct cap_cv_apng *a, void **out, size_t *len, char *err,
               size_t err_size) CAP_CV_NOEXCEPT;
    void (*drop)(struct cap_cv_apng *a) CAP_CV_NOEXCEPT;
};
extern const struct cap_cv_apng_ops cap_cv_apng_ops; /* inside the module */

struct cap_cv {
    int version; /* CAP_CV_VERSION */
    /* Bytes of an image file -> pixels as stored; alpha dropped, BGR turned to RGB. */
    int (*decode)(const void *bytes, size_t len, struct cap_cv_image *out, char *err,
                  size_t err_size) CAP_CV_NOEXCEPT;
    /* 8- or 16-bit grey or RGB -> bytes of a file of type ext (".png"). */
    int (*encode)(const char *ext, const struct cap_cv_image *img, void **out, size_t *len,
                  char *err, size_t err_size) CAP_CV_NOEXCEPT;
    /* size: width and height that the file declares. */
    int (*video_open)(const char *path, struct cap_cv_video **out, double *fps, int32_t size[2],
                      char *err, size_t err_size) CAP_CV_NOEXCEPT;
    /* RGB8; data is borrowed until the next call.  borrowed NULL: skip the frame.  PVX_ECLOSED at the end. */
    int (*video_next)(struct cap_cv_video *v, struct cap_cv_image *borrowed, char *err,
                      size_t err_size) CAP_CV_NOEXCEPT;
    void (*video_close)(struct cap_cv_video *v) CAP_CV_NOEXCEPT;
    const struct cap_cv_apng_ops *apng;
};

const struct cap_cv *cap_cv_module(void) CAP_CV_NOEXCEPT;

#ifdef __cplusplus
}
#endif
#endif
