/* reg.c - reads and writes the camera's registers, with the effects of that. */
#include <math.h>
#include <string.h>

#include "capture/gevsim/gevsim.h"

static uint32_t bits_of(float f)
{
    uint32_t u;
    memcpy(&u, &f, sizeof u);
    return u;
}

/* The feature with this address; GVCAM_N_FEATURES: there is none. */
static unsigned feature_at(uint32_t address)
{
    if (address >= GVF_ADDRESS(0) && address < GVF_ADDRESS(GVCAM_N_FEATURES)) {
        unsigned k = (address - GVF_ADDRESS(0)) / 4;
        return gvcam_features[k].address == 0 ? k : GVCAM_N_FEATURES;
    }
    for (unsigned k = 0; k < GVCAM_N_FEATURES; k++)
        if (gvcam_features[k].address != 0 && gvcam_features[k].address == address)
            return k;
    return GVCAM_N_FEATURES;
}

void gvcam_reg_reset(struct cap_gvcam *c)
{
    for (unsigned k = 0; k < GVCAM_N_FEATURES; k++) {
        const struct gvcam_feature_def *d = &gvcam_features[k];
        c->reg.v[k] = d->kind == GVK_FLOAT ? bits_of((float)d->value) : (uint32_t)d->value;
    }
    c->reg.v[GVF_SENSOR_WIDTH] = c->reg.v[GVF_WIDTH_MAX] = c->reg.v[GVF_WIDTH] =
        (uint32_t)c->c.width;
    c->reg.v[GVF_SENSOR_HEIGHT] = c->reg.v[GVF_HEIGHT_MAX] = c->reg.v[GVF_HEIGHT] =
        (uint32_t)c->c.height;
    c->reg.v[GVF_PIXEL_FORMAT] = cap_pixfmt_pfnc(c->c.fmt);
    c->reg.v[GVF_RATE] = bits_of((float)c->c.ring_fps);
}

/* ---- reading ---------------------------------------------------------------------------------- */

static uint32_t bytes_at(const void *from, size_t n, size_t at)
{
    uint8_t w[4] = {0};
    if (at < n)
        memcpy(w, (const uint8_t *)from + at, n - at < 4 ? n - at : 4);
    return cap_get32(w);
}

static float temperature(const struct cap_gvcam *c, int64_t now)
{
    double minutes = (double)(now % 3600000000000) / 60e9;
    float sensor = (float)(41.5 + 2.5 * sin(minutes) + (double)(c->addr.s_addr >> 24 & 7) * 0.5);
    return c->reg.v[GVF_TEMPERATURE_SELECTOR] == 0 ? sensor : sensor - 4;
}

static uint32_t read_feature(struct cap_gvcam *c, unsigned k, int64_t now)
{
    switch (k) {
    case GVF_TEMPERATURE: return bits_of(temperature(c, now));
    case GVF_TIMESTAMP_VALUE: return (uint32_t)(c->reg.latched >> 32);
    case GVF_TIMESTAMP_VALUE_LOW: return (uint32_t)c->reg.latched;
    case GVF_PTP_STATUS: return c->reg.ptp_status_latched;
    case GVF_PTP_OFFSET: return (uint32_t)((uint64_t)c->reg.ptp_offset_latched >> 32);
    case GVF_PTP_OFFSET_LOW: return (uint32_t)c->reg.ptp_offset_latched;
    case GVF_LINE_STATUS: return gvcam_lines(c) & 1;
    case GVF_LINE_STATUS_ALL: return gvcam_lines(c);
    case GVF_CHUNK_ENABLE: return c->reg.v[GVF_CHUNKS_ON] >> c->reg.v[GVF_CHUNK_SELECTOR] & 1;
    case GVF_PAYLOAD_SIZE: return gvcam_payload(c);
    case GVF_RESULTING_RATE: return bits_of((float)gvcam_expose_rate(c));
    default: return c->reg.v[k];
    }
}

