#!/bin/bash
# pyrovox view on real sockets: who may come in and who not, what a slow or greedy or silent page does, TLS, recordings,
# and what cannot be served, with its sentence.
name=096
. "$(dirname "$0")/lib.sh"
"$b/tests/unit/test_pub" --publish "$volumes" 40 0 > "$dir/pub.log" 2>&1 & pids+=($!)
timeout "$patience" "$pyrovox" record --endpoint "$volumes" --quiet --out "$dir/film.h5" --format hdf5 > "$dir/record.log" 2>&1
view() { # log, arguments...: its address without the token is $at, the token $token
    local log=$1; shift
    start "$log" "$pyrovox" view --listen 127.0.0.1:0 "$@"
    wait_for grep -q '#' "$dir/$log" || return 1
    local url; url=$(grep -m1 '#' "$dir/$log")
    token=${url#*#} at=${url%%/#*}; at=${at#*//}
}
does() { # what of bridge.py
    local what=$1; shift
    timeout "$patience" "$py" tests/view/bridge.py "$what" "$at" "$token" "$@"
}
view film.log "$dir/film.h5"
film=$started
check files does files
check foreign-host does host
check foreign-origin does origin
check token does token
check a-volume-is-the-daemons does volume
check credits does credits
check words does words
check frames does frames
check film does film
check too-many-pages does full
check slow-headers does slow
counted() { kill -INT "$film"; wait "$film"; grep -q 'without the right token' "$dir/film.log" && grep -q 'by a name that is not' "$dir/film.log" &&
    grep -q "another site's page" "$dir/film.log" && grep -q 'no room' "$dir/film.log" && grep -q 'nothing in time' "$dir/film.log"; }
check counted counted

openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj /CN=localhost -addext subjectAltName=DNS:localhost \
    -keyout "$dir/key.pem" -out "$dir/cert.pem" 2> /dev/null
faketime() { # an expired certificate, signed for a time that has passed
    openssl req -new -key "$dir/key.pem" -subj /CN=localhost 2>/dev/null | openssl x509 -req -signkey "$dir/key.pem" -days -1 -out "$dir/old.pem" 2>/dev/null; }
tls() { view tls.log "$dir/film.h5" --cert "$dir/cert.pem" --cert-key "$dir/key.pem" --host localhost && does tls "$dir/cert.pem"; local r=$?; kill -INT "$started"; return $r; }
check tls tls

names() {
    view names.log "$dir/film.h5" --host lab.example --host 203.0.113.7 --host '[2001:db8::7]' || return 1
    at=127.0.0.1:${at##*:}
    does names; local r=$?; kill -INT "$started"; [ $r = 0 ] || return 1
    run "$pyrovox" view "$dir/film.h5" --host lab.example:80; says 2 'without a port' || return 1
    run "$pyrovox" view ipc:///tmp/x; says 2 'is an endpoint'
}
check names names
opens() { # what is started to open the page is never told the token where others can read it
    mkdir -p "$dir/fake" "$dir/run"
    printf '#!/bin/sh\nps -o pgid= $$ > %s/pgid; echo "$@" > %s/opened\n' "$dir" "$dir" > "$dir/fake/xdg-open"; chmod 755 "$dir/fake/xdg-open"
    start open.log env PATH="$dir/fake:$PATH" XDG_RUNTIME_DIR="$dir/run" "$pyrovox" view --listen 127.0.0.1:0 --open "$dir/film.h5"
    wait_for test -s "$dir/opened" || return 1
    local url file; url=$(grep -m1 '#' "$dir/open.log"); file=$(cat "$dir/opened")
    ! grep -q "${url#*#}" "$dir/opened" && [ "$(stat -c %a "$file")" = 600 ] && grep -qF "url=$url\"" "$file" &&
        [ "$(tr -d ' ' < "$dir/pgid")" != "$(ps -o pgid= "$started" | tr -d ' ')" ] || return 1
    kill -INT "$started"; wait "$started"; [ ! -e "$file" ]
}
check opens opens
recordings() { # cut off: shown as far as it is whole; of a later version: refused
    run "$pyrovox" convert --format npy "$dir/film.h5" "$dir/folder"; says 0 || return 1
    sed -i 's/"closed":[[:space:]]*true/"closed": false/' "$dir/folder/recording.json"
    view cut.log "$dir/folder" && does cut || return 1
    kill -INT "$started"; wait "$started"
    sed -i 's/"version":[[:space:]]*1/"version": 9/' "$dir/folder/recording.json"
    run "$pyrovox" view "$dir/folder"; says 1 'version 9' 'update it'
}
check recordings recordings
refuses() {
    run "$pyrovox" view --listen 0.0.0.0:0 "$dir/film.h5"; says 1 "--cert" "ssh -L" || return 1
    run "$pyrovox" view --listen elsewhere:80 "$dir/film.h5"; says 1 "address and a port" || return 1
    faketime
    run "$pyrovox" view "$dir/film.h5" --cert "$dir/old.pem" --cert-key "$dir/key.pem"; says 1 "expired on" || return 1
    run "$pyrovox" view "$dir/film.h5" --cert "$dir/cert.pem" --cert-key "$dir/cert.pem"; [ "$code" = 1 ] || return 1
    run "$pyrovox" view "$dir/film.h5" --cert "$dir/cert.pem"; says 2 "go together" || return 1
    run "$pyrovox" view "$dir/none.h5"; says 1 "none.h5" || return 1
    echo 00 > "$dir/bad-token"; chmod 600 "$dir/bad-token"
    run "$pyrovox" view "$dir/film.h5" --token-file "$dir/bad-token"; says 1 "32 digits" || return 1
    chmod 644 "$dir/bad-token"
    run "$pyrovox" view "$dir/film.h5" --token-file "$dir/bad-token"; says 1 "others may read"
}
check refuses refuses
# two bridges, one port; a token that stays, and one of before
port_taken() {
    view one.log "$dir/film.h5" --token-file "$dir/token" || return 1
    run "$pyrovox" view "$dir/film.h5" --listen "$at"; says 1 "is in use" "port of its own" || return 1
    kill -INT "$started"; wait "$started"
    local before=$token
    view two.log "$dir/film.h5" --token-file "$dir/token" || return 1
    [ "$token" = "$before" ] && [ "$(stat -c %a "$dir/token")" = 600 ] && does volume
}
check port-taken-and-a-token-that-stays port_taken
not_a_recording() {
    echo not a recording > "$dir/text.h5"; run "$pyrovox" view "$dir/text.h5"; says 1 "text.h5"
}
check not-a-recording not_a_recording
live() { # waits for a daemon that comes, and for the next one
    view live.log --endpoint "$volumes" || return 1
    does live "$b/tests/unit/test_pub" "$volumes"
}
check live live
orders() { # what pages may tell the daemon, and only with --control
    view orders.log --endpoint "$volumes" "--control=ipc://$dir/orders" && does orders "ipc://$dir/orders" tells || return 1
    kill -INT "$started"; wait "$started"
    { "$pyrovox" keygen "$dir/lab" && "$pyrovox" keygen "$dir/me" --server "$dir/lab.pub"; } > "$dir/keygen.log" || return 1
    view keyed.log --endpoint "$volumes" "--control=ipc://$dir/keyless" --key "$dir/me.key" && does orders "ipc://$dir/keyless" keyed || return 1
    kill -INT "$started"; wait "$started"
    view reads.log --endpoint "$volumes" && does orders "ipc://$dir/none" reads || return 1
    run "$pyrovox" view "$dir/film.h5" --control; says 2 'a recording has no'
}
check orders orders
exit $rc
