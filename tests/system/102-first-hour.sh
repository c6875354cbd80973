#!/bin/bash
# The guide's first hour, pasted block by block; examples of --help, whole and with options that exist.
name=102
. "$(dirname "$0")/lib.sh"
page=$PWD/daemon/man/guide/first-hour.md env=$b/env
export RUNTIME_DIRECTORY=$dir/run; mkdir -p "$dir/run" # no other daemon of this user is asked
has() { "$py" -c "import $1" 2> /dev/null; }

blocks() { # block-NN of a terminal, in the order of the page; says-NN: what block NN must say
    awk -v to="$dir/" '/^```/ && on { on = 0; next }
        /^```sh/ { n++; on = 1; f = to sprintf("%s-%02d", NF > 1 ? "first" : "block", n); next }
        /^```text/ { on = 1; f = to sprintf("says-%02d", n); next }
        on { print > f }' "$page"
    [ "$(find "$dir" -name 'block-*' | wc -l)" -ge 6 ] && [ -f "$dir/first-05" ] && [ -f "$dir/says-03" ]
}
check blocks blocks

# The place of the sources is that of the page's reader; python3 is Debian's.
mkdir -p "$dir/bin" && ln -sf "$(command -v "$py")" "$dir/bin/python3"
paste_block() { # number: as it stands, with the names of build/env, until a command fails
    out=$(export HOME=$dir PATH=$dir/bin:$PATH MPLCONFIGDIR=$dir/mpl
     . "$env"
     PATH=$dir/bin:$PATH
     cd "$dir/flame" && timeout "$patience" bash -e "$dir/block-$1" 2>&1)
    code=$?
}
offline() {
    mkdir -p "$dir/flame"
    paste_block 02; says 0 '30 volumes in volumes' && [ -s "$dir/flame/strip.png" ] || return 1
    paste_block 03; says 1 "$(cat "$dir/says-03")" && [ ! -e "$dir/flame/wrong" ]
}
names() { # what the first block gives to a shell, whichever it is
    local sh
    for sh in bash dash; do
        run env -u MANPATH -u PYTHONPATH HOME="$dir" $sh -c ". '$env'; command -v pyrovox; command -v pyrovoxd; $py -c 'import pyrovox; print(pyrovox.__version__)'; man -w pyrovox-calibrate 2>&1 || echo no man"
        says 0 "$b/bin/pyrovox" "$b/bin/pyrovoxd" 0.1.0 || return 1
        command -v man > /dev/null && ! says 0 /pyrovox-calibrate.1 && return 1
    done
    run bash -c ". '$env'; complete -p pyrovox"; says 0 _pyrovox
}
check names names
check offline offline

live() {
    paste_block 04; says 0 'pyrovoxd.yaml: ok: 8 cameras' '0.11 GB for the system matrix' || return 1
    (cd "$dir/flame" && . "$env" && exec bash -c "exec $(cat "$dir/first-05")") > "$dir/first.log" 2>&1 & pids+=($!)
    wait_for "$pyrovox" record --quiet --volumes 1 --out "$dir/there"
    paste_block 06; says 0 'sets/s' || return 1
    [ -s "$dir/flame/flame.h5" ] || return 1
    has h5py && has matplotlib || { echo "SKIP $name:python (apt-get install python3-h5py python3-matplotlib)"; return 0; }
    paste_block 07; says 0 'live: (64, 64, 64, 3)' 'recorded: 30 volumes of 1/m' && [ -s "$dir/flame/slice.png" ]
}

examples() { # of a command: no example is broken by --help, and its options are options
    local help line words word bad=0 joined=
    help=$("$pyrovox" "$@" --help-all 2> /dev/null || "$pyrovox" "$@" --help) || return 1
    while IFS= read -r line; do
        [[ $joined != '' && $line =~ ^[^[:space:]] ]] && { echo "  $*: is broken: $line"; bad=1; }
        joined=
        [[ $line =~ ^\ \ (pyrovox|mpirun)\  || $line =~ ^\ {8,}-- && $more ]] || { more=; continue; }
        joined=$line more=
        [[ $line != *\\ ]] || more=1
        [[ $line == *pyrovox\ $1* || $line =~ ^\ {8,}-- ]] || continue
        line=${line%% -- *}; line=${line%%;*}; line=${line%%|*}
        for word in $line; do
            [[ $word =~ ^--[a-z] ]] || continue
            word=${word%%=*}
            grep -qE -- "(^|[ ,])$word([= \[]|\$)" <<< "$help" || { echo "  $*: no option $word"; bad=1; }
        done
    done <<< "$help"
    return $bad
}
all_examples() {
    local c bad=0
    for c in $("$pyrovox" --help | awk '/^Commands:$/ { on = 1; next } /^$/ { on = 0 } on { print $1 }'); do
        examples "$c" || bad=1
    done
    for c in $("$pyrovox" calibrate --help | awk '/^Steps:$/ { on = 1; next } /^$/ { on = 0 } on { print $1 }'); do
        examples calibrate "$c" || bad=1
    done
    return $bad
}
check examples all_examples
sim_yaml() { # what the help of calibrate live writes is a configuration
    (cd "$dir/flame" && eval "$("$pyrovox" calibrate live --help | grep -A1 '^  (echo'; "$pyrovox" calibrate live --help | grep '^  printf')" &&
        echo 'rig: rig.yaml' >> sim.yaml) || return 1
    run "$pyrovoxd" -k -c "$dir/flame/sim.yaml"
    says 0 'ok: 4 cameras' 'only 4 of the 8 cameras of'
}
check sim_yaml sim_yaml

needs_private_net
check live live
exit $rc
