/* apng_shim.cpp - writes pictures into one animated PNG with libavformat; see opencv_shim.h.  It is in that module,
 * because OpenCV's reader of videos uses the same libraries, which are loaded with it anyway. */
#include "capture/files/opencv_shim.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/opt.h>
}

#include "base/err.h"

struct cap_cv_apng {
    AVFormatContext *mux;
    AVCodecContext *enc;
    AVFrame *frame;
    AVPacket *packet;
    int64_t n;
};

namespace
{

int failed(int code, const char *what, char *err, size_t err_size)
{
    char why[AV_ERROR_MAX_STRING_SIZE] = "";
    av_strerror(code, why, sizeof why);
    snprintf(err, err_size, "%s: %s", what, why);
    return code == AVERROR(ENOMEM) ? PVX_ENOMEM : PVX_EIO;
}

void drop(struct cap_cv_apng *a) noexcept
{
    if (a == nullptr)
        return;
    if (a->mux != nullptr && a->mux->pb != nullptr) {
        uint8_t *bytes = nullptr;
        avio_close_dyn_buf(a->mux->pb, &bytes);
        av_free(bytes);
    }
    avformat_free_context(a->mux);
    avcodec_free_context(&a->enc);
    av_frame_free(&a->frame);
    av_packet_free(&a->packet);
    free(a);
}

/* Open the encoder and the file for pictures of this shape. */
int open(struct cap_cv_apng *a, int32_t width, int32_t height, int32_t channels, int32_t fps)
{
    const AVCodec *codec = avcodec_find_encoder(AV_CODEC_ID_APNG);
    int e = codec == nullptr ? AVERROR_ENCODER_NOT_FOUND
                             : avformat_alloc_output_context2(&a->mux, nullptr, "apng", nullptr);
    if (e < 0)
        return e;
    AVStream *stream = avformat_new_stream(a->mux, nullptr);
    a->enc = avcodec_alloc_context3(codec);
    a->frame = av_frame_alloc();
    a->packet = av_packet_alloc();
    if (stream == nullptr || a->enc == nullptr || a->frame == nullptr || a->packet == nullptr)
        return AVERROR(ENOMEM);
    a->enc->width = a->frame->width = width;
    a->enc->height = a->frame->height = height;
    a->enc->pix_fmt = channels == 3 ? AV_PIX_FMT_RGB24 : AV_PIX_FMT_GRAY8;
    a->frame->format = a->enc->pix_fmt;
    a->enc->time_base = stream->time_base = {1, fps};
    if ((e = avcodec_open2(a->enc, codec, nullptr)) < 0 ||
        (e = avcodec_parameters_from_context(stream->codecpar, a->enc)) < 0 ||
        (e = av_frame_get_buffer(a->frame, 0)) < 0 || (e = avio_open_dyn_buf(&a->mux->pb)) < 0 ||
        (e = av_opt_set_int(a->mux->priv_data, "plays", 0, 0)) < 0) /* for ever */
        return e;
    return avformat_write_header(a->mux, nullptr);
}

int begin(int32_t width, int32_t height, int32_t channels, int32_t fps, struct cap_cv_apng **out,
          char *err, size_t err_size) noexcept
{
    av_log_set_level(AV_LOG_QUIET); /* errors are returned, not printed */
    auto *a = static_cast<struct cap_cv_apng *>(calloc(1, sizeof(struct cap_cv_apng)));
    int e = a == nullptr ? AVERROR(ENOMEM) : open(a, width, height, channels, fps);
    *out = e < 0 ? nullptr : a;
    if (e >= 0)
        return PVX_OK;
    drop(a);
    return failed(e, "no animated PNG", err, err_size);
}

/* Encode a frame (nullptr: there are no more), and write the packets that come out to the file. */
int encode(struct cap_cv_apng *a, const AVFrame *frame)
{
    int e = avcodec_send_frame(a->enc, frame);
    while (e >= 0 && (e = avcodec_receive_packet(a->enc, a->packet)) >= 0) {
        av_packet_rescale_ts(a->packet, a->enc->time_base, a->mux->streams[0]->time_base);
        e = av_write_frame(a->mux, a->packet);
        av_packet_unref(a->packet);
    }
    return e == AVERROR(EAGAIN) || e == AVERROR_EOF ? 0 : e;
}

int add(struct cap_cv_apng *a, const void *pixels, char *err, size_t err_size) noexcept
{
    int e = av_frame_make_writable(a->frame);
    size_t row = static_cast<size_t>(a->enc->width) * (a->enc->pix_fmt == AV_PIX_FMT_RGB24 ? 3 : 1);
    for (int y = 0; y < a->enc->height && e >= 0; y++)
        memcpy(a->frame->data[0] + static_cast<ptrdiff_t>(y) * a->frame->linesize[0],
               static_cast<const uint8_t *>(pixels) + static_cast<size_t>(y) * row, row);
    a->frame->pts = a->n++;
    if (e >= 0)
        e = encode(a, a->frame);
    return e < 0 ? failed(e, "a picture could not be encoded", err, err_size) : PVX_OK;
}

int end(struct cap_cv_apng *a, void **out, size_t *len, char *err, size_t err_size) noexcept
{
    *out = nullptr;
    *len = 0;
    int e = encode(a, nullptr);
    if (e >= 0)
        e = av_write_trailer(a->mux);
    uint8_t *bytes =
        nullptr; /* not avio_close_dyn_buf: it pads at the place where the trailer ended, near the start */
    int n = e >= 0 ? avio_get_dyn_buf(a->mux->pb, &bytes) : 0;
    if (e >= 0 && (*out = malloc(static_cast<size_t>(n))) == nullptr)
        e = AVERROR(ENOMEM);
    if (e >= 0) {
        memcpy(*out, bytes, static_cast<size_t>(n));
        *len = static_cast<size_t>(n);
    }
    drop(a);
    return e < 0 ? failed(e, "the animation could not be closed", err, err_size) : PVX_OK;
}

} // namespace

const struct cap_cv_apng_ops cap_cv_apng_ops = {begin, add, end, drop};
