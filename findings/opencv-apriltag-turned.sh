#!/bin/sh
# OpenCV's pictures of AprilTags stand upside down beside those of AprilTag itself.
#
# Expected: tag 0 of family 36h11 drawn by OpenCV is the picture that AprilTag's own library has of it, so the corners that
#           the two report of one printed tag come in one order.
# Happens:  the picture is turned by 180 degrees.  Corner 0 of OpenCV is the tag's top left in its own picture, and another
#           corner of the tag for AprilTag.  A board printed by one and read by the other has a pose that is turned.
# Seen in:  python3-opencv 4.6.0+dfsg-12, python3-apriltag 3.3.0-1+b1, libapriltag3 3.3.0-1+b1 (Debian 12)
. "$(dirname "$0")/root.sh"
root python3-opencv=4.6.0+dfsg-12 python3-apriltag=3.3.0-1+b1 libapriltag3=3.3.0-1+b1
cat > "$R/try/try.py" <<'PY'
import cv2
import numpy as np
from apriltag import apriltag

page = np.full((200, 200), 255, np.uint8)
family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
page[50:150, 50:150] = cv2.aruco.drawMarker(family, 0, 100)
corners, ids, _ = cv2.aruco.detectMarkers(page, family)


def where(p):
    return ('top ' if p[1] < 100 else 'bottom ') + ('left' if p[0] < 100 else 'right')


print('OpenCV %s: tag %d begins at the %s' % (cv2.__version__, ids[0][0], where(corners[0][0][0])))
tag = apriltag('tag36h11').detect(page)[0]
lb, rb, rt, lt = tag['lb-rb-rt-lt']
print('AprilTag: the left top of tag %d is at the %s' % (tag['id'], where(lt)))
PY
ends "$(inside python3 try.py 2>&1)" 'OpenCV 4.6.0: tag 0 begins at the top left
AprilTag: the left top of tag 0 is at the bottom right'
