#!/bin/bash
# test.sh BUILD VERSION REVISION PACKAGE...: the packages of BUILD/deb (make deb; PACKAGE... is what they are built
# with) in a Debian that mmdebstrap makes for this alone, with this machine's apt sources; built once more, elsewhere,
# to the same bits; and, under systemd in the small virtual machine, upgraded while the daemon runs.
# Closes with "N passed, N failed, N skipped".
set -u
cd "$(dirname "$0")/../.."
b=$PWD/$1
rm -rf "$b/deb-test"; mkdir -p "$b"/deb-test/{1,2}
log=$b/deb-test/test.log
work=$(mktemp -d /tmp/pyrovox-deb-XXXXXX)
: > "$work/lines"
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM

# the same packages with a higher revision: what is in them is the same
packages=$b/deb-test
for d in "$b"/deb/*.deb; do
    case $d in *-dbgsym_*) continue;; esac
    cp "$d" "$packages/1/" || exit 1
    dpkg-deb -R "$d" "$work/tree"
    v=$(dpkg-deb -f "$d" Version)
    sed -i "/^Version:/s/\$/+next/; /^Depends:/s/(\(>*=\) $v)/(\1 $v+next)/g" "$work/tree/DEBIAN/control"
    dpkg-deb --root-owner-group -Znone -b "$work/tree" "$packages/2" > /dev/null || exit 1
    rm -rf "$work/tree"
done
# what make install makes of the same tree: names, without what only packages have
systemd/install.sh "$b" "$work/installed" /usr || exit 1
(cd "$work/installed" && find . ! -type d -printf '/%P\n' | sort) > "$work/names"

release=$(. /etc/os-release; echo "$VERSION_CODENAME")
sources=(/etc/apt/sources.list.d/debian.sources)
[ -f "${sources[0]}" ] || sources=(/etc/apt/sources.list)
echo "a clean Debian (output: $log)" >&2
as_root=(); [ "$(id -u)" = 0 ] || as_root=(sudo)
# shellcheck disable=SC2016 # $1 is mmdebstrap's
"${as_root[@]}" env PACKAGES="$packages" PYROVOX_DEB="$work" PYROVOX_RIG="$PWD/tests/data/rig4.yaml" mmdebstrap --mode=root --variant=apt --format=null \
    --customize-hook="bash $PWD/tests/deb/inside.sh \"\$1\" > $work/said 2>&1" "$release" /dev/null "${sources[@]}" > "$work/mmdebstrap" 2>&1
rc=$?
cat "$work/mmdebstrap" "$work/said" > "$log" 2> /dev/null
lines() { grep -E '^(PASS|FAIL|SKIP) ' | tee -a "$work/lines"; }
lines < "$work/said"
[ $rc = 0 ] || { tail -n 60 "$log"; grep -q '^FAIL' "$work/lines" || echo "FAIL deb:mmdebstrap: exit $rc" | lines; }

again() { # in another folder, time zone and umask
    (umask 027; TZ=Pacific/Chatham systemd/deb.sh "$b/deb-test" "${@:2}" > "$work/again" 2>&1) || { tail "$work/again"; return 1; }
    local d
    for d in "$b"/deb/*.deb; do cmp "$d" "$b/deb-test/deb/${d##*/}" || return 1; done
}
if again "$@" > "$work/differs" 2>&1; then echo "PASS deb:same_bits_again"; else cat "$work/differs"; echo "FAIL deb:same_bits_again"; fi | tee -a "$log" | lines

tests/vm/test.sh "$1" -package > "$work/vm"
cat "$work/vm" >> "$log"
lines < "$work/vm"
n() { grep -c "^$1 " "$work/lines"; }
[ "$(n FAIL)" = 0 ] || grep -vE '^(PASS|SKIP) ' "$work/vm"
echo
echo "full output: ${log#"$PWD"/}"
echo "$(n PASS) passed, $(n FAIL) failed, $(n SKIP) skipped"
[ "$(n FAIL)" = 0 ]
