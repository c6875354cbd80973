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

#define CAP_CV_VERSION 5

struct cap_cv_image {
    void *data; /* malloc */
    size_t size;
    int32_t width, height, channels, depth;
};

struct cap_cv {
    int version; /* CAP_CV_VERSION */
    /* Bytes of an image file -> pixels as stored; alpha dropped, BGR turned to RGB. */
    int (*decode)(const void *bytes, size_t len, struct cap_cv_image *out, char *err,
                  size_t err_size) CAP_CV_NOEXCEPT;
    /* 8- or 16-bit grey or RGB -> bytes of a file of type ext (".png"). */
    int (*encode)(const char *ext, const struct cap_cv_image *img, void **out, size_t *len,
                  char *err, size_t err_size) CAP_CV_NOEXCEPT;
};

const struct cap_cv *cap_cv_module(void) CAP_CV_NOEXCEPT;

#ifdef __cplusplus
}
#endif
#endif
