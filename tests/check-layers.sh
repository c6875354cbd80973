#!/bin/bash
# Dependencies one way: daemon/base <- {capture, recon, proto} <- daemon.  Greps the #includes.
set -u
cd "$(dirname "$0")/.."
bad=0
deny() { # folder, pattern of forbidden includes
    local hits
    hits=$(grep -rnE "^#include \"($2)" "$1" --include='*.c' --include='*.h' --include='*.cpp' 2>/dev/null)
    [ "$1" = daemon ] && hits=$(grep -v '^daemon/base' <<< "$hits")
    if [ -n "$hits" ]; then echo "$hits"; echo "  ^ $1 must not include these"; bad=1; fi
}
deny daemon/base 'capture/|recon/|proto/|daemon/|cli/'
deny capture 'recon/|proto/|daemon/|cli/'
deny recon 'capture/|proto/|daemon/|cli/'
deny proto 'capture/|recon/|daemon/|cli/'
for f in recon/*.c recon/*/*.c; do
    [ -f "$f" ] || continue
    if grep -nE '<(sys/socket|netinet/|arpa/|zmq|arv)' "$f"; then echo "$f: recon opens no socket or camera"; bad=1; fi
done
[ $bad = 0 ] && echo "layers: ok"
exit $bad
