/* film_apng.c - writes pictures into one animated PNG with libavformat; see film.h. */
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/opt.h>
#include <stdlib.h>
#include <string.h>

#include "capture/files/film_priv.h"

struct film_apng {
    const char *path; /* borrowed */
    AVFormatContext *mux;
    AVCodecContext *enc;
    AVFrame *frame;
    AVPacket *packet;
    int64_t n;
};

static pvx_err apng_failed(const char *path, int code, const char *what, struct pvx_diag *d)
{
    return pvx_fail(d, code == AVERROR(ENOMEM) ? PVX_ENOMEM : PVX_EIO, "%s: %s: %s", path, what,
                    av_err2str(code));
}

void film_apng_drop(struct film_apng *a)
{
    if (a == NULL)
        return;
    if (a->mux != NULL && a->mux->pb != NULL) {
        uint8_t *bytes = NULL;
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
static int apng_open(struct film_apng *a, int32_t width, int32_t height, int nch, int fps)
{
    const AVCodec *codec = avcodec_find_encoder(AV_CODEC_ID_APNG);
    int e = codec == NULL ? AVERROR_ENCODER_NOT_FOUND
                          : avformat_alloc_output_context2(&a->mux, NULL, "apng", NULL);
    if (e < 0)
        return e;
    AVStream *stream = avformat_new_stream(a->mux, NULL);
    a->enc = avcodec_alloc_context3(codec);
    a->frame = av_frame_alloc();
    a->packet = av_packet_alloc();
    if (stream == NULL || a->enc == NULL || a->frame == NULL || a->packet == NULL)
        return AVERROR(ENOMEM);
    a->enc->width = a->frame->width = width;
    a->enc->height = a->frame->height = height;
    a->enc->pix_fmt = nch == 3 ? AV_PIX_FMT_RGB24 : AV_PIX_FMT_GRAY8;
    a->frame->format = a->enc->pix_fmt;
    a->enc->time_base = stream->time_base = (AVRational){1, fps};
    if ((e = avcodec_open2(a->enc, codec, NULL)) < 0 ||
        (e = avcodec_parameters_from_context(stream->codecpar, a->enc)) < 0 ||
        (e = av_frame_get_buffer(a->frame, 0)) < 0 || (e = avio_open_dyn_buf(&a->mux->pb)) < 0 ||
        (e = av_opt_set_int(a->mux->priv_data, "plays", 0, 0)) < 0) /* for ever */
        return e;
    return avformat_write_header(a->mux, NULL);
}

pvx_err film_apng_begin(const char *path, int32_t w, int32_t h, int nch, int fps,
                        struct film_apng **out, struct pvx_diag *d)
{
    struct film_apng *a = calloc(1, sizeof *a);
    int e = a == NULL ? AVERROR(ENOMEM) : apng_open(a, w, h, nch, fps);
    *out = e < 0 ? NULL : a;
    if (e < 0) {
        film_apng_drop(a);
        return apng_failed(path, e, "no animated PNG", d);
    }
    a->path = path;
    return PVX_OK;
}

/* Encode a frame (NULL: there are no more), and write the packets that come out to the file. */
static int apng_encode(struct film_apng *a, const AVFrame *frame)
{
    int e = avcodec_send_frame(a->enc, frame);
    while (e >= 0 && (e = avcodec_receive_packet(a->enc, a->packet)) >= 0) {
        av_packet_rescale_ts(a->packet, a->enc->time_base, a->mux->streams[0]->time_base);
        e = av_write_frame(a->mux, a->packet);
        av_packet_unref(a->packet);
    }
    return e == AVERROR(EAGAIN) || e == AVERROR_EOF ? 0 : e;
}

pvx_err film_apng_add(struct film_apng *a, const uint8_t *samples, struct pvx_diag *d)
{
    int e = av_frame_make_writable(a->frame);
    size_t row = (size_t)a->enc->width * (a->enc->pix_fmt == AV_PIX_FMT_RGB24 ? 3 : 1);
    for (int y = 0; y < a->enc->height && e >= 0; y++)
        memcpy(a->frame->data[0] + (ptrdiff_t)y * a->frame->linesize[0], samples + (size_t)y * row,
               row);
    a->frame->pts = a->n++;
    if (e >= 0)
        e = apng_encode(a, a->frame);
    return e < 0 ? apng_failed(a->path, e, "a picture could not be encoded", d) : PVX_OK;
}

pvx_err film_apng_end(struct film_apng *a, void **out, size_t *len, struct pvx_diag *d)
{
    const char *path = a->path;
    *out = NULL;
    *len = 0;
    int e = apng_encode(a, NULL);
    if (e >= 0)
        e = av_write_trailer(a->mux);
    /* not avio_close_dyn_buf: it pads at the place where the trailer ended, near the start */
    uint8_t *bytes = NULL;
    int n = e >= 0 ? avio_get_dyn_buf(a->mux->pb, &bytes) : 0;
    if (e >= 0 && (*out = malloc((size_t)n)) == NULL)
        e = AVERROR(ENOMEM);
    if (e >= 0) {
        memcpy(*out, bytes, (size_t)n);
        *len = (size_t)n;
    }
    film_apng_drop(a);
    return e < 0 ? apng_failed(path, e, "the animation could not be closed", d) : PVX_OK;
}
