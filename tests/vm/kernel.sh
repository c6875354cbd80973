#!/bin/bash
# kernel.sh DIR: Debian's own kernel, unpacked below DIR but never installed; done once per DIR.
# Prints its version.  DIR/modules holds lib/modules/VERSION with an index, DIR/vmlinux what QEMU boots,
# DIR/udev Debian's udevd, without which libcamera sees no camera (containers have none).
# Exit 77 with one line on standard error when this machine cannot have it.
set -uo pipefail
no() { echo "$*" >&2; exit 77; }
dir=$1
[ "$(uname -m)" = x86_64 ] || no "the small virtual machine is written for x86_64, this is $(uname -m)"
mkdir -p "$dir" || no "$dir: cannot be made"
exec 9> "$dir/lock" && flock 9
if [ -s "$dir/version" ] && [ -x "$dir/udev/bin/udevadm" ]; then cat "$dir/version"; exit; fi

# What linux-image-amd64 depends on is the kernel that this release of Debian runs today.
package() { apt-cache depends linux-image-amd64 2>/dev/null | awk '/Depends: linux-image/ { print $2; exit }'; }
p=$(package)
if [ -z "$p" ] && [ "$(id -u)" = 0 ]; then apt-get update -qq >&2; p=$(package); fi
[ -n "$p" ] || no "apt knows no linux-image-amd64: apt-get update (as root) may help"
version=${p#linux-image-}
work=$dir/unpack
rm -rf "$work" "$dir/modules" "$dir/vmlinux" "$dir"/initramfs-*
mkdir -p "$work/deb" "$dir/modules"
chmod 777 "$work/deb" # apt fetches as a user of its own
get() { (cd "$work/deb" && apt-get download -qq "$p" udev libsystemd-shared 2>&1); }
have() { [ "$(find "$work/deb" -name '*.deb' | wc -l)" = 3 ]; }
said=$(get)
if ! have && [ "$(id -u)" = 0 ]; then # the index may be of last month
    apt-get update -qq >&2; said=$(get)
fi
have || no "$p, udev and libsystemd-shared cannot be fetched: $(grep '^E:' <<< "$said" | tail -n 1)"
deb=$(echo "$work"/deb/linux-image-*.deb)
rm -rf "$dir/udev"
for d in "$work"/deb/udev_*.deb "$work"/deb/libsystemd-shared_*.deb; do dpkg -x "$d" "$dir/udev" || no "$d cannot be unpacked"; done
# Two thirds of the modules serve hardware that this machine will never have.
dpkg-deb --fsys-tarfile "$deb" | tar -x -C "$work" --exclude='*/drivers/'{gpu,scsi,infiniband,iio,net/ethernet,net/wireless} \
    --exclude='*/kernel/sound' --exclude='./usr' || no "$deb cannot be unpacked"
mv "$work/lib" "$dir/modules/lib" && depmod -b "$dir/modules" "$version" || no "depmod -b $dir/modules $version failed"

# QEMU enters an ELF image directly (PVH), which saves the emulated decompression: 4 of 7.5 seconds.
# Where the payload lies is in the setup header (Documentation/x86/boot.rst): sectors of set-up code at
# 0x1f1, offset and length of the payload at 0x248 and 0x24c.
"$(command -v /usr/bin/python3 || command -v python3)" - "$work/boot/vmlinuz-$version" "$dir/vmlinux" << 'PY' || cp "$work/boot/vmlinuz-$version" "$dir/vmlinux"
import lzma, struct, subprocess, sys, zlib
image = open(sys.argv[1], 'rb').read()
at, size = struct.unpack_from('<II', image, 0x248)
at += (image[0x1f1] + 1) * 512
payload = image[at:at + size]
if payload[:6] == b'\xfd7zXZ\x00':
    elf = lzma.LZMADecompressor().decompress(payload)
elif payload[:2] == b'\x1f\x8b':
    elf = zlib.decompressobj(31).decompress(payload)
else:
    elf = subprocess.run(['zstd', '-dcq'], input=payload, stdout=subprocess.PIPE).stdout
if elf[:4] != b'\x7fELF':
    sys.exit(1)
open(sys.argv[2], 'wb').write(elf)
PY
rm -rf "$work"
echo "$version" > "$dir/version"
echo "$version"
