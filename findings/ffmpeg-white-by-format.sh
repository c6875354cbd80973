#!/bin/sh
# FFmpeg gives white another value when it makes 16-bit colour of fewer bits.
#
# Expected: the largest sample stays the largest: 255 of 8 bits or 1023 of 10 become 65535 of 16 bits, in grey and in colour.
# Happens:  only grey that stays grey becomes 65535.  As 16-bit RGB, grey of 8 bits becomes 65280, RGB of 8 bits 65283, and grey
#           of 10 and 12 bits 65472 and 65520.  A test for saturation at full scale then finds none.
# Seen in:  ffmpeg 7:5.1.9-0+deb12u1 (Debian 12; the filter scale, libswscale)
. "$(dirname "$0")/root.sh"
root ffmpeg=7:5.1.9-0+deb12u1 python3-minimal
cat > "$R/try/try.py" <<'PY'
import struct
import subprocess

for format, pixel in (('gray', b'\xff'), ('rgb24', b'\xff' * 3), ('gray10le', b'\xff\x03'), ('gray12le', b'\xff\x0f'), ('gray16le', b'\xff\xff')):
    said = []
    for out, samples in (('gray16le', 1), ('rgb48le', 3)):
        data = subprocess.run(['ffmpeg', '-v', 'error', '-f', 'rawvideo', '-pix_fmt', format, '-s', '16x16', '-i', '-', '-f', 'rawvideo',
                               '-pix_fmt', out, '-'], input=pixel * 256, stdout=subprocess.PIPE, check=True).stdout
        said.append('%s %d' % (out, struct.unpack('<H', data[:2])[0]))
    print('white of %s: %s' % (format, ', '.join(said)))
PY
ends "$(inside python3 try.py 2>&1)" 'white of gray: gray16le 65535, rgb48le 65280
white of rgb24: gray16le 65277, rgb48le 65283
white of gray10le: gray16le 65535, rgb48le 65472
white of gray12le: gray16le 65535, rgb48le 65520
white of gray16le: gray16le 65535, rgb48le 65535'
