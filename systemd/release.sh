#!/bin/bash
# What a release wants, cheap things first; then its files with their SHA-256 in BUILD/release.  `make release` runs it.
#   release.sh BUILD VERSION
set -euo pipefail
cd "$(dirname "$0")/.."
b=$1 version=$2
no() { echo "release: $*" >&2; exit 1; }
[ -z "$(git status --porcelain)" ] || no "the tree is not clean: git status"
grep -Eqx "$version \(20[0-9]{2}-[01][0-9]-[0-3][0-9]\)" NEWS || no "NEWS: the entry of $version has no date: \"$version ($(date +%F))\""
at=$(git rev-parse -q --verify "v$version^{commit}" || git rev-parse HEAD)
[ "$at" = "$(git rev-parse HEAD)" ] || no "v$version is another commit; a new version is a new entry in NEWS"
make --no-print-directory abi
[ -z "$(git status --porcelain)" ] || no "the libraries show more than *.abi says: it is renewed now, commit it"
make --no-print-directory WERROR=1 test
make --no-print-directory WERROR=1 lint
make --no-print-directory test-deb
make --no-print-directory sbom > /dev/null
out=$b/release
rm -rf "$out"; mkdir -p "$out"
git archive --prefix="pyrovox-$version/" HEAD | gzip -9n > "$out/pyrovox-$version.tar.gz"
cp "$b"/deb/*.deb "$b/pyrovox.spdx.json" "$out/"
(cd "$out" && sha256sum ./*.deb ./*.json ./*.tar.gz > SHA256SUMS)
ls "$out"
echo "release: next: git tag -s v$version; the files of $out beside it"
