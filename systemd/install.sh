#!/bin/bash
# Install or remove what `make` built.
#   install.sh BUILD DESTDIR PREFIX
#   install.sh --remove DESTDIR PREFIX
set -euo pipefail
cd "$(dirname "$0")/.."

remove=
if [ "${1:-}" = --remove ]; then
    remove=1; shift
    build=
else
    build=$1; shift
fi
dest=$1 prefix=$2
bin=$dest$prefix/bin libdir=$prefix/lib inc=$dest$prefix/include/pyrovox
man=$dest$prefix/share/man doc=$dest$prefix/share/doc/pyrovox complete=$dest$prefix/share/bash-completion/completions
# Units, users and rules are looked for outside /usr/local only in some places: these work for both.  Libraries, units and
# Python's modules of /usr lie where Debian's packages have them (make deb), so that either way of installing is the same.
case $prefix in
    /usr) sys=$dest/usr/lib units=$dest/lib/systemd/system rules=$dest/lib/udev/rules.d libdir+=/$(gcc -print-multiarch)
        python=$dest/usr/lib/python3/dist-packages ;;
    *) sys=$dest/etc units=$dest/etc/systemd/system rules=$dest/etc/udev/rules.d
        python=$dest$prefix/lib/python$(python3 -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null || echo 3)/dist-packages ;;
esac
lib=$dest$libdir

put() { # mode, source, target
    if [ -n "$remove" ]; then rm -f "$3"; else install -D -m "$1" "$2" "$3"; fi
}

for p in pyrovox pyrovoxd; do put 0755 "$build/bin/$p" "$bin/$p"; done
for m in films tiff aruco calib libcamera openvdb mpi; do
    if [ -n "$remove" ] || [ -f "$build/lib/pyrovox/pyrovox-$m.so" ]; then
        put 0644 "$build/lib/pyrovox/pyrovox-$m.so" "$lib/pyrovox/pyrovox-$m.so"
    fi
done
put 0644 "$build/lib/libpyrovox-client.so.1" "$lib/libpyrovox-client.so.1"
put 0644 proto/clients/pyrovox_sub.py "$python/pyrovox_sub.py"
for f in __init__ _hdf5 _npy _page live recording volume; do put 0644 "proto/clients/python/pyrovox/$f.py" "$python/pyrovox/$f.py"; done
for f in _page.pyi py.typed; do put 0644 "proto/clients/python/pyrovox/$f" "$python/pyrovox/$f"; done
put 0644 proto/clients/example.c "$doc/example.c"
put 0644 proto/PROTOCOL.md "$doc/PROTOCOL.md"
# what a program includes (sub.h), and what that includes
for h in proto/pvp.h proto/clients/sub.h proto/clients/pyrovox_share.h; do put 0644 "$h" "$inc/$h"; done
put 0644 daemon/base/err.h "$inc/base/err.h"
for m in daemon/man/*.[1358]; do put 0644 "$m" "$man/man${m##*.}/$(basename "$m")"; done
put 0644 daemon/config/pyrovoxd.example.yaml "$doc/pyrovoxd.example.yaml"
for u in pyrovoxd pyrovox-view; do put 0644 "systemd/$u.sysusers" "$sys/sysusers.d/$u.conf"; done
put 0644 systemd/pyrovoxd.tmpfiles "$sys/tmpfiles.d/pyrovoxd.conf"
put 0644 systemd/pyrovoxd.socket "$units/pyrovoxd.socket"
put 0644 systemd/pyrovoxd.sysctl "$sys/sysctl.d/60-pyrovoxd.conf"
put 0644 systemd/70-pyrovox-cameras.rules "$rules/70-pyrovox-cameras.rules"
put 0644 systemd/pyrovox.completion "$complete/pyrovox"
if [ -n "$remove" ]; then
    rm -f "$units/pyrovoxd.service" "$units/pyrovox-view.service" "$complete/pyrovoxd" "$lib"/libpyrovox-{client,recon}.so "$lib/libpyrovox-recon.so.1" \
        "$lib"/pkgconfig/pyrovox-{client,recon}.pc "$doc/example-recon.c"
    rm -rf "$inc" "$python/pyrovox"
    find "$inc" "$doc" "$lib/pyrovox" -depth -type d -empty -delete 2>/dev/null || true
    exit 0
fi
systemd/install-recon.sh "$build" "$dest" "$prefix"
ln -sf libpyrovox-client.so.1 "$lib/libpyrovox-client.so"
ln -sf pyrovox "$complete/pyrovoxd"
install -d "$units" "$lib/pkgconfig"
sed "s|@PREFIX@|$prefix|; s|@LIBDIR@|$libdir|" "$build/lib/pyrovox-client.pc" > "$lib/pkgconfig/pyrovox-client.pc"
for u in pyrovoxd pyrovox-view; do
    sed "s|@BINDIR@|$prefix/bin|" "systemd/$u.service" > "$units/$u.service"
    chmod 0644 "$units/$u.service"
done
if [ -z "$dest" ]; then
    echo "installed; next: ldconfig, systemd-sysusers, systemd-tmpfiles --create, then systemd/README.md" >&2
fi
