#!/bin/sh
# OpenCV turns a film with a rotation tag of 90 or 270 degrees the wrong way.
#
# Expected: cv2.VideoCapture turns frames by the display matrix as ffmpeg and players do.
# Happens:  90 and 270 are taken for each other, so the frames come upside down.  180 is right.  A telephone that films upright
#           writes such a tag.
# Seen in:  python3-opencv 4.6.0+dfsg-12 with ffmpeg 7:5.1.9-0+deb12u1 (Debian 12)
. "$(dirname "$0")/root.sh"
root python3-opencv=4.6.0+dfsg-12 ffmpeg=7:5.1.9-0+deb12u1
cat > "$R/try/try.py" <<'PY'
import subprocess
import cv2


def bright(a):
    """The quarter that is bright, and the size."""
    h, w = a.shape[:2]
    at = [n for n, y, x in (('top left', 1, 1), ('top right', 1, 3), ('bottom left', 3, 1), ('bottom right', 3, 3))
          if a[h * y // 4, w * x // 4, 0] > 128]
    return '%dx%d, bright at the %s' % (w, h, ' and '.join(at))


def ffmpeg(*args):
    subprocess.run(('ffmpeg', '-v', 'error', '-y') + args, check=True)


print('OpenCV', cv2.__version__)
ffmpeg('-f', 'lavfi', '-i', "nullsrc=s=64x48,geq=lum='if(lt(X,32)*lt(Y,24),235,16)':cb=128:cr=128", '-frames:v', '2', '-c:v',
       'libx264', '-qp', '0', 'up.mp4')
for r in (0, 90, 180, 270):
    ffmpeg('-i', 'up.mp4', '-metadata:s:v', 'rotate=%d' % r, '-c', 'copy', 'a.mp4')
    ffmpeg('-i', 'a.mp4', '-frames:v', '1', 'a.png')
    print('%3d: ffmpeg %s | OpenCV %s' % (r, bright(cv2.imread('a.png')), bright(cv2.VideoCapture('a.mp4').read()[1])))
PY
ends "$(inside python3 try.py 2>&1)" 'OpenCV 4.6.0
  0: ffmpeg 64x48, bright at the top left | OpenCV 64x48, bright at the top left
 90: ffmpeg 48x64, bright at the bottom left | OpenCV 48x64, bright at the top right
180: ffmpeg 64x48, bright at the bottom right | OpenCV 64x48, bright at the bottom right
270: ffmpeg 48x64, bright at the top right | OpenCV 48x64, bright at the bottom left'
