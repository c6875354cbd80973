#include "capture/libcamera/shim.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <vector>

#include <fcntl.h>
#include <linux/dma-buf.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <libcamera/libcamera.h>

#include "base/guarded.hpp"

using namespace libcamera;

/* One mapped buffer; data is the start of its first plane. */
struct Mapping {
    void *base = MAP_FAILED;
    size_t bytes = 0;
    const uint8_t *data = nullptr;
    int file = -1;
};
struct cap_lc_memory {
    std::vector<Mapping> buffer;
    ~cap_lc_memory()
    {
        for (const Mapping &m : buffer) {
            munmap(m.base, m.bytes);
            close(m.file);
        }
    }
};

struct cap_lc_camera {
    std::shared_ptr<Camera> camera;
    std::unique_ptr<CameraConfiguration> config;
    std::unique_ptr<FrameBufferAllocator> allocator;
    std::vector<std::unique_ptr<Request>> request; /* one per buffer */
    std::vector<bool> used;                        /* request was queued since start */
    Stream *stream = nullptr;
    cap_lc_memory *memory = nullptr; /* the caller's */
    ControlList controls{controls::controls};
    cap_lc_sink sink{};
    bool running = false;
    bool gone = false; /* under `calling`: unplugged */
    unsigned seen = 0;
    std::mutex calling; /* held during a callback; sink is empty when none may come */

    std::mutex lock; /* of text */
    std::string text;

    void done(Request *r);
    void compare(const ControlList &said);
};

namespace
{

std::string system_text(const char *what, int negative_errno)
{
    return std::string(what) + ": " + strerror(-negative_errno);
}

/* ---- the one manager of the process ------------------------------------------------------------- */

/* Made on first use and ended at exit, unless a camera is still open then, because libcamera would wait for it. */
struct Manager {
    std::mutex lock;
    std::unique_ptr<CameraManager> manager;
    unsigned open = 0;
    std::vector<cap_lc_camera *> unplugged; /* still open in libcamera */

