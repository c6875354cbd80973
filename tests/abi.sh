#!/bin/bash
# What the two libraries show - functions, variables, and the structs of the installed headers - against what their last
# release showed (proto/clients/*.abi, recon/*.abi; libabigail).  Only pyrovox_share.h, which is no library's, is not in it.
#   abi.sh BUILD [--renew]
# Until NEWS has a release anything may be renewed; afterwards only what existing programs survive, or a new SONAME.
set -u
cd "$(dirname "$0")/.."
b=$1 renew=${2:-} bad=0
command -v abidiff > /dev/null || { echo "abi: apt install abigail-tools" >&2; exit 1; }
released=; grep '^[0-9]' NEWS | grep -qv '(unreleased)$' && released=1
version=$(awk '/^[0-9]/ { print $1; exit }' NEWS)
out=$b/abi
rm -rf "$out"; mkdir -p "$out"
systemd/install.sh "$b" "$PWD/$out/root" /usr || exit 1

for dump in proto/clients/libpyrovox-client.abi recon/libpyrovox-recon.abi; do
    name=$(basename "$dump" .abi) now=$out/$(basename "$dump")
    so=$(ls "$out"/root/usr/lib/*/"$name".so.?)
    # nothing of this machine: no places, no folders; opaque structs stay opaque
    abidw --headers-dir "$out/root/usr/include/pyrovox" --drop-private-types --exported-interfaces-only --drop-undefined-syms \
        --no-show-locs --no-corpus-path --no-comp-dir-path --no-parameter-names --no-elf-needed --no-write-default-sizes \
        --no-architecture --type-id-style hash --out-file "$now" "$so" || exit 1
    grep -q '<function-decl' "$now" || { echo "abi: $so: built without -g: nothing to compare" >&2; exit 1; }
    soname() { sed -n "s/.*soname='\([^']*\)'.*/\1/p;q" "$1"; }
    symbols() { grep -o "elf-symbol name='[^']*' version='[^']*'" "$1" | cut -d"'" -f2,4 | sort; }
    if [ ! -f "$dump" ] && [ -z "$renew" ]; then echo "abi: $dump is not there: 'make abi'" >&2; bad=1; continue; fi
    if [ -f "$dump" ] && [ "$(soname "$dump")" = "$(soname "$now")" ] && ! { [ -n "$renew" ] && [ -z "$released" ]; }; then
        if ! abidiff --no-added-syms "$dump" "$now" > "$out/$name.diff" 2>&1; then
            cat "$out/$name.diff" >&2
            if [ -n "$released" ]; then
                echo "abi: programs built with the last release of $name would break: take it back, or give the library a new" \
                    "SONAME (Makefile, *.map, systemd)" >&2
            else
                echo "abi: $name is no longer what $dump says: if that is meant, 'make abi' and commit it" >&2
            fi
            bad=1
            continue
        fi
        # what is new is of a version of its own, so that packages know from which release on it is there
        for s in ${released:+$(comm -13 <(symbols "$dump") <(symbols "$now"))}; do
            node=${s#*\'} known=$(echo systemd/debian/"$name"?.symbols)
            if symbols "$dump" | grep -q "'$node\$"; then
                echo "abi: $name: ${s%\'*} is new and says $node, as the last release does: give it a node of its own in the .map" >&2
            elif ! grep -qF "(symver)$node " "$known"; then
                echo "abi: $name: ${s%\'*} is new: \" (symver)$node $version\" into $known" >&2
            else
                continue
            fi
            bad=1
        done
    fi
    if [ -n "$renew" ] && [ $bad = 0 ]; then cp "$now" "$dump"; fi
done
[ $bad = 0 ] && echo "abi: ok"
exit $bad
