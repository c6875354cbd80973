#!/bin/bash
# pyrovox share: a reader built against the installed header alone gets every voxel, live and of a recording, through writers
# that are killed, daemons that come and go, and other users; whose the name is, and what is said where it cannot be had.
name=099
. "$(dirname "$0")/lib.sh"
shm=pyrovox-test-$$
trap 'finish; rm -f /dev/shm/$shm*' EXIT
systemd/install.sh "$b" "$dir/root" /usr > /dev/null || { echo "FAIL $name:install"; exit 1; }
# What stands in tests/lib includes it as the tree has it: pyrovox's folders are not on the way but that one.
mkdir -p "$dir/tests" && cp -r tests/lib "$dir/tests/"
builds() { # the header with what it is read by, and nothing else of the tree
    gcc -Wall -Wextra -Werror -O2 -I"$dir/root/usr/include/pyrovox" -I"$dir" "$dir/tests/lib/share_reader.c" -o "$dir/reader" -lm
}
check reader_needs_the_header_alone builds
[ $rc = 0 ] || exit 1
publish() { start pub.log "$b/tests/unit/test_share" --publish "$volumes" "$@"; pub=$started; } # SIDES CHANNELS PAUSE_US [VOLUMES [no-end]]
share() { start share.log "$pyrovox" share "$shm" --endpoint "$volumes" "$@"; share=$started; }
shared() { grep -q '^sharing' "$dir/share.log"; }
reads() { timeout "$patience" "$dir/reader" "$shm" "$@" > "$dir/reader.out" || { cat "$dir/reader.out" "$dir/share.log"; return 1; }; } # SIDES CHANNELS vectors|split what
stop() { kill -INT "$1"; ended "$1" "$2"; }

live() { # sides, channels, layout; opened twice by who comes before the first volume, when there is no grid yet
    publish "$1" "$2" 5000
    share ${4:+$4}
    reads "$1" "$2" "$3" volumes 20 || return 1
    grep -q '^20 checked, .* [12] opened, 0 bad' "$dir/reader.out" && stop "$share" 130 && [ ! -e "/dev/shm/$shm" ] || return 1
    kill "$pub"; wait "$pub"
}
grids() { live 19x25x9 3 vectors && live 19x25x9 3 split --split && live 20x17x33 1 vectors; }
check every_voxel_live grids

# The reader goes on through all of them, and must never see anything but whole volumes.
killed() {
    publish 19x25x9 3 300
    start on.log "$dir/reader" "$shm" 19x25x9 3 vectors on; local on=$started k
    for k in $(seq 20); do
        share
        [ $((k % 2)) = 0 ] && { wait_for shared || return 1; }
        sleep "0.$(printf %03d $((RANDOM % 200)))"
        kill -KILL "$share"; wait "$share" 2> /dev/null
        reads 19x25x9 3 vectors last || return 1
    done
    share; wait_for shared && reads 19x25x9 3 vectors volumes 3 || return 1
    kill "$on"; ended "$on" 0 || { cat "$dir/on.log"; return 1; }
    grep -q ' 0 bad' "$dir/on.log" || { cat "$dir/on.log"; return 1; }
    local opened; opened=$(sed -n 's/.* \([0-9]*\) opened.*/\1/p' "$dir/on.log")
    [ "$opened" -ge 2 ] || { cat "$dir/on.log"; return 1; }
    # a reader that is killed leaves nothing
    start dead.log "$dir/reader" "$shm" 19x25x9 3 vectors on; sleep 0.2; kill -KILL "$started"; wait "$started" 2> /dev/null
    [ "$(echo /dev/shm/"$shm"*)" = "/dev/shm/$shm" ] && reads 19x25x9 3 vectors volumes 3
}
check killed_at_20_moments killed 2> "$dir/killed"

taken() {
    run "$pyrovox" share "$shm" --endpoint "$volumes"; says 1 "process $share shares under that name" "choose another" || return 1
    stop "$share" 130 && [ ! -e "/dev/shm/$shm" ] || return 1
    echo 'a thesis' > "/dev/shm/$shm"
    run "$pyrovox" share "$shm"; says 1 "not pyrovox's" "choose another name, or remove it" && [ "$(cat "/dev/shm/$shm")" = 'a thesis' ] || return 1
    run "$dir/reader" "$shm" 1x1x1 1 vectors open; says 5 "not a segment" || return 1
    rm "/dev/shm/$shm"
    run "$dir/reader" "$shm" 1x1x1 1 vectors open; says 3 "nobody shares" || return 1
    run "$pyrovox" share a/b; says 1 "'a/b' cannot be a name" || return 1
    run "$pyrovox" share; says 2 "NAME" || return 1
    run "$pyrovox" share "$shm" --readers some; says 2 "one of me, group, all" || return 1
    run "$pyrovox" share "$shm" "$dir/none.h5"; says 1 "none.h5" && [ ! -e "/dev/shm/$shm" ]
}
check name_is_taken_by_one taken

