#!/bin/sh
# nanovdb_validate calls a grid "failed" and ends with status 0.
#
# Expected: a program that validates files ends with another status than 0 when a grid is bad, as h5check or pngcheck do.
# Happens:  a grid whose checksum does not fit is listed as "failed" and the status is 0.  Without -v a good file prints nothing,
#           so only the word in the output tells a script.
# Seen in:  libnanovdb-tools 10.0.1-2 (Debian 12)
. "$(dirname "$0")/root.sh"
root libnanovdb-tools=10.0.1-2 python3-openvdb=10.0.1-2
cat > "$R/try/try.py" <<'PY'
import subprocess
import pyopenvdb

grid = pyopenvdb.FloatGrid()
grid.name = 'density'
for i in range(10):
    grid.getAccessor().setValueOn((i, 0, 0), 1.5)
pyopenvdb.write('a.vdb', grids=[grid])
subprocess.run(['nanovdb_convert', '--checksum', 'full', 'a.vdb', 'good.nvdb'], check=True)
data = bytearray(open('good.nvdb', 'rb').read())
data[len(data) // 2] ^= 0x55
open('bad.nvdb', 'wb').write(data)
for name in ('good', 'bad'):
    r = subprocess.run(['nanovdb_validate', '-v', name + '.nvdb'], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    said = [word for word in ('passed', 'failed') if word in r.stdout.split()]
    print('%s: it says %s, status %d' % (name, ' '.join(said), r.returncode))
PY
ends "$(inside python3 try.py 2>&1)" 'good: it says passed, status 0
bad: it says failed, status 0'
