/* last.h - objects of Aravis are given up by a thread of ours (private to the aravis: files).
 *
 * The finalizers of a device and of a stream join Aravis' threads.  If the last reference is dropped by one
 * of these, it joins itself, and GLib ends the process: "Resource deadlock avoided" (seen: the heartbeat
 * emitted "control-lost", an emission that somebody listens to holds the device, and we let go meanwhile).
 * So nobody listens to that signal (watch.c asks instead), and our reference goes when it is the only one. */
#ifndef CAP_ARAVIS_LAST_H
#define CAP_ARAVIS_LAST_H
#include <arv.h>
#include <stdbool.h>

/* Has nobody but the caller a reference?  Once true it stays so, for nobody is left to give any. */
bool aravis_is_last(gpointer object);
/* Wait for that, then give it up: Aravis' threads of this object have ended. */
void aravis_unref_last(gpointer object);
/* The camera, then its device; sets *camera NULL, which it may have been. */
void aravis_close_camera(ArvCamera **camera);
#endif
