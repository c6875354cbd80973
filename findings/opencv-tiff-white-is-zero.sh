#!/bin/sh
# OpenCV obeys a TIFF's "white is zero" at 8 bits and ignores it at 16.
#
# Expected: PhotometricInterpretation 0 (WhiteIsZero) means the same at each depth: cv2.imread inverts both or neither.
# Happens:  8-bit samples come inverted, as the tag asks.  16-bit samples come as they are stored, so a camera's picture
#           arrives as its negative.  There is no error and no warning.
# Seen in:  python3-opencv 4.6.0+dfsg-12 (Debian 12)
. "$(dirname "$0")/root.sh"
root python3-opencv=4.6.0+dfsg-12
cat > "$R/try/try.py" <<'PY'
import struct
import cv2
import numpy as np


def write(path, samples):
    h, w = samples.shape
    tags = [(256, 4, w), (257, 4, h), (258, 3, 8 * samples.itemsize), (259, 3, 1), (262, 3, 0), (273, 4, 8), (277, 3, 1), (278, 4, h),
            (279, 4, samples.nbytes)]
    data = b'II*\0' + struct.pack('<I', 8 + samples.nbytes) + samples.tobytes() + struct.pack('<H', len(tags))
    open(path, 'wb').write(data + b''.join(struct.pack('<HHII', t, y, 1, v) for t, y, v in tags) + b'\0' * 4)


print('OpenCV', cv2.__version__)
for type_ in ('u1', '<u2'):
    stored = (np.arange(32 * 8).reshape(8, 32) * (np.iinfo(type_).max // 255)).astype(type_)
    write('a.tif', stored)
    a = cv2.imread('a.tif', cv2.IMREAD_UNCHANGED)
    a = a if a.ndim == 2 else a[..., 0]
    print('%2d bits:' % (8 * stored.itemsize),
          'as stored' if (a == stored).all() else 'inverted' if (a == np.iinfo(type_).max - stored).all() else 'neither')
PY
ends "$(inside python3 try.py 2>&1)" 'OpenCV 4.6.0
 8 bits: inverted
16 bits: as stored'
