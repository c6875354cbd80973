#!/bin/bash
# What `make install` puts where, that systemd accepts the unit, and that nothing stays after uninstall.
name=043
. "$(dirname "$0")/lib.sh"
check install systemd/install.sh "$b" "$dir/root" /usr
check programs test -x "$dir/root/usr/bin/pyrovoxd" -a -x "$dir/root/usr/bin/pyrovox"
check manuals test -f "$dir/root/usr/share/man/man8/pyrovoxd.8" -a -f "$dir/root/usr/share/man/man5/pyrovoxd.yaml.5"
check unit-is-filled-in grep -q '^ExecStart=/usr/bin/pyrovoxd ' "$dir/root/lib/systemd/system/pyrovoxd.service"
# two builds are the same bits: here, that no file tells where it was built; of the packages test-deb compares every byte
check built-anywhere [ -z "$(grep -rlF "$PWD" "$dir/root")" ]
unit() { grep -qx "$1" "$dir/root/lib/systemd/system/pyrovoxd.service"; }
check comes-back-always unit StartLimitIntervalSec=0 # with what it was doing: 046
check comes-back-after-any-end unit Restart=on-failure
check remembers unit StateDirectory=pyrovox
view_unit() { grep -qx "$1" "$dir/root/lib/systemd/system/pyrovox-view.service"; }
promised() { # what is said to who asks about security
    local c
    for c in $(grep -o 'CAP_[A-Z_]*' .github/SECURITY.md); do unit "CapabilityBoundingSet=.*$c.*" || { echo "  the unit has no $c"; return 1; }; done
}
check capabilities-as-SECURITY.md-says promised
check view-has-a-user-of-its-own view_unit User=pyrovox-view
check view-keeps-its-token-to-itself view_unit StateDirectoryMode=0700
check socket-of-its-control grep -qx 'ListenStream=/run/pyrovox/control' "$dir/root/lib/systemd/system/pyrovoxd.socket"
check socket-stays unit RuntimeDirectoryPreserve=yes
if command -v systemd-analyze > /dev/null; then
    # verify looks for the programs on this machine: point it at the ones just built
    for u in pyrovoxd pyrovox-view; do
        sed "s|/usr/bin/|${pyrovox%/*}/|" "$dir/root/lib/systemd/system/$u.service" > "$dir/$u.service"
    done
    verify() { # unit
        local out
        out=$(SYSTEMD_LOG_LEVEL=warning systemd-analyze verify --man=no "$dir/$1" 2>&1)
        local code=$?
        case $out in *"Failed to"*"bus"*|*"not been booted"*) return 77;; esac
        [ $code = 0 ] && ! grep -q "$1" <<< "$out" || { echo "$out"; return 1; }
    }
    for u in pyrovoxd pyrovox-view; do
        verify $u.service; got=$?
        if [ $got = 77 ]; then echo "SKIP $name:$u-is-valid (systemd-analyze does not work here)"
        else check $u-is-valid [ $got = 0 ]; fi
    done
    # The lines for a graphics card, as the page has them
    mkdir "$dir/card"; cp "$dir/pyrovoxd.service" "$dir/card/"
    sed -n '/^## A graphics card/,$ s/^    //p' systemd/README.md >> "$dir/card/pyrovoxd.service"
    check card-lines-are-there [ "$(grep -c '^DeviceAllow=char-\(drm\|kfd\|nvidia\*\) rw$' "$dir/card/pyrovoxd.service")" = 3 ]
    verify card/pyrovoxd.service; got=$?
    if [ $got = 77 ]; then echo "SKIP $name:card-lines-are-valid (systemd-analyze does not work here)"
    else check card-lines-are-valid [ $got = 0 ]; fi
    # What they may do (systemd/README.md has the list, and why): 0 is nothing, 10 everything.
    exposed() { # unit, most
        local out; out=$(systemd-analyze security --no-pager --offline=true "$dir/$1.service" 2>&1 | grep Overall)
        out=${out% [A-Z]*}; echo "figures $name:$1: exposure ${out##* }"
        local level=${out##* }
        awk -v is="$level" -v most="$2" 'BEGIN { exit !(is ~ /^[0-9]+\.[0-9]$/ && is <= most) }'
    }
    if systemd-analyze security --help 2>&1 | grep -q -- --offline; then
        check pyrovoxd-may-do-little exposed pyrovoxd 1.5
        check a-card-costs-little exposed card/pyrovoxd 1.5
        check pyrovox-view-may-do-less exposed pyrovox-view 1.2
    else
        echo "SKIP $name:may-do-little (this systemd-analyze has no --offline)"
    fi
else
    echo "SKIP $name:unit-is-valid (no systemd-analyze)"
fi
completes() { # words of a command line: what is offered for the last, in one line
    PATH=${pyrovox%/*}:$PATH bash -c '. "$1/usr/share/bash-completion/completions/pyrovox"; shift; COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
        _pyrovox; echo "${COMPREPLY[*]}"' - "$dir/root" "$@"
}
completion() {
    [ "$(completes pyrovox rec)" = "reconstruct record" ] && [ "$(completes pyrovox --cpu avx2 calibrate fl)" = flat ] &&
        [ "$(completes pyrovox calibrate flat --fra)" = --frames ] && [ "$(completes pyrovoxd --check)" = --check-config ] &&
        [ -z "$(completes pyrovox record f)" ] # a file's name
}
check completion completion
check uninstall systemd/install.sh --remove "$dir/root" /usr
check nothing-stays [ -z "$(find "$dir/root" ! -type d)" ]

# the protocol of Type=notify, with a socket of our own
notified() {
    timeout "$patience" "$py" - "$pyrovoxd" "$dir/j.yaml" "$dir/notify" <<'PY'
import os, socket, subprocess, sys, time
s = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM); s.bind(sys.argv[3]); patience = int(os.environ["patience"]); s.settimeout(patience)
env = dict(os.environ, NOTIFY_SOCKET=sys.argv[3], WATCHDOG_USEC="1000000")
p = subprocess.Popen([sys.argv[1], "--config", sys.argv[2]], env=env, stderr=subprocess.DEVNULL)
seen, end = "", time.time() + patience
while time.time() < end and not all(w in seen for w in ("READY=1", "WATCHDOG=1", "STATUS=0.0 sets/s, ", "; not there: cam2 (1 of 4 cameras)")):
    seen += s.recv(4096).decode() + "\n"
p.terminate(); code = p.wait(patience)
while "STOPPING=1" not in seen:
    seen += s.recv(4096).decode() + "\n"
assert code == 0 and "READY=1" in seen and "WATCHDOG=1" in seen and "not there: cam2 (1 of 4" in seen, seen
PY
}
config j.yaml <<< $'cameras: {cam0: "sim:", cam1: "sim:", cam2: "v4l2:/dev/none", cam3: "sim:"}\nfps: 20'
check ready-watchdog-stopping notified

# A fault that goes on and on: 8 lines, then fewer, of which each says how many it stands for; the last is what is the case.
config f.yaml <<< "cameras: {cam0: 'sim:', cam1: 'sim:', cam2: 'v4l2:$dir/device', cam3: 'sim:'}"
becomes() { wait_for field "'$1' in s['cameras'][2]['error']"; }
told() { # lines of it, and what they stand for
    grep 'camera cam2' "$dir/flips.log" | awk '{ n++; if (match($0, /\([0-9]+ more/)) more += substr($0, RSTART + 1) + 0 } END { print n + 0, n + more }'
}
changes() { # until one is kept back, which the 20th is however slow this is
    start flips.log "$pyrovoxd" --config "$dir/f.yaml"
    flips=0
    until read -r n _ < <(told); [ $((n + 1)) -lt $flips ]; do # the last one may be on its way
        [ $flips -lt 40 ] || return 1
        rm -f "$dir/device"; becomes 'there is no' || return 1
        : > "$dir/device"; becomes 'is no V4L2' || return 1
        flips=$((flips + 2))
    done
}
all_told() { read -r n all < <(told); [ "$n" -lt "$flips" ] && [ "$all" = "$flips" ]; }
last_word() { grep 'camera cam2' "$dir/flips.log" | tail -n 1 | grep -q 'is no V4L2'; }
check a-fault-that-goes-on changes
check is-told-in-fewer-lines wait_for all_told
check and-what-is-the-case-at-last last_word
kill "$started"; wait "$started"

# Socket activation, as systemd does it: nothing runs until somebody asks, who is answered; the socket is systemd's and stays.
sleeps() { [ -S "$dir/control" ] && tr '\0' ' ' < "/proc/$started/cmdline" | grep -q socket-activate; }
wakes() { run "$pyrovox" status --endpoint "$control" --timeout "$patience" --json; says 0 '{' && ! sleeps; } # one question
ends_and_leaves_it() { kill "$started" && wait "$started" && [ "$(stat -c %F%i "$dir/control")" = "$its" ] && [ ! -e "$dir/control.lock" ]; }
if command -v systemd-socket-activate > /dev/null; then
    config s.yaml <<< $'cameras: "sim:"\nfps: 20'
    start activated.log systemd-socket-activate --listen="$dir/control" "$pyrovoxd" --config "$dir/s.yaml"
    check sleeps-until-asked wait_for sleeps
    its=$(stat -c %F%i "$dir/control")
    check is-woken-by-a-question wait_for wakes
    check answers-others wait_for field 's["sets"]["published"] > 0'
    check socket-is-left ends_and_leaves_it
else echo "SKIP $name:socket-activation (no systemd-socket-activate)"; fi

# the protocol of systemd's journal, its socket in a mount namespace of our own
journal() {
    timeout "$patience" unshare "${apart[@]}" "$py" - "$pyrovoxd" "$dir/j.yaml" <<'PY'
import os, socket, subprocess, sys, time
subprocess.run(["mount", "-t", "tmpfs", "run", "/run"], check=True); os.makedirs("/run/systemd/journal")
s = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM); s.bind("/run/systemd/journal/socket"); patience = int(os.environ["patience"]); s.settimeout(patience)
r, w = os.pipe(); st = os.fstat(w)
p = subprocess.Popen([sys.argv[1], "--config", sys.argv[2]], stderr=w, env=dict(os.environ, JOURNAL_STREAM="%d:%d" % (st.st_dev, st.st_ino)))
while True: # fields are lines; a text with a newline in it would be sent otherwise
    f = dict(l.split("=", 1) for l in s.recv(65536).decode().splitlines())
    if f.get("PYROVOX_CAUSE") == "lost_camera": break
p.terminate(); assert p.wait(patience) == 0
assert f["PYROVOX_CAMERA"] == "cam2" and f["PRIORITY"] == "4" and f["SYSLOG_IDENTIFIER"] == "pyrovoxd", f
assert f["MESSAGE"].startswith("capture: camera cam2 (v4l2:/dev/none): "), f
os.close(w); said = os.read(r, 65536).decode()
assert "capture:" not in said, said # each line once
PY
}
if apart=(--mount) && unshare "${apart[@]}" true 2> /dev/null || { apart=(--user --map-root-user --mount) && unshare "${apart[@]}" true 2> /dev/null; }; then
    check journal-has-cause-and-camera journal
else echo "SKIP $name:journal-has-cause-and-camera (no mount namespace to be had here)"; fi
exit $rc
