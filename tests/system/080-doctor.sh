#!/bin/bash
# pyrovox doctor on this very host, whatever state it is in; and in a network of its own with a
# firewall and a strict reverse-path filter, where that can be had.
name=080
. "$(dirname "$0")/lib.sh"
doctor() { "$pyrovox" doctor "$@"; }

doctor --sample 0 > "$dir/text.log" 2> "$dir/err.log"; code=$?
check exit-status-is-a-verdict [ $code -le 2 ]
check counts-what-it-saw grep -qE '^[0-9]+ failures?, [0-9]+ warnings?, [0-9]+ that cannot be told, [0-9]+ well' "$dir/text.log"
doctor --sample 0 --json > "$dir/report.json"; code=$?
judge() { "$py" - "$dir/report.json" $code <<'P'
import json, sys
r = json.load(open(sys.argv[1])); c = r["counts"]
assert sum(c.values()) == len(r["findings"]) >= 15, c
assert int(sys.argv[2]) == (2 if c["fail"] else 1 if c["warn"] + c["unknown"] else 0), (sys.argv[2], c)
for f in r["findings"]:
    assert f["what"] and f["verdict"] in c, f
    if f["verdict"] in ("warn", "fail"):
        assert f["means"] and f["remedies"], f
P
}
check json-agrees-with-exit-status judge
config a.yaml <<< $'cameras: "aravis:127.0.0.2+"\nfps: 15\npixel_format: RGB8\ngige: {packet_size: 9000}\nshared_clock: true'
doctor --sample 0 --config "$dir/a.yaml" --all --record "$dir" --disk-test 4 > "$dir/config.log"
check knows-the-configuration grep -qE '4 GigE .*cameras?, up to .* MB a frame, 15 Hz' "$dir/config.log"
check looks-at-their-interface grep -q 'network: lo$' "$dir/config.log"
check writes-to-the-disk grep -qE "takes [0-9]+ MB/s" "$dir/config.log"
doctor --sample 0 --config "$dir/none.yaml" > "$dir/none.log" 2>&1; code=$?
check missing-configuration [ $code = 3 ]
check which-is-named grep -q none.yaml "$dir/none.log"
awk '/^    t: /{gsub(/[][,]/, " "); $0 = "    t: [" 1e3 * $2 ", " 1e3 * $3 ", " 1e3 * $4 "]"} 1' tests/data/rig4.yaml > "$dir/mm.yaml"
echo '{rig: mm.yaml, cameras: "sim:"}' > "$dir/blind.yaml"
doctor --sample 0 --config "$dir/blind.yaml" > "$dir/blind.log" 2>&1; code=$?
check rig-that-sees-nothing [ $code = 3 ]
check how-it-would-see grep -q 'mm.yaml: no camera sees the volume; 4 of 4 would see it if t is in millimetres' "$dir/blind.log"

doctor --sample 0 --fix-script "$dir/fix.sh" > "$dir/fix.log" 2>&1
check script-is-shell sh -n "$dir/fix.sh"
before=$(cat /proc/sys/net/core/rmem_max /proc/sys/vm/swappiness)
check script-leaves-the-host-alone [ "$before" = "$(cat /proc/sys/net/core/rmem_max /proc/sys/vm/swappiness)" ]

# Real rules in a real (private) network stack.
if [ "$(id -u)" != 0 ] || ! unshare -nm true 2> "$dir/unshare.log"; then
    echo "SKIP $name:strict-filter-of-a-private-network (needs root to make one)"; exit $rc
fi
cat > "$dir/net.sh" <<'N'
mount -t sysfs none /sys || exit 77 # that of this network
ip link add cam0 type veth peer name cam0p && ip link add cam1 type veth peer name cam1p || exit 77
for i in cam0 cam0p cam1 cam1p lo; do ip link set $i up; done
ip address add 192.168.77.1/24 dev cam0; ip address add 192.168.77.2/24 dev cam1
echo 1 > /proc/sys/net/ipv4/conf/all/rp_filter || exit 77
"$1" doctor --sample 0 --config "$2" --all
echo "code $?"
if command -v nft > /dev/null && nft add table inet t 2> /dev/null; then
    nft 'add chain inet t in { type filter hook input priority 0; policy drop; }'
    "$1" doctor --sample 0 --config "$2" --all | sed 's/^/drop: /'
    nft insert rule inet t in iifname cam0 meta l4proto udp accept
    "$1" doctor --sample 0 --config "$2" --all | sed 's/^/open: /'
fi
N
config b.yaml <<< $'cameras: "aravis:192.168.77.11+"\nfps: 15\npixel_format: RGB8'
unshare -nm bash "$dir/net.sh" "$pyrovox" "$dir/b.yaml" > "$dir/net.log" 2>&1; code=$?
if [ $code = 77 ]; then
    echo "SKIP $name:strict-filter-of-a-private-network (no veth, sysctl or sysfs in a private network here)"; exit $rc
fi
check strict-filter-with-a-twin-network grep -qE '^FAIL +cam[01] filters by reverse path, and cam[01] has the same' "$dir/net.log"
check small-packets grep -qE '^WARN +cam[01] has an MTU of 1500: no jumbo frames$' "$dir/net.log"
check that-is-a-failure grep -q '^code 2' "$dir/net.log"
if grep -q '^drop:' "$dir/net.log"; then
    check closed-firewall grep -qE '^drop: FAIL +nftables keeps' "$dir/net.log"
    check opened-by-the-remedy grep -qE '^open: OK +nftables lets' "$dir/net.log"
else
    echo "SKIP $name:closed-firewall (no nft here, or no nftables in this kernel)"
fi
exit $rc
