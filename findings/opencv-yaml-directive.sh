#!/bin/sh
# What OpenCV's FileStorage writes as YAML cannot be read by YAML readers.
#
# Expected: yaml.safe_load reads the file of a FileStorage that holds one number.
# Happens:  the file begins with "%YAML:1.0".  A directive of YAML is "%YAML 1.1", with a blank, and the reader stops there.
#           Without this line the file is read.
# Seen in:  python3-opencv 4.6.0+dfsg-12, python3-yaml 6.0-3+b2 (Debian 12)
. "$(dirname "$0")/root.sh"
root python3-opencv=4.6.0+dfsg-12 python3-yaml=6.0-3+b2
cat > "$R/try/try.py" <<'PY'
import cv2
import yaml

f = cv2.FileStorage('one.yml', cv2.FILE_STORAGE_WRITE)
f.write('width', 640)
f.release()
text = open('one.yml').read()
print('OpenCV', cv2.__version__)
print(repr(text))
for what, t in (('as it is', text), ('without its first line', text.split('\n', 1)[1])):
    try:
        print(what + ':', yaml.safe_load(t))
    except yaml.YAMLError as e:
        print(what + ':', e.problem)
PY
ends "$(inside python3 try.py 2>&1)" "OpenCV 4.6.0
'%YAML:1.0\n---\nwidth: 640\n'
as it is: expected alphabetic or numeric character, but found ':'
without its first line: {'width': 640}"
