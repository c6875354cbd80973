#!/bin/bash
# inside.sh ROOT: the packages of $PACKAGES/1 installed into the clean Debian at ROOT, tried, upgraded to
# $PACKAGES/2, removed, purged; notes go to $PYROVOX_DEB.  Run by mmdebstrap; PASS and FAIL lines.
set -u
root=$1 name=deb rc=0
check() { # what, command...
    local what=$1; shift
    if "$@"; then echo "PASS $name:$what"; else echo "FAIL $name:$what"; rc=1; fi
}
in_it() { chroot "$root" env DEBIAN_FRONTEND=noninteractive HOME=/root LC_ALL=C.UTF-8 PYROVOX_CACHE=/tmp/cache "$@" < /dev/null; }
mkdir -p "$root/deb" && cp -r "$PACKAGES"/[12] "$root/deb/" && cp "$PYROVOX_RIG" "$root/deb/rig.yaml"
packages() { # folder, names...: with what they need and nothing else
    local from=$1 files=() p; shift
    for p; do files+=("$(cd "$root" && ls "deb/$from/${p}"_*.deb | sed 's|^|/|')"); done
    in_it apt-get install -y -q --no-install-recommends "${files[@]}"
}
there() { in_it dpkg-query -W -f '${Package} ${Status}\n' 2> /dev/null | awk '/ installed$/ { print $1 }'; }
lacks() { ! there | grep -E "$1"; }
# all of the tree but what installing anything changes
everything() { (cd "$root" && find . -xdev \( -path ./proc -o -path ./sys -o -path ./dev -o -path ./deb -o -path ./tmp -o -path ./var/lib/dpkg -o -path ./var/lib/apt -o \
    -path ./var/cache -o -path ./var/log -o -path ./usr/share/man -o -name __pycache__ \) -prune -o -printf '%p\n' | sort); }

# ---- each with what it needs, and no camera's libraries where there is no camera --------------------------------
check libraries_install packages 1 libpyrovox-recon1 libpyrovox-client1 libpyrovox-recon-dev libpyrovox-client-dev
check libraries_need_no_cameras lacks '^lib(aravis|camera|opencv|usb|v4l)'
check python_installs packages 1 python3-pyrovox
python() { in_it python3 -c 'import pyrovox, pyrovox_sub; pyrovox.subscribe'; }
check python_imports python
check python_needs_no_cameras lacks '^lib(aravis|camera|opencv|usb|v4l)'
in_it apt-get purge -y -q 'libpyrovox*' python3-pyrovox > /dev/null && in_it apt-get autoremove --purge -y -q > /dev/null
check base_is_clean lacks pyrovox
# what pyrovox needs stays when it goes: nobody asked for it to be kept, so it is asked for here
needs=$(in_it dpkg-deb -f "$(cd "$root" && ls deb/1/pyrovox_*.deb)" Depends | tr ',' '\n' | sed 's/ *(.*//; s/ *|.*//; s/^ *//')
# shellcheck disable=SC2086
in_it apt-get install -y -q --no-install-recommends systemd udev $needs
everything > "$PYROVOX_DEB/before"

check pyrovox_installs packages 1 pyrovox
check daemon_needs_neither_libcamera_nor_opencv lacks '^lib(camera|opencv|ceres|openvdb)|^pyrovox-'
version() { [ "$(in_it pyrovox --version)" = "pyrovox $1" ] && [ "$(in_it pyrovoxd --version)" = "pyrovoxd $1" ]; }
check version version "$(in_it dpkg-query -W -f '${Version}' pyrovox | sed 's/-[^-]*$//')"
check users [ "$(in_it getent passwd pyrovox | cut -d: -f1,6)" = pyrovox:/var/cache/pyrovox ]
check folder_of_configuration [ -d "$root/etc/pyrovox" ]
check waits_for_its_administrator [ ! -e "$root/etc/systemd/system/multi-user.target.wants/pyrovoxd.service" ]
install_rig() { cp "$root/deb/rig.yaml" "$root/etc/pyrovox/" && cat > "$root/etc/pyrovox/pyrovoxd.yaml"; }
install_rig << 'Y'
rig: rig.yaml
cameras: "sim:"
fps: 20
publish: { endpoints: ["ipc:///run/pyrovox/volumes"] }
control: { endpoint: "ipc:///run/pyrovox/control" }
record: { mode: raw, path: /var/lib/pyrovox/night.h5 }
Y
check checks_configuration in_it pyrovoxd --check-config
lives() { # as the unit would: volumes out, a take closed in order
    install -d "$root/run/pyrovox" "$root/var/lib/pyrovox" && in_it chown pyrovox: /run/pyrovox /var/lib/pyrovox
    in_it bash -c 'setpriv --reuid=pyrovox --regid=pyrovox --clear-groups env PYROVOX_CACHE=/tmp/cache-of-it pyrovoxd & d=$!
        timeout 600 pyrovox record --endpoint ipc:///run/pyrovox/volumes --out /tmp/vol --volumes 5 --quiet; r=$?
        kill -TERM $d; wait $d || r=1; exit $r' && in_it pyrovox replay --info /var/lib/pyrovox/night.h5 | grep 'closed in order'
}
check daemon_lives lives
without() { # a module's libraries are missing: one line that says so
    in_it pyrovox convert /tmp/vol /tmp/vol.vdb > "$PYROVOX_DEB/out" 2>&1 && return 1
    cat "$PYROVOX_DEB/out"; grep -q 'package pyrovox-openvdb' "$PYROVOX_DEB/out"
}
check names_the_package_that_is_missing without

