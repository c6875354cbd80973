#!/bin/sh
# OpenCV reads a colour TIFF whose planes lie apart as another picture.
#
# Expected: cv2.imread(FILE, IMREAD_UNCHANGED) of an RGB TIFF with PlanarConfiguration 2 (TIFF 6.0, page 38) gives its colours,
#           or None.
# Happens:  with 16-bit integers and with 32-bit floats it gives an array of the right shape and type, in which almost no
#           sample is right.  There is no error and no warning.  With 8 bits the colours are right.
# Seen in:  python3-opencv 4.6.0+dfsg-12 (Debian 12), libtiff 4.5.0
. "$(dirname "$0")/root.sh"
root python3-opencv=4.6.0+dfsg-12
cat > "$R/try/try.py" <<'PY'
import struct
import cv2
import numpy as np

H, W = 12, 20


def write(path, planes, bits, kind):
    """A little-endian TIFF, not compressed, one strip a plane."""
    data, places = b'II*\0\0\0\0\0', []
    for p in planes:
        places.append(len(data))
        data += p.tobytes()
    tags = [(256, 4, [W]), (257, 4, [H]), (258, 3, [bits] * 3), (259, 3, [1]), (262, 3, [2]), (273, 4, places), (277, 3, [3]),
            (278, 4, [H]), (279, 4, [p.nbytes for p in planes]), (284, 3, [2]), (339, 3, [kind] * 3)]
    entries = b''
    for tag, type_, v in tags:
        raw = struct.pack('<%d%s' % (len(v), {3: 'H', 4: 'I'}[type_]), *v)
        if len(raw) > 4:
            at, data = len(data), data + raw
            raw = struct.pack('<I', at)
        entries += struct.pack('<HHI', tag, type_, len(v)) + raw.ljust(4, b'\0')
    data += b'\0' * (len(data) % 2)
    head = struct.pack('<I', len(data))
    open(path, 'wb').write(data[:4] + head + data[8:] + struct.pack('<H', len(tags)) + entries + b'\0' * 4)


print('OpenCV', cv2.__version__)
base = np.arange(H * W * 3).reshape(H, W, 3)
for name, rgb, bits, kind in (('8 bits', (base % 256).astype('u1'), 8, 1), ('16 bits', (base * 80).astype('<u2'), 16, 1),
                              ('floats', (base / 720).astype('<f4'), 32, 3)):
    write('a.tif', [np.ascontiguousarray(rgb[..., c]) for c in range(3)], bits, kind)
    a = cv2.imread('a.tif', cv2.IMREAD_UNCHANGED)
    right = (a[..., ::-1] == rgb).mean()
    print('%s: %s %s, %s' % (name, a.shape, a.dtype, 'right' if right == 1 else '%.1f %% of the samples right' % (100 * right)))
PY
ends "$(inside python3 try.py 2>&1)" 'OpenCV 4.6.0
8 bits: (12, 20, 3) uint8, right
16 bits: (12, 20, 3) uint16, 0.1 % of the samples right
floats: (12, 20, 3) float32, 0.1 % of the samples right'
