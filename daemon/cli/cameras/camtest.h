/* camtest.h - all cameras opened together, watched for some seconds, and judged.
 *
 * Measured for each camera: frames, rate, bytes, intervals by its own stamps and by arrival, lost frames and their
 * causes, how far its exposures lie from the middle of their sets, and whether its blacks are clipped.  For all
 * together: the spread of the sets.
 * Intervals are taken only between frames with successive numbers, so that a lost frame does not also count as
 * jitter.  Counts are of the measured time only, without the time in which cameras were opened.
 * Threads: one test belongs to one thread.  Frames outside of sets come from capture's threads. */
#ifndef CAMTEST_H
#define CAMTEST_H
#include <pthread.h>
#include <stdio.h>
#include "daemon/cli/common/cli.h"
#include "daemon/pipeline/scene.h"
#include "daemon/pipeline/sources.h"

/* Welford's mean and variance, and the extremes; seconds. */
struct camtest_series {
    uint64_t n;
    double mean, m2, min, max;
};
void camtest_add(struct camtest_series *s, double v);
double camtest_std(const struct camtest_series *s);
double camtest_worst(const struct camtest_series *s); /* farthest from the mean */

enum camtest_verdict { CAMTEST_OK, CAMTEST_WARN, CAMTEST_FAIL };
struct camtest_camera {
    char name[REC_NAME_MAX + 1];
    bool seen; /* it has given a frame, measured or not */
    uint64_t frames, bytes;
    int64_t first_mono_ns, last_mono_ns;
    uint64_t last_id;
    int64_t last_device_ns, last_arrival_ns;
    int32_t width, height;
    enum cap_pixfmt fmt;
    struct camtest_series device, arrival, offset; /* offset: exposure - mean of its set */
    uint64_t base[CAP_N_COUNT], count[CAP_N_COUNT];
    struct cap_camera_stats stats;
    struct cap_set *last; /* holds the last frame */
    double cut, pedestal; /* of rec_photo_say_cut, by camtest_look */
    /* filled in by camtest_judge */
    double hz;
    enum camtest_verdict verdict;
    char what[320], remedy[320];
};

struct camtest {
    uint32_t n;
    double fps, seconds, measured_s;
    bool triggered, ptp, measuring, interrupted;
    struct dmn_sources sources;
    struct rec_rig rig;
    struct rec_camera *made; /* cameras of a rig that was made up */
    dmn_scene *scene;
    cap_capture *capture;
    pthread_mutex_t lock; /* camera[] while capture runs */
    struct camtest_camera camera[REC_MAX_CAMERAS];
    struct camtest_series spread;
    struct pvx_hist spread_hist;
    uint64_t sets, by_size[REC_MAX_CAMERAS + 1]; /* by_size[k]: sets with k cameras */
    /* filled in by camtest_judge */
    uint64_t whole;               /* sets with every camera that gives frames */
    enum camtest_verdict verdict; /* of the sets */
    char what[320], remedy[320];
};

struct camtest_options {
    const char *config;     /* pyrovoxd.yaml, or NULL: */
    const char *const *uri; /* [n] */
    size_t n;
    const char *pixel_format, *trigger; /* NULL = as configured */
    double fps, seconds;                /* fps 0 = as configured */
    int32_t width, height;              /* 0 = as the camera has it */
};

/* Owner: caller, camtest_free.  Errors: the configuration's, capture's. */
PVX_MUST_CHECK pvx_err camtest_new(const struct camtest_options *o, struct camtest **out,
                                   struct pvx_diag *d);
/* Measure until the time is over or cli_stop (then `interrupted` is set).  Progress goes to stderr. */
PVX_MUST_CHECK pvx_err camtest_run(struct camtest *t, struct pvx_diag *d);
/* Look at the blacks of the last pictures. */
PVX_MUST_CHECK pvx_err camtest_look(struct camtest *t, struct pvx_diag *d);
void camtest_judge(struct camtest *t);
/* Save a picture of each camera that gave one as DIR/NAME.png. */
PVX_MUST_CHECK pvx_err camtest_save(const struct camtest *t, const char *dir, struct pvx_diag *d);
void camtest_print(FILE *f, const struct camtest *t, int width);
PVX_MUST_CHECK pvx_err camtest_print_json(FILE *f, const struct camtest *t, struct pvx_diag *d);
void camtest_free(struct camtest **t);

#endif
