/* film_read.c - reads films with libavformat and libavcodec; see film.h.
 *
 * What a film says about its frames is obeyed or refused by name: files/README.md has the table.  A frame that is
 * damaged, or that the decoder does not give at all, ends the film with an error: no picture stands for another.
 * Of some damage FFmpeg tells its log only (a wrong checksum of FFV1, whose slice it then takes from the frame before).
 * So its log is read: a line about a film at the level of errors is damage. */
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/avstring.h>
#include <libavutil/stereo3d.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/files/film_priv.h"
#include "capture/files/picture.h"

#define FILM_THREADS 4
#define FILM_WAITING 256 /* packets whose frames have not come: a decoder holds 16 to 32 */
#define FILM_FAR     (INT64_MAX / 4) /* ns: 73 years, so that times may be subtracted */

/* The first line of the log that is an error.  The decoder's threads write it. */
struct film_said {
    atomic_bool begun, done;
    char text[160];
};

struct film {
    char *path;
    struct film_said said;
    AVFormatContext *file;
    AVStream *stream; /* of it */
    AVCodecContext *codec;
    AVFrame *frame;
    AVPacket *packet;
    struct film_pixels pixels;
    enum AVPixelFormat format; /* of the first frame, */
    int width, height;
    enum AVColorSpace space;
    enum AVColorRange range;
    enum AVColorTransferCharacteristic transfer;
    int32_t matrix[9];
    bool turned; /* there is a matrix */
    int64_t waiting[FILM_WAITING];
    int n_waiting;
    int64_t packets, frames, last;
    bool pending; /* the first frame, decoded when the film was opened */
};

static pvx_err film_refuse(const struct film *f, const char *what, struct pvx_diag *d)
{
    return pvx_fail(d, PVX_EUNSUP, "%s: frame %lld: %s", f->path, (long long)f->frames, what);
}

static pvx_err film_damaged(const struct film *f, int code, struct pvx_diag *d)
{
    char why[AV_ERROR_MAX_STRING_SIZE] = "";
    av_strerror(code, why, sizeof why);
    return pvx_fail(d, code == AVERROR(ENOMEM) ? PVX_ENOMEM : PVX_ECORRUPT,
                    "%s: frame %lld: damaged or cut (%s); the film is read up to it; cut it there, "
                    "or record it again",
                    f->path, (long long)f->frames, f->said.done ? f->said.text : why);
}

static PVX_PRINTF(3, 0) void film_log(void *about, int level, const char *format, va_list args)
{
    if (about == NULL)
        return;
    const AVClass *class = *(const AVClass *const *)about;
    struct film_said *said = class == avcodec_get_class()    ? ((AVCodecContext *)about)->opaque
                             : class == avformat_get_class() ? ((AVFormatContext *)about)->opaque
                                                             : NULL;
    /* H.264 numbers its frames; where one is missing, FFmpeg puts a copy of another into its place */
    bool gap = class == avcodec_get_class() && strncmp(format, "Frame num gap", 13) == 0 &&
               ((AVCodecContext *)about)->frame_number > 0;
    if ((level > AV_LOG_ERROR && !gap) || said == NULL || atomic_exchange(&said->begun, true))
        return;
    vsnprintf(said->text, sizeof said->text, format, args);
    said->text[strcspn(said->text, "\n")] = '\0';
    said->done = true;
}

/* ---- the container ---- */

static pvx_err film_choose(AVFormatContext *file, const char *path, AVStream **out,
                           struct pvx_diag *d)
{
    int n = 0;
    bool cover = false;
    for (unsigned i = 0; i < file->nb_streams; i++) {
        AVStream *s = file->streams[i];
        bool video = s->codecpar->codec_type == AVMEDIA_TYPE_VIDEO;
        bool still =
            (s->disposition & (AV_DISPOSITION_ATTACHED_PIC | AV_DISPOSITION_TIMED_THUMBNAILS)) != 0;
        s->discard = AVDISCARD_ALL;
        cover = cover || (video && still);
        if (video && !still && n++ == 0)
            *out = s;
    }
    if (n == 0)
        return pvx_fail(d, PVX_EFORMAT, "%s: no video in it%s", path,
                        cover ? ", only a cover picture" : "");
    if (n > 1)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: %d videos in one file; take them apart: ffmpeg -i IN -map 0:v:0 -c "
                        "copy OUT.mkv, and so on",
                        path, n);
    (*out)->discard = AVDISCARD_DEFAULT;
    return PVX_OK;
}