    ~Manager()
    {
        if (open > 0)
            (void)manager.release();
        else if (manager)
            manager->stop();
    }
    int start(std::string &why)
    {
        if (manager)
            return PVX_OK;
        auto m = std::make_unique<CameraManager>();
        int r = m->start();
        if (r != 0) {
            why = system_text("the camera manager does not start", r);
            return PVX_EIO;
        }
        manager = std::move(m);
        return PVX_OK;
    }
};

Manager &the_manager()
{
    static Manager m;
    return m;
}

std::shared_ptr<Camera> find(const std::string &id)
{
    for (const std::shared_ptr<Camera> &c : the_manager().manager->cameras())
        if (c->id() == id)
            return c;
    return nullptr;
}

/* ---- controls ----------------------------------------------------------------------------------- */

const ControlId *control_named(const Camera &c, const std::string &name)
{
    for (const auto &[id, info] : c.controls())
        if (id->name() == name)
            return id;
    return nullptr;
}

double number(const ControlValue &v)
{
    if (v.isArray())
        return NAN;
    switch (v.type()) {
    case ControlTypeBool: return v.get<bool>();
    case ControlTypeByte: return v.get<uint8_t>();
    case ControlTypeInteger32: return v.get<int32_t>();
    case ControlTypeInteger64: return static_cast<double>(v.get<int64_t>());
    case ControlTypeFloat: return v.get<float>();
    default: return NAN;
    }
}

bool parse_numbers(const char *text, std::vector<double> &out)
{
    std::string word;
    std::stringstream all(text);
    while (std::getline(all, word, ',')) {
        if (word == "true" || word == "false") {
            out.push_back(word == "true");
            continue;
        }
        char *end = nullptr;
        double v = strtod(word.c_str(), &end);
        if (end == word.c_str() || *end != '\0' || !std::isfinite(v))
            return false;
        out.push_back(v);
    }
    return !out.empty();
}

/* The library's own span: libcamera::Span, or std::span after 0.7. */
template <typename> struct span_rebound;
template <template <typename, size_t> class S, typename T, size_t N> struct span_rebound<S<T, N>> {
    template <typename U> using of = S<U, static_cast<size_t>(-1)>; /* dynamic_extent of both */
};
template <typename U>
using LibSpan =
    typename span_rebound<decltype(std::declval<const ControlValue &>().data())>::template of<U>;

template <typename T> ControlValue value_of(const std::vector<double> &v)
{
    std::vector<T> all;
    for (double x : v)
        all.push_back(static_cast<T>(x));
    if (all.size() == 1)
        return ControlValue(all[0]);
    return ControlValue(LibSpan<const T>(all.data(), all.size()));
}

bool make_value(ControlType type, const std::vector<double> &v, ControlValue &out)
{
    switch (type) {
    case ControlTypeBool: out = ControlValue(v[0] != 0); return v.size() == 1;
    case ControlTypeByte: out = value_of<uint8_t>(v); return true;
    case ControlTypeInteger32: out = value_of<int32_t>(v); return true;
    case ControlTypeInteger64: out = value_of<int64_t>(v); return true;
    case ControlTypeFloat: out = value_of<float>(v); return true;
    default: return false;
    }
}

int set_control(cap_lc_camera &c, const std::string &name, const char *value, std::string &why)
{
    const ControlId *id = control_named(*c.camera, name);
    if (id == nullptr) {
        why = "has no control " + name + "; there are:";
        for (const auto &[known, info] : c.camera->controls())
            why += " " + known->name();
        return PVX_EINVAL;
    }
    std::vector<double> v;
    ControlValue out;
    if (!parse_numbers(value, v) || !make_value(id->type(), v, out)) {
        why = "control " + name + ": '" + value +
              "' should be a number, true or false (several with commas)";
        return PVX_EINVAL;
    }
    const ControlInfo &info = c.camera->controls().at(id->id());
    double lo = number(info.min()), hi = number(info.max());
    for (double x : v)
        if (x < lo || x > hi) {
            why = "control " + name + ": " + value + " is outside " + info.toString();
            return PVX_EINVAL;
        }
    c.controls.set(id->id(), out);
    return PVX_OK;
}

bool has(const cap_lc_camera &c, const char *name)
{
    return control_named(*c.camera, name) != nullptr;
}

/* Set a number, converted to the control's own type. */
int set_number(cap_lc_camera &c, const char *name, double v, std::string &why)
{
    const ControlId *id = control_named(*c.camera, name);
    bool whole = id != nullptr && id->type() != ControlTypeFloat;
    char text[64];
    snprintf(text, sizeof text, whole ? "%.0f" : "%.9g", v);
    return set_control(c, name, text, why);
}

int set_controls(cap_lc_camera &c, const cap_lc_config &cfg, cap_lc_layout &layout,
                 std::string &why)
{
    layout.has_duration = has(c, "FrameDurationLimits");
    if (cfg.frame_us > 0 && layout.has_duration) {
        std::array<int64_t, 2> both{cfg.frame_us, cfg.frame_us};
        c.controls.set(controls::FrameDurationLimits, both);
    }
    /* Since 0.5 exposure and gain have separate automatic modes.  Before, they share one. */
    if (cfg.exposure_us >= 0 && has(c, "ExposureTimeMode"))
        PVX_TRY(static_cast<pvx_err>(set_number(c, "ExposureTimeMode", 1, why)));
    if (cfg.gain >= 0 && has(c, "AnalogueGainMode"))
        PVX_TRY(static_cast<pvx_err>(set_number(c, "AnalogueGainMode", 1, why)));
    if (cfg.exposure_us >= 0 && !has(c, "ExposureTimeMode") && has(c, "AeEnable"))
        PVX_TRY(static_cast<pvx_err>(set_number(c, "AeEnable", 0, why)));
    if (cfg.exposure_us >= 0)
        PVX_TRY(static_cast<pvx_err>(set_number(c, "ExposureTime", cfg.exposure_us, why)));
    if (cfg.gain >= 0)
        PVX_TRY(static_cast<pvx_err>(set_number(c, "AnalogueGain", cfg.gain, why)));
    const ControlList ours = c.controls;
    for (size_t i = 0; i < cfg.n_controls; i++) {
        const cap_lc_control &k = cfg.control[i];
        PVX_TRY(static_cast<pvx_err>(set_control(c, k.name, k.value, why)));
        for (const auto &[id, value] : ours)
            if (c.controls.get(id) != value) {
                why = "fps, exposure_us or gain sets " + std::string(k.name) + " to " +
                      value.toString() + ", and `features: " + k.name + ": " + k.value +
                      "` disagrees; leave one of them out";
                return PVX_EINVAL;
            }
    }
    return PVX_OK;
}

/* ---- configuration ------------------------------------------------------------------------------ */

std::unique_ptr<CameraConfiguration> configuration(Camera &camera, bool raw)
{
    static const StreamRole processed[] = {StreamRole::VideoRecording, StreamRole::Viewfinder,
                                           StreamRole::StillCapture, StreamRole::Raw};
    static const StreamRole unprocessed[] = {StreamRole::Raw, StreamRole::VideoRecording,
                                             StreamRole::Viewfinder, StreamRole::StillCapture};
    for (StreamRole role : raw ? unprocessed : processed) {
        auto c = camera.generateConfiguration({role});
        if (c && !c->empty())
            return c;
    }
    return nullptr;
}

std::vector<cap_lc_mode> modes_of(const StreamConfiguration &s)
{
    std::vector<cap_lc_mode> out;
    auto add = [&](const PixelFormat &f, const Size &size) {
        out.push_back({{f.fourcc(), f.modifier()},
                       static_cast<int32_t>(size.width),
                       static_cast<int32_t>(size.height)});
    };
    add(s.pixelFormat, s.size); /* the camera's own choice comes first */
    for (const PixelFormat &f : s.formats().pixelformats())
        for (const Size &size : s.formats().sizes(f))
            add(f, size);
    return out;
}

int configure(cap_lc_camera &c, const cap_lc_config &cfg, cap_lc_layout &layout, std::string &why)
{
    c.config = configuration(*c.camera, cfg.raw != 0);
    if (!c.config) {
        why = "offers no stream";
        return PVX_EUNSUP;
    }
    StreamConfiguration &s = c.config->at(0);
    std::vector<cap_lc_mode> modes = modes_of(s);
    int32_t w = 0, h = 0;
    int i = cfg.choose(cfg.choose_ctx, modes.data(), modes.size(), &w, &h);
    if (i < 0 || static_cast<size_t>(i) >= modes.size())
        return PVX_EUNSUP;
    const PixelFormat wanted(modes[i].format.fourcc, modes[i].format.modifier);
    const Size size(static_cast<unsigned>(w > 0 ? w : modes[i].width),
                    static_cast<unsigned>(h > 0 ? h : modes[i].height));
    s.pixelFormat = wanted;
    s.size = size;
    s.bufferCount = cfg.buffers;
    if (c.config->validate() == CameraConfiguration::Invalid || s.pixelFormat != wanted ||
        s.size != size) {
        why =
            "does " + s.toString() + " when asked for " + size.toString() + "-" + wanted.toString();
        return PVX_EUNSUP;
    }
    int r = c.camera->configure(c.config.get());
    if (r != 0) {
        why = system_text("cannot be configured", r);
        return PVX_EIO;
    }
    c.stream = s.stream();
    layout.mode = {{s.pixelFormat.fourcc(), s.pixelFormat.modifier()},
                   static_cast<int32_t>(s.size.width),
                   static_cast<int32_t>(s.size.height)};
    layout.stride = s.stride;
    layout.frame_bytes = s.frameSize;
    layout.rec709 =
        s.colorSpace && s.colorSpace->ycbcrEncoding == ColorSpace::YcbcrEncoding::Rec709;
    layout.transfer_rec709 =
        s.colorSpace && s.colorSpace->transferFunction == ColorSpace::TransferFunction::Rec709;
    layout.full_range = !s.colorSpace                                    ? CAP_LC_RANGE_UNKNOWN
                        : s.colorSpace->range == ColorSpace::Range::Full ? CAP_LC_RANGE_FULL
                                                                         : CAP_LC_RANGE_LIMITED;
    return PVX_OK;
}

int map_buffers(cap_lc_camera &c, cap_lc_memory &m, std::string &why)
{
    c.allocator = std::make_unique<FrameBufferAllocator>(c.camera);
    int r = c.allocator->allocate(c.stream);
    if (r < 0) {
        why = system_text("gives no buffers", r);
        return PVX_EIO;
    }
    for (const std::unique_ptr<FrameBuffer> &b : c.allocator->buffers(c.stream)) {
        const FrameBuffer::Plane &p = b->planes().front();
        size_t offset = p.offset == FrameBuffer::Plane::kInvalidOffset ? 0 : p.offset;
        Mapping map;
        map.bytes = offset + p.length;
        map.base = mmap(nullptr, map.bytes, PROT_READ, MAP_SHARED, p.fd.get(), 0);
        if (map.base == MAP_FAILED) {
            why = system_text("a buffer cannot be mapped", -errno);
            return PVX_EIO;
        }
        map.file = fcntl(p.fd.get(), F_DUPFD_CLOEXEC, 3);
        map.data = static_cast<const uint8_t *>(map.base) + offset;
        std::unique_ptr<Request> q = c.camera->createRequest(m.buffer.size());
        m.buffer.push_back(map);
        if (!q || q->addBuffer(c.stream, b.get()) != 0) {
            why = "a request cannot be made";
            return PVX_EIO;
        }
        c.request.push_back(std::move(q));
    }
    return PVX_OK;
}

/* Prepare the caches for reads by the CPU.  No effect with coherent caches or for memory that is not a DMABUF. */
void cpu_reads(int file, uint64_t when)
{
    struct dma_buf_sync sync = {when | DMA_BUF_SYNC_READ};
    (void)ioctl(file, DMA_BUF_IOCTL_SYNC, &sync);
}

/* Whether this is a frame that the sensor needs to start.  Only later libcameras have this status. */
template <typename M> auto starting(const M &m, int) -> decltype(M::FrameStartup, true)
{
    return m.status == M::FrameStartup;
}
template <typename M> bool starting(const M &, long)
{
    return false;
}

/* Bytes used of the first plane.  Images with several planes are never requested. */
size_t bytes_used(const FrameMetadata &m)
{
    return m.planes().empty() ? 0 : m.planes()[0].bytesused;
}

} // namespace

