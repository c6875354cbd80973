/* controls.c - sets the camera's controls to the configuration's values, and reads them back. */
#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "capture/v4l2/v4l2.h"

#define MAX_CONTROLS 1024
#define MAX_STRING   256

typedef struct v4l2_query_ext_ctrl control;

/* What the text of a refusal needs. */
struct request {
    const struct cap_source_config *c;
    const struct v4l_device *dev;
    struct pvx_diag *d;
    const control *q;
    const char *value; /* as configured */
};

/* "White Balance, Automatic" -> "white_balance_automatic", as v4l2-ctl writes it. */
static void plain(const char *in, char *out, size_t size)
{
    size_t n = 0;
    bool gap = false;
    for (; *in != '\0' && n + 2 < size; in++) {
        if (!isalnum((unsigned char)*in)) {
            gap = n > 0;
            continue;
        }
        if (gap)
            out[n++] = '_';
        gap = false;
        out[n++] = (char)tolower((unsigned char)*in);
    }
    out[n] = '\0';
}

static bool same_name(const char *a, const char *b)
{
    char x[128], y[128];
    plain(a, x, sizeof x);
    plain(b, y, sizeof y);
    return strcmp(x, y) == 0;
}

static bool whole_number(const char *text, int64_t *out)
{
    char *end;
    errno = 0;
    *out = strtoll(text, &end, 0);
    return end != text && *end == '\0' && errno == 0;
}

static bool query(const struct v4l_device *dev, uint32_t id, control *q)
{
    *q = (control){.id = id};
    return v4l_call(dev->fd, VIDIOC_QUERY_EXT_CTRL, q) == 0;
}

/* Find a control by number, "0x009a0902", or by name.  False: the camera does not have it. */
static bool controls_find(const struct v4l_device *dev, const char *name, control *q)
{
    const uint32_t next = V4L2_CTRL_FLAG_NEXT_CTRL | V4L2_CTRL_FLAG_NEXT_COMPOUND;
    int64_t number;
    if (whole_number(name, &number) && number > 0 && number <= V4L2_CTRL_ID_MASK)
        return query(dev, (uint32_t)number, q);
    uint32_t id = 0;
    for (int i = 0; i < MAX_CONTROLS && query(dev, id | next, q) && q->id > id; i++) {
        if (q->type != V4L2_CTRL_TYPE_CTRL_CLASS && same_name(q->name, name))
            return true;
        id = q->id;
    }
    return false;
}

static bool is_menu(const control *q)
{
    return q->type == V4L2_CTRL_TYPE_MENU || q->type == V4L2_CTRL_TYPE_INTEGER_MENU;
}

static bool menu_item(const struct v4l_device *dev, const control *q, int64_t i, char *out,
                      size_t size)
{
    struct v4l2_querymenu m = {.id = q->id, .index = (uint32_t)i};
    if (v4l_call(dev->fd, VIDIOC_QUERYMENU, &m) != 0)
        return false;
    if (q->type == V4L2_CTRL_TYPE_INTEGER_MENU)
        snprintf(out, size, "%lld", (long long)m.value);
    else
        snprintf(out, size, "%.32s", (const char *)m.name);
    return true;
}

/* "0 to 255 in steps of 2", "0 = Auto Mode, 1 = Manual Mode". */
static void controls_say_range(const struct v4l_device *dev, const control *q, struct v4l_text *t)
{
    char item[64];
    if (is_menu(q)) {
        for (int64_t i = q->minimum; i <= q->maximum && i - q->minimum < 256; i++)
            if (menu_item(dev, q, i, item, sizeof item))
                v4l_say(t, "%s%lld = %s", t->len > 0 ? ", " : "", (long long)i, item);
        return;
    }
    if (q->type == V4L2_CTRL_TYPE_BITMASK) {
        v4l_say(t, "bits of 0x%llx", (unsigned long long)q->maximum);
        return;
    }
    v4l_say(t, "%lld to %lld", (long long)q->minimum, (long long)q->maximum);
    if (q->type == V4L2_CTRL_TYPE_STRING)
        v4l_say(t, " characters");
    else if (q->step > 1)
        v4l_say(t, " in steps of %llu", (unsigned long long)q->step);
}