/* No playlist that names other files, under any file name, and nothing that is not a file. */
static int film_open_container(const char *path, AVFormatContext **file)
{
    AVDictionary *options = NULL;
    char *url = av_asprintf("file:%s", path);
    av_dict_set(&options, "format_whitelist", "mov,matroska,avi,apng", 0);
    av_dict_set(&options, "protocol_whitelist", "file", 0);
    int e = url == NULL ? AVERROR(ENOMEM) : avformat_open_input(file, url, NULL, &options);
    av_dict_free(&options);
    av_free(url);
    return e;
}

static int64_t film_max_pixels(uint64_t bytes)
{
    uint64_t side = CAP_SIDE_MAX, most = side * side;
    return (int64_t)(bytes < most / CAP_PER_BYTE_MAX ? (bytes + 1) * CAP_PER_BYTE_MAX : most);
}

/* Look at the streams; decoders that libavformat uses for this take no larger pictures than ours. */
static int film_find_streams(AVFormatContext *file, uint64_t bytes)
{
    unsigned n = file->nb_streams;
    AVDictionary **options = pvx_calloc(n, sizeof *options);
    int e = options == NULL ? AVERROR(ENOMEM) : 0;
    for (unsigned i = 0; i < n && e >= 0; i++)
        e = av_dict_set_int(&options[i], "max_pixels", film_max_pixels(bytes), 0);
    if (e >= 0)
        e = avformat_find_stream_info(file, options);
    for (unsigned i = 0; i < n && options != NULL; i++)
        av_dict_free(&options[i]);
    free(options);
    return e;
}

static pvx_err film_unreadable(const char *path, int code, struct pvx_diag *d)
{
    return pvx_fail(d, code == AVERROR(ENOMEM) ? PVX_ENOMEM : PVX_EFORMAT,
                    "%s: not a film that can be read (%s); films are MP4, MOV, Matroska, AVI and "
                    "animated PNG",
                    path, av_err2str(code));
}

static pvx_err film_open_file(const char *path, uint64_t bytes, AVFormatContext **file,
                              AVStream **stream, struct pvx_diag *d)
{
    *file = NULL;
    int e = film_open_container(path, file);
    if (e < 0)
        return film_unreadable(path, e, d);
    PVX_TRY(film_choose(*file, path, stream, d));
    const AVCodecParameters *c = (*stream)->codecpar;
    PVX_TRY(cap_picture_fits((uint32_t)c->width, (uint32_t)c->height, bytes, path, d));
    e = film_find_streams(*file, bytes);
    return e < 0 ? film_unreadable(path, e, d) : PVX_OK;
}

/* The next packet of the stream; AVERROR_EOF: there is none.  AVI has only times of decoding.  Where no frame waits for
 * another, they are those of presentation. */
static int film_read_packet(AVFormatContext *file, const AVStream *stream, AVPacket *packet)
{
    int e;
    while ((e = av_read_frame(file, packet)) >= 0 && packet->stream_index != stream->index)
        av_packet_unref(packet);
    if (e >= 0 && (packet->flags & AV_PKT_FLAG_CORRUPT) != 0)
        return AVERROR_INVALIDDATA;
    if (e >= 0 && packet->pts == AV_NOPTS_VALUE && stream->codecpar->video_delay == 0)
        packet->pts = packet->dts;
    return e;
}

/* Whether a packet stands for a frame that is shown: not so where an edit list leaves it out, where the frame before is
 * shown on (an empty packet), and for frames of VP8 that are there to refer to. */
