#!/bin/bash
# A program against the installed client: it compiles, links and reads volumes; nothing private is shown.
name=084
. "$(dirname "$0")/lib.sh"
root=$dir/root libdir=$dir/root/usr/lib/$(gcc -print-multiarch)
systemd/install.sh "$b" "$root" /usr || { echo "FAIL $name:install"; exit 1; }
export PKG_CONFIG_PATH=$libdir/pkgconfig PKG_CONFIG_SYSROOT_DIR=$root LD_LIBRARY_PATH=$libdir
flags=$(pkg-config --cflags --libs pyrovox-client)
sanitizer=$([[ $b == *undefined* ]] && echo -fsanitize=address,undefined; [[ $b == *thread* ]] && echo -fsanitize=thread)

builds() { # compiler, language
    # shellcheck disable=SC2086
    "$1" -Wall -Wextra -Werror -x "$2" "$root/usr/share/doc/pyrovox/example.c" -x none $flags $sanitizer -o "$dir/example-$2"
}
check links_in_c builds gcc c

headers() { # by itself, in C and C++
    local h bad=0
    cd "$root/usr/include/pyrovox" || return 1
    for h in base/err.h proto/pvp.h proto/clients/sub.h proto/clients/pyrovox_share.h; do
        echo "#include <$h>" | g++ -std=c++17 -Wall -Wextra -Werror -I. -fsyntax-only -x c++ - || bad=1
    done
    for h in */*.h */*/*.h; do
        echo "#include <$h>" | gcc -std=c17 -Wall -Wextra -Werror -I. -fsyntax-only -x c - || bad=1
    done
    cd "$OLDPWD" || return 1
    return $bad
}
check headers_compile_alone headers

names() { # the functions that its headers declare, and no others
    nm -D --defined-only "$libdir/libpyrovox-client.so.1" | awk '$2 == "T" { sub(/@.*/, "", $3); print $3 }' | sort > "$dir/shown"
    (cd "$root/usr/include/pyrovox" && gcc -I. -E -P base/err.h proto/pvp.h proto/clients/sub.h) |
        tr '\n' ' ' | tr ';{}' '\n\n\n' | grep -v typedef | grep -oE '\bpv[xp]_[a-z0-9_]+ *\(' | tr -d ' (' | sort -u > "$dir/declared"
    [ -s "$dir/shown" ] && diff "$dir/declared" "$dir/shown"
}
check shows_what_is_declared names

reads() { # 20 volumes
    "$b/tests/unit/test_pub" --publish "$volumes" 20 0 & pub=$!; pids+=("$pub")
    timeout "$patience" "$dir/example-c" "$volumes" > "$dir/read" || return 1
    wait "$pub"
    [ "$(grep -c '^set ' "$dir/read")" = 20 ] && grep -q '^set 19: 147.875 at ' "$dir/read" || { cat "$dir/read"; return 1; }
}
check reads_volumes reads

python() {
    (cd "$dir" && PYTHONPATH=$root/usr/lib/python3/dist-packages "$py" -c 'import pyrovox_sub; pyrovox_sub.Subscriber')
}
if "$py" -c 'import numpy, zmq' 2> /dev/null; then check python_module python
else echo "SKIP $name:python_module (no python3 with numpy and zmq)"; fi
exit $rc
