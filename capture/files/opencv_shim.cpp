#include "capture/files/opencv_shim.h"

#include <cstdlib>
#include <cstring>
#include <memory>

#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "capture/source/guarded.hpp"

struct cap_cv_video {
    cv::VideoCapture capture;
    cv::Mat frame, rgb;
};

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

int video_open(const char *path, struct cap_cv_video **out, double *fps, int32_t size[2], char *err,
               size_t err_size) noexcept
{
    return in_opencv(err, err_size, [&]() -> int {
        *out = nullptr;
        auto v = std::make_unique<cap_cv_video>();
        /* only backends for files: the others look for cameras */
        if (!v->capture.open(path, cv::CAP_FFMPEG) && !v->capture.open(path, cv::CAP_OPENCV_MJPEG))
            return fail(PVX_EFORMAT, err, err_size, "not a video that OpenCV can read");
        size[0] = static_cast<int32_t>(v->capture.get(cv::CAP_PROP_FRAME_WIDTH));
        size[1] = static_cast<int32_t>(v->capture.get(cv::CAP_PROP_FRAME_HEIGHT));
        double rate = v->capture.get(cv::CAP_PROP_FPS);
        if (fps != nullptr)
            *fps = rate > 0 && rate < 1e6 ? rate : 0;
        *out = v.release();
        return PVX_OK;
    });
}

int video_next(struct cap_cv_video *v, struct cap_cv_image *borrowed, char *err,
               size_t err_size) noexcept
{
    return in_opencv(err, err_size, [&]() -> int {
        if (!v->capture.grab())
            return PVX_ECLOSED;
        if (borrowed == nullptr)
            return PVX_OK;
        if (!v->capture.retrieve(v->frame) || v->frame.empty())
            return PVX_ECLOSED;
        if (v->frame.depth() != CV_8U)
            return fail(PVX_EUNSUP, err, err_size, "video frames are not 8 bit");
        if (v->frame.channels() == 1)
            cv::cvtColor(v->frame, v->rgb, cv::COLOR_GRAY2RGB);
        else
            to_rgb(v->frame, v->rgb);
        *borrowed = {v->rgb.data, v->rgb.total() * 3, v->rgb.cols, v->rgb.rows, 3, 8};
        return PVX_OK;
    });
}

void video_close(struct cap_cv_video *v) noexcept
{
    char err[16];
    (void)in_opencv(err, sizeof err, [&]() -> int {
        delete v;
        return PVX_OK;
    });
}

const struct cap_cv module = {CAP_CV_VERSION, decode,      encode,          video_open,
                              video_next,     video_close, &cap_cv_apng_ops};

} // namespace

const struct cap_cv *cap_cv_module(void) noexcept
{
    char err[16];
    (void)in_opencv(err, sizeof err, [&]() -> int { /* errors are returned, not printed */
                                                    cv::utils::logging::setLogLevel(
                                                        cv::utils::logging::LOG_LEVEL_SILENT);
                                                    setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);
                                                    /* no playlist that names other files, under any file name */
                                                    setenv("OPENCV_FFMPEG_CAPTURE_OPTIONS",
                                                           "format_whitelist;mov,matroska,avi,apng",
                                                           0);
                                                    return PVX_OK;
    });
    return &module;
}
