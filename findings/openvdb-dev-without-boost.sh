#!/bin/sh
# Debian's libopenvdb-dev does not bring the Boost headers that its own headers include.
#
# Expected: after the installation of libopenvdb-dev a program that includes <openvdb/openvdb.h> compiles.
# Happens:  the compiler does not find boost/..., since no package of Boost is among the dependencies.  With libboost-dev beside
#           it the program compiles.
# Seen in:  libopenvdb-dev 10.0.1-2 (Debian 12)
. "$(dirname "$0")/root.sh"
try() {
    printf '#include <openvdb/openvdb.h>\nint main() { openvdb::initialize(); }\n' > "$R/try/a.cpp"
    said=$(inside g++ -fsyntax-only a.cpp 2>&1)
    echo "$1: $(echo "$said" | grep -o 'fatal error: boost/.*: No such file' || echo "${said:-compiles}")"
}
root libopenvdb-dev=10.0.1-2 g++=4:12.2.0-3
alone=$(try alone)
rm -rf --one-file-system "$R"
root libopenvdb-dev=10.0.1-2 g++=4:12.2.0-3 libboost-dev=1.74.0.3
ends "$alone
$(try 'with libboost-dev')" 'alone: fatal error: boost/numeric/conversion/conversion_traits.hpp: No such file
with libboost-dev: compiles'
