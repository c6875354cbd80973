#!/bin/bash
# make test-all: every suite in its long form, one after the other; hours.  The last line is "N passed, N failed,
# N skipped" over all parts.  T_LONG: the tests run the cases that CI leaves out.  HOURS: of the soak under faults (2).
cd "$(dirname "$0")/.."
. tests/parts.sh
export T_LONG=1
part build make -j"$(nproc)" WERROR=1 built tests-build
part test make WERROR=1 test
part lint make WERROR=1 lint
part tidy make WERROR=1 DEEP=1 tidy
part asan make WERROR=1 test-asan
part tsan make WERROR=1 test-tsan
part view make WERROR=1 test-view
part blender make WERROR=1 test-blender
part vm make WERROR=1 test-vm
part cluster make WERROR=1 test-cluster
part deb make test-deb
part stability make WERROR=1 stability
part stability-card make WERROR=1 stability-card
part power make WERROR=1 power
part fuzz make fuzz
part soak make WERROR=1 soak
part lapse make WERROR=1 LAPSE=1 soak
part hours make WERROR=1 HOURS="${HOURS:-2}" soak
parts_end 17