again() { # the daemon ends and comes back with another grid
    kill "$pub"; wait "$pub"
    publish 19x25x9 3 3000; share; wait_for shared || return 1
    kill "$pub"; wait "$pub"
    wait_for grep -q 'the daemon ended: stopped; waiting for the next' "$dir/share.log" || return 1
    [ -e "/dev/shm/$shm" ] && ! gone "$share" || return 1 # its last volume stays
    publish 41x25x9 1 3000
    wait_for reads_large && stop "$share" 130
}
reads_large() { timeout "$patience" "$dir/reader" "$shm" 41x25x9 1 vectors volumes 5 > "$dir/reader.out"; }
check another_daemon_another_grid again

recorded() {
    timeout "$patience" "$pyrovox" record --endpoint "$volumes" --quiet --volumes 6 --out "$dir/film.h5" > /dev/null || return 1
    start share.log "$pyrovox" share "/$shm" "$dir/film.h5"; share=$started
    reads 41x25x9 1 vectors volumes 12 && stop "$share" 130 || return 1
    "$pyrovox" convert "$dir/film.h5" "$dir/film" --format npy > /dev/null 2>&1 || return 1 # one of them damaged: the others come
    "$py" -c 'import sys, glob, numpy as np; f = sorted(glob.glob(sys.argv[1] + "/*.npy"))[2]; a = np.load(f); a[3, 3, 3] = np.nan; np.save(f, a)' "$dir/film"
    start share.log "$pyrovox" share "$shm" "$dir/film"; share=$started
    reads 41x25x9 1 vectors volumes 12 && stop "$share" 130 && grep -q 'not finite' "$dir/share.log" && grep -q 'could not be read' "$dir/share.log" || return 1
    run "$pyrovox" share "$shm" "$dir/film.h5" --endpoint "$volumes"; says 2 "no --endpoint"
}
check recording recorded

nobody=(setpriv --reuid=65534 --regid=65534 --clear-groups)
users() {
    chmod 755 "$dir"
    share; wait_for shared || return 1
    run "${nobody[@]}" "$dir/reader" "$shm" 41x25x9 1 vectors open; says 4 "--readers" || return 1
    run "${nobody[@]}" "$pyrovox" share "$shm" --endpoint "$volumes"; says 1 "belongs to another user, root (0): choose another name" || return 1
    stop "$share" 130 || return 1
    share --readers all; wait_for shared || return 1
    timeout "$patience" "${nobody[@]}" "$dir/reader" "$shm" 41x25x9 1 vectors volumes 5 > /dev/null && stop "$share" 130 || return 1
    "${nobody[@]}" touch "/dev/shm/$shm" # and root takes nobody's
    run "$pyrovox" share "$shm"; says 1 "belongs to another user, nobody (65534)" && [ -e "/dev/shm/$shm" ] && rm "/dev/shm/$shm"
}
full() { # a /dev/shm of its own, too small at first
    export -f wait_for; export dir pyrovox shm volumes
    unshare -rm bash -c 'mount -t tmpfs -o size=300k none /dev/shm || exit 77
        : > "$dir/full.log"
        "$pyrovox" share "$shm" --endpoint "$volumes" > "$dir/full.log" 2>&1 & p=$!
        wait_for grep -q "no room in /dev/shm" "$dir/full.log"; r=$?
        grep -q ^sharing "$dir/full.log" && r=1
        mount -o remount,size=64m /dev/shm && timeout "$patience" "$dir/reader" "$shm" 41x25x9 1 vectors volumes 5 || r=1
        kill -INT $p; wait $p; [ $? = 130 ] && [ $r = 0 ] && grep -q "left out as there was no room" "$dir/full.log"' > "$dir/full.out" 2>&1
    local r=$?
    [ $r = 0 ] || cat "$dir/full.out" "$dir/full.log"
    return $r
}
if unshare -rm bash -c 'mount -t tmpfs -o size=100k none /mnt' 2> /dev/null; then check no_room full
else echo "SKIP $name:no_room (needs a mount namespace)"; fi
if [ "$(id -u)" = 0 ]; then check other_users users
else echo "SKIP $name:other_users (needs root)"; fi
exit $rc
