/* pvp.h - Pyrovox wire format: encode and decode one message in memory (PROTOCOL.md is the spec).
 *
 * One message = one ZeroMQ frame, little-endian, fixed header with type, version, sequence and
 * length; a subscriber filters on the first bytes.  Types: start, volume, status, end, rig, event, preview, bars.
 * A volume carries only bricks of 8^3 voxels that have an active voxel.
 * Decoding is bounds-checked and never trusts a length; it gives views into the message, and
 * pvp_volume_unpack writes into the caller's array.  Only pvp_decoder owns memory: room for one
 * decompressed volume, grown to the largest seen.
 * Threads: pure; an encoder or a decoder belongs to one thread. */
#ifndef PVP_H
#define PVP_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"
#ifdef __cplusplus
extern "C" {
#endif

enum pvp_type {
    PVP_START = 100,
    PVP_VOLUME = 200,
    PVP_STATUS = 300,
    PVP_END = 400,
    PVP_RIG = 500,     /* since 1.1, as all that follow */
    PVP_EVENT = 600,   /* an event, as JSON */
    PVP_PREVIEW = 700, /* the cameras' pictures, on an endpoint of its own */
    PVP_BARS = 800     /* since 1.2: error bars of the volume that follows */
};
enum pvp_sample { PVP_F32 = 1, PVP_F16 = 2 };
enum pvp_compress { PVP_RAW = 0, PVP_LZ4 = 1, PVP_ZSTD = 2 };
#define PVP_BRICK         8
#define PVP_GRID_MAX      1024              /* voxels per side */
#define PVP_STATUS_MAX    ((size_t)1 << 20) /* bytes of a status text */
#define PVP_REASON_MAX    64                /* bytes of an end reason, with the 0 */
#define PVP_RIG_MAX       ((size_t)1 << 20) /* bytes of a rig's text */
#define PVP_EVENT_MAX     4096u             /* bytes of an event's text */
#define PVP_PREVIEW_MAX   ((size_t)1 << 24) /* bytes of a preview message's body */
#define PVP_PREVIEW_SIDE  320               /* pixels of a preview picture's longer side, at most */
#define PVP_CAMERAS_MAX   64
#define PVP_VERSION_MAJOR 1
#define PVP_VERSION_MINOR 2

/* Header flags.  A reader may ignore unknown flags among the lower 16, but not among the upper 16. */
#define PVP_FLAG_CLAMPED 1u /* volume in f16: some value was beyond +-65504 and was cut to it */

/* Prefix of a subscription to all messages.  Followed by a type's two bytes: to that type only. */
#define PVP_SUBSCRIBE_ALL "PVX1"

struct pvp_grid {
    uint32_t n[3];
    double min[3], max[3]; /* m */
    uint32_t basis;        /* 0 box, 1 trilinear */
    uint32_t channels;     /* 1 or 3 */
};
/* Voxels times channels: the `count` that pvp_volume_unpack needs. */
size_t pvp_grid_count(const struct pvp_grid *g);
/* nb[3]: bricks along x, y, z; returns their product (at most 2^21). */
uint32_t pvp_grid_bricks(const struct pvp_grid *g, uint32_t nb[3]);
/* Whether the grid is within the limits of the format. */
bool pvp_grid_valid(const struct pvp_grid *g);
bool pvp_grid_same(const struct pvp_grid *a, const struct pvp_grid *b);

struct pvp_start {
    struct pvp_grid grid;
    uint64_t session; /* differs between runs of the daemon */
    uint64_t rig_hash;
    uint32_t n_cameras;
    double fps;        /* nominal, 0 unknown */
    char units[32];    /* "1/m" : linear pixel value per metre */
    char software[32]; /* "pyrovoxd 0.1.0" */
};
struct pvp_report {
    uint32_t status; /* as recon's rec_status: 0 converged 1 max-iter 2 deadline 4 empty */
    char solver[16];
    uint32_t iterations;
    double rel_residual;
    uint32_t active_voxels, active_rays;
    uint64_t entries;
    int64_t photometry_ns, hull_ns, restrict_ns, solve_ns, total_ns;
};
struct pvp_volume {
    uint64_t session, set;         /* set: number of the frame set */
    int64_t t_exposure_ns;         /* host CLOCK_REALTIME (UTC) */
    int64_t t_publish_ns;          /* same clock */
    int64_t spread_ns, latency_ns; /* last frame received -> encoded */
    uint32_t cameras_present;
    uint64_t camera_mask;
    struct pvp_grid grid;
    struct pvp_report report;
};

/* Why the error bars of a volume may be too small: bits, names and sentences, the only list of them. */
#define PVP_DOUBTS(X)                                                                      \
    X(0, POOR_FIT, "poor-fit",                                                             \
      "the model misses the pictures by more than noise, calibration and texture explain") \
    X(1, FEW_CAMERAS, "few-cameras", "there are fewer than five cameras")                  \
    X(2, FINE, "fine-detail",                                                              \
      "the flame has detail as fine as its voxels, so finer detail is likely lost")        \
    X(3, LATE, "late", "too few draws have been made yet")                                 \
    X(4, BLURRED, "blurred", "noise hides detail that is finer than a few voxels")
enum pvp_doubt {
#define PVP_DOUBT_BIT(bit, id, name, sentence) PVP_DOUBT_##id = 1 << (bit),
    PVP_DOUBTS(PVP_DOUBT_BIT)
#undef PVP_DOUBT_BIT
};
/* "poor-fit" and its sentence for bit 0, and so on; NULL: this version has no such bit. */
const char *pvp_doubt_name(unsigned bit);
const char *pvp_doubt_sentence(unsigned bit);

/* --- encoding: buffers are sized once for the grid, as reserved address space --- */
typedef struct pvp_encoder pvp_encoder;
/* Errors: PVX_EINVAL (grid, sample or compression outside what the format knows), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err pvp_encoder_new(const struct pvp_grid *g, enum pvp_sample sample,
                                       enum pvp_compress comp, pvp_encoder **out);
void pvp_encoder_free(pvp_encoder **e);
/* Applies from the next volume on; every volume states its compression. */
void pvp_encoder_compress(pvp_encoder *e, enum pvp_compress comp);
struct pvp_voxels {
    uint32_t n;
    const int32_t *index; /* [n] ascending, x fastest */
    const float *value;   /* [n][stride], of which the first grid.channels count */
    int stride;
};
/* Sparse volume.  *msg borrowed until the next call.  A payload that compression would not
 * make smaller goes out uncompressed.  PVX_EINVAL: another grid than the encoder's, index not
 * ascending or outside, a value that is not finite.  Allocates nothing.
 * Cost: O(n + 512 * bricks), plus the compression. */
PVX_MUST_CHECK pvx_err pvp_encode_volume(pvp_encoder *e, uint64_t sequence,
                                         const struct pvp_volume *v, const struct pvp_voxels *x,
                                         const void **msg, size_t *len);
/* Error bars of the volume that follows: one standard deviation for each of its voxels (sd->index is the volume's),
 * none below 0.  doubt: bits of enum pvp_doubt.  Otherwise as pvp_encode_volume. */
PVX_MUST_CHECK pvx_err pvp_encode_bars(pvp_encoder *e, uint64_t sequence,
                                       const struct pvp_volume *v, uint32_t doubt,
                                       const struct pvp_voxels *sd, const void **msg, size_t *len);
PVX_MUST_CHECK pvx_err pvp_encode_start(pvp_encoder *e, uint64_t sequence,
                                        const struct pvp_start *s, const void **msg, size_t *len);
/* JSON text, unchanged; PVX_ERANGE above PVP_STATUS_MAX.  Carries the session of the last start. */
PVX_MUST_CHECK pvx_err pvp_encode_status(pvp_encoder *e, uint64_t sequence, const char *json,
                                         const void **msg, size_t *len);
PVX_MUST_CHECK pvx_err pvp_encode_end(pvp_encoder *e, uint64_t sequence, uint64_t session,
                                      const char *reason, const void **msg, size_t *len);

/* The rig.yaml in effect, as text; PVX_ERANGE above PVP_RIG_MAX. */
PVX_MUST_CHECK pvx_err pvp_encode_rig(pvp_encoder *e, uint64_t sequence, uint64_t rig_hash,
                                      const char *yaml, const void **msg, size_t *len);
/* JSON text, unchanged; PVX_ERANGE above PVP_EVENT_MAX. */
PVX_MUST_CHECK pvx_err pvp_encode_event(pvp_encoder *e, uint64_t sequence, const char *json,
                                        const void **msg, size_t *len);
/* One camera's picture and silhouette.  The bytes are borrowed, in both directions. */
struct pvp_preview_camera {
    char name[64];
    bool left_out;          /* present and not believed */
    uint32_t width, height; /* of the picture; 0 0: no picture, since the camera gave no frame */
    const uint8_t *jpeg;    /* [jpeg_len] */
    size_t jpeg_len;        /* 0: no picture */
    uint32_t across, down;  /* bins of the silhouette; 0 0: none */
    const uint8_t
        *lit_bits; /* [down][(across + 7) / 8], the leftmost bin in the highest bit, 1 = lit */
    uint32_t lit, saturated; /* bins */
};
struct pvp_preview {
    uint64_t session, set; /* set: as in the volume made from it, if there is one */
    int64_t t_exposure_ns;
    uint32_t n_cameras; /* of the rig */
    struct pvp_preview_camera camera[PVP_CAMERAS_MAX];
};
/* PVX_EINVAL: too many cameras, sizes that do not fit each other; PVX_ERANGE above
 * PVP_PREVIEW_MAX.  Carries the session of the last start; p's is ignored. */
PVX_MUST_CHECK pvx_err pvp_encode_preview(pvp_encoder *e, uint64_t sequence,
                                          const struct pvp_preview *p, const void **msg,
                                          size_t *len);

/* --- decoding --- */
struct pvp_header {
    enum pvp_type type;     /* may be unknown to this version: ignore the message then */
    uint32_t version;       /* major << 16 | minor */
    uint32_t flags;         /* PVP_FLAG_* */
    uint64_t sequence;      /* counts all messages of the session */
    uint64_t type_sequence; /* counts the messages of this type in the session */
    uint64_t session;
    size_t head, body; /* bytes; the body starts at msg + head */
};
struct pvp_view { /* a volume message's bricks, borrowed from the message */
    struct pvp_volume v;
    enum pvp_sample sample;
    enum pvp_compress comp;
    bool clamped;
    uint32_t n_bricks;
    const uint8_t *ids;
    const uint8_t *payload;
    size_t payload_len;
    size_t raw_len; /* bytes of the payload decompressed */
};
/* All of them: PVX_EFORMAT (not a message, cut short, a field outside its range), PVX_EVERSION (made
 * for readers of a later version), PVX_EUNSUP (sample or compression not known here). */
PVX_MUST_CHECK pvx_err pvp_decode_header(const void *msg, size_t len, struct pvp_header *h,
                                         struct pvx_diag *d);
PVX_MUST_CHECK pvx_err pvp_decode_start(const void *msg, size_t len, struct pvp_start *s,
                                        struct pvx_diag *d);
PVX_MUST_CHECK pvx_err pvp_decode_volume(const void *msg, size_t len, struct pvp_view *out,
                                         struct pvx_diag *d);
/* Error bars: a view like a volume's, whose samples are standard deviations, and bits of enum pvp_doubt; unknown bits
 * count as doubt too. */
PVX_MUST_CHECK pvx_err pvp_decode_bars(const void *msg, size_t len, struct pvp_view *out,
                                       uint32_t *doubt, struct pvx_diag *d);
/* Whether the bars belong to the volume: same session, set, grid and bricks. */
bool pvp_bars_fit(const struct pvp_view *bars, const struct pvp_view *volume);
typedef struct pvp_decoder pvp_decoder;
PVX_MUST_CHECK pvx_err pvp_decoder_new(pvp_decoder **out);
void pvp_decoder_free(pvp_decoder **dec);
/* dense [nz][ny][nx][channels] out, zeroed first; count must be pvp_grid_count.  Errors:
 * PVX_EINVAL (count), PVX_ECORRUPT (does not decompress to the stated size, not finite),
 * PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err pvp_volume_unpack(pvp_decoder *dec, const struct pvp_view *v, float *dense,
                                         size_t count, struct pvx_diag *d);
/* The bricks themselves, as float32 [n_bricks][8][8][8][channels], cells outside the grid 0, and their ids;
 * count: room in `brick`.  No dense volume is made.  Errors: as pvp_volume_unpack. */
PVX_MUST_CHECK pvx_err pvp_volume_bricks(pvp_decoder *dec, const struct pvp_view *v, uint32_t *ids,
                                         float *brick, size_t count, struct pvx_diag *d);
/* The payload uncompressed, v->raw_len bytes as samples of v->sample, borrowed from the message or the decoder.
 * Errors: PVX_ECORRUPT, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err pvp_volume_payload(pvp_decoder *dec, const struct pvp_view *v,
                                          const uint8_t **raw, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err pvp_decode_status(const void *msg, size_t len, const char **json,
                                         size_t *json_len, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err pvp_decode_end(const void *msg, size_t len, uint64_t *session,
                                      char reason[PVP_REASON_MAX], struct pvx_diag *d);
/* The text is borrowed from the message and not zero-terminated. */
PVX_MUST_CHECK pvx_err pvp_decode_rig(const void *msg, size_t len, uint64_t *rig_hash,
                                      const char **yaml, size_t *yaml_len, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err pvp_decode_event(const void *msg, size_t len, const char **json,
                                        size_t *json_len, struct pvx_diag *d);
/* Pictures are not decoded here.  A reader that decodes a JPEG must check its size against width and height. */
PVX_MUST_CHECK pvx_err pvp_decode_preview(const void *msg, size_t len, struct pvp_preview *out,
                                          struct pvx_diag *d);
#ifdef __cplusplus
}
#endif
#endif
