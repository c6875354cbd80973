#!/bin/sh
# FFmpeg gives the code values of a packed Phantom recording as if they were light.
#
# Expected: a .cine whose images have 10 packed bits (biCompression 256) stores 12 bits of light by a table of its
#           specification, a line for dark values and a power of about 2.22 for bright ones.  Code 512 is a quarter of full
#           scale, 998 of 4095, and not half of it.
# Happens:  the demuxer and rawvideo spread the 10 bits over 16.  Code 512 comes as 32800 of 65535, so that the middle of the
#           scale is twice as bright as it was.  Of 12 packed bits (biCompression 1024) nothing is read.
# Seen in:  ffmpeg 7:5.1.9-0+deb12u1 (Debian 12)
. "$(dirname "$0")/root.sh"
root ffmpeg=7:5.1.9-0+deb12u1 python3-minimal
cat > "$R/try/try.py" <<'PY'
import struct
import subprocess

CODES = 64, 200, 512, 1000
for bits, packing in ((10, 256), (12, 1024)):
    value = 0
    for code in CODES * 2:
        value = value << bits | code
    image = value.to_bytes(8 * bits // 8, 'big')
    setup = bytearray(10408)
    for at, form, v in ((140, '2s', b'ST'), (142, 'H', len(setup)), (768, 'I', 1000), (896, 'I', bits)):
        struct.pack_into('<' + form, setup, at, v)
    lists = 84 + len(setup)
    with open('a.cine', 'wb') as f:
        f.write(struct.pack('<2sHHHiIiIIIIQ', b'CI', 44, 0, 1, 0, 1, 0, 1, 44, 84, lists, 1 << 60))
        f.write(struct.pack('<IiiHHIIiiII', 40, 4, 2, 1, 16, packing, len(image), 0, 0, 0, 4096) + setup)
        f.write(struct.pack('<QII', lists + 8, 8, len(image)) + image)
    run = subprocess.run(['ffmpeg', '-v', 'quiet', '-i', 'a.cine', '-f', 'rawvideo', '-pix_fmt', 'gray16le', '-'], stdout=subprocess.PIPE)
    got = struct.unpack('<%dH' % (len(run.stdout) // 2), run.stdout)[:len(CODES)]
    print('%d packed bits, codes %s: %s' % (bits, ' '.join(map(str, CODES)), ' '.join(map(str, got)) or 'not read'))
PY
ends "$(inside python3 try.py 2>&1)" '10 packed bits, codes 64 200 512 1000: 4100 12812 32800 64062
12 packed bits, codes 64 200 512 1000: not read'
