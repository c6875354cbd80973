/* triggers.h - record.ring and triggers of pyrovoxd.yaml.
 *
 *     record: { ring: { seconds: 5, memory: 8GB } }
 *     triggers:
 *       - { name: ignition, when: appears, pre: 2, post: 3 }
 *       - { name: spark, when: line, camera: cam2, line: 1 }
 *       - { name: bright, when: light, above: 0.02, release: 0.01, box: [-0.1, -0.1, 0, 0.1, 0.1, 0.2] }
 *
 * Threads: constant once read. */
#ifndef DMN_TRIGGERS_CONFIG_H
#define DMN_TRIGGERS_CONFIG_H
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include "base/yaml.h"

#define DMN_TRIGGERS_MAX       16
#define DMN_TRIGGER_NAME_MAX   32
#define DMN_TRIGGER_CAMERA_MAX 64

struct dmn_ring {
    double seconds;   /* 0 = there is no ring */
    double memory;    /* bytes */
    double pre, post; /* s, of a trigger without a name */
};

/* What a trigger waits for. */
enum dmn_when {
    DMN_WHEN_ORDER,    /* a command */
    DMN_WHEN_AT,       /* a time */
    DMN_WHEN_LINE,     /* a camera's input line rises */
    DMN_WHEN_LIGHT,    /* light in a box; this and all that follow are conditions on volumes */
    DMN_WHEN_HEIGHT,   /* of the flame */
    DMN_WHEN_CHANGE,   /* of the light from set to set */
    DMN_WHEN_APPEARS,  /* a hull: ignition */
    DMN_WHEN_VANISHES, /* the hull: blow-off */
    DMN_N_WHEN
};
extern const char *const dmn_when_names[DMN_N_WHEN];
/* Unit of the value that is compared, "" for orders and times. */
extern const char *const dmn_when_units[DMN_N_WHEN];

struct dmn_trigger {
    char name[DMN_TRIGGER_NAME_MAX];
    enum dmn_when when;
    int64_t at_ns;                       /* AT: UTC */
    char camera[DMN_TRIGGER_CAMERA_MAX]; /* LINE: its name, */
    int64_t line;                        /* and the bit of LineStatusAll */
    double above, release; /* fires above the one, is ready again at or below the other */
    bool boxed;
    double box[6];    /* x y z of one corner, x y z of the other, m */
    double pre, post; /* s */
    double hold_off;  /* s after it fired in which it does not fire again */
    int64_t agree;    /* successive sets that must be above */
};
struct dmn_triggers {
    size_t n;
    struct dmn_trigger item[DMN_TRIGGERS_MAX];
};

/* Errors name file, line, key and reason.  *out is not changed on error. */
PVX_MUST_CHECK pvx_err dmn_ring_read(const pvx_yaml *y, int node, const char *key,
                                     struct dmn_ring *out, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err dmn_triggers_read(const pvx_yaml *y, int node, const char *key,
                                         struct dmn_triggers *out, struct pvx_diag *d);
/* In one line, as they are read. */
void dmn_ring_print(FILE *f, const struct dmn_ring *r);
void dmn_triggers_print(FILE *f, const struct dmn_triggers *t);
#endif
