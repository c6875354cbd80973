/* doctor.h - what on this host loses frames, and what to do about it.
 *
 * Each check looks at one thing, says in what state it is, what that means for frames, and how it is
 * put right: `id` OK | WARN | FAIL | UNKNOWN (cannot tell, and why).  Nothing is ever changed here;
 * doc_script writes the remedies as a shell script for a person to read and run.
 * All of the host is read through struct doc_host (host.h), so that tests can show a made-up host.
 * Weights: 0..100, how much a state of this kind costs; a report is sorted by verdict, then weight.
 * Threads: one doctor belongs to one thread. */
#ifndef DOC_DOCTOR_H
#define DOC_DOCTOR_H
#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include "base/err.h"
#include "capture/sync/frameset.h"

struct dmn_config;
struct doc_host;

enum doc_verdict { DOC_OK, DOC_WARN, DOC_FAIL, DOC_UNKNOWN, DOC_N_VERDICT };

/* SYSCTL: file = key, text = value.  COMMAND: text = shell line, holds until the next boot.
 * LINE: text belongs into file.  NOTE: text is for a person. */
enum doc_fix_kind { DOC_SYSCTL, DOC_COMMAND, DOC_LINE, DOC_NOTE };
struct doc_fix {
    enum doc_fix_kind kind;
    char file[96], text[320];
};

#define DOC_MAX_FIX 4
struct doc_finding {
    char id[48]; /* "net.rmem_max"; stays the same in all releases */
    enum doc_verdict verdict;
    int weight;
    char what[320], means[400];
    size_t n_fix;
    struct doc_fix fix[DOC_MAX_FIX];
};

#define DOC_MAX_FINDINGS 256
struct doc_report {
    size_t n;
    size_t lost; /* findings for which there was no room */
    struct doc_finding f[DOC_MAX_FINDINGS + 1];
};

/* What the cameras ask of the host; from the configuration, or assumed. */
enum doc_kind { DOC_CAM_OTHER, DOC_CAM_GIGE, DOC_CAM_USB3, DOC_CAM_V4L2 };
struct doc_load {
    bool given;        /* from a configuration */
    char source[4200]; /* one line: what it is and where it comes from */
    size_t n;
    struct doc_load_camera {
        enum doc_kind kind;
        char name[64];
        uint32_t address; /* GigE, host order; 0 = not known */
        size_t frame_bytes;
        bool looked;          /* the camera was opened, and gave a picture or did not */
        bool pictured;        /* it did */
        double cut, pedestal; /* of its blacks, as for rec_photo_say_cut */
    } camera[CAP_MAX_CAMERAS];
    double fps;
    size_t frame_bytes;    /* largest */
    double bytes_per_s;    /* all cameras */
    int packet_size;       /* GigE; 0 = negotiated */
    unsigned buffers;      /* frames per camera that a driver may fill */
    unsigned held;         /* and of record.ring */
    bool ptp;              /* the cameras share a clock by PTP */
    bool shared_clock;     /* and it must be the host's */
    int packet_delay_ns;   /* GigE, between packets of a frame */
    bool triggered;        /* not free running */
    size_t socket_buffer;  /* asked for each GigE camera; 0 = not known */
    char compute[256];     /* where sets are solved (daemon/config/compute.h), "" = not known */
    char record[PATH_MAX]; /* folder of raw recording, "" = none */
};

/* Eight GigE cameras of 640x480 RGB8 at 20 Hz. */
void doc_load_assumed(struct doc_load *l);
/* Errors: the rig's. */
PVX_MUST_CHECK pvx_err doc_load_config(const struct dmn_config *c, struct doc_load *l,
                                       struct pvx_diag *d);
/* Bytes of all frames that the daemon keeps. */
double doc_load_memory(const struct doc_load *l);
size_t doc_load_count(const struct doc_load *l, enum doc_kind kind);

/* Interfaces that cameras are, or may be, on. */
#define DOC_MAX_LINKS 16
struct doc_link {
    char name[16];
    bool loopback;
    bool certain;   /* a camera's address is on it */
    size_t cameras; /* with a known address */
    double bytes_per_s;
    uint32_t address; /* one camera on it, 0 = not known */
};

struct doctor {
    struct doc_host *host;
    struct doc_load load;
    struct doc_link link[DOC_MAX_LINKS];
    size_t n_links;
    struct doc_report report;
};

/* Runs all checks and sorts the report.  The caller has filled in `host` and `load`. */
void doc_run(struct doctor *d);
size_t doc_count(const struct doc_report *r, enum doc_verdict v);
/* 0 all well, 1 warnings or unknown states, 2 failures. */
int doc_exit_status(const struct doc_report *r);

struct doc_style {
    bool colour, all; /* all: OK ones in full too */
    int width;        /* columns */
};
void doc_print(FILE *f, const struct doctor *d, const struct doc_style *s);
PVX_MUST_CHECK pvx_err doc_print_json(FILE *f, const struct doctor *d, struct pvx_diag *why);
/* Shell script of all remedies.  Files that it writes lie under $ROOT (empty: the host itself). */
void doc_script(FILE *f, const struct doctor *d);
#endif
