#!/bin/bash
# Install the reconstruction as a library: what a program that includes frame.h or view.h needs.
#   install-recon.sh BUILD DESTDIR PREFIX
set -euo pipefail
cd "$(dirname "$0")/.."
build=$1 dest=$2 prefix=$3
libdir=$prefix/lib inc=$dest$prefix/include/pyrovox
[ "$prefix" != /usr ] || libdir+=/$(gcc -print-multiarch) # as Debian's packages
lib=$dest$libdir
put() { install -D -m 0644 "$1" "$2"; }

put "$build/lib/libpyrovox-recon.so.1" "$lib/libpyrovox-recon.so.1"
ln -sf libpyrovox-recon.so.1 "$lib/libpyrovox-recon.so"
for h in recon/carve/{hull,photo}.h recon/frame/frame.h recon/geom/{body,camera,grid,photometry,rig,spectral}.h recon/matrix/sysmat.h \
    recon/opencl/device.h recon/simd/windows.h recon/solve/params.h recon/view/{render,view}.h recon/vote/{verdict,wrong}.h; do
    put "$h" "$inc/$h"
done
for h in err pool; do put "daemon/base/$h.h" "$inc/base/$h.h"; done
put daemon/man/pyrovox-recon.3 "$dest$prefix/share/man/man3/pyrovox-recon.3"
put recon/view/example.c "$dest$prefix/share/doc/pyrovox/example-recon.c"
install -d "$lib/pkgconfig"
sed "s|@PREFIX@|$prefix|; s|@LIBDIR@|$libdir|" "$build/lib/pyrovox-recon.pc" > "$lib/pkgconfig/pyrovox-recon.pc"
