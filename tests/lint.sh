#!/bin/bash
# Style checks that need no build: language, links, man pages, shell syntax, conventions of CONTRIBUTING.md.
#   lint.sh VERSION
set -u
version=$1
cd "$(dirname "$0")/.."
bad=0
[ -e .git ] || { echo "lint: needs git's list of the files, and this is no checkout of git" >&2; exit 1; }
for s in $(git ls-files '*.sh' '.ci/run'); do bash -n "$s" || bad=1; done
for m in $(git ls-files '*.[1358]'); do
    [ -f "$m" ] || continue
    mandoc -Tlint -Wwarning "$m" || bad=1
done
python3 tests/language.py || bad=1        # README.md and all other pages, and references to what is not here
# libpng returns from an error by longjmp only
if git ls-files '*.c' '*.h' '*.cpp' | grep -v '^capture/files/png.c$' | xargs -r grep -nE '(^|[^_a-z])(strcpy|strcat|sprintf|gets|setjmp|longjmp)\(' ; then
    echo "  ^ not used here"; bad=1
fi
if git ls-files '*.c' '*.h' '*.cpp' Makefile '*.mk' | grep -v '^tests/lint' | xargs -r grep -n -e '-ffast-math' | grep -v '[Nn]ever'; then bad=1; fi
if git ls-files '*.c' '*.h' | xargs -r grep -nP '\t| +$'; then echo "  ^ tabs or trailing blanks"; bad=1; fi
if git ls-files Makefile '*.mk' | xargs grep -nE '.{121}'; then echo "  ^ longer than 120 columns"; bad=1; fi
# each header says what it is in its first line
for h in $(git ls-files '*.h'); do head -1 "$h" | grep -q '^/\* ' || { echo "$h: no opening comment"; bad=1; }; done
grep -qxF "__version__ = \"$version\"" proto/clients/python/pyrovox/__init__.py && grep -qxF "version = \"$version\"" proto/clients/python/pyproject.toml ||
    { echo "the Python package is not of version $version, as NEWS is"; bad=1; }
[ $bad = 0 ] && echo "lint: ok"
exit $bad