static pvx_err controls_refused(const struct request *r, const char *why)
{
    char name[64], range[400] = "";
    plain(r->q->name, name, sizeof name);
    controls_say_range(r->dev, r->q, &(struct v4l_text){range, sizeof range, 0});
    return CAP_FAIL(r->c, "v4l2", r->d, PVX_EINVAL, "%s = %s refused: %s; it offers %s", name,
                    r->value, why, range);
}

/* Get or set one control, in the form of the interface that has every type. */
static int transfer(const struct v4l_device *dev, unsigned long request, struct v4l2_ext_control *x)
{
    struct v4l2_ext_controls all = {.which = V4L2_CTRL_WHICH_CUR_VAL, .count = 1, .controls = x};
    return v4l_call(dev->fd, request, &all);
}

static pvx_err transfer_failed(const struct request *r)
{
    if (errno == EBUSY)
        return controls_refused(r, "the camera is streaming, or another setting rules it");
    if (errno == ERANGE || errno == EINVAL)
        return controls_refused(r, "out of range");
    if (errno == EACCES)
        return controls_refused(r, "it can only be read, or an automatic mode rules it");
    return v4l_fail(r->c, r->dev->node, r->q->name, r->d);
}

static pvx_err controls_set_number(const struct request *r, int64_t value)
{
    const control *q = r->q;
    bool wide = q->type == V4L2_CTRL_TYPE_INTEGER64;
    bool mask = q->type == V4L2_CTRL_TYPE_BITMASK;
    /* Drivers clamp values silently, so the range is checked here. */
    if (mask ? (value & ~(int64_t)(uint32_t)q->maximum) != 0
             : value < q->minimum || value > q->maximum)
        return controls_refused(r, "out of range");
    struct v4l2_ext_control x = {.id = q->id};
    if (wide)
        x.value64 = value;
    else
        x.value = (int32_t)value;
    if (transfer(r->dev, VIDIOC_S_EXT_CTRLS, &x) != 0)
        return transfer_failed(r);
    if (q->flags & V4L2_CTRL_FLAG_WRITE_ONLY)
        return PVX_OK;
    x = (struct v4l2_ext_control){.id = q->id};
    if (transfer(r->dev, VIDIOC_G_EXT_CTRLS, &x) != 0)
        return transfer_failed(r);
    int64_t got = wide ? x.value64 : x.value;
    if (mask)
        got = (uint32_t)x.value;
    uint64_t off = got > value ? (uint64_t)got - (uint64_t)value : (uint64_t)value - (uint64_t)got;
    /* A value between two steps is set to the nearer one. */
    uint64_t near = q->type == V4L2_CTRL_TYPE_INTEGER || wide ? q->step / 2 : 0;
    if (off <= near)
        return PVX_OK;
    char why[120];
    snprintf(why, sizeof why, "the camera has %lld%s", (long long)got,
             q->flags & V4L2_CTRL_FLAG_INACTIVE ? ", because an automatic mode rules it" : "");
    return controls_refused(r, why);
}

static pvx_err set_string(const struct request *r)
{
    char text[MAX_STRING] = "", got[MAX_STRING] = "";
    const control *q = r->q;
    size_t len = strlen(r->value);
    if (q->elem_size > sizeof text || len + 1 > q->elem_size || (int64_t)len < q->minimum ||
        (int64_t)len > q->maximum)
        return controls_refused(r, "too long or too short");
    memcpy(text, r->value, len + 1);
    struct v4l2_ext_control x = {.id = q->id, .size = q->elem_size, .string = text};
    if (transfer(r->dev, VIDIOC_S_EXT_CTRLS, &x) != 0)
        return transfer_failed(r);
    if (q->flags & V4L2_CTRL_FLAG_WRITE_ONLY)
        return PVX_OK;
    x = (struct v4l2_ext_control){.id = q->id, .size = q->elem_size, .string = got};
    if (transfer(r->dev, VIDIOC_G_EXT_CTRLS, &x) != 0)
        return transfer_failed(r);
    return strcmp(text, got) == 0 ? PVX_OK : controls_refused(r, "the camera has another text");
}

static bool menu_number(const struct v4l_device *dev, const control *q, const char *name,
                        int64_t *out)
{
    char item[64];
    for (*out = q->minimum; *out <= q->maximum && *out - q->minimum < 256; ++*out)
        if (menu_item(dev, q, *out, item, sizeof item) && same_name(item, name))
            return true;
    return false;
}

