#!/bin/bash
# Debian's packages of this tree, in BUILD/deb.
#   deb.sh BUILD VERSION REVISION PACKAGE...     (the packages that it is built with)
# SOURCE_DATE_EPOCH: the date in them; else that of the last commit, or of NEWS where this is no repository
# of its own: a release's tarball, wherever it was unpacked.
set -euo pipefail
cd "$(dirname "$0")/.."
out=$1/deb version=$2 revision=$3; shift 3
src=$out/pyrovox-$version log=$out/build.log
date=${SOURCE_DATE_EPOCH:-$({ [ -e .git ] && git log -1 --format=%ct; } 2> /dev/null || stat -c %Y NEWS)}
rm -rf "$out"; mkdir -p "$src"
tar -c --exclude=./.git --exclude='./build*' --exclude=./config.mk . | tar -x -C "$src"
cp -r systemd/debian "$src/debian"
build=$(printf '%s\n' "$@" | grep -vx build-essential | paste -sd, | sed 's/,/, /g')
sed "s|@BUILD@|$build|" systemd/debian/control.in > "$src/debian/control"
rm "$src/debian/control.in"
cat > "$src/debian/changelog" << END
pyrovox ($version-$revision) bookworm; urgency=medium

  * What is new stands in NEWS.

 -- $(sed -n 's/^Maintainer: //p' systemd/debian/control.in)  $(LC_ALL=C date -u -d "@$date" '+%a, %d %b %Y %H:%M:%S +0000')
END
echo "building packages (output: $log)" >&2
# what was said to this make is not for that one
if ! (cd "$src" && env -u MAKEFLAGS -u MAKELEVEL -u MFLAGS -u SOURCE_DATE_EPOCH LC_ALL=C.UTF-8 \
    DEB_BUILD_OPTIONS="${DEB_BUILD_OPTIONS-nocheck parallel=$(nproc)}" dpkg-buildpackage -b -us -uc) > "$log" 2>&1; then
    tail -n 20 "$log" >&2
    exit 1
fi
rm -rf "$src"
# a first entry closes a request for packaging only in Debian's own archive
lintian --fail-on error,warning --allow-root --suppress-tags initial-upload-closes-no-bugs "$out"/*.changes >&2
ls "$out"/*.deb
