#!/bin/bash
# The package upgraded and removed while its daemon runs, under systemd and the unit as it is: it restarts once, and every
# take is closed in order.
# vm-memory: 2048
name=200
. "$(dirname "$0")/lib.sh"
packages_start

check installs packages 1
check is_not_started is ActiveState inactive
packaged_daemon
check starts_by_its_unit in_it systemctl start pyrovoxd
check records wait_for records
first=$(value InvocationID)
in_it systemctl start pyrovox-view
# it has got as far as its page, at the first start
view_serves() { in_it bash -c 'exec 3<> /dev/tcp/127.0.0.1/8737' 2> /dev/null && [ "$(in_it systemctl show -P NRestarts pyrovox-view)" = 0 ]; }
check view_runs wait_for view_serves

check upgrades_while_it_runs packages 2
check is_the_next [ -n "$(in_it dpkg-query -W -f '${Version}' pyrovox | grep next)" ]
check runs_after_upgrade wait_for records
check restarted [ "$(value InvocationID)" != "$first" ]
check restarted_once [ "$(ends)" = 1 -a "$(value NRestarts)" = 0 -a "$(takes | wc -l)" = 2 ]
closed() { # every take
    local t bad=0
    for t in $(takes); do pyrovox replay --info "$t" | grep -q 'closed in order' || { echo "  $t"; bad=1; }; done
    [ "$(takes | wc -l)" = "$1" ] && return $bad
}
check take_was_closed_in_order first_take_is_closed
check view_runs_after_upgrade wait_for view_serves
check removal_while_it_runs in_it dpkg -r pyrovox-view pyrovox
check ended [ "$(in_it systemctl is-active pyrovoxd)" != active -a -z "$(in_it pgrep -x pyrovoxd)" ]
both_closed() { in_it dpkg --force-unsafe-io --unpack "$b/deb-test/1"/pyrovox_*.deb > "$dir/dpkg-3.log" 2>&1 && closed 2; }
check takes_are_closed_in_order both_closed
[ $rc = 0 ] || { grep -hv 'files list file' "$dir"/dpkg-*.log; in_it journalctl --no-pager -u pyrovoxd -u pyrovox-view -n 40; }
exit $rc
