# root.sh - sourced by the findings: packages of Debian 12 with pinned versions, in a root of their own.
# Needs root and mmdebstrap.  Nothing is installed on the host, and nothing of Pyrovox is used.
set -u
T=$(mktemp -d) || exit 2
R=$T/root
trap 'rm -rf --one-file-system "$T"' EXIT

# root PACKAGE=VERSION ...: unpack them and what they need into $R.
root() {
    mmdebstrap --quiet --variant=extract --include="$(echo dash coreutils "$@" | tr ' ' ,)" bookworm "$R" \
        || { echo "not to be had: $*"; exit 2; }
    mkdir -p "$R/try"
    for p in "$@"; do echo "package $p"; done
}
# inside COMMAND ...: run it in $R/try.  Alternatives are not set up there, so LAPACK and BLAS are named.
inside() {
    LD_LIBRARY_PATH=/usr/lib/x86_64-linux-gnu/lapack:/usr/lib/x86_64-linux-gnu/blas PATH=/usr/bin:/bin:/usr/sbin \
        HOME=/try LC_ALL=C.UTF-8 chroot "$R" sh -c 'cd /try && exec "$@"' sh "$@"
}
# ends SEEN EXPECTED: print what was seen.  Fails if that has changed.
ends() {
    printf '%s\n' "$1"
    [ "$1" = "$2" ] && { echo "as found"; exit 0; }
    printf 'changed; it was:\n%s\n' "$2"
    exit 1
}
