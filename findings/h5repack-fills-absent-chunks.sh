#!/bin/sh
# h5repack with a filter writes the chunks that a dataset never had.
#
# Expected: h5repack -f GZIP=1 packs the chunks that are there.  A chunk that was never written stays absent, as it does when
#           h5repack runs without a filter.
# Happens:  with any -f, also NONE, each absent chunk is written with the fill value.  A sparse dataset becomes a dense one, and a
#           reader that takes an absent chunk for "no data" (H5Dget_num_chunks) sees data everywhere.
# Seen in:  hdf5-tools 1.10.8+repack1-1, python3-h5py 3.7.0-8 (Debian 12)
. "$(dirname "$0")/root.sh"
root hdf5-tools=1.10.8+repack1-1 python3-h5py=3.7.0-8
cat > "$R/try/try.py" <<'PY'
import subprocess
import h5py

print('HDF5', h5py.version.hdf5_version)
with h5py.File('a.h5', 'w') as f:
    d = f.create_dataset('volume', (6, 4, 4), 'f4', chunks=(1, 4, 4), maxshape=(None, 4, 4))
    d[0] = d[2] = d[5] = 1
for options in ([], ['-f', 'NONE'], ['-f', 'SHUF'], ['-f', 'GZIP=1']):
    subprocess.run(['h5repack'] + options + ['a.h5', 'b.h5'], check=True)
    with h5py.File('b.h5') as f:
        print('h5repack %-9s 3 of 6 chunks before, %d after' % (' '.join(options) + ':', f['volume'].id.get_num_chunks()))
PY
ends "$(inside python3 try.py 2>&1)" 'HDF5 1.10.8
h5repack :         3 of 6 chunks before, 3 after
h5repack -f NONE:  3 of 6 chunks before, 6 after
h5repack -f SHUF:  3 of 6 chunks before, 6 after
h5repack -f GZIP=1: 3 of 6 chunks before, 6 after'
