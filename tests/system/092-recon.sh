#!/bin/bash
# offline: A program against the installed reconstruction, which is built and installed without any camera's packages.
name=092
. "$(dirname "$0")/lib.sh"
root=$dir/root libdir=$dir/root/usr/lib/$(gcc -print-multiarch)
systemd/install-recon.sh "$b" "$root" /usr || { echo "FAIL $name:install"; exit 1; }
export PKG_CONFIG_SYSROOT_DIR=$root LD_LIBRARY_PATH=$libdir
flags=$(PKG_CONFIG_LIBDIR=$libdir/pkgconfig pkg-config --cflags --libs pyrovox-recon)
sanitizer=$([[ $b == *undefined* ]] && echo -fsanitize=address,undefined; [[ $b == *thread* ]] && echo -fsanitize=thread)
lib=libpyrovox-recon.so.1

example() { # with an error that is that of a ball of gas, not of nothing
    # shellcheck disable=SC2086
    gcc -Wall -Wextra -Werror "$root/usr/share/doc/pyrovox/example-recon.c" $flags $sanitizer -lm -o "$dir/example" || return 1
    "$dir/example" > "$dir/said" && awk '/^[0-9]+ voxels, mean error/ && $1 > 500 && $5 < 0.05 { ok = 1 } END { exit !ok }' "$dir/said" ||
        { cat "$dir/said"; return 1; }
}
check example_runs example

headers() { # each by itself, in C and C++
    local h bad=0
    cd "$root/usr/include/pyrovox" || return 1
    for h in */*.h */*/*.h; do
        echo "#include <$h>" | gcc -std=c17 -Wall -Wextra -Werror -I. -fsyntax-only -x c - || bad=1
        echo "#include <$h>" | g++ -std=c++17 -Wall -Wextra -Werror -I. -fsyntax-only -x c++ - || bad=1
    done
    cd "$OLDPWD" || return 1
    return $bad
}
check headers_compile_alone headers

cpp() { # its functions are found from C++
    printf '%s\n' '#include <recon/view/render.h>' '#include <recon/frame/frame.h>' \
        'int main() { rec_rig r; if (rec_rig_ring(4, 2, 8, 8, 8, &r) != PVX_OK) return 1; rec_rig_fini(&r); }' > "$dir/a.cpp"
    # shellcheck disable=SC2086
    g++ -Wall -Wextra "$dir/a.cpp" $flags $sanitizer -o "$dir/a" && "$dir/a"
}
check links_in_cpp cpp

names() { # what its headers declare, and nothing else
    nm -D --defined-only "$libdir/$lib" | awk '$2 ~ /[TBDR]/ { sub(/@.*/, "", $3); print $3 }' | sort > "$dir/shown"
    (cd "$root/usr/include/pyrovox" && ls base/*.h recon/*/*.h | sed 's/.*/#include <&>/' | gcc -I. -E -P -x c -) | tr '\n' ' ' |
        sed -E 's/__attribute__\(\([a-z_]+(\([^)]*\))?\)\)//g; s/static inline [^{]*\{/{/g' | tr '{};' '\n\n\n' | grep -v 'typedef\|^ *return' |
        grep -oE '^ *[a-zA-Z_][a-zA-Z0-9_ *]*[ *](pvx|rec)_[a-z0-9_]+ *\(|^ *extern const [a-z_ ]+' | sed -E 's/ *\(//; s/.*[ *]//' | sort -u > "$dir/declared"
    [ "$(wc -l < "$dir/shown")" -gt 40 ] && diff "$dir/declared" "$dir/shown"
}
check shows_what_is_declared names

needs() { # nothing of cameras, sockets, drawing
    local n
    n=$(readelf -d "$1" | sed -n 's/.*(NEEDED).*\[\(.*\)\]/\1/p' | grep -vE '^(libc|libm|ld-linux.*|libyaml-.*|libxxhash|lib[atu]b?san|libgcc_s)\.so' )
    [ -z "$n" ] || { echo "  $n"; return 1; }
}
check needs_little needs "$b/lib/$lib"

opencl() { # its text asks for the library by name, and the loader does not
    local f
    grep -q 'libOpenCL\.so\.1' "$b/lib/$lib" || return 1
    for f in "$b/lib/$lib" "$pyrovox" "$pyrovoxd"; do
        readelf -d "$f" > "$dir/needs" && grep -q NEEDED "$dir/needs" && ! grep -i opencl "$dir/needs" || return 1
    done
}
check opencl_is_no_dependency opencl

both() { # with the client in one program
    [ -f "$b/lib/libpyrovox-client.so.1" ] || return 1
    printf '%s\n' '#include <proto/clients/sub.h>' '#include <recon/geom/rig.h>' '#include <stdio.h>' \
        'int main(void) { struct pvx_diag w = {""}; struct rec_rig r; pvp_sub *s; pvx_err e = rec_rig_load("none.yaml", &r, &w);' \
        'puts(pvx_diag_text(&w, e)); w.text[0] = 0; e = pvp_sub_new("nonsense", NULL, &s, &w); puts(pvx_diag_text(&w, e)); return 0; }' > "$dir/b.c"
    # shellcheck disable=SC2086
    gcc -Wall -Wextra -Werror -I. -Idaemon "$dir/b.c" $flags "$b/lib/libpyrovox-client.so.1" $sanitizer -o "$dir/b" &&
        (cd "$dir" && LD_LIBRARY_PATH=$libdir:$b/lib ./b > said) && grep -q 'none.yaml' "$dir/said" && grep -q nonsense "$dir/said" ||
        { cat "$dir/said"; return 1; }
}
check beside_the_client both

bare() { # what it includes compiles where every other package's headers refuse, and nothing of it asks pkg-config
    local h f no=$dir/no
    for h in arv.h libusb-1.0/libusb.h libusb.h libcamera/libcamera.h turbojpeg.h zmq.h hdf5.h cjson/cJSON.h lz4.h zstd.h zlib.h \
        cairo/cairo.h cairo.h systemd/sd-daemon.h opencv2/core.hpp ceres/ceres.h; do
        mkdir -p "$no/$(dirname $h)"; echo '#error of a package that is not there' > "$no/$h"
    done
    mkdir "$dir/pc"
    env -u MAKEFLAGS -u MAKELEVEL PKG_CONFIG_LIBDIR="$dir/pc" make -n B="$dir/build" CC=gcc SAN= V=1 install-recon > "$dir/make.log" 2> "$dir/asked" || return 1
    [ ! -s "$dir/asked" ] || { cat "$dir/asked"; return 1; }
    grep -oE ' -c [^ ]+\.c( |$)' "$dir/make.log" | cut -d' ' -f3 | sort -u > "$dir/sources"
    [ "$(wc -l < "$dir/sources")" -gt 80 ] || return 1
    { cat "$dir/sources"; xargs dirname < "$dir/sources" | sort -u | while read -r f; do ls "$f"/*.h; done 2> "$dir/none"; } |
        xargs grep -hE '^ *# *include *<' | sort -u > "$dir/included.c"
    [ "$(wc -l < "$dir/included.c")" -gt 20 ] || return 1
    gcc -std=c17 -D_GNU_SOURCE -I"$no" -fsyntax-only "$dir/included.c" && ! [ -e "$root/usr/include/pyrovox/proto" ]
}
check without_cameras bare
exit $rc
