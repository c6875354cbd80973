#!/bin/bash
# offline: What tests/abi.sh lets through before and after a release, on both libraries with their sources changed in a copy.
name=101
. "$(dirname "$0")/lib.sh"
command -v abidiff > /dev/null || { echo "no abidiff here: apt install abigail-tools"; exit 77; }
t=$dir/tree
mkdir -p "$t"/{build/daemon,daemon/config,tests} && cp -a daemon/*.mk "$t/daemon/" && cp -a tests/*.mk "$t/tests/" &&
    cp -a Makefile NEWS proto recon systemd "$t/" && cp -a daemon/{base,man} "$t/daemon/" && cp -a daemon/config/*.yaml "$t/daemon/config/" &&
    cp -a tests/abi.sh tests/rooms.txt "$t/tests/" && cp -a "$b"/{lib,proto,recon} "$t/build/" && cp -a "$b/daemon/base" "$t/build/daemon/" &&
    ln -s "$b/bin" "$t/build/bin" || { echo "FAIL $name:copy"; exit 1; }

libraries=(build/lib/libpyrovox-client.so.1 build/lib/libpyrovox-recon.so.1)
change() { # file, sed's...: it is as in the tree but for that
    local f=$1; shift
    sed "$@" "$f" > "$t/$f"
    ! cmp -s "$f" "$t/$f" || { echo "  $f is as it was: $*"; return 1; }
}
as_it_was() { local f; for f in proto/clients/{sub.h,sub.c,client.map} recon/recon.map recon/view/view.{h,c}; do cat "$f" > "$t/$f"; done; }
build() { env -u MAKEFLAGS -u MAKELEVEL make -s -C "$t" B=build CC=gcc SAN= WERROR= "${libraries[@]}" > "$dir/make.log" 2>&1; }
abi() { run "$t/tests/abi.sh" build "$@"; }
released() { printf '%s\n' '0.2.0 (unreleased)' '- news' '' '0.1.0 (2027-01-02)' '- all' > "$t/NEWS"; }
unreleased() { printf '%s\n' '0.1.0 (unreleased)' '- all' > "$t/NEWS"; }
written() { (cd "$t" && md5sum proto/clients/*.abi recon/*.abi); }

unreleased
taken_over() { build && abi --renew && says 0 'abi: ok'; }
check takes_over_before_a_release taken_over
before=$(written)
released
unchanged() { abi && says 0 'abi: ok'; }
check unchanged_is_well unchanged

broken() {
    for f in proto/clients/sub.[hc]; do change $f 's/^\(int pvp_sub_fd(const pvp_sub \*s\))/\1, int more)/; s/^struct pvp_sub_stats {/& int more;/' || return 1; done
    for f in recon/view/view.[hc]; do change $f 's/^\(void rec_view_get_stats(.*\*out\))/\1, int more)/; s/^struct rec_view_stats {/& int more;/' || return 1; done
    build
}
refused() { # arguments of abi.sh, and what it says of each library
    local said=$1; shift
    abi "$@" && says 1 "$said" libpyrovox-client libpyrovox-recon pvp_sub_fd pvp_sub_stats rec_view_get_stats rec_view_stats && [ "$before" = "$(written)" ]
}
check is_broken broken
check breaks_programs refused SONAME
check is_not_written_down refused SONAME --renew
unreleased
check must_be_meant_before_a_release refused "'make abi' and commit it"

as_it_was; released
added() {
    for f in proto/clients/sub.h recon/view/view.h; do
        change $f 's/^int pvp_sub_fd.*/&\nint pvp_sub_more(const pvp_sub *s);/; s/^void rec_view_get_stats.*/&\nint rec_view_more(const rec_view *v);/' || return 1
    done
    echo 'int pvp_sub_more(const pvp_sub *s) { return s != NULL; }' >> "$t/proto/clients/sub.c"
    echo 'int rec_view_more(const rec_view *v) { return v != NULL; }' >> "$t/recon/view/view.c"
    change proto/clients/client.map 's/^ *pvp_sub_fd;/& pvp_sub_more;/' && change recon/recon.map 's/^ *rec_view_free;/& rec_view_more;/' && build
}
with_nodes() {
    as_it_was_maps && echo 'PYROVOX_CLIENT_1_1 { global: pvp_sub_more; } PYROVOX_CLIENT_1;' >> "$t/proto/clients/client.map" &&
        echo 'PYROVOX_RECON_1_1 { global: rec_view_more; } PYROVOX_RECON_1;' >> "$t/recon/recon.map" && build
}
as_it_was_maps() { cat proto/clients/client.map > "$t/proto/clients/client.map" && cat recon/recon.map > "$t/recon/recon.map"; }
check has_more added
no_node() { abi "$@" && says 1 "pvp_sub_more is new and says PYROVOX_CLIENT_1," "rec_view_more is new and says PYROVOX_RECON_1," .map && [ "$before" = "$(written)" ]; }
check wants_a_node_of_its_own no_node
check is_not_written_down_without no_node --renew
check has_more_with_nodes with_nodes
unknown() { abi && says 1 ' (symver)PYROVOX_CLIENT_1_1 0.2.0' ' (symver)PYROVOX_RECON_1_1 0.2.0' .symbols; }
check packages_must_know_it unknown
for n in client recon; do echo " (symver)PYROVOX_${n^^}_1_1 0.2.0" >> "$t/systemd/debian/libpyrovox-${n}1.symbols"; done
check is_compatible unchanged
next() { abi --renew && says 0 'abi: ok' && grep -q "pvp_sub_more' version='PYROVOX_CLIENT_1_1'" "$t/proto/clients/libpyrovox-client.abi" && grep -q rec_view_more "$t/recon/libpyrovox-recon.abi"; }
check is_written_down next
check is_well_then unchanged
exit $rc
