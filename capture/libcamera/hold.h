/* hold.h - keeps libcamera alive when a USB camera is plugged in again (private to
 * libcamera.c).
 *
 * libcamera's enumerator (0.0.3, DeviceEnumeratorUdev) notes under the number of a video device that
 * a media device waits for it, and never takes the note back, though what it points to is freed.
 * A camera that is pulled gives its numbers back to the kernel; plugged in again it gets the same,
 * and the first message of udevd about it makes libcamera follow the note: the program crashes.
 * The kernel gives away no number that belongs to an open file, even of a camera that is gone.  So
 * every video device on USB is opened once, beside libcamera and before libcamera learns of it, and
 * stays open until the program ends.  Nothing is done with it; an idle camera does not go to sleep.
 * Cost: one file per video device (a webcam has two), again each time that one is plugged in. */
#ifndef CAP_LIBCAMERA_HOLD_H
#define CAP_LIBCAMERA_HOLD_H

/* Open what is there now and not held yet; quick when nothing is new.  Before libcamera starts, and
 * again before a camera is looked for, so that one that came later is held before it can go.
 * Devices that may not be opened are left out: libcamera cannot use them either.
 * Any thread; calls exclude each other. */
void lc_hold(void);
#endif
