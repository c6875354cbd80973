#include "recon/board/aruco_shim.h"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <map>
#include <mutex>
#include <new>
#include <vector>

#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgproc.hpp>

#include "base/err.h"

namespace
{

/* Run f() and turn any exception into an error. */
template <typename F> int guarded(F f) noexcept
{
    try {
        f();
        return PVX_OK;
    } catch (const std::bad_alloc &) {
        return PVX_ENOMEM;
    } catch (const cv::Exception &e) {
        return e.code == cv::Error::StsNoMem ? PVX_ENOMEM : PVX_EUNSUP;
    } catch (...) {
        return PVX_EUNSUP;
    }
}

int bits(int dictionary, int id, uint8_t *out, char *err, size_t err_size) noexcept
{
    int e = guarded([&] {
        auto d = cv::aruco::getPredefinedDictionary(dictionary);
        cv::Mat m = cv::aruco::Dictionary::getBitsFromByteList(d->bytesList.rowRange(id, id + 1),
                                                               d->markerSize);
        std::copy(m.begin<uint8_t>(), m.end<uint8_t>(), out);
    });
    if (e != PVX_OK)
        snprintf(err, err_size, "dictionary %d has no marker %d", dictionary, id);
    return e;
}

cv::Mat mat(const struct rec_cv_picture *p)
{
    return cv::Mat(p->height, p->width, CV_8UC1, const_cast<uint8_t *>(p->grey), p->stride);
}

/* The dictionary followed by its markers mirrored.  A marker counts as the first entry that fits. */
cv::Ptr<cv::aruco::Dictionary> both_sides(int index)
{
    static std::mutex lock;
    static std::map<int, cv::Ptr<cv::aruco::Dictionary>> made;
    std::lock_guard<std::mutex> hold(lock);
    auto &d = made[index];
    if (d.empty()) {
        auto plain = cv::aruco::getPredefinedDictionary(index);
        cv::Mat all = plain->bytesList.clone();
        for (int i = 0; i < plain->bytesList.rows; i++) {
            cv::Mat bit, turned;
            bit = cv::aruco::Dictionary::getBitsFromByteList(plain->bytesList.rowRange(i, i + 1),
                                                             plain->markerSize);
            cv::flip(bit, turned, 1);
            all.push_back(cv::aruco::Dictionary::getByteListFromBits(turned));
        }
        d = cv::makePtr<cv::aruco::Dictionary>(all, plain->markerSize, plain->maxCorrectionBits);
    }
    return d;
}

void scaled(cv::Mat &img, double scale)
{
    cv::Mat out, soft;
    if (scale == 1)
        return;
    cv::resize(img, out, cv::Size(), scale, scale, scale < 1 ? cv::INTER_AREA : cv::INTER_CUBIC);
    if (scale > 1) {
        cv::GaussianBlur(out, soft, cv::Size(), scale);
        cv::addWeighted(out, 4, soft, -3, 0, out); /* separates details one pixel apart */
    }
    img = out;
}

int markers(const struct rec_cv_picture *p, const struct rec_cv_search *s,
            struct rec_cv_marker *out, size_t max, size_t *n) noexcept
{
    *n = 0;
    return guarded([&] {
        cv::Mat img = mat(p);
        auto dict = cv::aruco::getPredefinedDictionary(s->dictionary);
        int plain = dict->bytesList.rows;
        if (s->mirrored_too)
            dict = both_sides(s->dictionary);
        scaled(img, s->scale);
        auto par = cv::aruco::DetectorParameters::create();
        par->markerBorderBits = s->border;
        if (s->border > 1) { /* a window within the border sees no ink: take larger ones too */
            par->adaptiveThreshWinSizeMax = 63;
            par->adaptiveThreshWinSizeStep = 20;
        }
        par->adaptiveThreshConstant = s->darker;
        par->minMarkerPerimeterRate = 4 * s->min_side * s->scale / std::max(img.cols, img.rows);
        par->minMarkerDistanceRate = 0.02; /* squares of a board lie close together */
        par->minDistanceToBorder = 1;
        std::vector<std::vector<cv::Point2f>> quad, rejected;
        std::vector<int> id;
        cv::aruco::detectMarkers(img, dict, quad, id, par, rejected);
        id.resize(id.size() + rejected.size(), -1);
        quad.insert(quad.end(), rejected.begin(), rejected.end());
        *n = std::min(max, quad.size());
        for (size_t i = 0; i < *n; i++) {
            bool mirrored = out[i].mirrored = id[i] >= plain;
            out[i].id = id[i] - (mirrored ? plain : 0);
            for (int c = 0; c < 4; c++) {
                /* contours run through the middles of the outermost pixels, so move them out by half a pixel */
                cv::Point2f at = quad[i][c], a = at - quad[i][(c + 1) % 4],
                            b = at - quad[i][(c + 3) % 4];
                at += a * (0.5 / cv::norm(a)) + b * (0.5 / cv::norm(b));
                float *xy = out[i].xy[mirrored ? c ^ 1 : c];
                xy[0] = static_cast<float>((at.x + 0.5) / s->scale - 0.5);
                xy[1] = static_cast<float>((at.y + 0.5) / s->scale - 0.5);
            }
        }
    });
}

int chessboard(const struct rec_cv_picture *p, int cols, int rows, float *xy, int *found) noexcept
{
    *found = 0;
    return guarded([&] {
        std::vector<cv::Point2f> at;
        cv::Size size(cols, rows);
        cv::Mat img = mat(p);
        bool ok =
            cv::findChessboardCornersSB(img, size, at, cv::CALIB_CB_NORMALIZE_IMAGE) ||
            cv::findChessboardCorners(img, size, at,
                                      cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE |
                                          cv::CALIB_CB_FAST_CHECK);
        if (!ok || at.size() != static_cast<size_t>(cols) * rows)
            return;
        for (size_t i = 0; i < at.size(); i++) {
            xy[2 * i] = at[i].x;
            xy[2 * i + 1] = at[i].y;
        }
        *found = 1;
    });
}

const struct rec_cv module = {REC_CV_VERSION, bits, markers, chessboard};

} // namespace

const struct rec_cv *rec_cv_module(void) noexcept
{
    (void)guarded([] {
        cv::setNumThreads(1);
        cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    });
    return &module;
}