/* The value that a text means for this control; false: none. */
static bool controls_number_of(const struct v4l_device *dev, const control *q, const char *text,
                               int64_t *out)
{
    static const char *const on[] = {"true", "on", "yes"}, *const off[] = {"false", "off", "no"};
    if (whole_number(text, out))
        return true;
    if (q->type == V4L2_CTRL_TYPE_MENU)
        return menu_number(dev, q, text, out);
    for (int i = 0; q->type == V4L2_CTRL_TYPE_BOOLEAN && i < 3; i++) {
        *out = strcmp(text, on[i]) == 0;
        if (*out == 1 || strcmp(text, off[i]) == 0)
            return true;
    }
    return false;
}

static pvx_err controls_set(const struct cap_source_config *c, const struct v4l_device *dev,
                            const control *q, const char *value, struct pvx_diag *d)
{
    const struct request r = {c, dev, d, q, value};
    int64_t number = 0;
    if (q->flags & V4L2_CTRL_FLAG_DISABLED)
        return controls_refused(&r, "the control is disabled");
    if (q->flags & V4L2_CTRL_FLAG_READ_ONLY)
        return controls_refused(&r, "it can only be read");
    if (q->flags & V4L2_CTRL_FLAG_GRABBED)
        return controls_refused(&r, "another program holds it");
    switch (q->type) {
    case V4L2_CTRL_TYPE_BUTTON: {
        struct v4l2_ext_control x = {.id = q->id, .value = 1};
        return transfer(dev, VIDIOC_S_EXT_CTRLS, &x) == 0 ? PVX_OK : transfer_failed(&r);
    }
    case V4L2_CTRL_TYPE_STRING: return set_string(&r);
    case V4L2_CTRL_TYPE_INTEGER:
    case V4L2_CTRL_TYPE_INTEGER64:
    case V4L2_CTRL_TYPE_BOOLEAN:
    case V4L2_CTRL_TYPE_MENU:
    case V4L2_CTRL_TYPE_INTEGER_MENU:
    case V4L2_CTRL_TYPE_BITMASK:
        if ((q->flags & V4L2_CTRL_FLAG_HAS_PAYLOAD) != 0)
            break;
        if (!controls_number_of(dev, q, value, &number))
            return controls_refused(&r, "no value of it");
        return controls_set_number(&r, number);
    }
    return controls_refused(&r, "it is a table, which has no form in the configuration");
}

static pvx_err controls_set_feature(const struct cap_source_config *c, const struct v4l_device *dev,
                                    const struct cap_feature *f, struct pvx_diag *d)
{
    control q;
    if (!controls_find(dev, f->name, &q))
        return CAP_FAIL(c, "v4l2", d, PVX_EINVAL,
                        "the camera has no control %s; `v4l2-ctl -d %s -L` lists those it has",
                        f->name, dev->node);
    return controls_set(c, dev, &q, f->value, d);
}

static pvx_err set_value(const struct cap_source_config *c, const struct v4l_device *dev,
                         const control *q, int64_t value, struct pvx_diag *d)
{
    char text[32];
    snprintf(text, sizeof text, "%lld", (long long)value);
    return controls_set(c, dev, q, text, d);
}

static bool controls_is_there(const struct v4l_device *dev, uint32_t id, control *q)
{
    return query(dev, id, q) && (q->flags & V4L2_CTRL_FLAG_DISABLED) == 0;
}

/* Set the exposure: manual mode, and a frame rate that does not give way to it. */
static pvx_err controls_set_exposure(const struct cap_source_config *c,
                                     const struct v4l_device *dev, struct pvx_diag *d)
{
    control q;
    if (c->exposure_us < 0)
        return PVX_OK;
    if (!controls_is_there(dev, V4L2_CID_EXPOSURE_ABSOLUTE, &q))
        return CAP_FAIL(c, "v4l2", d, PVX_EINVAL,
                        "exposure_us = %g refused: the camera has no exposure "
                        "control in units of time%s",
                        c->exposure_us,
                        controls_is_there(dev, V4L2_CID_EXPOSURE, &q)
                            ? "; set the one it has, in its own units, under features: exposure"
                            : "");
    control automatic;
    if (controls_is_there(dev, V4L2_CID_EXPOSURE_AUTO, &automatic)) {
        char item[64];
        bool manual = menu_item(dev, &automatic, V4L2_EXPOSURE_MANUAL, item, sizeof item);
        PVX_TRY(set_value(c, dev, &automatic,
                          manual ? V4L2_EXPOSURE_MANUAL : V4L2_EXPOSURE_SHUTTER_PRIORITY, d));
    }
    if (controls_is_there(dev, V4L2_CID_EXPOSURE_AUTO_PRIORITY, &automatic) &&
        (automatic.flags & V4L2_CTRL_FLAG_READ_ONLY) == 0)
        PVX_TRY(set_value(c, dev, &automatic, 0, d));
    if (!controls_is_there(dev, V4L2_CID_EXPOSURE_ABSOLUTE, &q)) /* again: its flags have changed */
        return PVX_EIO;
    double want = c->exposure_us / 100;
    if (want < (double)q.minimum - 0.5 || want > (double)q.maximum + 0.5)
        return CAP_FAIL(c, "v4l2", d, PVX_EINVAL,
                        "exposure_us = %g refused: the camera offers %lld to %lld us",
                        c->exposure_us, (long long)q.minimum * 100, (long long)q.maximum * 100);
    return set_value(c, dev, &q, llrint(want), d);
}

