#include "daemon/pipeline/cameras_in.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "daemon/pipeline/stage.h"

#define BAD_NS             (10 * PVX_NS_PER_S)
#define UNKNOWN_SETS       200 /* a camera that gives its temperature has done so within these */
#define WAIT_SUBSCRIBER_NS (20 * PVX_NS_PER_MS)

/* How many cameras' images a set must have to be solved. */
static uint32_t images_needed(const struct dmn_cameras_in *in, const struct cap_set *set)
{
    bool all = in->sets.policy == CAP_POLICY_DROP || set->n < in->sets.min_cameras;
    return all ? set->n : in->sets.min_cameras;
}

/* A set that is too old makes way for a newer one if there is one. */
static struct cap_set *cameras_in_newest(struct dmn_cameras_in *in, struct cap_set *set,
                                         uint64_t *passed_over)
{
    int64_t stale_ns = atomic_load(&in->stale_ns);
    while (stale_ns > 0 && pvx_now_mono() - set->t_last_mono_ns > stale_ns) {
        struct cap_set *next;
        if (cap_capture_next(in->capture, 0, &next) != PVX_OK)
            break;
        ++*passed_over;
        cap_set_release(set);
        set = next;
    }
    return set;
}

/* Whether camera c is the one that the rig's photometry was measured on; if not, its pictures are not used.
 * A temperature too far from that of its dark is only logged, once until it fits again. */
static bool cameras_in_is_ours(struct dmn_cameras_in *in, size_t c)
{
    const struct rec_camera *k = &in->rig->cameras[c];
    const struct rec_photometry *p = &k->photometry;
    struct dmn_camera_said *said = &in->said[c];
    struct cap_health h;
    if (p->device[0] == '\0' && p->dark.file[0] == '\0')
        return true;
    cap_capture_health(in->capture, (uint32_t)c, &h);
    bool other = p->device[0] != '\0' && h.serial[0] != '\0' && strcmp(p->device, h.serial) != 0;
    if (other && !said->other)
        LOG_ABOUT(
            PVX_LOG_ERROR, DAEMON, ABOUT(.cause = "other_device", .camera = k->name),
            "camera %s is %s, but the rig's photometry was measured on %s: %s; plug that one in, "
            "or measure this one (pyrovox calibrate dark, flat)",
            k->name, h.serial, p->device,
            in->sets.policy == CAP_POLICY_DROP ? "no set is whole (sync.policy: drop)"
                                               : "it is left out");
    bool far = !other && dmn_photometry_too_far(k, h.temperature_c);
    if (far && !said->far)
        LOG_ABOUT(
            PVX_LOG_WARN, DAEMON, ABOUT(.cause = "temperature", .camera = k->name),
            "camera %s has %.1f degrees Celsius, but its dark is of %.1f: let it warm up, or take "
            "darks as it is (pyrovox calibrate dark)",
            k->name, h.temperature_c, p->temperature);
    if (isfinite(h.temperature_c) && p->has_temperature)
        said->unknown = 0;
    else if (p->dark.file[0] != '\0' && ++said->unknown == UNKNOWN_SETS)
        LOG_ABOUT(PVX_LOG_INFO, DAEMON, ABOUT(.cause = "temperature", .camera = k->name),
                  "camera %s: its dark's temperature is not checked: %s", k->name,
                  p->has_temperature ? "the camera does not say its own"
                                     : "the rig does not say it");
    said->other = other;
    said->far = far || (said->far && fabs(h.temperature_c - p->temperature) > DMN_DARK_DEGREES - 1);
    return !other;
}

/* Log an image that cannot be used: the first of a camera, then one in BAD_NS. */
static void cameras_in_say(struct dmn_cameras_in *in, size_t c, bool bad)
{
    int64_t *said = &in->said[c].bad_ns, now = pvx_now_mono();
    if (bad && (*said == 0 || now - *said > BAD_NS)) {
        *said = now;
        LOG_ABOUT(
            PVX_LOG_WARN, DAEMON, ABOUT(.cause = "bad_image", .camera = in->rig->cameras[c].name),
            "camera %s: image cannot be used: %s%s", in->rig->cameras[c].name,
            dmn_images_why(in->images, c),
            in->sets.policy == CAP_POLICY_DROP ? "; no set is whole (sync.policy: drop)" : "");
    }
}

/* Log, once, that a camera has fewer bits than its format. */
static void cameras_in_bits(struct dmn_cameras_in *in, size_t c, enum cap_pixfmt fmt)
{
    const char *name = in->rig->cameras[c].name;
    int bits = dmn_images_bits(in->images, c), most = (1 << bits) - 1;
    char room[120];
    if (bits == in->said[c].bits || bits == 0)
        return;
    in->said[c].bits = bits;
    LOG_ABOUT(PVX_LOG_WARN, DAEMON, ABOUT(.cause = "depth", .camera = name),
              "camera %s: samples of its %s images go up to %d and stop there: these are %d bits, "
              "saturated at %d; %s",
              name, cap_pixfmt_name(fmt), most, bits, most,
              cap_depth_remedy(fmt, bits, "pixel_format: ", room));
}

/* Bin the set's images into the slot. */
static void cameras_in_load(struct dmn_cameras_in *in, const struct cap_set *set,
                            struct dmn_slot *s)
{
    const struct cap_image *image[REC_MAX_CAMERAS] = {0};
    int64_t t0 = pvx_now_mono();
    for (size_t c = 0; c < in->rig->n_cameras; c++)
        image[c] = set->frame[c] != NULL && cameras_in_is_ours(in, c) ? &set->frame[c]->img : NULL;
    s->n_present = dmn_images_bin_frame(in->images, image, s->frame, &s->mask);
    s->bin_ns = pvx_now_mono() - t0;
    for (size_t c = 0; c < in->rig->n_cameras; c++) {
        cameras_in_say(in, c, image[c] != NULL && !(s->mask >> c & 1));
        if (image[c] != NULL)
            cameras_in_bits(in, c, image[c]->fmt);
    }
}

static pvx_err cameras_in_next(void *ctx, struct dmn_slot *s)
{
    struct dmn_cameras_in *in = ctx;
    struct cap_set *set;
    if (in->wait_for != NULL && !atomic_load(in->stopping)) {
        if (atomic_load(in->wait_for) == 0) {
            pvx_sleep_until_mono(pvx_now_mono() + WAIT_SUBSCRIBER_NS);
            return PVX_ETIMEDOUT;
        }
        in->wait_for = NULL; /* from now on sets are taken without subscribers too */
    }
    PVX_TRY(cap_capture_next(in->capture, DMN_STAGE_WAIT_NS, &set));
    set = cameras_in_newest(in, set, &s->passed_over);
    s->set = set->number;
    s->t_exposure_ns = set->t_exposure_ns;
    s->spread_ns = set->spread_ns;
    s->t_last_mono_ns = set->t_last_mono_ns;
    cameras_in_load(in, set, s);
    if (s->n_present == 0 || s->n_present < images_needed(in, set))
        s->why = DMN_DROP_IMAGES;
    else if (in->background != NULL)
        dmn_background_look(in->background, s, *in->pipeline);
    if (s->why == DMN_N_DROP)
        dmn_instant_look(in->instant, set);
    cap_set_release(set);
    return PVX_OK;
}

struct dmn_source dmn_cameras_source(struct dmn_cameras_in *in)
{
    return (struct dmn_source){.next = cameras_in_next, .ctx = in};
}
