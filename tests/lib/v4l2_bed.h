/* v4l2_bed.h - opening, starting and refusing of V4L2 sources, for tests with box.h.  The camera's name is
 * "cam0": every refusal must say it. */
#ifndef TESTS_V4L2_BED_H
#define TESTS_V4L2_BED_H
#include "tests/lib/box.h"
#include "tests/lib/source.h"
#include "tests/t.h"

static const struct cap_source_ops *v4l2;
static struct box box = BOX_EMPTY;
static const struct cap_sink box_sink = SINK_OF(&box);

static cap_source *opened(const struct cap_source_config *c)
{
    cap_source *s;
    struct pvx_diag d = {""};
    pvx_err e = v4l2->open(c, &s, &d);
    T_CHECK_(e == PVX_OK, "%s: %s", c->uri, pvx_diag_text(&d, e));
    return s;
}

static bool started(cap_source *s)
{
    struct pvx_diag d = {""};
    pvx_err e = s == NULL ? PVX_EINVAL : v4l2->start(s, &box_sink, &d);
    T_CHECK_(e == PVX_OK, "start: %s", pvx_diag_text(&d, e));
    return e == PVX_OK;
}

/* Opened and started, into an empty box; NULL, and a failed check, when it does not. */
static cap_source *running(const struct cap_source_config *c, bool keep)
{
    reset_box(&box, keep);
    cap_source *s = opened(c);
    if (!started(s) && s != NULL)
        v4l2->close(&s);
    return s;
}

#define FEATURES(c, ...)                                        \
    ((c)->features = (const struct cap_feature[]){__VA_ARGS__}, \
     (c)->n_features = sizeof((const struct cap_feature[]){__VA_ARGS__}) / sizeof *(c)->features)

static void ended(cap_source *s)
{
    if (s == NULL)
        return;
    v4l2->stop(s);
    v4l2->close(&s);
    T_OK(s == NULL);
}

static void refused(const struct cap_source_config *c, pvx_err want, const char *const *parts)
{
    cap_source *s;
    struct pvx_diag d = {""};
    T_EQ_I(v4l2->open(c, &s, &d), want);
    T_OK(s == NULL);
    T_CONTAINS(d.text, "cam0");
    for (; *parts != NULL; parts++)
        T_CONTAINS(d.text, *parts);
    ended(s);
}
#define REFUSED(c, e, ...) refused(c, e, (const char *const[]){__VA_ARGS__, NULL})
#endif
