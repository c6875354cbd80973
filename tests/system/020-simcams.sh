#!/bin/bash
# pyrovox simcams over real GigE Vision, seen by Aravis' own tool: private network, faults by hand,
# exit codes, signals.
name=020
. "$(dirname "$0")/lib.sh"
sim() { "$pyrovox" simcams "$@"; }
small=(--cameras 4 --size 64x48 --ring 3)
chmod 755 "$dir" # another user looks in
if ! sim --private-net "${small[@]}" -- true > "$dir/out" 2> "$dir/err"; then
    if grep -q 'private network' "$dir/err"; then tail -n 1 "$dir/err"; exit 77; fi
    cat "$dir/err"; echo "FAIL $name:serves"; exit 1
fi
check says_where grep -qx 'serving 4 cameras on 127.0.0.2..127.0.0.5' "$dir/out"

if command -v arv-tool-0.8 > "$dir/null"; then
    peer() {
        sim --private-net "${small[@]}" -- arv-tool-0.8 > "$dir/out" 2> "$dir/err"
        [ "$(grep -cE '^Pyrovox-SimCam-SIM0[0-3] \(127\.0\.0\.[2-5]\)$' "$dir/out")" = 4 ] || { cat "$dir/out" "$dir/err"; return 1; }
    }
    check aravis_tool_lists_them peer
    registers() {
        sim --private-net "${small[@]}" --format bayerrg8 -- arv-tool-0.8 -a 127.0.0.4 control Width Height SensorWidth PixelFormat > "$dir/out" 2> "$dir/err"
        grep -q '^Width = 64' "$dir/out" && grep -q '^Height = 48' "$dir/out" && grep -q '^SensorWidth = 64' "$dir/out" && grep -q "^PixelFormat = BayerRG8" "$dir/out" || { cat "$dir/out" "$dir/err"; return 1; }
    }
    check aravis_tool_reads_registers registers
    zipped() { # the description zipped; features set through it and read back
        sim --private-net "${small[@]}" --zip-xml -- sh -c 'arv-tool-0.8 -a 127.0.0.3 control TriggerSource=Action1 TriggerSource ActionGroupMask=7 ActionGroupMask PtpEnable=true GevIEEE1588 && arv-tool-0.8 -a 127.0.0.3 features' > "$dir/out" 2> "$dir/err"
        grep -q '^TriggerSource = Action1' "$dir/out" && grep -q '^ActionGroupMask = 7 ' "$dir/out" && grep -q '^GevIEEE1588 = true' "$dir/out" && grep -q "'ChunkTimestamp'" "$dir/out" || { cat "$dir/out" "$dir/err"; return 1; }
    }
    check aravis_tool_sets_features zipped
else
    echo "SKIP $name:aravis_tool_lists_them (no arv-tool-0.8)"
fi

lists() {
    sim --private-net "${small[@]}" -- "$pyrovox" cameras > "$dir/out" 2> "$dir/err"
    [ "$(grep -cE '^  cam[0-3]: "aravis:127\.0\.0\.[2-5]"  # Pyrovox SimCam, serial SIM0[0-3]' "$dir/out")" = 4 ] || { cat "$dir/out"; return 1; }
}
check pyrovox_cameras_lists_them lists

exits() { sim --private-net "${small[@]}" -- sh -c 'exit 7' > "$dir/out" 2>&1; [ $? -eq 7 ]; }
check exits_as_the_command_does exits
missing() { sim --private-net "${small[@]}" -- "$dir/nothing" > "$dir/out" 2>&1; [ $? -eq 127 ] && grep -q "cannot run $dir/nothing" "$dir/out"; }
check command_that_is_not_there missing

rig() {
    sim --private-net "${small[@]}" --write-rig "$dir/rig.yaml" -- true > "$dir/out" 2>&1 &&
    sim --private-net --rig "$dir/rig.yaml" --ring 2 -- true > "$dir/out" 2>&1 &&
    grep -qx 'serving 4 cameras on 127.0.0.2..127.0.0.5' "$dir/out"
}
check rig_written_and_served rig

refuse() { # exit code, text, arguments...
    local code=$1 text=$2; shift 2
    sim "$@" > "$dir/out" 2>&1
    [ $? -eq "$code" ] && grep -q -e "$text" "$dir/out" || { cat "$dir/out"; return 1; }
}
check timed_line_is_checked refuse 1 "no camera 'cam9'" "${small[@]}" --at 3:"kill cam9"
check too_much_memory refuse 1 'max-memory' --ring 5000
check unknown_camera refuse 1 "no camera 'cam9'" --set "drop cam9 0.5"
check foreign_address refuse 1 'no interface of this host' --address 203.0.113.2 "${small[@]}"
check missing_rig refuse 1 "$dir/none.yaml" --rig "$dir/none.yaml"
check wrong_number refuse 2 'should be a number' --fps fast

