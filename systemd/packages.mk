# What a bare Debian 12 needs.  tests/setup.sh asks dpkg first, so that installed packages cost no network.  It uses
# sudo only where it is not root.
PACKAGES_RECON := build-essential pkg-config libyaml-dev libxxhash-dev opencl-c-headers
PACKAGES_BUILD := $(PACKAGES_RECON) libaravis-dev libxml2-dev libusb-1.0-0-dev zlib1g-dev libzmq3-dev \
  libcjson-dev liblz4-dev libzstd-dev libsystemd-dev libopencv-dev \
  libopencv-contrib-dev libcairo2-dev libavformat-dev libavcodec-dev libavutil-dev \
  libturbojpeg0-dev libtiff-dev libpng-dev libhdf5-dev libcamera-dev libceres-dev libopenvdb-dev \
  libboost-dev libnanovdb-dev libmicrohttpd-dev libgnutls28-dev libwslay-dev libopenmpi-dev
# make lint
PACKAGES_LINT := git clang clang-format clang-tidy mandoc abigail-tools python3 \
  libumockdev-dev liblapacke-dev libopenblas0-serial
PACKAGES_TEST := $(PACKAGES_LINT) python3-numpy python3-zmq iproute2 libclang-rt-14-dev aravis-tools-cli util-linux \
  mount procps systemd tmux openmpi-bin umockdev hdf5-tools netcdf-bin python3-h5py python3-xarray python3-mypy \
  python3-pip python3-setuptools python3-wheel nftables libopenvdb-tools libnanovdb-tools python3-openvdb \
  python3-opencv colmap camera-calibration-parsers-tools python3-toml \
  python3-vtk9 weasyprint nodejs openssl ffmpeg faketime node-spdx-expression-parse \
  ocl-icd-libopencl1 pocl-opencl-icd oclgrind
PACKAGES_BENCH := python3-matplotlib
# make test-view: the page in a browser.
PACKAGES_VIEW := chromium-headless-shell
# make test-blender: the add-on, in the background and on a virtual screen.
PACKAGES_BLENDER := blender python3-openvdb xvfb xauth libgl1-mesa-dri
# make test-vm: a small virtual machine with a real kernel's camera drivers.
PACKAGES_VM := qemu-system-x86 busybox-static kmod cpio libcamera-ipa libcamera-tools v4l-utils
# make test-cluster: a cluster of two nodes, with a file server that can be slow or stall.
PACKAGES_CLUSTER := slurm-wlm munge openmpi-bin bindfs faketime
# make deb, make test-deb: Debian's packages, and a clean Debian to try them in.
PACKAGES_DEB := debhelper dh-python lintian python3
PACKAGES_CHROOT := mmdebstrap systemd

.PHONY: setup setup-lint setup-test setup-ci
# Where a package is missing that cannot be installed, the compiler says what it misses.
setup:
	@tests/setup.sh $(PACKAGES_BUILD) || true
setup-lint:
	@tests/setup.sh $(PACKAGES_BUILD) $(PACKAGES_LINT)
setup-test:
	@tests/setup.sh $(PACKAGES_BUILD) $(PACKAGES_TEST)
setup-ci:
	@tests/setup.sh $(PACKAGES_BUILD) $(PACKAGES_TEST) $(PACKAGES_VIEW) $(PACKAGES_BLENDER) $(PACKAGES_VM)
