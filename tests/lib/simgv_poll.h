/* simgv_poll.h - g_poll for the threads of simulated cameras (private to simgv.c).
 *
 * libaravis' fake camera waits for its next frame with a poll timeout that is computed unsigned:
 * when the deadline has just passed it becomes 100 ms, and below 1 ms it is 0 and spins.  libaravis
 * calls g_poll through the symbol table, so a definition in the executable is used instead of
 * GLib's.  This one knows the frame clock of each camera's thread and waits exactly until its next
 * tick; threads that serve no camera get plain poll(2). */
#ifndef SIMGV_POLL_H
#define SIMGV_POLL_H
#include <stdint.h>

struct simgv_pacer {
    uint32_t address_be; /* the camera's; its control socket tells which thread is whose */
    /* Frame period while streaming, us; 0 = idle.  Called on the camera's thread. */
    int64_t (*period_us)(void *ctx);
    void *ctx;
    struct simgv_pacer *next;
};
/* The pacer must be there before its camera's thread starts and until it has ended. */
void simgv_poll_add(struct simgv_pacer *p);
void simgv_poll_remove(struct simgv_pacer *p);
#endif