if [ "$(id -u)" = 0 ] && setpriv --reuid=65534 --regid=65534 --clear-groups test -x "$pyrovox"; then
    ordinary() {
        setpriv --reuid=65534 --regid=65534 --clear-groups "$pyrovox" simcams --private-net "${small[@]}" -- sh -c 'id -u; "$0" cameras' "$pyrovox" > "$dir/out" 2> "$dir/err"
        if grep -q 'private network' "$dir/err"; then return 77; fi
        grep -qx 65534 "$dir/out" && [ "$(grep -c aravis: "$dir/out")" = 4 ] || { cat "$dir/out" "$dir/err"; return 1; }
    }
    ordinary; case $? in
        0) echo "PASS $name:ordinary_user";;
        77) echo "SKIP $name:ordinary_user ($(grep 'private network' "$dir/err" | head -c 200))";;
        *) echo "FAIL $name:ordinary_user"; rc=1;;
    esac
fi

# Faults by hand: what an outsider sees of kill and revive.
cat > "$dir/watch.sh" <<'W'
while [ ! -e "$2/stop" ]; do
    "$1" cameras > "$2/list.new" 2> "$2/list.err"; mv "$2/list.new" "$2/list"
done
W
seen() { [ -f "$dir/list" ] && [ "$(grep -c aravis: "$dir/list")" = "$1" ]; }
by_hand() {
    mkfifo "$dir/ctl"
    : > "$dir/out"
    "$pyrovox" simcams --private-net "${small[@]}" --control -- sh "$dir/watch.sh" "$pyrovox" "$dir" < "$dir/ctl" > "$dir/out" 2> "$dir/err" & p=$!; pids+=("$p")
    exec 5> "$dir/ctl"
    local ok=0
    wait_for seen 4 && echo "kill cam1" >&5 && wait_for seen 3 && ! grep -q 127.0.0.3 "$dir/list" &&
        echo "nonsense" >&5 && echo "revive cam1" >&5 && wait_for seen 4 &&
        echo "reboot cam2 3600" >&5 && wait_for seen 3 && ! grep -q 127.0.0.4 "$dir/list" &&
        echo "switch 3600" >&5 && wait_for seen 0 && echo "stats" >&5 && wait_for grep -q '^stats {' "$dir/out" || ok=1
    touch "$dir/stop"
    exec 5>&-
    wait $p || ok=1
    grep -q "control: 'nonsense'" "$dir/err" && grep -q '"cam2": {"exposed": 0, .*"reboots": 1' "$dir/out" || ok=1
    [ $ok = 0 ] || cat "$dir/err"
    return $ok
}
check killed_and_revived_by_hand by_hand

signals() { # the command hears TERM, and simcams exits as it does
    "$pyrovox" simcams --private-net "${small[@]}" -- sh -c 'trap "exit 5" TERM; touch "$0"; while :; do sleep 0.05; done' "$dir/up" > "$dir/out" 2>&1 & p=$!; pids+=("$p")
    wait_for test -e "$dir/up" || return 1
    kill -TERM $p; wait $p; local code=$?
    [ $code -eq 5 ]
}
check passes_signals_on signals

orphan() { # cameras gone: the command goes too
    rm -f "$dir/up"
    "$pyrovox" simcams --private-net "${small[@]}" -- sh -c 'echo $$ > "$0.pid"; touch "$0"; exec sleep 3600' "$dir/up" > "$dir/out" 2>&1 & p=$!; pids+=("$p")
    wait_for test -e "$dir/up" || return 1
    local child; child=$(cat "$dir/up.pid")
    kill -9 $p; wait $p 2> "$dir/null"
    wait_for bash -c "! kill -0 $child 2>/dev/null || grep -q '^State:.Z' /proc/$child/status 2>/dev/null"
}
check command_ends_with_the_cameras orphan

interrupt() {
    rm -f "$dir/out" # of the last test, which says so too
    : > "$dir/out"
    "$pyrovox" simcams --private-net "${small[@]}" > "$dir/out" 2> "$dir/err" & p=$!; pids+=("$p")
    wait_for grep -q '^serving' "$dir/out" || return 1
    kill -INT $p; wait $p; local code=$?
    [ $code -eq 130 ] && grep -q 'frames sent' "$dir/err"
}
check stops_on_interrupt interrupt
exit $rc
