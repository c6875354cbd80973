#!/bin/bash
# The libcamera module against what later libcameras declare.  Only 0.0.3 is installed here, so its headers are
# changed into a double of 0.7.2's where the two differ in what the module uses, and the module is compiled
# (not linked, not run) against them.  The differences are facts from libcamera's own headers at v0.7.2.
set -u
cd "$(dirname "$0")/../.."
name=085
from=$(pkg-config --variable=includedir libcamera 2>&1)/libcamera
[ -f "$from/libcamera/version.h" ] || { echo "no libcamera headers here"; exit 77; }
version=$(pkg-config --modversion libcamera)
[ "$version" = 0.0.3 ] || { echo "libcamera $version is installed: the module was built with it"; exit 77; }
dir=$(mktemp -d); trap 'rm -rf "$dir"' EXIT
cp -r "$from" "$dir/new"
rc=0
change() { # header, text, text instead: must be there, or the double is none
    python3 - "$dir/new/libcamera/$1" "$2" "$3" << 'PY' || { echo "FAIL $name:double-of-$1"; rc=1; }
import sys
path, old, new = sys.argv[1:]
text = open(path).read()
if old not in text:
    print('  not in %s: %s' % (path, old))
    sys.exit(1)
open(path, 'w').write(text.replace(old, new))
PY
}
change version.h 'LIBCAMERA_VERSION_MINOR		0' 'LIBCAMERA_VERSION_MINOR		7'
change version.h 'LIBCAMERA_VERSION_PATCH		3' 'LIBCAMERA_VERSION_PATCH		2'
# 0.1.0: cameras are not found by device number; 0.5.0: by string_view
change camera_manager.h 'std::shared_ptr<Camera> get(const std::string &id);' 'std::shared_ptr<Camera> get(std::string_view id);'
change camera_manager.h 'std::shared_ptr<Camera> get(dev_t devnum);' ''
# 0.1.0: roles as a span; 0.2.0: orientation instead of transform
change stream.h 'using StreamRoles = std::vector<StreamRole>;' ''
change camera.h 'generateConfiguration(const StreamRoles &roles = {});' 'generateConfiguration(Span<const StreamRole> roles = {});
	std::unique_ptr<CameraConfiguration> generateConfiguration(std::initializer_list<StreamRole> roles);'
change camera.h 'Transform transform;' 'int orientation;'
# 0.6.0: buffers may be derived from, planes are a span, frames that a sensor needs to start with
change framebuffer.h 'class FrameBuffer final : public Extensible' 'class FrameBuffer : public Extensible'
change framebuffer.h 'const std::vector<Plane> &planes() const;' 'Span<const Plane> planes() const;'
change framebuffer.h 'FrameCancelled,' 'FrameCancelled,
		FrameStartup,'
# 0.7.0: metadata is for reading
change request.h 'ControlList &metadata() { return *metadata_; }' 'const ControlList &metadata() const;'
change request.h 'ControlList &controls() { return *controls_; }' 'ControlList &controls();'
change request.h 'const BufferMap &buffers() const { return bufferMap_; }' 'const BufferMap &buffers() const;'
change request.h 'std::unique_ptr<Fence> fence = nullptr' 'std::unique_ptr<Fence> &&fence = {}'
# controls: more types; identifiers know their vendor and direction
change controls.h 'ControlTypeInteger32,' 'ControlTypeUnsigned16,
	ControlTypeUnsigned32,
	ControlTypeInteger32,'
change controls.h 'ControlId(unsigned int id, const std::string &name, ControlType type)
		: id_(id), name_(name), type_(type)' 'ControlId(unsigned int id, const std::string &name, const std::string &vendor, ControlType type)
		: id_(id), name_(name), type_(type), vendor_(vendor)'
change controls.h 'std::string name_;
	ControlType type_;' 'std::string name_;
	ControlType type_;
	std::string vendor_;'
change controls.h ': ControlId(id, name, details' ': ControlId(id, name, "libcamera", details'
compiles() { # include folder, more arguments
    local inc=$1; shift
    g++ -std=c++20 -fsyntax-only -Wall -Wextra -Werror -I. -Idaemon -isystem "$inc" "$@" capture/libcamera/shim.cpp
}
check() { local what=$1; shift; if "$@"; then echo "PASS $name:$what"; else echo "FAIL $name:$what"; rc=1; fi; }
check compiles-against-0.0.3 compiles "$from"
check compiles-against-the-double-of-0.7.2 compiles "$dir/new"
# after 0.7 libcamera has no span of its own, but C++20's
cp -r "$dir/new" "$dir/span"
sed -i 's/\bSpan</std::span</g' "$dir"/span/libcamera/*.h
cat > "$dir/span/libcamera/base/span.h" << 'CPP'
#pragma once
#include <span>
namespace libcamera::details {
template <typename T> struct is_span : std::false_type {};
template <typename T, std::size_t N> struct is_span<std::span<T, N>> : std::true_type {};
}
CPP
check compiles-with-the-span-of-c++20 compiles "$dir/span"
# it is the double that is compiled, and the branch for it that is taken
sees() { compiles "$dir/new" -include "$dir/assert.h"; }
printf '#include <libcamera/libcamera.h>\nstatic_assert(LIBCAMERA_VERSION_MINOR == 7 && libcamera::FrameMetadata::FrameStartup > 0);\n' > "$dir/assert.h"
check sees-the-double sees
exit $rc
