#!/bin/bash
# test.sh BUILD [CHECK]: the add-on in Debian's Blender: in the background, and on a screen that nobody sees (Xvfb, software GL).
# Screenshots in build/blender/, to be looked at.
set -u
cd "$(dirname "$0")/../.."
b=$PWD/${1:-build}
mkdir -p "$b/blender"
PYTHONDONTWRITEBYTECODE=1 exec timeout -k 10 1500 /usr/bin/python3 tests/blender/blender.py "$b" ${2:+"$2"}