static bool read_bootstrap(struct cap_gvcam *c, uint32_t a, uint32_t *out)
{
    if (a < GVB_BOOT_END)
        *out = cap_get32(c->reg.boot + a);
    else if (a >= GVB_URL_0 && a < GVB_URL_1)
        *out = bytes_at(c->reg.url, sizeof c->reg.url, a - GVB_URL_0);
    else if (a >= GVB_XML && a < GVB_XML + ((c->reg.xml_bytes + 511) / 512) * 512)
        *out = bytes_at(c->reg.xml, c->reg.xml_bytes, a - GVB_XML);
    else
        switch (a) {
        case GVB_INTERFACES:
        case GVB_STREAM_CHANNELS:
        case GVB_ACTIVE_LINKS:
        case GVB_ACTIONS: *out = 1; break;
        case GVB_LINK_SPEED: *out = (uint32_t)c->c.link_mbit; break;
        case GVB_MESSAGE_CHANNELS:
        case GVB_GVSP_CAPABILITY:
        case GVB_MESSAGE_CAPABILITY:
        case GVB_TIMESTAMP_CONTROL:
        case GVB_GVCP_CONFIG:
        case GVB_PRIMARY_PORT:
        case GVB_PRIMARY_IP:
        case GVB_PENDING_TIMEOUT: *out = 0; break;
        case GVB_GVCP_CAPABILITY:
            *out = GVCAM_CAN_CONCATENATE | GVCAM_CAN_WRITEMEM |
                   (c->c.no_resend ? 0 : GVCAM_CAN_RESEND) | GVCAM_CAN_ACTION | GVCAM_CAN_SCHEDULE |
                   GVCAM_CAN_PTP | GVCAM_CAN_SERIAL | GVCAM_CAN_NAME;
            break;
        case GVB_TICKS_HIGH: *out = (uint32_t)(gvcam_clock_hz(&c->clock) >> 32); break;
        case GVB_TICKS_LOW: *out = (uint32_t)gvcam_clock_hz(&c->clock); break;
        case GVB_TIMESTAMP_HIGH: *out = (uint32_t)(c->reg.latched >> 32); break;
        case GVB_TIMESTAMP_LOW: *out = (uint32_t)c->reg.latched; break;
        case GVB_SCPS: *out = c->reg.v[GVF_SCPS] | c->reg.df; break;
        case GVB_SCSP: *out = c->send.port; break;
        default: return a >= GVB_URL_1 && a < GVB_URL_END ? (*out = 0, true) : false;
        }
    return true;
}

uint16_t gvcam_reg_read(struct cap_gvcam *c, uint32_t address, int64_t now, uint32_t *out)
{
    *out = 0;
    if (address % 4 != 0)
        return CAP_GVCP_BAD_ALIGNMENT;
    if (read_bootstrap(c, address, out))
        return CAP_GVCP_OK;
    unsigned k = feature_at(address);
    if (k == GVCAM_N_FEATURES)
        return CAP_GVCP_INVALID_ADDRESS;
    if (k != GVF_ACTION_DEVICE_KEY) /* a secret */
        *out = read_feature(c, k, now);
    return CAP_GVCP_OK;
}

/* ---- writing ---------------------------------------------------------------------------------- */

/* Load the user set that the client has saved; false: it has saved none. */
static bool load_saved(struct cap_gvcam *c)
{
    bool saved = c->reg.user_set[GVF_WIDTH] != 0;
    if (saved)
        memcpy(c->reg.v, c->reg.user_set, sizeof c->reg.v);
    return saved;
}

