#!/bin/bash
# The package upgraded and removed while its daemon runs, under systemd and the unit as it is: it restarts once, and every
# take is closed in order.
# vm-seconds: 180
# vm-memory: 2048
name=200
. "$(dirname "$0")/lib.sh"
[ -d "$b/deb-test/2" ] || { echo "no packages here: make test-deb"; exit 77; }
export DEBIAN_FRONTEND=noninteractive
rm -f /usr/sbin/policy-rc.d # containers have one that starts no service
# dpkg would read the list of files of every package here, through an emulated machine: it is told what is installed, no more
export DPKG_ADMINDIR=/var/lib/dpkg-test
mkdir -p $DPKG_ADMINDIR/{info,updates,triggers} && cp /var/lib/dpkg/status $DPKG_ADMINDIR/
systemd_start
packages() { in_it dpkg --force-unsafe-io -i "$b/deb-test/$1"/pyrovox{,-view}_*.deb > "$dir/dpkg-$1.log" 2>&1 || { cat "$dir/dpkg-$1.log"; return 1; }; }
value() { in_it systemctl show -P "$1" pyrovoxd; }
takes() { find /var/lib/pyrovox -name '*.h5' | sort; }
is() { [ "$(value "$1")" = "$2" ]; }

check installs packages 1
check is_not_started is ActiveState inactive
cp tests/data/rig4.yaml /etc/pyrovox/rig.yaml
cat > /etc/pyrovox/pyrovoxd.yaml << 'Y'
rig: rig.yaml
cameras: "sim:"
fps: 5
record: { mode: raw, path: "/var/lib/pyrovox/%Y%m%d-%H%M%S.h5" }
Y
check starts_by_its_unit in_it systemctl start pyrovoxd
says_sets() { in_it pyrovox status --json 2> /dev/null | "$py" -c 'import json, sys; sys.exit(json.load(sys.stdin)["record"]["sets"] < 5)' 2> /dev/null; }
check records wait_for 60 says_sets
first=$(value InvocationID)
in_it systemctl start pyrovox-view
# it has got as far as its page, at the first start
view_serves() { in_it bash -c 'exec 3<> /dev/tcp/127.0.0.1/8737' 2> /dev/null && [ "$(in_it systemctl show -P NRestarts pyrovox-view)" = 0 ]; }
check view_runs wait_for 30 view_serves

check upgrades_while_it_runs packages 2
check is_the_next [ -n "$(in_it dpkg-query -W -f '${Version}' pyrovox | grep next)" ]
check runs_after_upgrade wait_for 60 says_sets
check restarted [ "$(value InvocationID)" != "$first" ]
ends() { in_it journalctl --no-pager -q -o cat -u pyrovoxd | grep -c 'stopping: terminated'; }
check restarted_once [ "$(ends)" = 1 -a "$(value NRestarts)" = 0 -a "$(takes | wc -l)" = 2 ]
closed() { # every take
    local t bad=0
    for t in $(takes); do pyrovox replay --info "$t" | grep -q 'closed in order' || { echo "  $t"; bad=1; }; done
    [ "$(takes | wc -l)" = "$1" ] && return $bad
}
first_take() { pyrovox replay --info "$(takes | head -n 1)" | grep -q 'closed in order'; }
check take_was_closed_in_order first_take
check view_runs_after_upgrade wait_for 30 view_serves
check removal_while_it_runs in_it dpkg -r pyrovox-view pyrovox
check ended [ "$(in_it systemctl is-active pyrovoxd)" != active -a -z "$(pgrep -x pyrovoxd)" ]
both_closed() { in_it dpkg --force-unsafe-io --unpack "$b/deb-test/1"/pyrovox_*.deb > "$dir/dpkg-3.log" 2>&1 && closed 2; }
check takes_are_closed_in_order both_closed
[ $rc = 0 ] || { grep -hv 'files list file' "$dir"/dpkg-*.log; in_it journalctl --no-pager -u pyrovoxd -u pyrovox-view -n 40; }
exit $rc
