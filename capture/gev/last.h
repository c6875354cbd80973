/* last.h - our own thread gives up objects of Aravis (private to the aravis: files).
 *
 * The finalizers of a device and of a stream join Aravis' threads.  If such a thread drops the last reference, it
 * joins itself, and GLib ends the process: "Resource deadlock avoided".  (Seen: the heartbeat thread emitted
 * "control-lost".  An emission with a handler holds the device, and we released ours meanwhile.)
 * So nothing connects to that signal (watch.c asks instead), and we drop our reference when it is the only one. */
#ifndef CAP_ARAVIS_LAST_H
#define CAP_ARAVIS_LAST_H
#include <arv.h>
#include <stdbool.h>

/* Is the caller's reference the only one?  Once true it stays so, because no other holder is left. */
bool aravis_is_last(gpointer object);
/* Wait for that, then give it up: Aravis' threads of this object have ended. */
void aravis_unref_last(gpointer object);
/* The camera, then its device; sets *camera NULL, which it may have been. */
void aravis_close_camera(ArvCamera **camera);
#endif
