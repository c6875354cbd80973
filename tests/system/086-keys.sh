#!/bin/bash
# Keys as a user has them: made by keygen, a daemon that is reached by a name of this host's network, clients with
# and without a key, a key that is taken back while its owner reads.
name=086
. "$(dirname "$0")/lib.sh"
# three ports that are ours: who holds them without listening lets the daemon have them
free_ports 3
read -r port control_port previews_port <<< "${ports[*]}"
keys=$dir/keys
mkdir "$keys"

made() {
    { "$pyrovox" keygen "$keys/lab" && "$pyrovox" keygen "$keys/anna" --server "$keys/lab.pub" &&
        "$pyrovox" keygen "$keys/bert" --server "$keys/lab.pub" --control; } > "$keys/said" || return 1
    [ "$(stat -c %a "$keys/lab.key")" = 600 ] && cat "$keys/anna.pub" "$keys/bert.pub" > "$keys/clients.keys"
}
check keygen made
run "$pyrovox" keygen "$keys/anna" --server "$keys/lab.pub"
check keygen-writes-nothing-over says 1 "anna.pub is there already"

cat > "$dir/a.yaml" <<E2
rig: $PWD/tests/data/rig4.yaml
cameras: "sim:"
fps: 20
publish: {endpoints: ["tcp://*:$port", "$volumes"], previews: "tcp://*:$previews_port"}
control: {endpoint: "tcp://127.0.0.1:$control_port"}
keys: {server: keys/lab.key, clients: keys/clients.keys}
record: {path: "$dir/take.h5", keep_free_gb: 0, ring: {seconds: 2, memory: 100MB, pre: 1}}
triggers: [{name: mine, pre: 0.1, post: 0.1}]
E2
start daemon.log "$pyrovoxd" --config "$dir/a.yaml"
daemon=$started
ask=("$pyrovox" status --endpoint "tcp://127.0.0.1:$control_port")
answers() { "${ask[@]}" --key "$keys/bert.key" --timeout 5 > "$dir/said" 2>&1; }
start heard.log listen # by the file, which needs no key
volumes_for() { "$pyrovox" record --endpoint "tcp://127.0.0.1:$port" --key "$keys/$1.key" --volumes 3 --out "$dir/out-$1-$2" -q; }
check control-with-its-key wait_for answers
run "${ask[@]}" --key "$keys/anna.key" --timeout 1
check read-is-not-control says 1 "refuses this key"
run "${ask[@]}" --timeout 1
check no-key-no-answer says 1 "asks for a key"
# twice refused by the handler, which reads this; one without a key never gets so far
refused() { "${ask[@]}" --key "$keys/bert.key" --timeout "$patience" --json | "$py" -c 'import json, sys; sys.exit(json.load(sys.stdin)["keys"]["refused"] < 2)'; }
check those-without-a-key-are-counted wait_for refused
ctl() { run "$pyrovox" ctl --control "tcp://127.0.0.1:$control_port" --key "$keys/$1.key" "${@:2}"; }
told() { ctl bert set solver.iterations 9; says 0 'value 9'; }
check control-sets told
placed() { ctl bert record start "$dir/elsewhere.h5"; says 1 'over the network it goes to the folder of record.path'; }
check control-does-not-place-a-take placed
named() { ctl bert record start named.h5; says 0 "$dir/named.h5" && ctl bert record stop && says 0 "$dir/named.h5"; }
check control-names-a-take named
fires() { ctl bert trigger mine; says 0 'instant 20'; ctl anna trigger mine; says 1 'refuses this key'; }
check control-fires-a-trigger fires
reread() { ctl bert reload-keys; says 0 ok; }
check control-reads-keys-again reread
untold() { ctl anna set solver.iterations 8; says 1 'refuses this key'; }
check read-does-not-set untold
ground() { run "$pyrovox" calibrate background --live --control "tcp://127.0.0.1:$control_port" --key "$keys/bert.key" --sets 0; says 0 'the background is removed'; }
check background-with-a-key ground
check reads volumes_for anna 1
check control-reads-too volumes_for bert 1
# a key where none is asked for is not a wrong key
needless() { run "$pyrovox" "$@" --key "$keys/anna.key"; says 1 "asks for no key: leave --key out"; }
check a-needless-key-is-told needless record --endpoint "$volumes" --volumes 1 --out "$dir/out-needless" -q
config k.yaml < <(echo 'cameras: "sim:"'; echo 'fps: 2')
sed -i "s|$volumes|ipc://$dir/keyless|" "$dir/k.yaml"
start keyless.log "$pyrovoxd" --config "$dir/k.yaml"
keyless=$started
check without-keys wait_for "$pyrovox" status --endpoint "$control" --timeout 5
check needless-for-status needless status --endpoint "$control" --timeout "$patience"
check needless-for-view eval 'start view.log "$pyrovox" view --listen 127.0.0.1:0 --endpoint "ipc://$dir/keyless" --key "$keys/anna.key" && wait_for grep -q "asks for no key" "$dir/view.log"; kill -INT "$started"'
kill -INT "$keyless"; wait "$keyless"
check a-file-needs-none "$pyrovox" record --endpoint "$volumes" --volumes 3 --out "$dir/out-file" -q
run "$pyrovox" record --control "tcp://127.0.0.1:$control_port" --key "$keys/bert.key" --raw start --out "$dir/elsewhere.h5"
check writes-where-it-is-told-here says 1 "to the folder of record.path"
python_reads() {
    "$py" proto/clients/pyrovox_sub.py "tcp://127.0.0.1:$port" --key "$keys/anna.key" --frames 3 --timeout "$patience" | tail -n 1 | grep -q '^3 volumes'
}
if "$py" -c 'import numpy, zmq' 2> /dev/null; then check python-reads python_reads
    page_says() { run "$py" proto/clients/pyrovox_sub.py "tcp://127.0.0.1:$port" "${@:2}"; says 1 "$1"; }
    previews() { # key or none: 0 when one came
        PYTHONPATH=proto/clients timeout "$patience" "$py" -c 'import sys, pyrovox_sub as pvx
with pvx.Subscriber(sys.argv[1], key=sys.argv[2] if len(sys.argv) > 2 else None) as sub:
    next(m for m in sub if m["type"] == "preview")' "tcp://127.0.0.1:$previews_port" "$@" > "$dir/previews.log" 2>&1
    }
    check previews-with-a-key previews "$keys/anna.key"
    check no-previews-without eval '! previews && grep -q "asks for a key" "$dir/previews.log"'
    check python-without-a-key page_says 'asks for a key'
    "$pyrovox" keygen "$keys/carl" --server "$keys/lab.pub" > "$dir/said"
    check python-not-listed page_says "refuses the key in $keys/carl.key" --key "$keys/carl.key"
    "$pyrovox" keygen "$keys/other" > "$dir/said"; "$pyrovox" keygen "$keys/dora" --server "$keys/other.pub" > "$dir/said"
    check python-another-daemon page_says "another key than $keys/dora.key says" --key "$keys/dora.key"
    run "$py" proto/clients/pyrovox_sub.py "$volumes" --key "$keys/anna.key"
    check python-needless-key says 1 "asks for no key: leave $keys/anna.key out"
    check python-no-key-file page_says "none.key" --key "$keys/none.key"
