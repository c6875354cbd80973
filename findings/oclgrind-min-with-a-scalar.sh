#!/bin/sh
# Oclgrind computes min and max of a vector with a scalar in the first lane alone.
#
# Expected: OpenCL C 1.1 and later have gentype min(gentype x, sgentype y): each lane of x is compared with y.  The program that
#           checks kernels for races and bounds gives the results that a device gives.
# Happens:  only the first lane is compared with the scalar.  The others are compared with other numbers, and nothing is
#           reported.  With the scalar written as a vector, min(x, (uint4)(100)), all lanes are right.
# Seen in:  oclgrind 21.10-3 (Debian 12)
. "$(dirname "$0")/root.sh"
root oclgrind=21.10-3
cat > "$R/try/min.cl" <<'CL'
kernel void least(global const uint4 *in, global uint4 *scalar, global uint4 *vector)
{
    *scalar = min(*in, 100u);
    *vector = min(*in, (uint4)(100u));
}
CL
cat > "$R/try/min.sim" <<'SIM'
min.cl
least
1 1 1
1 1 1
<size=16 uint>
500 600 700 800
<size=16 uint fill=7 dump>
<size=16 uint fill=7 dump>
SIM
inside oclgrind-kernel min.sim > "$T/out" 2>&1
grep ' = ' "$T/out" # lanes of `scalar` after the first change from run to run
lanes() { sed -n "s/^ *$1\[[0-9]\] = //p" "$T/out" | tr '\n' ' '; }
same() { [ "$1" = "$2" ] && echo right || echo wrong; }
ends "with a vector: $(same "$(lanes vector)" '100 100 100 100 ')
with a scalar, first lane: $(same "$(lanes scalar | cut -d ' ' -f 1)" 100)
with a scalar, all lanes: $(same "$(lanes scalar)" '100 100 100 100 ')" 'with a vector: right
with a scalar, first lane: right
with a scalar, all lanes: wrong'
