#include "capture/gev/chunk.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "capture/gev/err.h"
#include "capture/gev/feature.h"
#include "capture/gev/find.h"
#include "capture/gev/ticks.h"

static bool enable(ArvCamera *cam, const char *selector, const char *feature)
{
    GError *err = NULL;
    if (!arv_camera_is_enumeration_entry_available(cam, "ChunkSelector", selector, NULL) ||
        arv_device_get_feature(arv_camera_get_device(cam), feature) == NULL)
        return false;
    arv_camera_set_chunk_state(cam, selector, TRUE, &err);
    bool on = err == NULL && arv_camera_get_chunk_state(cam, selector, &err) && err == NULL;
    g_clear_error(&err);
    return on;
}

pvx_err aravis_chunks_init(struct aravis_chunks *k, const struct cap_source_config *c,
                           ArvCamera *cam, struct pvx_diag *d)
{
    memset(k, 0, sizeof *k);
    GError *err = NULL;
    if (!c->chunks && !c->lines) {
        /* chunks that another program left on would only cost time */
        if (!aravis_asks(c, "ChunkModeActive") && arv_camera_are_chunks_available(cam, NULL))
            arv_camera_set_chunk_mode(cam, FALSE, NULL);
        return PVX_OK;
    }
    if (!arv_camera_are_chunks_available(cam, NULL))
        return aravis_lacks(c, cam, c->chunks ? "chunks" : "triggers: when: line",
                            "ChunkModeActive", d);
    arv_camera_set_chunk_mode(cam, TRUE, &err);
    if (err != NULL)
        return aravis_fail(c, PVX_EINVAL, "chunks", &err, d);
    if (c->chunks) {
        k->exposure = enable(cam, "ExposureTime", "ChunkExposureTime");
        k->gain = enable(cam, "Gain", "ChunkGain");
        k->id = enable(cam, "FrameID", "ChunkFrameID");
        k->time = enable(cam, "Timestamp", "ChunkTimestamp");
    }
    k->lines = c->lines && enable(cam, "LineStatusAll", "ChunkLineStatusAll");
    if (c->lines && !k->lines)
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                        "triggers: when: line: the camera does not send ChunkLineStatusAll, the "
                        "levels of its lines, with its frames: name a camera that does, or take "
                        "another condition");
    if (c->chunks && !k->exposure && !k->gain)
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                        "chunks refused: the camera sends neither exposure "
                        "time nor gain with its frames");
    k->tick_hz = aravis_tick_hz(cam);
    aravis_parser_lock();
    k->parser = arv_camera_create_chunk_parser(cam);
    aravis_parser_unlock();
    return k->parser != NULL ? PVX_OK : PVX_EIO;
}

void aravis_chunks_fini(struct aravis_chunks *k)
{
    g_clear_object(&k->parser);
}

static bool read_float(const struct aravis_chunks *k, ArvBuffer *b, const char *name, double *out)
{
    GError *err = NULL;
    double v = arv_chunk_parser_get_float_value(k->parser, b, name, &err);
    bool ok = err == NULL && isfinite(v);
    g_clear_error(&err);
    if (ok)
        *out = v;
    return ok;
}

static bool read_int(const struct aravis_chunks *k, ArvBuffer *b, const char *name, int64_t *out)
{
    GError *err = NULL;
    *out = arv_chunk_parser_get_integer_value(k->parser, b, name, &err);
    bool ok = err == NULL;
    g_clear_error(&err);
    return ok;
}

bool aravis_chunks_read(struct aravis_chunks *k, ArvBuffer *b, struct cap_frame *f, uint64_t *id)
{
    int64_t n, t;
    f->exposure_us = f->gain = NAN;
    if (k->parser == NULL)
        return true;
    if (arv_buffer_get_payload_type(b) == ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA &&
        !arv_buffer_has_chunks(b)) {
        atomic_store(&k->unread, true);
        return true;
    }
    if ((k->exposure && !read_float(k, b, "ChunkExposureTime", &f->exposure_us)) ||
        (k->gain && !read_float(k, b, "ChunkGain", &f->gain)))
        return false;
    if (k->lines) {
        if (!read_int(k, b, "ChunkLineStatusAll", &n))
            return false;
        f->lines = (uint64_t)n;
        f->lines_known = true;
    }
    if (k->id) {
        if (!read_int(k, b, "ChunkFrameID", &n))
            return false;
        *id = (uint64_t)n;
    }
    if (k->time) {
        if (!read_int(k, b, "ChunkTimestamp", &t))
            return false;
        /* Some cameras count in ticks, some in ns, some from another moment.  Only a time near the stamp of the
         * leader is from the same clock. */
        t = aravis_ticks_to_ns((uint64_t)t, k->tick_hz);
        if (f->t_device_ns == 0 ||
            (t >= 0 && f->t_device_ns > 0 && llabs(t - f->t_device_ns) < PVX_NS_PER_S))
            f->t_device_ns = t;
    }
    return true;
}
