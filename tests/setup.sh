#!/bin/bash
# Install the Debian packages given, if they are missing.  Asks nothing; no network when all are there.
#   setup.sh [--missing] PACKAGE...      --missing: only name those that are
set -euo pipefail
ask=; [ "$1" != --missing ] || { ask=1; shift; }
command -v dpkg-query > /dev/null || { echo "no Debian here: these have to be there: $*" >&2; exit 0; }
there=$(dpkg-query -W -f='${binary:Package} ${db:Status-Status}\n' "$@" 2> /dev/null | sed -n 's/^\([^: ]*\)[^ ]* installed$/ \1 /p' || true)
missing=()
for p in "$@"; do [[ $there == *" $p "* || " ${missing[*]:-} " == *" $p "* ]] || missing+=("$p"); done
[ ${#missing[@]} -eq 0 ] && exit 0
[ -z "$ask" ] || { echo "${missing[*]}"; exit 0; }
echo "installing Debian packages: ${missing[*]}" >&2
as_root=()
if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || {
        echo "need root or sudo to install: ${missing[*]}" >&2
        echo "ask an administrator for: apt-get install ${missing[*]}" >&2
        exit 1
    }
    as_root=(sudo)
fi
# Several targets may be made at a time: one installs, the others wait for it.
apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=600)
(
    flock 9
    "${apt[@]}" update >&2
    "${apt[@]}" install -y --no-install-recommends "${missing[@]}" >&2
) 9> "${TMPDIR:-/tmp}/pyrovox-setup-$(id -u).lock"
