/* hold.h - prevents a crash of libcamera when a USB camera is plugged in again (private to libcamera.c).
 *
 * libcamera's enumerator (0.0.3, DeviceEnumeratorUdev) stores under the number of a video device which media device
 * waits for it.  It never removes this entry, although the media device is freed.  A camera that is unplugged returns
 * its numbers to the kernel, and gets the same ones when it is plugged in again.  The first message of udevd about it
 * makes libcamera follow the entry, and the program crashes.
 * The kernel never reuses a number that belongs to an open file, even if the camera is gone.  So every video device
 * on USB is opened once, beside libcamera and before libcamera learns of it, and stays open until the program ends.
 * The file is not used otherwise.  An idle camera does not go to sleep.
 * Cost: one file per video device (a webcam has two), and again each time that one is plugged in. */
#ifndef CAP_LIBCAMERA_HOLD_H
#define CAP_LIBCAMERA_HOLD_H

/* Open the devices that are present and not held yet; quick if none is new.  Called before libcamera starts, and
 * again before each search for a camera, so that a camera that came later is held before it can go.  Devices that may
 * not be opened are left out, because libcamera cannot use them either.  Any thread; calls exclude each other. */
void lc_hold(void);
#endif