static void load_user_set(struct cap_gvcam *c)
{
    uint32_t keep[] = {c->reg.v[GVF_SCP_PORT], c->reg.v[GVF_SCDA], c->reg.v[GVF_HEARTBEAT],
                       c->reg.v[GVF_USER_SET_SELECTOR]};
    if (c->reg.v[GVF_USER_SET_SELECTOR] != 1 || !load_saved(c))
        gvcam_reg_reset(c);
    c->reg.v[GVF_SCP_PORT] = keep[0];
    c->reg.v[GVF_SCDA] = keep[1];
    c->reg.v[GVF_HEARTBEAT] = keep[2];
    c->reg.v[GVF_USER_SET_SELECTOR] = keep[3];
}

static uint16_t reg_command(struct cap_gvcam *c, unsigned k, int64_t now)
{
    switch (k) {
    case GVF_DEVICE_RESET: c->reg.reset = true; break;
    case GVF_TIMESTAMP_LATCH:
        c->reg.latched = gvcam_clock_ticks(&c->clock, gvcam_clock_ns(&c->clock, now));
        break;
    case GVF_TIMESTAMP_RESET:
        if (!gvcam_clock_reset(&c->clock, now))
            return CAP_GVCP_ACCESS_DENIED;
        break;
    case GVF_ACQ_START: gvcam_expose_start(c, now); break;
    case GVF_ACQ_STOP: gvcam_expose_stop(c); break;
    case GVF_TRIGGER_SOFTWARE: gvcam_trigger(c, GVCAM_SOFTWARE, now); break;
    case GVF_PTP_LATCH:
        c->reg.ptp_status_latched = gvcam_ptp_status(&c->clock, now);
        c->reg.ptp_offset_latched = gvcam_ptp_offset_ns(&c->clock, now);
        break;
    case GVF_USER_SET_LOAD:
        if (c->expose.acquiring)
            return CAP_GVCP_ACCESS_DENIED;
        load_user_set(c);
        break;
    case GVF_USER_SET_SAVE:
        if (c->reg.v[GVF_USER_SET_SELECTOR] == 0)
            return CAP_GVCP_WRITE_PROTECT;
        memcpy(c->reg.user_set, c->reg.v, sizeof c->reg.v);
        break;
    default: return CAP_GVCP_INVALID_ADDRESS;
    }
    return CAP_GVCP_OK;
}

static bool is_entry(const struct gvcam_entry *e, uint32_t v)
{
    for (; e->name != NULL; e++)
        if (e->value == v)
            return true;
    return false;
}

/* Whether size and offset keep the region inside the sensor. */
static bool region_fits(const struct cap_gvcam *c, unsigned k, uint32_t v)
{
    uint32_t w = (uint32_t)c->c.width, h = (uint32_t)c->c.height;
    switch (k) {
    case GVF_WIDTH: return v >= 1 && v <= w - c->reg.v[GVF_OFFSET_X] && (w % 4 != 0 || v % 4 == 0);
    case GVF_HEIGHT: return v >= 1 && v <= h - c->reg.v[GVF_OFFSET_Y];
    case GVF_OFFSET_X: return v % 2 == 0 && v <= w - c->reg.v[GVF_WIDTH];
    case GVF_OFFSET_Y: return v % 2 == 0 && v <= h - c->reg.v[GVF_HEIGHT];
    default: return true;
    }
}

static bool reg_in_range(const struct cap_gvcam *c, unsigned k, uint32_t v)
{
    const struct gvcam_feature_def *d = &gvcam_features[k];
    float f;
    switch (d->kind) {
    case GVK_FLOAT:
        memcpy(&f, &v, sizeof f);
        return f >= (float)d->min && f <= (float)d->max; /* false for NaN */
    case GVK_BOOL: return v <= 1;
    case GVK_ENUM: return is_entry(d->entry, v);
    case GVK_FORMAT: return gvcam_offers(c, cap_pixfmt_from_pfnc(v));
    default:
        if (d->max_of != NULL)
            return region_fits(c, k, v);
        return (double)v >= d->min && (double)v <= d->max;
    }
}