static bool film_shows(const AVStream *stream, const AVPacket *p)
{
    return p->size > 0 && (p->flags & AV_PKT_FLAG_DISCARD) == 0 &&
           (stream->codecpar->codec_id != AV_CODEC_ID_VP8 || (p->data[0] & 0x10) != 0);
}

/* Out of the range of 64 bits: INT64_MIN. */
static int64_t film_ns(const AVStream *stream, int64_t pts)
{
    return av_rescale_q(pts, stream->time_base, (AVRational){1, 1000000000});
}

static pvx_err film_check_time(const struct film *f, int64_t frame, int64_t pts, struct pvx_diag *d)
{
    int64_t ns = film_ns(f->stream, pts);
    if (pts == AV_NOPTS_VALUE)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: frame %lld has no time of presentation of its own (an AVI has none "
                        "with B-frames); write the film again: ffmpeg -i IN -c:v ffv1 OUT.mkv",
                        f->path, (long long)frame);
    if (ns > FILM_FAR || ns < -FILM_FAR)
        return pvx_fail(d, PVX_ERANGE,
                        "%s: frame %lld is shown at %.4g s, too far from 0; let the film begin "
                        "there: ffmpeg -i IN -c:v ffv1 OUT.mkv",
                        f->path, (long long)frame, (double)pts * av_q2d(f->stream->time_base));
    return PVX_OK;
}

/* ---- all times ---- */

static int film_by_time(const void *a, const void *b)
{
    int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return x < y ? -1 : x > y;
}

static pvx_err film_add_time(int64_t **t, size_t *n, int64_t value)
{
    if ((*n & (*n - 1)) == 0) {
        int64_t *more = realloc(*t, (*n > 0 ? 2 * *n : 1) * sizeof **t);
        if (more == NULL)
            return PVX_ENOMEM;
        *t = more;
    }
    (*t)[(*n)++] = value;
    return PVX_OK;
}

static pvx_err film_read_times(struct film *f, int64_t **t, size_t *n, struct pvx_diag *d)
{
    int e;
    f->file->opaque = &f->said;
    while ((e = film_read_packet(f->file, f->stream, f->packet)) >= 0) {
        bool shows = film_shows(f->stream, f->packet);
        int64_t pts = f->packet->pts;
        av_packet_unref(f->packet);
        if (shows) {
            PVX_TRY(film_check_time(f, (int64_t)*n, pts, d));
            PVX_TRY(film_add_time(t, n, film_ns(f->stream, pts)));
        }
    }
    f->frames = (int64_t)*n;
    if (e != AVERROR_EOF || f->said.begun)
        return film_damaged(f, e, d);
    if (*n == 0)
        return pvx_fail(d, PVX_EFORMAT, "%s: no frame in it", f->path);
    qsort(*t, *n, sizeof **t, film_by_time);
    for (size_t i = 1; i < *n; i++)
        if ((*t)[i] == (*t)[i - 1])
            return pvx_fail(d, PVX_ECORRUPT, "%s: frames %zu and %zu are shown at the same time",
                            f->path, i - 1, i);
    return PVX_OK;
}

static pvx_err film_times(const char *path, uint64_t bytes, int64_t **t_ns, size_t *n,
                          struct pvx_diag *d)
{
    struct film f = {.path = (char *)path, .packet = av_packet_alloc()};
    pvx_err e = f.packet == NULL ? PVX_ENOMEM : film_open_file(path, bytes, &f.file, &f.stream, d);
    if (e == PVX_OK)
        e = film_read_times(&f, t_ns, n, d);
    if (e != PVX_OK) {
        PVX_FREE(*t_ns);
        *n = 0;
    }
    av_packet_free(&f.packet);
    avformat_close_input(&f.file);
    return e;
}

/* ---- frames ---- */

static pvx_err film_wait_for(struct film *f, int64_t pts, struct pvx_diag *d)
{
    PVX_TRY(film_check_time(f, f->frames, pts, d));
    if (f->n_waiting == FILM_WAITING)
        return film_damaged(f, AVERROR_INVALIDDATA, d);
    f->waiting[f->n_waiting++] = pts;
    return PVX_OK;
}

