#!/bin/bash
# A power cut at any moment of a take and of a recording of volumes: every write of the programs as they record is noted
# (tests/power/shim.c), and what a disk may have of them then is read by the programs' own readers (tests/power/power.c).
# `make power CUTS=n` does more of the same.
name=048
source "$(dirname "$0")/lib.sh"
cuts=${POWER_CUTS:-50} sets=${POWER_SETS:-75} seed=${POWER_SEED:-$RANDOM}

noted() { # file: what notes its writes
    echo "LD_PRELOAD=$b/tests/power/shim.so PYROVOX_POWER_FILE=$1 PYROVOX_POWER_LOG=$1.noted"
}
recorded() {
    config live.yaml "wait_subscriber: true" < <(
        echo 'cameras: "sim:"'
        echo 'fps: 25'
        echo "record: { mode: raw, path: \"$dir/take.h5\", queue: 64, sync_s: 0.3 }")
    # shellcheck disable=SC2046
    start live.log env $(noted "$dir/take.h5") "$pyrovoxd" -c "$dir/live.yaml"; local d=$started
    # shellcheck disable=SC2046
    start volumes.log env $(noted "$dir/volumes.h5") "$pyrovox" record --endpoint "$volumes" --format hdf5 --out "$dir/volumes.h5" --quiet; local r=$started
    wait_for published "$sets" || return 1
    kill -INT "$d"
    ended "$d" 0 && ended "$r" 0
}
check recorded recorded

cut() { # take|volumes, cuts
    run "$b/tests/power/power" "$1" "$dir/$1.h5.noted" "$dir/$1.h5" "$2" "$seed" "$dir/cut.h5"
    [ -z "${POWER_CUTS:-}" ] && [ $code = 0 ] || echo "$out"
    return $code
}
check take_after_any_power_cut cut take "$cuts"
check volumes_after_any_power_cut cut volumes $((cuts / 2))
exit $rc
