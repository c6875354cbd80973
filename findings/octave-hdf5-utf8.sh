#!/bin/sh
# Octave stops reading an HDF5 file at the first UTF-8 text.
#
# Expected: load FILE gives every dataset that Octave can represent.  What it cannot is passed over or named.
# Happens:  the first dataset of UTF-8 strings (H5T_CSET_UTF8, as h5py writes every str) is not loaded, and neither is any dataset
#           after it in the order of names.  It warns of the first alone, and load succeeds.  An ASCII string in its place loads,
#           and so do those after it.
# Seen in:  octave 7.3.0-2, python3-h5py 3.7.0-8 (Debian 12)
. "$(dirname "$0")/root.sh"
root octave=7.3.0-2 python3-h5py=3.7.0-8
cat > "$R/try/make.py" <<'PY'
import h5py

for name, charset in (('utf8', 'utf-8'), ('ascii', 'ascii')):
    with h5py.File(name + '.h5', 'w') as f:
        f['a'] = 1.0
        f.create_dataset('b', data='words', dtype=h5py.string_dtype(charset, 5))
        f['c'] = 3.0
PY
inside python3 make.py || exit 2
see() {
    inside octave-cli --no-gui --no-init-file --eval "
        try s = load('-hdf5', '$1.h5'); catch e, disp(e.message); s = struct(); end
        n = fieldnames(s); printf('$1: %s\n', strjoin(n', ' '))" 2>&1 | grep -E "^($1:|warning: load)"
}
ends "$(see ascii; see utf8)" 'ascii: a b c
warning: load: error while reading hdf5 item '\''b'\''
utf8: a'