/* Give the decoder a packet, or the end. */
static pvx_err film_feed(struct film *f, struct pvx_diag *d)
{
    int e = film_read_packet(f->file, f->stream, f->packet);
    if (e == AVERROR_EOF) {
        e = avcodec_send_packet(f->codec, NULL);
        return e < 0 ? film_damaged(f, e, d) : PVX_OK;
    }
    if (e < 0)
        return film_damaged(f, e, d);
    if (f->packets++ == 0 && (f->packet->flags & AV_PKT_FLAG_KEY) == 0)
        return pvx_fail(d, PVX_ECORRUPT,
                        "%s: its first frame is no key frame, so its begin cannot be decoded: cut "
                        "it at a key frame",
                        f->path);
    pvx_err r = PVX_OK;
    if (film_shows(f->stream, f->packet))
        r = film_wait_for(f, f->packet->pts, d);
    if (r == PVX_OK && f->packet->size > 0 && (e = avcodec_send_packet(f->codec, f->packet)) < 0)
        r = film_damaged(f, e, d);
    av_packet_unref(f->packet);
    return r;
}

/* A frame has come: it must be the earliest that is waited for. */
static pvx_err film_arrived(struct film *f, struct pvx_diag *d)
{
    int64_t pts = f->frame->pts;
    int at = -1, earlier = 0;
    for (int i = 0; i < f->n_waiting; i++) {
        if (f->waiting[i] == pts)
            at = i;
        else
            earlier += f->waiting[i] < pts;
    }
    if (at < 0 || earlier > 0 || (f->frames > 0 && pts <= f->last))
        return pvx_fail(d, PVX_ECORRUPT,
                        "%s: frame %lld (%.3f s): the decoder gives no picture for it, or "
                        "not in the order of time: damaged; the film is read up to it",
                        f->path, (long long)f->frames,
                        (double)film_ns(f->stream, f->waiting[0]) * 1e-9);
    f->waiting[at] = f->waiting[--f->n_waiting];
    f->last = pts;
    return PVX_OK;
}

static const int32_t *film_matrix(const struct film *f)
{
    const AVFrameSideData *own = av_frame_get_side_data(f->frame, AV_FRAME_DATA_DISPLAYMATRIX);
    if (own != NULL && own->size >= sizeof f->matrix)
        return (const int32_t *)(const void *)own->data;
    return (const int32_t *)(const void *)av_stream_get_side_data(f->stream,
                                                                  AV_PKT_DATA_DISPLAYMATRIX, NULL);
}

static bool film_is_stereo(const struct film *f)
{
    const AVFrameSideData *own = av_frame_get_side_data(f->frame, AV_FRAME_DATA_STEREO3D);
    const void *all = av_stream_get_side_data(f->stream, AV_PKT_DATA_STEREO3D, NULL);
    const AVStereo3D *s = own != NULL ? (const AVStereo3D *)(const void *)own->data : all;
    return s != NULL && s->type != AV_STEREO3D_2D;
}

/* What each frame must be by itself. */
static pvx_err film_check_frame(struct film *f, struct pvx_diag *d)
{
    AVRational shape = av_guess_sample_aspect_ratio(f->file, f->stream, f->frame);
    if (f->frame->decode_error_flags != 0 || (f->frame->flags & AV_FRAME_FLAG_CORRUPT) != 0 ||
        f->said.begun)
        return film_damaged(f, AVERROR_INVALIDDATA, d);
    if (f->frame->interlaced_frame || (f->stream->codecpar->field_order != AV_FIELD_UNKNOWN &&
                                       f->stream->codecpar->field_order != AV_FIELD_PROGRESSIVE))
        return film_refuse(f,
                           "interlaced: its odd and even lines show two instants; write it again: "
                           "ffmpeg -i IN -vf bwdif -c:v ffv1 OUT.mkv",
                           d);
    if (shape.num > 0 && shape.num != shape.den)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its pixels are shown %d:%d wide to high, not square; if they are "
                        "square, or the camera is calibrated with such films, write it again: "
                        "ffmpeg -i IN -vf setsar=1 -c:v ffv1 OUT.mkv",
                        f->path, shape.num, shape.den);
    if (f->codec->codec_id == AV_CODEC_ID_RAWVIDEO && f->stream->codecpar->codec_tag == 0 &&
        f->frame->format == AV_PIX_FMT_RGB555LE)
        return film_refuse(f,
                           "uncompressed, of 16 bits in a pixel: AVI means 5 bits of each colour, "
                           "but programs write grey of 16 bits so, too; save it as TIFF or PNG "
                           "pictures, or as Matroska with FFV1",
                           d);
    if (film_is_stereo(f))
        return film_refuse(f, "two views in one frame (stereo 3D); take them apart with ffmpeg", d);
    return PVX_OK;
}

