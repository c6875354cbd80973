#!/bin/bash
# What could end the daemon without its doing (the table in capture/README.md), and that after an end all the
# same it comes back with what it was doing.
name=046
. "$(dirname "$0")/lib.sh"
config a.yaml <<< $'cameras: "sim:"\nfps: 20\nrecord: {path: "'"$dir"'/take-%s.h5", keep_free_gb: 0}'
run() { start "$1.log" env STATE_DIRECTORY="$dir" "$pyrovoxd" --config "$dir/a.yaml"; wait_for published 5; }
rec() { "$pyrovox" record --raw "$1" --control "$control" > "$dir/rec.log"; }
recording() { field "s['record']['state'] == 'recording'"; }

# more clients than the soft limit of handles, as systemd sets it to 1024: libzmq aborts when accept() has none left
crowd() {
    timeout "$patience" "$py" - "$volumes" "$control" <<'PY'
import socket, sys
crowd = []
for i in range(300):
    s = socket.socket(socket.AF_UNIX); s.connect(sys.argv[1 + i % 2][len("ipc://"):]); crowd.append(s)
    s.sendall(b"\xff") # nobody who speaks its language, and who goes
PY
}
start few.log bash -c "ulimit -Sn 80; exec '$pyrovoxd' --config '$dir/a.yaml'"
check few-handles wait_for published 5
check a-crowd-of-clients crowd
check lives-on wait_for published 20
# a disk whose files may not grow: an error of the recording, no signal
prlimit --pid "$started" --fsize=100000
rec start
check limit-of-size wait_for field "'cannot' in s['record']['error'] or 'large' in s['record']['error']"
n=$(sets)
check goes-on wait_for published $((n + 20))
kill "$started"; check ends ended "$started" 0

# ended in the middle of a take: it records again; ended in order: it does not
check runs run killed
check records rec start
check recording wait_for recording
kill -9 "$started"; wait "$started" 2> "$dir/null"
sleep 1.1 # another second, another name
check runs-again run again
check recording-goes-on wait_for recording
check said grep -q "the last run ended while it recorded: recording goes on in $dir/take-" "$dir/again.log"
kill "$started"; check ends-in-order ended "$started" 0
check both-takes [ "$(ls "$dir"/take-*.h5 | wc -l)" = 3 ]
check runs-afresh run afresh
check does-not-record field "s['record']['state'] == 'idle'"

# the matrix that it works on is cut
matrix=$(find "$PYROVOX_CACHE" -type f | head -n 1)
truncate -s 4096 "$matrix"
check cut-matrix-ends-it ended "$started" 1
check and-is-named grep -q "a file that is mapped was cut.*$matrix" "$dir/afresh.log"
check is-rebuilt run rebuilt
kill "$started"; check ends-at-last ended "$started" 0
exit $rc