all=(pyrovox pyrovox-view pyrovox-libcamera pyrovox-openvdb pyrovox-mpi libpyrovox-client1 libpyrovox-client-dev libpyrovox-recon1 libpyrovox-recon-dev python3-pyrovox)
check all_install packages 1 "${all[@]}"
openvdb() { in_it pyrovox convert --format vdb /tmp/vol /tmp/vdb && [ -n "$(ls "$root"/tmp/vdb/*.vdb)" ]; }
check openvdb_is_found openvdb
libcamera() { # no camera is there, which the module says, not its absence
    in_it pyrovox cameras libcamera > "$PYROVOX_DEB/out" 2>&1
    cat "$PYROVOX_DEB/out"; ! grep -q 'cannot be used' "$PYROVOX_DEB/out"
}
check libcamera_is_found libcamera
owned() { # as make install has them
    for p in "${all[@]}"; do in_it dpkg -L "$p"; done | sort -u | while read -r f; do
        [ -d "$root$f" ] || echo "$f"
    done | sed -E 's|(/man/.*)\.gz$|\1|' | grep -vE '^/usr/share/doc/[^/]*/(copyright|changelog.*|NEWS.*)$|^/usr/share/(python3|lintian)/' > "$PYROVOX_DEB/owned"
    diff "$PYROVOX_DEB/names" "$PYROVOX_DEB/owned"
}
check same_files_as_make_install owned
check files_are_as_packed in_it dpkg --verify

# ---- upgrade, removal, purge -----------------------------------------------------------------------------------
kept() { cmp "$root/etc/pyrovox/rig.yaml" "$PYROVOX_RIG" && grep -q night.h5 "$root/etc/pyrovox/pyrovoxd.yaml" && [ -s "$root/var/lib/pyrovox/night.h5" ]; }
check upgrade packages 2 "${all[@]}"
next() { for p in "${all[@]}"; do in_it dpkg-query -W -f '${Version}\n' "$p"; done | grep -vc '+next$' | grep -qx 0; }
check all_of_the_next_revision next
check upgrade_keeps_what_was_made kept
check works_after_upgrade in_it pyrovoxd --check-config
check remove in_it apt-get remove -y -q "${all[@]}"
check programs_are_gone [ ! -e "$root/usr/bin/pyrovox" -a ! -e "$root/usr/lib/$(gcc -print-multiarch)/pyrovox" ]
check removal_keeps_what_was_made kept
: > "$root/var/lib/pyrovox/recording"; install -d "$root/var/cache/pyrovox"; : > "$root/var/cache/pyrovox/matrix"
check purge in_it apt-get purge -y -q pyrovox pyrovox-view # of the others nothing is left to purge
check purge_keeps_recordings_and_rig kept
check purge_takes_state_and_cache [ ! -e "$root/var/lib/pyrovox/recording" -a ! -e "$root/var/cache/pyrovox" ]
in_it apt-get autoremove --purge -y -q > /dev/null
rm -rf "$root/var/lib/pyrovox" "$root/etc/pyrovox" "$root/run/pyrovox"
nothing() { everything > "$PYROVOX_DEB/after"; ! comm -13 "$PYROVOX_DEB/before" "$PYROVOX_DEB/after" | grep -iE pyrovox; }
check nothing_else_is_left nothing
again() { # by whom nothing was made: not a folder stays
    packages 1 pyrovox pyrovox-view && in_it apt-get purge -y -q pyrovox pyrovox-view && nothing
}
check nothing_is_left again
exit $rc
