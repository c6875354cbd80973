#include "capture/files/opencv_shim.h"

#include <cstdlib>
#include <cstring>
#include <memory>

#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "capture/source/guarded.hpp"

namespace
{

/* Uses the text of OpenCV's own exceptions, which says better what failed. */
template <typename F> int in_opencv(char *err, size_t err_size, F f) noexcept
{
    return guarded(err, err_size, [&]() -> int {
        try {
            return f();
        } catch (const cv::Exception &e) {
            return e.code == cv::Error::StsNoMem ? fail(PVX_ENOMEM, err, err_size, "out of memory")
                                                 : fail(PVX_EFORMAT, err, err_size, e.err);
        }
    });
}

struct freed {
    void operator()(void *p) const
    {
        free(p);
    }
};

/* Grey, BGR or BGRA -> grey or RGB, without another copy if `out` has that shape already. */
void to_rgb(const cv::Mat &in, cv::Mat &out)
{
    switch (in.channels()) {
    case 3: cv::cvtColor(in, out, cv::COLOR_BGR2RGB); break;
    case 4: cv::cvtColor(in, out, cv::COLOR_BGRA2RGB); break;
    default: in.copyTo(out);
    }
}

int decode(const void *bytes, size_t len, struct cap_cv_image *out, char *err,
           size_t err_size) noexcept
{
    return in_opencv(err, err_size, [&]() -> int {
        *out = {};
        if (len > INT32_MAX)
            return fail(PVX_ERANGE, err, err_size, "larger than 2 GiB");
        const cv::Mat raw(1, static_cast<int>(len), CV_8UC1, const_cast<void *>(bytes));
        cv::Mat img = cv::imdecode(raw, cv::IMREAD_UNCHANGED);
        if (img.empty())
            return fail(PVX_EFORMAT, err, err_size,
                        "not an image that OpenCV can read, or damaged");
        if (img.depth() == CV_64F)
            img.convertTo(img, CV_32F);
        int depth = img.depth() == CV_8U ? 8 : img.depth() == CV_16U ? 16 : 32;
        if (depth == 32 && img.depth() != CV_32F)
            return fail(PVX_EUNSUP, err, err_size,
                        "pixels are neither 8 or 16 bit unsigned nor float");
        if (img.channels() == 2 || img.channels() > 4)
            return fail(PVX_EUNSUP, err, err_size, "has neither 1 nor 3 channels (and alpha)");
        int channels = img.channels() == 1 ? 1 : 3;
        size_t size = img.total() * img.elemSize1() * static_cast<size_t>(channels);
        std::unique_ptr<void, freed> data(malloc(size));
        if (data == nullptr)
            return fail(PVX_ENOMEM, err, err_size, "out of memory");
        cv::Mat rgb(img.rows, img.cols, CV_MAKETYPE(img.depth(), channels), data.get());
        to_rgb(img, rgb);
        *out = {data.release(), size, img.cols, img.rows, channels, depth};
        return PVX_OK;
    });
}

int encode(const char *ext, const struct cap_cv_image *img, void **out, size_t *len, char *err,
           size_t err_size) noexcept
{
    return in_opencv(err, err_size, [&]() -> int {
        *out = nullptr;
        int type = CV_MAKETYPE(img->depth == 16 ? CV_16U : CV_8U, img->channels);
        const cv::Mat rgb(img->height, img->width, type, img->data);
        cv::Mat bgr;
        if (img->channels == 3)
            cv::cvtColor(rgb, bgr, cv::COLOR_RGB2BGR);
        else
            bgr = rgb;
        std::vector<uchar> bytes;
        if (!cv::imencode(ext, bgr, bytes))
            return fail(PVX_EIO, err, err_size, "OpenCV could not encode the image");
        *out = malloc(bytes.size());
        if (*out == nullptr)
            return fail(PVX_ENOMEM, err, err_size, "out of memory");
        memcpy(*out, bytes.data(), bytes.size());
        *len = bytes.size();
        return PVX_OK;
    });
}

const struct cap_cv module = {CAP_CV_VERSION, decode, encode};

} // namespace

const struct cap_cv *cap_cv_module(void) noexcept
{
    char err[16];
    (void)in_opencv(err, sizeof err, [&]() -> int { /* errors are returned, not printed */
                                                    cv::utils::logging::setLogLevel(
                                                        cv::utils::logging::LOG_LEVEL_SILENT);
                                                    return PVX_OK;
    });
    return &module;
}
