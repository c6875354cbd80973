/* last.h - drops the last reference to objects of Aravis in our own thread (private to the aravis: files).
 *
 * The finalizers of a device and of a stream join Aravis' threads.  If such a thread drops the last reference, it
 * joins itself, and GLib ends the process: "Resource deadlock avoided".  (Seen: the heartbeat thread emitted
 * "control-lost".  An emission with a handler holds the device, and we released ours meanwhile.)
 * So nothing connects to that signal (watch.c asks instead), and we drop our reference when it is the only one. */
#ifndef CAP_ARAVIS_LAST_H
#define CAP_ARAVIS_LAST_H
#include <arv.h>
#include <stdbool.h>

/* Whether the caller's reference is the only one.  Once true it stays so, because no other holder is left. */
bool aravis_is_last(gpointer object);
/* Wait until the reference is the last, then drop it.  On return Aravis' threads of this object have ended. */
void aravis_unref_last(gpointer object);
/* Release the camera, then its device; sets *camera to NULL.  *camera may be NULL. */
void aravis_close_camera(ArvCamera **camera);
#endif