/* ---- frames: on libcamera's thread -------------------------------------------------------------- */

void cap_lc_camera::compare(const ControlList &said)
{
    std::string differ;
    for (const auto &[id, value] : controls) {
        if (!said.contains(id) || said.get(id) == value)
            continue;
        double is = number(said.get(id)), asked = number(value);
        if (std::fabs(is - asked) <= 0.01 * std::fabs(asked)) /* sensors count in lines */
            continue;
        differ += (differ.empty() ? "" : ", ") + controls::controls.at(id)->name() + " is " +
                  said.get(id).toString() + ", asked " + value.toString();
    }
    const std::lock_guard<std::mutex> hold(lock);
    text = differ;
}

void cap_lc_camera::done(Request *r)
{
    const std::lock_guard<std::mutex> hold_calls(calling);
    if (r->status() == Request::RequestCancelled || r->buffers().empty() || sink.frame == nullptr)
        return; /* being stopped */
    const FrameMetadata &m = r->buffers().begin()->second->metadata();
    const ControlList &said = r->metadata();
    cap_lc_frame f{};
    f.index = static_cast<uint32_t>(r->cookie());
    const Mapping &map = memory->buffer[f.index];
    f.data = map.data;
    f.bytes = bytes_used(m);
    cpu_reads(map.file, DMA_BUF_SYNC_START);
    f.sequence = m.sequence;
    f.stamp_ns = said.get(controls::SensorTimestamp).value_or(static_cast<int64_t>(m.timestamp));
    const auto exposure = said.get(controls::ExposureTime);
    const auto gain = said.get(controls::AnalogueGain);
    const auto temperature = said.get(controls::SensorTemperature);
    f.exposure_us = exposure ? *exposure : NAN;
    f.gain = gain ? *gain : NAN;
    f.temperature_c = temperature ? *temperature : NAN;
    f.good = m.status == FrameMetadata::FrameSuccess;
    if (starting(m, 0))
        f.good = -1;
    if (f.bytes > map.bytes - static_cast<size_t>(map.data - static_cast<uint8_t *>(map.base)))
        f.good = 0;
    if (++seen == 10) { /* guarded: an exception in libcamera's thread would end the process */
        char err[64];
        (void)guarded(err, sizeof err, [&]() -> int {
            compare(said);
            return PVX_OK;
        });
    }
    sink.frame(sink.ctx, &f);
}