static void film_remember(struct film *f)
{
    const int32_t *m = film_matrix(f);
    f->format = f->frame->format;
    f->width = f->frame->width;
    f->height = f->frame->height;
    f->space = f->frame->colorspace;
    f->range = f->frame->color_range;
    f->transfer = f->frame->color_trc;
    f->turned = m != NULL;
    if (m != NULL)
        memcpy(f->matrix, m, sizeof f->matrix);
}

/* What must be as in the first frame. */
static pvx_err film_check_same(const struct film *f, struct pvx_diag *d)
{
    const AVFrame *a = f->frame;
    const int32_t *m = film_matrix(f);
    if (a->width != f->width || a->height != f->height || (int)f->format != a->format)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: frame %lld is %dx%d %s, and the first is %dx%d %s; cut the film there",
                        f->path, (long long)f->frames, a->width, a->height,
                        av_get_pix_fmt_name(a->format), f->width, f->height,
                        av_get_pix_fmt_name(f->format));
    if (a->colorspace != f->space || a->color_range != f->range || a->color_trc != f->transfer ||
        !film_pixels_same_palette(&f->pixels, a))
        return film_refuse(f, "its colours are coded in another way than the first's: cut it there",
                           d);
    if (m != NULL && (!f->turned || memcmp(m, f->matrix, sizeof f->matrix) != 0))
        return film_refuse(f, "turned in another way than the first: cut it there", d);
    return PVX_OK;
}

/* Decode the next frame into f->frame.  PVX_ECLOSED: the end. */
static pvx_err film_decode(struct film *f, struct pvx_diag *d)
{
    int e;
    while ((e = avcodec_receive_frame(f->codec, f->frame)) == AVERROR(EAGAIN) ||
           (e >= 0 && (f->frame->flags & AV_FRAME_FLAG_DISCARD) != 0)) /* of some decoders */
        if (e < 0)
            PVX_TRY(film_feed(f, d));
    if (e == AVERROR_EOF)
        return f->n_waiting == 0 && !f->said.begun ? PVX_ECLOSED
                                                   : film_damaged(f, AVERROR_INVALIDDATA, d);
    if (e < 0)
        return film_damaged(f, e, d);
    PVX_TRY(film_arrived(f, d));
    PVX_TRY(film_check_frame(f, d));
    if (f->frames == 0)
        film_remember(f);
    else
        PVX_TRY(film_check_same(f, d));
    f->frames++;
    return PVX_OK;
}

static pvx_err film_next(struct film *f, struct cap_image *img, int64_t *t_ns, struct pvx_diag *d)
{
    if (!f->pending)
        PVX_TRY(film_decode(f, d));
    f->pending = false;
    if (img != NULL)
        film_pixels_read(&f->pixels, f->frame, img);
    if (t_ns != NULL)
        *t_ns = film_ns(f->stream, f->frame->pts);
    return PVX_OK;
}

static void film_close(struct film *f)
{
    if (f == NULL)
        return;
    film_pixels_free(&f->pixels);
    av_frame_free(&f->frame);
    av_packet_free(&f->packet);
    avcodec_free_context(&f->codec);
    avformat_close_input(&f->file);
    free(f->path);
    free(f);
}

