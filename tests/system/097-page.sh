#!/bin/bash
# The page's modules in nodejs: golden messages read to the same values, mutated ones refused or read, never worse;
# bricks from one volume to the next; contrast of the colours.
name=097
. "$(dirname "$0")/lib.sh"
modules=$dir/page
cp -r daemon/view/page "$modules"; echo '{"type": "module"}' > "$modules/package.json"
for what in golden half lz4 mutated bricks flat bright cells camera contrast probe names; do
    check "$what" timeout "$patience" node tests/view/vectors.mjs "$what" "$modules" proto/vectors
done
exit $rc