static uint16_t write_packet_size(struct cap_gvcam *c, uint32_t v)
{
    uint32_t size = v & 0xffff;
    if (size < GVCAM_PACKET_MIN || size > GVCAM_PACKET_MAX)
        return CAP_GVCP_INVALID_PARAMETER;
    if (c->expose.acquiring && size != c->reg.v[GVF_SCPS])
        return CAP_GVCP_ACCESS_DENIED;
    c->reg.v[GVF_SCPS] = size - size % 4;
    c->reg.df = v & GVCAM_SCPS_DF;
    if ((v & GVCAM_SCPS_FIRE) != 0)
        gvcam_send_test(c);
    return CAP_GVCP_OK;
}

static uint16_t write_feature(struct cap_gvcam *c, unsigned k, int64_t now, uint32_t v)
{
    const struct gvcam_feature_def *d = &gvcam_features[k];
    if ((d->access & GVA_W) == 0)
        return CAP_GVCP_WRITE_PROTECT;
    bool trigger = k == GVF_TRIGGER_MODE || k == GVF_TRIGGER_SOURCE;
    if ((d->access == GVA_LOCKED || (trigger && c->fault.lock_trigger)) && c->expose.acquiring)
        return CAP_GVCP_ACCESS_DENIED;
    if (d->kind == GVK_COMMAND)
        return v != 0 ? reg_command(c, k, now) : CAP_GVCP_OK;
    if (k == GVF_SCPS)
        return write_packet_size(c, v);
    if (k == GVF_SCP_PORT)
        v &= 0xffff;
    if (!reg_in_range(c, k, v))
        return CAP_GVCP_INVALID_PARAMETER;
    if (k == GVF_CHUNK_ENABLE) {
        uint32_t bit = 1u << c->reg.v[GVF_CHUNK_SELECTOR];
        c->reg.v[GVF_CHUNKS_ON] =
            v != 0 ? c->reg.v[GVF_CHUNKS_ON] | bit : c->reg.v[GVF_CHUNKS_ON] & ~bit;
        return CAP_GVCP_OK;
    }
    c->reg.v[k] = v;
    if (k == GVF_PTP_ENABLE)
        gvcam_ptp_enable(&c->clock, now, v != 0);
    return CAP_GVCP_OK;
}

uint16_t gvcam_reg_write(struct cap_gvcam *c, uint32_t address, int64_t now, uint32_t value)
{
    if (address % 4 != 0)
        return CAP_GVCP_BAD_ALIGNMENT;
    unsigned k = feature_at(address);
    if (k != GVCAM_N_FEATURES)
        return write_feature(c, k, now, value);
    if (address >= GVB_USER_NAME && address < GVB_BOOT_END) {
        cap_put32(c->reg.boot + address, value);
        c->reg.boot[GVB_BOOT_END - 1] = 0;
        return CAP_GVCP_OK;
    }
    if (address == GVB_TIMESTAMP_CONTROL) {
        uint16_t e = CAP_GVCP_OK;
        if ((value & 2) != 0)
            e = reg_command(c, GVF_TIMESTAMP_LATCH, now);
        if ((value & 1) != 0)
            e = reg_command(c, GVF_TIMESTAMP_RESET, now);
        return e;
    }
    if (address == GVB_GVCP_CONFIG)
        return CAP_GVCP_OK;
    uint32_t is;
    return read_bootstrap(c, address, &is) ? CAP_GVCP_WRITE_PROTECT : CAP_GVCP_INVALID_ADDRESS;
}

void gvcam_reg_reboot(struct cap_gvcam *c)
{
    gvcam_reg_reset(c);
    if (c->reg.v[GVF_USER_SET_DEFAULT] == 1)
        (void)load_saved(c);
    c->reg.df = 0;
    c->reg.latched = 0;
    c->reg.ptp_status_latched = GVCAM_PTP_DISABLED;
    c->reg.ptp_offset_latched = 0;
    c->reg.reset = false;
}
