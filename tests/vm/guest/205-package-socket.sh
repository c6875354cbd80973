#!/bin/bash
# The package upgraded and removed while pyrovoxd.socket listens: the daemon awake, then asleep.  Who asks meanwhile waits, the
# socket stays, and nobody is woken by an upgrade.
# vm-memory: 2048
name=205
. "$(dirname "$0")/lib.sh"
packages_start
asks() { in_it pyrovox status --timeout "$patience" --json > "$dir/asked.log" 2>&1 || { cat "$dir/asked.log"; return 1; }; }
socket() { stat -c %i /run/pyrovox/control; } # systemd makes another whenever it starts to listen
listens() { is ActiveState active pyrovoxd.socket && [ "$(socket)" = "$its" ]; }
no_trouble() { is Result success pyrovoxd.socket && ! in_it journalctl --no-pager -q -o cat -u pyrovoxd.socket | grep -iE 'refus|fail'; }

check installs packages 1
packaged_daemon
check socket_is_enabled in_it systemctl enable --now pyrovoxd.socket
its=$(socket)
check is_asleep is ActiveState inactive
check is_woken asks
check records wait_for records

# ---- awake: between the two daemons is one who asks ----------------------------------------------------------------
mkdir -p /etc/systemd/system/pyrovoxd.service.d
printf '%s\n' '[Service]' "ExecStartPre=/bin/sh -c 'while [ -e /run/held ]; do sleep 0.2; done'" > /etc/systemd/system/pyrovoxd.service.d/held.conf
touch /run/held
packages 2 &
upgrade=$!
check the_first_ends wait_for is ActiveState activating
asks &
asking=$!
waits() { ss -xlHn | awk '$5 == "/run/pyrovox/control" && $3 > 0 { n = 1 } END { exit !n }'; }
check a_question_waits_in_the_socket wait_for waits
rm /run/held
check upgrades wait $upgrade
check is_answered_by_the_next wait $asking
check is_the_next [ -n "$(in_it dpkg-query -W -f '${Version}' pyrovox | grep next)" ]
check records_again wait_for records
check restarted_once [ "$(ends)" = 1 -a "$(value NRestarts)" = 0 -a "$(takes | wc -l)" = 2 ]
check take_was_closed_in_order first_take_is_closed
check socket_stayed listens

# ---- asleep --------------------------------------------------------------------------------------------------------
check sleeps in_it systemctl stop pyrovoxd
check upgrades_asleep packages 2
check sleeps_on is ActiveState inactive
check socket_stayed_again listens
check is_woken_again asks
check nothing_was_refused no_trouble

# ---- removed, while somebody goes on asking ------------------------------------------------------------------------
rm -r /etc/systemd/system/pyrovoxd.service.d
knock() { until [ -e "$dir/removed" ]; do in_it pyrovox status > "$dir/knock.log" 2>&1 || sleep 0.2; done; }
knock &
goes() { in_it dpkg "$1" pyrovox-view pyrovox > "$dir/dpkg$1.log" 2>&1; }
check removal goes -r
check nobody_runs [ -z "$(in_it pgrep -x pyrovoxd)" ]
check nobody_listens [ ! -e /run/pyrovox -a -z "$(ss -xlHn | grep pyrovox)" ]
touch "$dir/removed"
check purge goes -P
check nothing_is_enabled [ -z "$(find /etc/systemd /var/lib/systemd -name 'pyrovoxd*' -o -name 'pyrovox-view*')" ]
[ $rc = 0 ] || { grep -hv 'files list file' "$dir"/dpkg-*.log; in_it journalctl --no-pager -u pyrovoxd -u pyrovoxd.socket -n 60; }
exit $rc
