#!/bin/sh
# OpenCV finds the corners of a ChArUco board half a pixel beside their place.
#
# Expected: cv2.aruco.interpolateCornersCharuco gives the corners where cornerSubPix finds them in the same picture.  Both have
#           the first pixel's centre at (0, 0).
# Happens:  all corners lie half a pixel further right and down.  A calibration from them has cx and cy half a pixel too large.
# Seen in:  python3-opencv 4.6.0+dfsg-12 (Debian 12)
. "$(dirname "$0")/root.sh"
root python3-opencv=4.6.0+dfsg-12
cat > "$R/try/try.py" <<'PY'
import cv2
import numpy as np

SQUARE, BORDER = 60, 50
dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
board = cv2.aruco.CharucoBoard_create(7, 5, 1.0, 0.7, dictionary)
picture = np.pad(board.draw((7 * SQUARE, 5 * SQUARE)), BORDER, constant_values=255)
picture = cv2.GaussianBlur(picture, (0, 0), 1.2)
markers, ids, _ = cv2.aruco.detectMarkers(picture, dictionary)
n, corners, _ = cv2.aruco.interpolateCornersCharuco(markers, ids, picture, board)
fine = cv2.cornerSubPix(picture, corners.copy(), (8, 8), (-1, -1), (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4))
print('OpenCV', cv2.__version__)
print('%d corners' % n)
where = np.array([(BORDER + SQUARE * i - 0.5, BORDER + SQUARE * j - 0.5) for i in range(1, 7) for j in range(1, 5)])
for name, c in (('interpolateCornersCharuco', corners), ('cornerSubPix', fine)):
    off = np.array([p - where[np.argmin(((where - p) ** 2).sum(1))] for p in c[:, 0]])
    print('%s: %.1f right, %.1f down of the drawn corners' % (name, *(off.mean(0).round(1) + 0.0)))
PY
ends "$(inside python3 try.py 2>&1)" 'OpenCV 4.6.0
24 corners
interpolateCornersCharuco: 0.5 right, 0.5 down of the drawn corners
cornerSubPix: 0.0 right, 0.0 down of the drawn corners'