/* ---- entries ------------------------------------------------------------------------------------ */

namespace
{

int lc_list(void (*camera)(void *, const char *, const char *), void *ctx, char *err,
            size_t err_size) noexcept
{
    return guarded(err, err_size, [&]() -> int {
        Manager &m = the_manager();
        const std::lock_guard<std::mutex> hold(m.lock);
        std::string why;
        if (int e = m.start(why); e != PVX_OK)
            return fail(e, err, err_size, why);
        for (const std::shared_ptr<Camera> &c : m.manager->cameras()) {
            const auto model = c->properties().get(properties::Model);
            camera(ctx, c->id().c_str(), model ? std::string(*model).c_str() : "");
        }
        return PVX_OK;
    });
}

int lc_modes(const char *id, void (*mode)(void *, const cap_lc_mode *), void *ctx, char *err,
             size_t err_size) noexcept
{
    return guarded(err, err_size, [&]() -> int {
        Manager &m = the_manager();
        const std::lock_guard<std::mutex> hold(m.lock);
        std::shared_ptr<Camera> c = m.manager ? find(id) : nullptr;
        if (!c)
            return fail(PVX_ENOENT, err, err_size, "is gone");
        for (bool raw : {false, true}) {
            auto config = configuration(*c, raw);
            if (!config)
                continue;
            for (const cap_lc_mode &one : modes_of(config->at(0)))
                mode(ctx, &one);
        }
        return PVX_OK;
    });
}

void lc_close(cap_lc_camera *c) noexcept
{
    char err[64];
    (void)guarded(err, sizeof err, [&]() -> int {
        Manager &m = the_manager();
        const std::lock_guard<std::mutex> hold(m.lock);
        {
            /* libcamera does not take back the requests of an unplugged camera (0.0.3: stop() refuses, its video
             * device keeps pointers to the buffers and may still complete them).  They stay, with the camera, until
             * the program ends: some 2 MB of address space each time that a cable is pulled. */
            const std::lock_guard<std::mutex> hold_calls(c->calling);
            if (c->gone) {
                m.unplugged.push_back(c);
                return PVX_OK;
            }
        }
        c->request.clear();
        if (c->allocator && c->stream != nullptr)
            c->allocator->free(c->stream);
        c->allocator.reset();
        c->config.reset();
        if (c->camera)
            c->camera->release();
        c->camera.reset();
        delete c;
        m.open--;
        return PVX_OK;
    });
}

int lc_open(const cap_lc_config *cfg, cap_lc_camera **out, cap_lc_memory **memory,
            cap_lc_layout *layout, char *err, size_t err_size) noexcept
{
    *out = nullptr;
    *memory = nullptr;
    *layout = {};
    cap_lc_camera *c = nullptr;
    cap_lc_memory *mapped = nullptr;
    int e = guarded(err, err_size, [&]() -> int {
        std::string why;
        {
            Manager &m = the_manager();
            const std::lock_guard<std::mutex> hold(m.lock);
            if (int s = m.start(why); s != PVX_OK)
                return fail(s, err, err_size, why);
            std::shared_ptr<Camera> camera = find(cfg->id);
            if (!camera)
                return fail(PVX_ENOENT, err, err_size, "is gone");
            if (int r = camera->acquire(); r != 0)
                return fail(r == -EBUSY ? PVX_EBUSY : PVX_EIO, err, err_size,
                            r == -EBUSY ? "is in use by another program"
                                        : system_text("cannot be had", r));
            c = new cap_lc_camera;
            c->camera = camera;
            m.open++;
        }
        mapped = new cap_lc_memory;
        c->memory = mapped;
        int r = configure(*c, *cfg, *layout, why);
        if (r == PVX_OK)
            r = set_controls(*c, *cfg, *layout, why);
        if (r == PVX_OK)
            r = map_buffers(*c, *mapped, why);
        if (r != PVX_OK)
            return fail(r, err, err_size, why);
        layout->buffers = static_cast<uint32_t>(c->request.size());
        c->used.resize(c->request.size());
        return PVX_OK;
    });
    if (e != PVX_OK) {
        if (c != nullptr)
            lc_close(c);
        delete mapped;
        return e;
    }
    *out = c;
    *memory = mapped;
    return PVX_OK;
}

int lc_start(cap_lc_camera *c, const cap_lc_sink *sink, char *err, size_t err_size) noexcept
{
    return guarded(err, err_size, [&]() -> int {
        c->sink = *sink;
        c->seen = 0;
        c->used.assign(c->used.size(), false);
        c->camera->requestCompleted.connect(c, [c](Request *r) { c->done(r); });
        c->camera->disconnected.connect(c, [c]() {
            const std::lock_guard<std::mutex> hold_calls(c->calling);
            c->gone = true;
            if (c->sink.gone != nullptr)
                c->sink.gone(c->sink.ctx);
        });
        int r = c->camera->start(c->controls.empty() ? nullptr : &c->controls);
        c->running = r == 0;
        if (r == 0)
            return PVX_OK;
        c->camera->requestCompleted.disconnect();
        c->camera->disconnected.disconnect();
        return fail(r == -ENODEV ? PVX_ENODEV : PVX_EIO, err, err_size,
                    system_text("does not start", r));
    });
}

int lc_requeue(cap_lc_camera *c, uint32_t index) noexcept
{
    char err[64];
    return guarded(err, sizeof err, [&]() -> int {
        Request *r = c->request[index].get();
        r->reuse(Request::ReuseBuffers);
        if (c->used[index])
            cpu_reads(c->memory->buffer[index].file, DMA_BUF_SYNC_END);
        /* Handlers that ignore the controls of start() use those of a request. */
        if (!c->used[index])
            for (const auto &[id, value] : c->controls)
                r->controls().set(id, value);
        c->used[index] = true;
        return c->camera->queueRequest(r) == 0 ? PVX_OK : PVX_EIO;
    });
}

int lc_differs(cap_lc_camera *c, char *text, size_t size) noexcept
{
    return guarded(text, size, [&]() -> int {
        const std::lock_guard<std::mutex> hold(c->lock);
        snprintf(text, size, "%s", c->text.c_str());
        c->text.clear();
        return text[0] != '\0';
    });
}

void lc_stop(cap_lc_camera *c) noexcept
{
    char err[64];
    (void)guarded(err, sizeof err, [&]() -> int {
        if (c->running)
            (void)c->camera->stop(); /* fails if the camera is gone */
        c->running = false;
        {
            const std::lock_guard<std::mutex> hold_calls(c->calling);
            c->sink = {};
            if (c->gone)
                return PVX_OK;
        }
        c->camera->requestCompleted.disconnect();
        c->camera->disconnected.disconnect();
        return PVX_OK;
    });
}

void lc_unmap(cap_lc_memory *m) noexcept
{
    delete m;
}

const struct cap_lc *module() noexcept
{
    static char library[32];
    snprintf(library, sizeof library, "%d.%d.%d", LIBCAMERA_VERSION_MAJOR, LIBCAMERA_VERSION_MINOR,
             LIBCAMERA_VERSION_PATCH);
    static const struct cap_lc m = {CAP_LC_VERSION, library,  lc_list,    lc_modes,
                                    lc_open,        lc_start, lc_requeue, lc_differs,
                                    lc_stop,        lc_close, lc_unmap};
    return &m;
}

} // namespace

const struct cap_lc *cap_lc_module(void) noexcept
{
    return module();
}