else echo "SKIP $name:python-reads (no python3 with numpy and zmq)"; fi

# nobody without a key gets a byte, however long it asks
start none.log "$pyrovox" record --endpoint "tcp://127.0.0.1:$port" --volumes 1 --out "$dir/out-none" -q
none=$started
# who reads when the key is taken back hears no more; the other goes on, with a gap that is counted
start anna.log "$pyrovox" record --endpoint "tcp://127.0.0.1:$port" --key "$keys/anna.key" --out "$dir/out-anna" -q
anna=$started
start bert.log "$pyrovox" record --endpoint "tcp://127.0.0.1:$port" --key "$keys/bert.key" --out "$dir/out-bert" -q
bert=$started
have() { [ "$(find "$dir/out-$1" -name '*.npy' 2> /dev/null | wc -l)" -ge "$2" ]; }
check one-reads wait_for have anna 3
check another-reads wait_for have bert 3
check a-refused-key-is-told wait_for heard "^event .*'kind': 'key_refused', 'connections': [1-9]"
cat "$keys/bert.pub" > "$keys/clients.keys"
kill -HUP "$daemon"
check taken-back wait_for grep -q 'refused a connection from 127.0.0.1' "$dir/daemon.log"
n=$(find "$dir/out-bert" -name '*.npy' | wc -l)
check the-other-goes-on wait_for have bert $((n + 20))
n=$(find "$dir/out-anna" -name '*.npy' | wc -l)
m=$(find "$dir/out-bert" -name '*.npy' | wc -l)
wait_for have bert $((m + 20))
check hears-no-more [ "$(find "$dir/out-anna" -name '*.npy' | wc -l)" = "$n" ]
check and-is-told grep -q 'refuses this key' "$dir/anna.log"
check none-is-told grep -q 'asks for a key' "$dir/none.log"
check none-without-a-key [ "$(find "$dir/out-none" -name '*.npy' | wc -l)" = 0 ]
kill -INT "$bert" # the others were told that they may not, and have ended
wait "$none" "$anna" "$bert" 2> /dev/null
run "${ask[@]}" --key "$keys/bert.key" --timeout "$patience"
check status-says-who-was-refused says 0 "keys      1 may come in"
run "${ask[@]}" --key "$keys/bert.key" --stop --timeout "$patience"
check stops-by-its-key says 0 "stopping"
check ends wait "$daemon"

# as systemd gives it: in a folder that it names, readable by a list that shows as the group's bits
mkdir "$dir/credentials" && cp "$keys/lab.key" "$dir/credentials/pyrovox.key" && chmod 440 "$dir/credentials/pyrovox.key"
sed 's|server: keys/lab.key|server: "credential:pyrovox.key"|' "$dir/a.yaml" > "$dir/c.yaml"
checked() { run env "$@" "$pyrovoxd" --check-config --config "$dir/c.yaml"; }
checked CREDENTIALS_DIRECTORY="$dir/credentials"
check key-is-a-credential says 0 ok
checked -u CREDENTIALS_DIRECTORY # as by hand
check no-credentials-to-check says 0 "credential:pyrovox.key, for the service alone"
run env -u CREDENTIALS_DIRECTORY "$pyrovoxd" --config "$dir/c.yaml"
check no-credentials says 1 "keys.server: systemd gives no credential pyrovox.key" LoadCredential=
checked CREDENTIALS_DIRECTORY="$dir"
check not-that-credential says 1 "keys.server: systemd gives no credential pyrovox.key"
chmod 444 "$dir/credentials/pyrovox.key"
checked CREDENTIALS_DIRECTORY="$dir/credentials"
check a-credential-that-others-read says 1 "pyrovox.key: others may read this secret key"

chmod 644 "$keys/lab.key"
run "$pyrovoxd" --check-config --config "$dir/a.yaml"
check a-secret-that-others-read says 1 "lab.key: others may read this secret key"
exit $rc