/* Decoders whose threads wait for each other within a frame.  Where one slice is damaged, that of VP8 waits for ever. */
static bool film_slices_wait(enum AVCodecID id)
{
    return id == AV_CODEC_ID_VP8 || id == AV_CODEC_ID_VP9 || id == AV_CODEC_ID_HEVC;
}

static pvx_err film_open_codec(struct film *f, uint64_t bytes, struct pvx_diag *d)
{
    const AVCodecParameters *par = f->stream->codecpar;
    const AVCodec *codec = avcodec_find_decoder(par->codec_id);
    if (codec == NULL)
        return pvx_fail(d, PVX_EUNSUP, "%s: its codec (%s) is not read", f->path,
                        avcodec_get_name(par->codec_id));
    f->codec = avcodec_alloc_context3(codec);
    if (f->codec == NULL)
        return PVX_ENOMEM;
    int e = avcodec_parameters_to_context(f->codec, par);
    f->file->opaque = f->codec->opaque = &f->said;
    f->codec->pkt_timebase = f->stream->time_base;
    f->codec->flags |= AV_CODEC_FLAG_UNALIGNED; /* else a crop at the left is rounded */
    f->codec->err_recognition = AV_EF_CRCCHECK | AV_EF_EXPLODE;
    f->codec->max_pixels = film_max_pixels(bytes);
    f->codec->thread_type = FF_THREAD_SLICE; /* of one frame: no delay, and errors come at once */
    f->codec->thread_count = film_slices_wait(par->codec_id) ? 1 : FILM_THREADS;
    if (e >= 0)
        e = avcodec_open2(f->codec, codec, NULL);
    return e < 0 ? film_damaged(f, e, d) : PVX_OK;
}

static double film_rate(const AVStream *s)
{
    AVRational r = s->avg_frame_rate.num > 0 ? s->avg_frame_rate : s->r_frame_rate;
    double fps = r.num > 0 && r.den > 0 ? av_q2d(r) : 0;
    return fps < 1e4 ? fps : 0; /* else it is the unit of time */
}

static pvx_err film_begin(struct film *f, uint64_t bytes, struct cap_video_info *info,
                          struct pvx_diag *d)
{
    PVX_TRY(film_open_file(f->path, bytes, &f->file, &f->stream, d));
    PVX_TRY(film_open_codec(f, bytes, d));
    pvx_err e = film_decode(f, d);
    if (e == PVX_ECLOSED)
        return pvx_fail(d, PVX_EFORMAT, "%s: no frame in it", f->path);
    PVX_TRY(e);
    PVX_TRY(cap_picture_fits((uint32_t)f->width, (uint32_t)f->height, bytes, f->path, d));
    PVX_TRY(film_pixels_of(f->path, f->frame, f->turned ? f->matrix : NULL, &f->pixels, d));
    f->pending = true;
    *info = (struct cap_video_info){.width = f->pixels.width,
                                    .height = f->pixels.height,
                                    .fmt = f->pixels.fmt,
                                    .fps = film_rate(f->stream)};
    return PVX_OK;
}

static pvx_err film_open(const char *path, uint64_t bytes, struct film **out,
                         struct cap_video_info *info, struct pvx_diag *d)
{
    *out = NULL;
    struct film *f = pvx_calloc(1, sizeof *f);
    if (f == NULL)
        return PVX_ENOMEM;
    f->path = strdup(path);
    f->frame = av_frame_alloc();
    f->packet = av_packet_alloc();
    pvx_err e = f->path == NULL || f->frame == NULL || f->packet == NULL
                    ? PVX_ENOMEM
                    : film_begin(f, bytes, info, d);
    if (e == PVX_OK)
        *out = f;
    else
        film_close(f);
    return e;
}

const struct cap_films *cap_films_module(void)
{
    static const struct cap_films module = {.version = CAP_FILMS_VERSION,
                                            .open = film_open,
                                            .next = film_next,
                                            .times = film_times,
                                            .close = film_close};
    av_log_set_callback(film_log); /* nothing is printed */
    return &module;
}
