/* find.h - finds a camera, checks that it answers, and opens it (private to the aravis: files).
 *
 * Cameras can only be opened one after the other, and Aravis asks a camera that does not answer for 3 s.  So every
 * address gets a discovery command first.  A camera answers within a millisecond, and we give up after 0.3 s.
 * Serial numbers and names are looked up in Aravis' list of devices.  Threads that want the list at the same time
 * share one renewal.  The address is remembered and tried first the next time.
 * Threads: any. */
#ifndef CAP_ARAVIS_FIND_H
#define CAP_ARAVIS_FIND_H
#include <arv.h>
#include "capture/source/source.h"

/* Addresses of a GigE camera; IPv4, host order; all 0 for other cameras. */
struct aravis_route {
    uint32_t camera, host, broadcast;
};

struct aravis_who {
    char vendor[33], model[33], serial[17], name[17];
};
/* Whether a camera answers at the address.  who may be NULL. */
bool aravis_probe(uint32_t address, struct aravis_who *who);

/* Whether a program controls the camera at the address. */
bool aravis_controlled(uint32_t address);
uint32_t aravis_address(const char *text); /* "127.0.0.2", host order; 0 = no IPv4 address */

/* To be held during every use of Aravis' list of devices. */
void aravis_list_lock(void);
void aravis_list_unlock(void);

/* To be held while Aravis reads a GenICam file, because its parser has global state (seen: two cameras opened at once
 * got documents of neither). */
void aravis_parser_lock(void);
void aravis_parser_unlock(void);

/* list.c, as cap_source_ops.list. */
PVX_MUST_CHECK pvx_err aravis_list(void (*cb)(void *ctx, const struct cap_found *f), void *ctx,
                                   struct pvx_diag *d);

/* Owner: caller, aravis_close_camera.  PVX_ENOENT: no camera answers; PVX_EBUSY: another program controls it;
 * PVX_ECORRUPT: its GenICam file cannot be right. */
PVX_MUST_CHECK pvx_err aravis_open_camera(const struct cap_source_config *c, ArvCamera **out,
                                          struct aravis_route *route, struct pvx_diag *d);
#endif
