/* photo_pass.h - the loops of photo.c over the bins of a band, compiled once per instruction set.
 *
 * They run over floats, independent of the channels: 32 floats at a time are 8 bins of colour or 32 of grey.  No
 * sum depends on the instruction set.
 * Private to photo*.c. */
#ifndef REC_PHOTO_PASS_H
#define REC_PHOTO_PASS_H
#include "base/cpu.h"
#include "recon/carve/bands.h"
#include "recon/carve/clipped.h"
#include "recon/carve/photo.h"
#include "recon/carve/photo_mosaic.h"

#define REC_PHOTO_BLOCK  8   /* bins per side of a block in which noise is measured */
#define REC_PHOTO_BLOCKS 400 /* blocks at most, spread over the image */

enum { REC_UNLIT = 0, REC_LIT = 1, REC_FORCED = 2 };

/* Noise of up to three channels in one block, its lowest value and the share of bins that have it. */
struct rec_photo_block {
    rec_f4 mean, noise2, low, at_low;
    bool measured; /* there were enough bins */
};

/* A band's part of its picture's sums. */
struct rec_photo_band {
    rec_f4 low;    /* least value of the bins with weight */
    double sum[4]; /* over the lit bins; number of them */
    uint32_t hits;
    uint32_t saturated, not_finite, lit;
    int32_t peak; /* bits of the brightest bin's float; above 0 they have the order of the floats */
};

/* A channel's least value, and of the darker half of its blocks: the lower quartile of means, the medians of noise2 and
 * of the share of bins that have the least value. */
struct rec_photo_dark {
    float low, mean, noise2, at_low;
};

struct rec_photo_work {
    struct rec_photo_band *band; /* [bands] */
    uint8_t *raw, *clean;        /* [bh*bw] REC_LIT and REC_FORCED; despeckled */
    struct rec_grain grain;
    float sigma[3], dark[3]; /* of each channel */
    struct rec_photo_dark half[3];
    rec_f4 limit, faint,
        fainter;       /* for a bin and for means over 3x3 and 7x7; lanes without a channel INF */
    bool means, noisy; /* judge means over 3x3; over 7x7 */
    struct rec_clipped clipped[3];
    const float *above; /* [3] least values above the clip level; NULL: clipped.c looks for them */
    float inverse[REC_CLIPPED_KNOTS];
    struct rec_photo_block block[REC_PHOTO_BLOCKS];
};

/* Blocks of an image: `across` in a row, every `every`-th of `all` is measured. */
struct rec_photo_blocks {
    int32_t across, all, every;
};
static inline struct rec_photo_blocks rec_photo_blocks(const struct rec_photo_image *im)
{
    int32_t across = (im->bw + REC_PHOTO_BLOCK - 1) / REC_PHOTO_BLOCK;
    int32_t all = across * ((im->bh + REC_PHOTO_BLOCK - 1) / REC_PHOTO_BLOCK);
    return (struct rec_photo_blocks){across, all, (all + REC_PHOTO_BLOCKS - 1) / REC_PHOTO_BLOCKS};
}

struct rec_photo_passes {
    /* (1) of photo.h: b, weight and forced bins; low and the blocks that lie in the band */
    void (*linear)(const struct rec_photo_image *im, int32_t band);
    /* sigma and dark of channel c from all blocks */
    void (*noise)(const struct rec_photo_image *im, int32_t c);
    /* (2) of photo.h */
    void (*plane)(const struct rec_photo_image *im, int32_t band);
    /* bins that reach `limit` and means over 3x3 that reach `faint`; sum, hits */
    void (*judge)(const struct rec_photo_image *im, int32_t band);
    /* means over 7x7 that reach `fainter` */
    void (*widen)(const struct rec_photo_image *im, int32_t band);
    /* raw to 0/1 in `out`, without lone bins if `despeckle`; counts lit */
    void (*finish)(const struct rec_photo_image *im, int32_t band, bool despeckle, uint8_t *out);
};

/* Fill the table for `cpu`: all slots with the reference, then an instruction set's over them. */
void rec_photo_passes_init(struct rec_photo_passes *p, enum pvx_cpu cpu);
/* One function of each file, which overwrites the slots that the file implements. */
void rec_photo_passes_ref(struct rec_photo_passes *p);
#if defined(__x86_64__)
void rec_photo_passes_avx2(struct rec_photo_passes *p);
#endif

#endif
