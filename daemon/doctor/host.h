/* host.h - the doctor's view of a host: files under a root, and a few questions to the kernel.
 *
 * Files are given by their absolute path and read under `root`.  Answers that no file holds come
 * through functions, so that tests can give them.  Reading never blocks on hardware.
 * Threads: as the doctor. */
#ifndef DOC_HOST_H
#define DOC_HOST_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <unistd.h>
#include "base/err.h"
#include "recon/opencl/rates.h"

/* What the driver of a network card says (ethtool); each group may be unknown. */
struct doc_nic {
    bool ring_known, pause_known, coalesce_known, stamp_known, eee_known;
    uint32_t rx_ring, rx_ring_max;
    bool tx_pause;
    bool adaptive_rx;
    uint32_t rx_usecs, rx_frames;
    bool hw_stamps; /* transmit and receive time stamps in hardware */
    int phc;        /* /dev/ptpN, -1 = none */
    bool eee_active;
};

struct doc_clock { /* adjtimex(2) */
    bool known, synchronized;
    double max_error_s;
};

/* An OpenCL device, and how fast it moves bytes (recon/opencl/rates.h); rates 0: `slow` says why not. */
struct doc_card {
    struct rec_cl_info info;
    struct rec_cl_rates rates;
    char slow[160];
};

struct doc_host {
    const char *root; /* "" = this host */
    void (*nic)(struct doc_host *h, const char *ifname, struct doc_nic *out);
    void (*clock)(struct doc_host *h, struct doc_clock *out);
    /* Standard output of a command, cut to size; PVX_ENOENT: not installed; PVX_EPERM, PVX_EIO:
     * it failed (diag: its last words). */
    pvx_err (*run)(struct doc_host *h, const char *const *argv, char *out, size_t size,
                   struct pvx_diag *d);
    bool (*space)(struct doc_host *h, const char *path, double *free_bytes);
    /* Permitted capabilities that an executable file gives; false: none. */
    bool (*file_caps)(struct doc_host *h, const char *path, uint64_t *permitted);
    /* The OpenCL devices; none: *d says why.  NULL: not looked at. */
    size_t (*cards)(struct doc_host *h, struct doc_card out[REC_CL_MOST], struct pvx_diag *d);
    void (*wait)(struct doc_host *h, double seconds);
    double sample_s;     /* counters are read twice, this far apart; 0 = once */
    double disk_write;   /* bytes to write as a speed test; 0 = no test */
    const char *exe_dir; /* where pyrovoxd lies, "" = not known */
    void *ctx;
};
void doc_host_init(struct doc_host *h); /* this host */
/* The functions of this host's struct, in host_real.c. */
void doc_real_nic(struct doc_host *h, const char *ifname, struct doc_nic *out);
pvx_err doc_real_run(struct doc_host *h, const char *const *argv, char *out, size_t size,
                     struct pvx_diag *d);

/* This host's.  Takes a few tenths of a second for each device. */
size_t doc_real_cards(struct doc_host *h, struct doc_card out[REC_CL_MOST], struct pvx_diag *d);
/* Bytes a second that all processors together copy, read plus written; 0: no memory. */
double doc_copy_rate(void);
/* A device in one line: what it is, how fast, or why it cannot be used. */
void doc_card_line(const struct doc_card *c, char *out, size_t size);

/* First `size`-1 bytes of a file, trailing white space cut; false: cannot be read. */
bool doc_text(struct doc_host *h, char *out, size_t size, const char *fmt, ...) PVX_PRINTF(4, 5);
/* Whole file up to 4 MiB, 0-terminated; NULL: cannot be read.  Owner: caller, free(). */
char *doc_file(struct doc_host *h, const char *fmt, ...) PVX_PRINTF(2, 3);
/* A file that holds one whole number. */
bool doc_int(struct doc_host *h, int64_t *out, const char *fmt, ...) PVX_PRINTF(3, 4);
/* As access(2).  Is it there?  May this process read and write it? */
bool doc_access(struct doc_host *h, int mode, const char *fmt, ...) PVX_PRINTF(3, 4);
#define doc_exists(h, ...) doc_access(h, F_OK, __VA_ARGS__)
#define doc_usable(h, ...) doc_access(h, R_OK | W_OK, __VA_ARGS__)

#define DOC_MAX_NAMES 512
struct doc_names {
    size_t n;
    char v[DOC_MAX_NAMES][64]; /* sorted; longer names are left out */
};
/* Entries of a folder, without those that begin with a dot.  A folder that is not there has none.  NULL: no
 * memory.  Owner: caller, free(). */
struct doc_names *doc_names(struct doc_host *h, const char *fmt, ...) PVX_PRINTF(2, 3);
/* Is a process of this name (as in /proc/N/comm) running?  *pid may be NULL. */
bool doc_process(struct doc_host *h, const char *comm, int *pid);
#endif
