#!/bin/bash
# Every #include goes from a room to itself or to one further up in tests/rooms.txt, and no more than two files of a room
# depend on each other in a circle.  check-layers.sh [BUILD]: the circles only with BUILD, where the objects are.
set -u
cd "$(dirname "$0")/.."
git ls-files --cached --others --exclude-standard '*.c' '*.h' '*.cpp' | grep -v ^tests/ | xargs awk '
# The deepest room that holds the file; folders inside a room that are none themselves belong to it.
function room(f) { do sub(/\/?[^\/]*$/, "", f); while (f != "" && !(f in order)); return f }
function house(r) { sub(/\/.*/, "", r); return r }
FILENAME == "tests/rooms.txt" { if ($0 ~ /^[a-z]/) order[$1] = ++n; next }
FNR == 1 && !(room(FILENAME) in order) { print FILENAME ": its room is not in tests/rooms.txt"; bad = 1 }
/^#include "/ {
    split($0, part, "\""); to = part[2]
    if (to ~ /^base\//) to = "daemon/" to
    from = room(FILENAME); at = room(to)
    if (!(at in order)) { print FILENAME ":" FNR ": " to " is in no room: write its path from the top"; bad = 1 }
    else if (order[at] > order[from]) { print FILENAME ":" FNR ": " from " must not include " to ", which is further down"; bad = 1 }
    else if (from != at && from ~ /^daemon\/cli\// && at ~ /^daemon\/cli\// && at !~ /\/(common|pictures|report)$/) {
        print FILENAME ":" FNR ": " from " must not know " to ": commands share common, pictures and report"; bad = 1 }
    else if (house(at) != house(from) && house(from) != "daemon" && at != "daemon/base") {
        print FILENAME ":" FNR ": " house(from) " must not know " to; bad = 1 }
}
/^#include <(sys\/socket|netinet\/|arpa\/|zmq|arv)/ && house(room(FILENAME)) == "recon" {
    print FILENAME ":" FNR ": recon opens no socket or camera"; bad = 1 }
END { exit bad }' tests/rooms.txt || exit 1
[ -z "${1:-}" ] || python3 tests/circles.py "$1" || exit 1
echo "layers: ok"