static pvx_err set_gain(const struct cap_source_config *c, const struct v4l_device *dev,
                        struct pvx_diag *d)
{
    control q, automatic;
    if (c->gain < 0)
        return PVX_OK;
    if (controls_is_there(dev, V4L2_CID_AUTOGAIN, &automatic))
        PVX_TRY(set_value(c, dev, &automatic, 0, d));
    if (controls_is_there(dev, V4L2_CID_GAIN, &q) ||
        controls_is_there(dev, V4L2_CID_ANALOGUE_GAIN, &q)) {
        if (fabs(c->gain) < 0x1p52)
            return set_value(c, dev, &q, llrint(c->gain), d);
    }
    return CAP_FAIL(c, "v4l2", d, PVX_EINVAL, "gain = %g refused: no such control", c->gain);
}

static bool controls_value_of(const struct v4l_device *dev, uint32_t id, int32_t *out)
{
    control q;
    struct v4l2_ext_control x = {.id = id};
    if (!controls_is_there(dev, id, &q) || transfer(dev, VIDIOC_G_EXT_CTRLS, &x) != 0)
        return false;
    *out = x.value;
    return true;
}

double v4l_fixed_exposure_us(const struct v4l_device *dev)
{
    int32_t mode, value;
    if (controls_value_of(dev, V4L2_CID_EXPOSURE_AUTO, &mode) && mode != V4L2_EXPOSURE_MANUAL &&
        mode != V4L2_EXPOSURE_SHUTTER_PRIORITY)
        return NAN;
    return controls_value_of(dev, V4L2_CID_EXPOSURE_ABSOLUTE, &value) ? value * 100.0 : NAN;
}

double v4l_fixed_gain(const struct v4l_device *dev)
{
    int32_t automatic, value;
    if (controls_value_of(dev, V4L2_CID_AUTOGAIN, &automatic) && automatic != 0)
        return NAN;
    if (controls_value_of(dev, V4L2_CID_GAIN, &value) ||
        controls_value_of(dev, V4L2_CID_ANALOGUE_GAIN, &value))
        return value;
    return NAN;
}

/* Whether exposure or gain is no longer what it was; `was` NAN = it was automatic or is not known. */
static bool controls_changed(double was, double is)
{
    return !isnan(was) && !(is == was);
}

pvx_err v4l_set_controls(const struct cap_source_config *c, const struct v4l_device *dev,
                         struct pvx_diag *d)
{
    PVX_TRY(controls_set_exposure(c, dev, d));
    PVX_TRY(set_gain(c, dev, d));
    double exposure = c->exposure_us >= 0 ? v4l_fixed_exposure_us(dev) : NAN;
    double gain = c->gain >= 0 ? v4l_fixed_gain(dev) : NAN;
    for (size_t i = 0; i < c->n_features; i++) {
        /* in the given order: for example an automatic mode off, then its value */
        const struct cap_feature *f = &c->features[i];
        PVX_TRY(controls_set_feature(c, dev, f, d));
        bool exposed = controls_changed(exposure, v4l_fixed_exposure_us(dev));
        if (exposed || controls_changed(gain, v4l_fixed_gain(dev)))
            return CAP_FAIL(c, "v4l2", d, PVX_EINVAL,
                            "%s: %g and `features: %s: %s` disagree; leave one of them out",
                            exposed ? "exposure_us" : "gain", exposed ? c->exposure_us : c->gain,
                            f->name, f->value);
    }
    return PVX_OK;
}
