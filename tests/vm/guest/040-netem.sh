#!/bin/bash
# GigE cameras behind a bad network: the guest kernel's netem between them and the daemon loses, reorders and
# delays packets and limits the rate.  Every volume that comes out is that of one instant; what was lost has
# its cause; nothing has to be restarted.
# vm-modprobe: veth
# vm-modprobe: sch_netem
# vm-modprobe: sch_prio
# vm-modprobe: cls_u32
# vm-before: "$b/bin/pyrovox" simcams --rig tests/data/rig4.yaml --ring 3 --fps 5 --noise 0 --write-frames "$out/png"; "$b/tests/vm/vm_flame" "$out/png" "$out/rgb8"
name=040
. "$(dirname "$0")/lib.sh"
instants=3
# cameras in a network namespace of their own, at 10.9.0.2 to 10.9.0.5; the cable is a veth pair
network() {
    ip netns add cameras && ip link add host type veth peer name cams netns cameras &&
    ip addr add 10.9.0.1/24 dev host && ip link set host up && ip -n cameras link set lo up || return 1
    local i
    for i in 2 3 4 5; do ip -n cameras addr add 10.9.0.$i/24 dev cams || return 1; done
    ip -n cameras link set cams up
}
in_net() { ip netns exec cameras "$@"; }
netem() { in_net tc qdisc replace dev cams root netem "$@"; }
# Only what is no answer to a command (UDP, not from port 3956): the cameras stay there, whatever is lost.
netem_of_pictures() {
    in_net tc qdisc replace dev cams root handle 1: prio priomap 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 &&
    in_net tc qdisc add dev cams parent 1:3 handle 3: netem "$@" &&
    in_net tc filter add dev cams parent 1: protocol ip prio 1 u32 match ip sport 3956 0xffff flowid 1:1 &&
    in_net tc filter add dev cams parent 1: protocol ip prio 2 u32 match ip protocol 17 0xff flowid 1:3
}
check network-of-its-own network
check netem-is-there netem delay 0ms

settings() { # cameras
    echo "rig: $PWD/tests/data/rig4.yaml
publish: {endpoints: [\"$volumes\"], sample: f32, wait_subscriber: true}
control: {endpoint: \"$control\"}
cameras: $1
fps: 5
pixel_format: RGB8
matrix_cache: $dir/matrix
photometry: {black: 0.02, threshold: 0.02}
solver: {stop: iterations, iterations: 20, warm_start: off, deadline_ms: 0}"
}
reference() {
    settings '"files:/out/rgb8/{name}/%06d.npy"' > "$dir/ref.yaml"
    echo "lossless: true" >> "$dir/ref.yaml"
    start ref-record.log "$pyrovox" record --quiet --endpoint "$volumes" --out "$dir/ref"
    local recorder=$started
    start ref.log "$pyrovoxd" --config "$dir/ref.yaml"
    ended "$started" 0 && ended "$recorder" 0 && [ "$(ls "$dir/ref"/*.npy | wc -l)" = $instants ]
}
check files reference; [ $rc = 0 ] || exit 1

serving() { grep -q ^serving "$dir/simcams.log"; }
start simcams.log ip netns exec cameras "$pyrovox" simcams --rig tests/data/rig4.yaml --ring $instants --fps 5 --noise 0 --address 10.9.0.2
check cameras-answer wait_for serving
settings '"aravis:10.9.0.2+"' > "$dir/a.yaml"
# what comes late because this machine is busy is no loss
echo "shared_clock: true
gige: {frame_retention_ms: 500}" >> "$dir/a.yaml"
start record.log "$pyrovox" record --quiet --endpoint "$volumes" --out "$dir/live"
recorder=$started
start a.log "$pyrovoxd" --config "$dir/a.yaml"
daemon=$started
sum() { # counter, over all cameras; 0 when the daemon does not answer
    status | "$py" -c 'import json, sys
try: print(sum(c["counts"].get(sys.argv[1], 0) or 0 for c in json.load(sys.stdin)["cameras"]))
except ValueError: print(0)' "$1"
}
more() { [ "$(sum "$1")" -gt "$2" ]; }
# All cameras expose together, so as many frames are counted of each as of the first, but for those that it started with.
ledger() {
    field "print([n - f[0] for f in [[sum(c['counts'].get(k) or 0 for k in
        'received incomplete bad_size bad_format bad_stamp underrun id_gap'.split()) for c in s['cameras']]] for n in f]) or True"
}
settled() { books=$(ledger); sleep 0.07; [ "$(ledger)" = "$books" ]; } # not in the middle of an exposure
balanced() { [ "$(ledger)" = "$books" ] || more lost_camera "$away"; } # frames of a lost camera are known by that
further() { local n; n=$(status | "$py" -c 'import json, sys; print(json.load(sys.stdin)["sets"]["published"])'); wait_for published $((n + $1)); }

check clean-publishes wait_for published 6; [ $rc = 0 ] || exit 1
few() { # per cent of the pictures since `since`
    local n=$(($(sum incomplete) - before)) of=$(($(sum received) - had))
    echo "  $n pictures incomplete, $of whole"; [ $((100 * n)) -le $(($1 * of)) ]
}
since() { before=$(sum incomplete) had=$(sum received); }
before=0 had=0
check clean-loses-next-to-nothing few 10 # a starved receiver may take a late packet for a lost one
since

# Packets overtake each other by 1 ms: no reason to lose a picture.
netem delay 1ms reorder 25% 50%
check reorder-publishes further 6
check reorder-loses-next-to-nothing few 10

# 2 % of the packets lost, 20 % of the pictures: asked for again.
netem delay 1ms loss 2%
since
check loss-publishes further 6
check loss-is-made-good few 10 # 20 % of the pictures would go
lost() { [ "$(in_net tc -s qdisc show dev cams | grep -o 'dropped [0-9]*' | cut -d' ' -f2)" -gt 0 ]; }
check packets-were-lost lost
# 40 % of the packets lost, of the answers, too: pictures of 13 packets are late, and whole.
asked() { field "sum(c['health']['packets_resent'] for c in s['cameras']) > $1"; }
netem delay 1ms
wait_for settled
away=$(sum lost_camera)
netem delay 1ms loss 40%
check heavy-loss-is-asked-for wait_for asked 200
check heavy-loss-publishes further 6
# 80 % of what the pictures are sent in: of 20 pictures all packets of one are lost.
netem_of_pictures delay 1ms loss 80%
before=$(sum id_gap)
check heavier-loss-is-counted wait_for more id_gap "$((before + 5))"
netem delay 1ms
check every-frame-is-counted wait_for balanced

# 1 Mbit/s for cameras that send 2.3.
netem rate 1mbit limit 20 # as a switch with a small buffer
before=$(sum incomplete)
check rate-limit-is-counted wait_for more incomplete "$before"

in_net tc qdisc del dev cams root
check recovers-by-itself further 6
running() { field "all(c['state'] == 'running' for c in s['cameras'])"; }
check all-cameras-run wait_for running
kill -TERM "$daemon"
check daemon-ends ended "$daemon" 0
check recorder-ends ended "$recorder" 0
same() { "$vm/vm_volumes" "$dir/live" "$dir/ref" 1e-6 > "$dir/volumes.log"; local got=$?; grep -v ^PASS "$dir/volumes.log"; return $got; }
check every-volume-is-right same
exit $rc
