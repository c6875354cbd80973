#!/bin/bash
# test.sh BUILD: the page in a browser (Debian's chromium-headless-shell, software GL), driven over the DevTools pipe.
# Screenshots in build/view/, to be looked at.
set -u
cd "$(dirname "$0")/../.."
b=$PWD/${1:-build}
mkdir -p "$b/view"
PYTHONDONTWRITEBYTECODE=1 exec timeout -k 10 1500 /usr/bin/python3 tests/view/view.py "$b" ${2:+"$2"}
