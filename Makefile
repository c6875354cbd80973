# Pyrovox - one Makefile, no recursion, everything built under $(B).  `make help` lists the targets.
# SAN=address,undefined | thread, CC=clang, O=-O0 each build in a folder of their own.
SHELL := /bin/bash
-include config.mk
ifeq ($(origin CC),default)
CC := gcc
endif
Q := $(if $(V),,@)
say = $(if $(V),,@printf '  %-4s %s\n' $(1) $@)
O   ?= -O2
SAN ?=
comma := ,
VARIANT := $(if $(filter-out gcc cc,$(notdir $(CC))),-$(notdir $(CC)))$(if $(strip $(SAN)),-$(subst $(comma),-,$(strip $(SAN))))$(if $(COVERAGE),-coverage)$(if $(filter-out -O2,$(O)),$(O))
B := build$(VARIANT)
PREFIX ?= /usr/local
DESTDIR ?=
# The newest entry of NEWS.
VERSION := $(shell awk '/^[0-9]/ { print $$1; exit }' NEWS)

# ---- packages ---------------------------------------------------------------------------------
# What a bare Debian 12 needs to build, run and test.  tests/setup.sh asks dpkg first, so installed
# packages cost no network, and uses sudo only when not root.
PACKAGES_BUILD := build-essential pkg-config libaravis-dev libusb-1.0-0-dev zlib1g-dev libzmq3-dev \
  libyaml-dev libcjson-dev libxxhash-dev liblz4-dev libzstd-dev libsystemd-dev libopencv-dev \
  libopencv-contrib-dev libcairo2-dev libavformat-dev libavcodec-dev libavutil-dev \
  libturbojpeg0-dev libhdf5-dev libcamera-dev libceres-dev libopenvdb-dev libboost-dev libnanovdb-dev \
  libmicrohttpd-dev libgnutls28-dev libwslay-dev libopenmpi-dev
PACKAGES_TEST := python3 python3-numpy python3-zmq iproute2 clang clang-format clang-tidy \
  libclang-rt-14-dev mandoc aravis-tools-cli util-linux tmux openmpi-bin \
  umockdev libumockdev-dev hdf5-tools python3-h5py python3-xarray python3-mypy python3-pip python3-setuptools python3-wheel nftables liblapacke-dev libopenblas0-serial \
  libopenvdb-tools libnanovdb-tools python3-openvdb python3-vtk9 weasyprint \
  nodejs openssl ffmpeg faketime abigail-tools node-spdx-expression-parse
PACKAGES_BENCH := python3-matplotlib
# make test-view: the page in a browser.
PACKAGES_VIEW := chromium-headless-shell
# make test-blender: the add-on, in the background and on a screen that nobody sees.
PACKAGES_BLENDER := blender python3-openvdb xvfb xauth libgl1-mesa-dri
# make test-vm: a small virtual machine with a real kernel's camera drivers.
PACKAGES_VM := qemu-system-x86 busybox-static kmod cpio libcamera-ipa libcamera-tools v4l-utils

# make test-cluster: a cluster of two nodes, with a file server that can be slow or stall.
PACKAGES_CLUSTER := slurm-wlm munge openmpi-bin bindfs faketime

# make deb, make test-deb: Debian's packages, and a clean Debian to try them in.
PACKAGES_DEB := debhelper dh-python lintian python3
PACKAGES_CHROOT := mmdebstrap systemd

PKGS := aravis-0.8 zlib libzmq yaml-0.1 libcjson libxxhash liblz4 libzstd libsystemd libturbojpeg hdf5 cairo libmicrohttpd gnutls
# The set-up targets must work before the packages are there, so pkg-config is asked lazily, once.
pkg_cflags = $(eval pkg_cflags := $$(shell pkg-config --cflags $(PKGS)))$(pkg_cflags)
pkg_libs   = $(eval pkg_libs := $$(shell pkg-config --libs $(PKGS)))$(pkg_libs)

WARN := -Wall -Wextra -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wvla -Wformat=2 \
  -Wpointer-arith -Wwrite-strings -Wundef
CPPFLAGS += -I. -Idaemon -D_GNU_SOURCE -DPVX_VERSION='"$(VERSION)"' -MMD -MP
# Where it is built is not in it: the same bits anywhere.  (A debugger finds the sources from here.)
ANYWHERE := -g -ffile-prefix-map='$(CURDIR)=.'
CFLAGS   += -std=c17 $(O) $(ANYWHERE) $(WARN) -fno-math-errno -ffp-contract=off -fPIC \
  $(if $(WERROR),-Werror) $(if $(SAN),-fsanitize=$(SAN) -fno-omit-frame-pointer) $(if $(LIBFUZZER),-fsanitize=fuzzer-no-link) $(if $(COVERAGE),-fprofile-instr-generate -fcoverage-mapping)
CXXFLAGS += -std=c++17 $(O) $(ANYWHERE) -Wall -Wextra -fPIC $(if $(WERROR),-Werror)
LDFLAGS  += $(if $(SAN),-fsanitize=$(SAN)) $(if $(COVERAGE),-fprofile-instr-generate)
# A program is tied to what it calls: the daemon has no need of cairo.
LDLIBS    = -Wl,--as-needed $(pkg_libs) -lwslay -lpthread -ldl -lm

# ---- sources ----------------------------------------------------------------------------------
# One archive a room, the last room of tests/rooms.txt first: what a room calls upwards does not link.
ROOMS := $(shell awk '/^[a-z]/ { r = $$1 " " r } END { print r }' tests/rooms.txt)
MAINS := daemon/main.c daemon/cli/pyrovox.c daemon/cli/reconstruct/ranks_mpi.c proto/clients/example.c recon/view/example.c
ifneq ($(shell $(CC) -dumpmachine | cut -d- -f1),x86_64)
FOREIGN := %_avx2.c %_avx512.c
endif
obj = $(patsubst %.c,$(B)/%.o,$(1))
# Folders inside a room belong to it, unless they are rooms themselves.
room_obj = $(call obj,$(filter-out $(MAINS) $(FOREIGN) $(addsuffix /%,$(filter $(1)/%,$(ROOMS))),$(sort $(wildcard $(1)/*.c $(if $(findstring /,$(1)),$(1)/*/*.c)))))
# The fast ways from pixels to floats (capture/pixel/pixfmt_fast.h): once for any processor, once for AVX2.
ifndef FOREIGN
PIX_AVX2 := $(addprefix $(B)/capture/pixel/pixfmt_,$(addsuffix _avx2.o,unpack sums bayer mosaic finish))
endif
LIBS := $(foreach r,$(ROOMS),$(B)/$(r)/room.a)
BINS := $(B)/bin/pyrovox $(B)/bin/pyrovoxd
# What libpyrovox-recon.so.1 is made of, and all that it needs: no camera, no socket, no drawing.
RECON_ROOMS := $(filter-out recon/light recon/board recon/calib recon/check,$(filter recon/%,$(ROOMS)))
RECON_LIBS := -lyaml -lxxhash -lpthread -lm
RECON := $(B)/lib/libpyrovox-recon.so.1 $(B)/lib/pyrovox-recon.pc
CLIENT := $(B)/lib/libpyrovox-client.so.1 $(B)/lib/pyrovox-client.pc
MPI := $(shell pkg-config --exists ompi-c 2>/dev/null && echo 1)
PLUGINS := $(patsubst %,$(B)/lib/pyrovox/pyrovox-%.so,opencv aruco calib $(if $(shell pkg-config --exists libcamera 2>/dev/null && echo 1),libcamera) \
  $(if $(wildcard /usr/include/openvdb/openvdb.h),$(if $(wildcard /usr/include/nanovdb/NanoVDB.h),openvdb)) $(if $(MPI),mpi))

UNIT  := $(patsubst %.c,$(B)/%,$(sort $(wildcard tests/unit/test_*.c tests/check/test_*.c tests/sim/test_*.c)))
VM    := $(patsubst %.c,$(B)/%,$(sort $(wildcard tests/vm/vm_*.c)))
VM_UVC := $(call obj,$(sort $(wildcard tests/vm/uvc/*.c)))
FUZZ  := $(patsubst %.c,$(B)/%,$(sort $(wildcard tests/fuzz/fuzz_*.c)))
STABILITY := $(call obj,$(filter-out tests/stability/stability.c,$(sort $(wildcard tests/stability/*.c))))
POWER := $(B)/tests/power/power $(B)/tests/power/shim.so
SOAK := $(call obj,$(sort $(wildcard tests/soak/*.c)))
# A stamp beside each object, made after it: a header that changed makes both anew.
TIDY := $(patsubst %.c,$(B)/%.tidy,$(filter-out $(if $(PIX_AVX2),,%_avx2.c %_avx512.c) $(if $(MPI),,%_mpi.c),$(wildcard */*.c */*/*.c */*/*/*.c */*/*/*/*.c)))
BENCH := $(patsubst %.c,$(B)/%,$(sort $(wildcard tests/bench/bench_*.c)))

.DEFAULT_GOAL := all
.PHONY: all help setup setup-test run test paper test-vm test-cluster test-view test-blender blender-addon test-sanitize bench fit stability soak power lint check-layers check-abi abi format-check tidy \
  fuzz fuzz-keep fuzz-coverage clean install install-recon uninstall deb test-deb sbom release tests-run tests-build
.DELETE_ON_ERROR:
.SECONDARY:

all: $(BINS) $(PLUGINS) $(RECON) $(CLIENT) ## build build/bin/pyrovox and build/bin/pyrovoxd

help: ## list the targets
	@awk -F':.*## ' '/^[a-z][a-z-]*:.*## /{printf "  make %-16s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
	@echo; echo "  Variables: SECONDS=n (make run), SAN=address,undefined|thread, CC=clang, O=-O0, WERROR=1, PREFIX, DESTDIR"

setup:
	@tests/setup.sh $(PACKAGES_BUILD)
setup-test:
	@tests/setup.sh $(PACKAGES_BUILD) $(PACKAGES_TEST)

# SECONDS is bash's own clock unless it is given on make's command line.
RUN_SECONDS := $(if $(filter command line,$(origin SECONDS)),$(SECONDS),0)
run: setup ## install what is missing, build, and watch 8 simulated GigE cameras become a flame (SECONDS=n to stop by itself)
	@$(MAKE) --no-print-directory -s -j$$(nproc) all
	@exec $(B)/bin/pyrovox demo --seconds $(RUN_SECONDS)

test: setup-test ## install what is missing, build, run every test; ends with "N passed, N failed, N skipped"
	@$(MAKE) --no-print-directory -j$$(nproc) all tests-build
	@tests/run.sh $(B)

test-sanitize: setup-test ## the unit, check and sim tests under ASan+UBSan and TSan, the fuzz corpora under the former
	@$(MAKE) --no-print-directory -j$$(nproc) SAN=address,undefined all tests-run
	@tests/run.sh build-address-undefined --no-system; asan=$$?; \
	$(MAKE) --no-print-directory -j$$(nproc) SAN=thread all tests-run && \
	tests/run.sh build-thread --no-system && exit $$asan

test-vm: setup-test ## cameras behind a real kernel's drivers, in a small virtual machine (fetches Debian's kernel once); QUICK=1: three scripts
	@tests/setup.sh $(PACKAGES_VM) || echo "without them most of this cannot run" >&2
	@$(MAKE) --no-print-directory -j$$(nproc) all $(VM)
	@tests/vm/test.sh $(B) $(if $(QUICK),--quick)

test-cluster: setup-test ## recordings solved by Slurm and by Open MPI on a cluster made for it: tasks and nodes die, disks fill, the file server stalls
	@tests/setup.sh $(PACKAGES_CLUSTER)
	@$(MAKE) --no-print-directory -j$$(nproc) all
	@tests/cluster/test.sh $(B) '$(ONLY)'

test-view: setup-test ## the page in a headless browser, driven as a person would; screenshots in build/view/
	@tests/setup.sh $(PACKAGES_VIEW)
	@$(MAKE) --no-print-directory -j$$(nproc) all
	@tests/view/test.sh $(B)

ADDON := $(wildcard proto/clients/blender/pyrovox_blender/*.py)
blender-addon: $(B)/pyrovox-blender.zip ## the Blender add-on as a zip that Blender installs: build/pyrovox-blender.zip
$(B)/pyrovox-blender.zip: $(ADDON) proto/clients/pyrovox_sub.py
	@rm -rf $@ $(@D)/addon && mkdir -p $(@D)/addon/pyrovox_blender
	$(call say,ZIP)
	@cp -L $(ADDON) $(@D)/addon/pyrovox_blender/
	$(Q)cd $(@D)/addon && python3 -m zipfile -c ../$(@F) pyrovox_blender

test-blender: setup-test ## Blender: the add-on follows a live daemon, pictures agree with pyrovox render; screenshots in build/blender/
	@tests/setup.sh $(PACKAGES_BLENDER)
	@$(MAKE) --no-print-directory -j$$(nproc) all blender-addon
	@tests/blender/test.sh $(B)

tests-run: $(UNIT) $(if $(filter thread,$(SAN)),,$(FUZZ)) # a parser is one thread
tests-build: tests-run $(BENCH) $(VM) $(B)/tests/bench/record $(B)/tests/fit/fit $(B)/tests/stability/stability $(POWER)

bench: setup-test ## all figures (build/bench/, tests/bench/RESULTS.md); ONLY=REGEX: these; AGAINST=DIR: beside another built checkout, in turns
	@tests/setup.sh $(PACKAGES_BENCH)
	@$(MAKE) --no-print-directory -j$$(nproc) all $(BENCH) $(B)/tests/bench/record
	@$(if $(AGAINST),/usr/bin/python3 tests/bench/against.py $(B) $(AGAINST)/build,tests/bench/run.sh $(B) '$(ONLY)')

fit: setup-test ## fit the automatic weight's exponents anew from random cases (CASES=n), beside those in the code
	@$(MAKE) --no-print-directory -j$$(nproc) $(B)/tests/fit/fit
	@mkdir -p $(B)/fit
	@$(B)/tests/fit/fit $(B)/fit $(CASES)
	@/usr/bin/python3 tests/fit/fit.py $(B)/fit/fit.csv

paper: setup-test ## the paper's figures on a recording like its own, fires held out and a real plume: build/paper/report.html and .pdf (goes on where it stopped)
	@$(MAKE) --no-print-directory -j$$(nproc) all $(B)/tests/bench/record
	@tests/bench/paper.sh $(B)

stability: setup-test ## every hard case: outcome, error against the truth, bound (writes build/stability/)
	@$(MAKE) --no-print-directory -j$$(nproc) $(B)/tests/stability/stability
	@mkdir -p $(B)/stability
	@$(B)/tests/stability/stability $(B)/stability

soak: setup-test ## eight GigE cameras: HOURS=n under faults, slopes of memory and latency, picture (SEED=n BUSY=1); LAPSE=1: what comes after years; else SECONDS=n (600): every frame there, what it costs
	@$(MAKE) --no-print-directory -j$$(nproc) all $(B)/tests/soak/soak $(B)/tests/unit/test_pub
ifdef LAPSE
	@PYROVOX_BUILD=$(abspath $(B)) LAPSE_S=$(or $(LAPSE_S),120) tests/system/058-lapse.sh
else ifdef HOURS
	@tests/setup.sh $(PACKAGES_BENCH)
	@tests/soak/hours.sh $(B) $(HOURS)
else
	@tests/soak/soak.sh $(B) $(if $(filter command line,$(origin SECONDS)),$(SECONDS),600)
endif

power: setup-test ## power cuts of a take and of a recording of volumes, CUTS=n (1000) of each kind of disk, SETS=n (300) long
	@$(MAKE) --no-print-directory -j$$(nproc) all $(POWER)
	@POWER_CUTS=$(or $(CUTS),1000) POWER_SETS=$(or $(SETS),300) tests/system/048-power-cut.sh

fuzz: setup-test ## libFuzzer on every parser, 60 s each (FUZZ_SECONDS=n, ONLY=REGEX); inputs stay in build-clang-address-undefined/fuzz
	@$(MAKE) --no-print-directory -j$$(nproc) CC=clang SAN=address,undefined LIBFUZZER=1 tests-build
	@tests/fuzz/run.sh build-clang-address-undefined $(or $(FUZZ_SECONDS),60) '$(ONLY)'
fuzz-keep: ## what make fuzz found, as few inputs as reach as much, into tests/fuzz/found
	@tests/fuzz/keep.sh build-clang-address-undefined '$(ONLY)'
fuzz-coverage: ## a table: what the inputs in the tree reach of each parser
	@tests/setup.sh llvm clang
	@$(MAKE) --no-print-directory -s -j$$(nproc) CC=clang COVERAGE=1 $(patsubst $(B)/%,build-clang-coverage/%,$(FUZZ))
	@tests/fuzz/coverage.sh build-clang-coverage

lint: check-layers format-check ## layers, formatting, man pages, shell scripts, conventions, clang-tidy, what the libraries show
	@tests/lint.sh $(VERSION)
	@$(MAKE) --no-print-directory -k -j$$(nproc) tidy check-abi
check-layers: all ## dependencies one way: daemon/base <- {capture, recon, proto} <- daemon; no circles in a room
	@tests/check-layers.sh $(B)
tidy: $(TIDY) ## clang-tidy (.clang-tidy) over what changed since it was last clean
check-abi: all ## what the libraries show breaks no program that was built with their last release
	@tests/abi.sh $(B)
abi: all ## write down what the libraries show (*.abi): for a release, and before the first whenever it changes
	@tests/abi.sh $(B) --renew
format-check: ## clang-format --dry-run over the C sources
	@clang-format --dry-run -Werror $$(git ls-files '*.c' '*.h' '*.cpp')

clean: ## remove everything that was built
	rm -rf build build-*

# ---- rules ------------------------------------------------------------------------------------
# Four lanes at a time in plain C: at -O2 gcc 12 leaves most of these loops scalar.
$(B)/recon/%.o: CFLAGS += -O3
$(B)/proto/pvp_encode.o $(B)/proto/pvp_decode.o: CFLAGS += $(if $(filter -O2,$(O)),-O3)
$(B)/recon/simd/kernels_avx512.% $(B)/recon/simd/windows_avx512.%: CFLAGS += -mavx512f -mavx512vl -mavx2 -mfma -mbmi2
$(B)/recon/carve/photo_pass_avx2.%: CFLAGS += -mavx2
$(B)/recon/simd/kernels_avx2.% $(B)/recon/simd/windows_avx2.% $(B)/recon/solve/passes/pcg_pass_avx2.%: CFLAGS += -mavx2 -mfma -mbmi2
# Plain loops written to be vectorised.
$(B)/recon/view/flame.o $(B)/capture/gevsim/optics.o $(B)/daemon/cli/simcams/ring.o: CFLAGS += $(if $(filter -O2,$(O)),-O3)
$(B)/capture/pixel/pixfmt_%.o: CFLAGS += $(if $(filter -O2,$(O)),-O3)
$(B)/capture/%.o $(B)/proto/%.o: CFLAGS += -Wconversion -Wno-sign-conversion

$(B)/%.o: %.c Makefile
	@mkdir -p $(@D)
	$(call say,CC)
	$(Q)$(CC) $(CPPFLAGS) $(CFLAGS) $(pkg_cflags) -c $< -o $@

$(B)/%.tidy: %.c $(B)/%.o .clang-tidy
	$(call say,TIDY)
	$(Q)clang-tidy --quiet $< -- $(filter-out -MMD -MP,$(CPPFLAGS)) $(CFLAGS) $(pkg_cflags) 2> $@.log || { cat $@.log; exit 1; }
	@touch $@

$(PIX_AVX2): $(B)/%_avx2.o: %.c Makefile
	@mkdir -p $(@D)
	$(call say,CC)
	$(Q)$(CC) $(CPPFLAGS) -DCAP_PIX_AVX2 $(CFLAGS) -mavx2 $(pkg_cflags) -c $< -o $@

# The page's files are compiled in.
$(B)/daemon/view/files.o: $(wildcard daemon/view/page/*)

archive = @rm -f $@ && mkdir -p $(@D) && ar qcs $@ $^
define room
$(B)/$(1)/room.a: $(call room_obj,$(1))
	$$(archive)
endef
$(foreach r,$(ROOMS),$(eval $(call room,$(r))))
$(B)/capture/pixel/room.a: $(PIX_AVX2)

# One file for a subscriber: the wire format, and of base what it calls.
$(B)/lib/libpyrovox-client.so.1: proto/clients/client.map $(call obj,proto/fields.c proto/pvp_decode.c proto/pvp_encode.c proto/pvp_messages.c proto/pvp_preview.c proto/auth.c proto/keys.c proto/door.c proto/clients/sub.c) $(B)/daemon/base/room.a
	@mkdir -p $(@D)
	$(call say,LD)
	$(Q)$(CC) -shared $(CFLAGS) $(LDFLAGS) $(if $(SAN),,-Wl,-z,defs) -Wl,-soname,$(@F),--version-script=$< -o $@ $(filter %.o %.a,$^) $(LDLIBS)
$(B)/lib/libpyrovox-recon.so.1: recon/recon.map $(foreach r,$(RECON_ROOMS),$(call room_obj,$(r))) $(B)/daemon/base/room.a
	@mkdir -p $(@D)
	$(call say,LD)
	$(Q)$(CC) -shared $(CFLAGS) $(LDFLAGS) $(if $(SAN),,-Wl,-z,defs) -Wl,-soname,$(@F),--version-script=$< -o $@ $(filter %.o %.a,$^) -Wl,--as-needed $(RECON_LIBS)
$(addprefix $(B)/,$(addsuffix /%.o,$(RECON_ROOMS) daemon/base)): pkg_cflags =
$(B)/lib/pyrovox-client.pc: proto/clients/pyrovox-client.pc.in
$(B)/lib/pyrovox-recon.pc: recon/pyrovox-recon.pc.in
$(B)/lib/%.pc: Makefile
	@mkdir -p $(@D)
	@sed 's|@VERSION@|$(VERSION)|' $(filter %.in,$^) > $@

# The modules are C++ and loaded on first use; each is its own shared object.
module = $(CXX) -I. -Idaemon -DPVX_VERSION='"$(VERSION)"' $(1) $(CXXFLAGS) -shared $(filter-out -fsanitize=%,$(LDFLAGS)) -o $@ $(filter %.cpp,$^)
$(PLUGINS): Makefile
# Where fuzz targets see into it, it is instrumented as they are: by clang, too, whose run-time library is theirs.
ifneq ($(LIBFUZZER)$(COVERAGE),)
$(B)/lib/pyrovox/pyrovox-opencv.so: CXX := clang++
$(B)/lib/pyrovox/pyrovox-opencv.so: CXXFLAGS += $(if $(SAN),-fsanitize=$(SAN) -fno-sanitize=vptr) $(if $(LIBFUZZER),-fsanitize=fuzzer-no-link) $(if $(COVERAGE),-fprofile-instr-generate -fcoverage-mapping)
endif
$(B)/lib/pyrovox/pyrovox-opencv.so: capture/files/opencv_shim.cpp capture/files/apng_shim.cpp capture/files/opencv_shim.h
	@mkdir -p $(@D)
	$(call say,CXX)
	$(Q)$(call module,-I/usr/include/opencv4) -lopencv_core -lopencv_imgcodecs -lopencv_imgproc -lopencv_videoio -lavformat -lavcodec -lavutil

$(B)/lib/pyrovox/pyrovox-aruco.so: recon/board/aruco_shim.cpp recon/board/aruco_shim.h
	@mkdir -p $(@D)
	$(call say,CXX)
	$(Q)$(call module,-I/usr/include/opencv4) -lopencv_aruco -lopencv_calib3d -lopencv_imgproc -lopencv_core

# Least squares by Ceres, planes by OpenCV: one C++ file, since the headers of both are most of its cost.
$(B)/lib/pyrovox/pyrovox-calib.so: recon/calib/shim.cpp recon/calib/shim.h
	@mkdir -p $(@D)
	$(call say,CXX)
	$(Q)$(call module,-I/usr/include/opencv4 -isystem /usr/include/eigen3) -lceres -lglog -lopencv_core -lopencv_calib3d

$(B)/lib/pyrovox/pyrovox-libcamera.so: capture/libcamera/shim.cpp capture/libcamera/shim.h
	@mkdir -p $(@D)
	$(call say,CXX)
	$(Q)$(call module,$$(pkg-config --cflags libcamera)) -std=c++20 $$(pkg-config --libs libcamera)

# In C, since MPI has a C API.
$(B)/daemon/cli/reconstruct/ranks_mpi.%: pkg_cflags = $(shell pkg-config --cflags ompi-c)
$(B)/lib/pyrovox/pyrovox-mpi.so: $(B)/daemon/cli/reconstruct/ranks_mpi.o
	@mkdir -p $(@D)
	$(call say,LD)
	$(Q)$(CC) -shared $(CFLAGS) $(filter-out -fsanitize=%,$(LDFLAGS)) -o $@ $(filter %.o,$^) $$(pkg-config --libs ompi-c)

# Its headers warn; most of the library's own cost is theirs too.
$(B)/lib/pyrovox/pyrovox-openvdb.so: daemon/volumes/openvdb_shim.cpp daemon/volumes/nanovdb_grids.cpp daemon/volumes/openvdb_shim.h daemon/volumes/nanovdb_grids.h
	@mkdir -p $(@D)
	$(call say,CXX)
	$(Q)$(call module) -lopenvdb -ltbb -lImath-3_1 -Wl,--gc-sections -s

link = $(CC) $(CFLAGS) $(LDFLAGS) -rdynamic -o $@ $(filter %.o,$^) $(filter %.a,$^) $(LDLIBS)
$(B)/bin/pyrovox: $(B)/daemon/cli/pyrovox.o $(LIBS)
$(B)/bin/pyrovoxd: $(B)/daemon/main.o $(LIBS)
$(BINS):
	@mkdir -p $(@D)
	$(call say,LD)
	$(Q)$(link)

$(B)/tests/%: $(B)/tests/%.o $(LIBS)
	$(call say,LD)
	$(Q)$(link)
$(UNIT): $(B)/tests/lib/main.o
$(B)/tests/stability/stability $(B)/tests/sim/test_stability: $(STABILITY)
$(B)/tests/stability/stability $(B)/tests/sim/test_stability $(B)/tests/unit/test_resolution: LDLIBS += -llapacke
# libaravis' fake camera, the peer that is not of our own making.
$(B)/tests/unit/test_simgv $(B)/tests/sim/test_aravis_loopback: $(B)/tests/lib/simgv.o $(B)/tests/lib/simgv_poll.o
# A V4L2 device that umockdev answers for.
$(B)/tests/sim/test_v4l2_umockdev: $(B)/tests/lib/mock_v4l2.o
$(B)/tests/sim/test_v4l2_umockdev: LDLIBS += $(shell pkg-config --libs umockdev-1.0)
$(B)/tests/lib/mock_v4l2.%: CPPFLAGS += $(shell pkg-config --cflags umockdev-1.0)
# Pictures of boards with known truth.
$(addprefix $(B)/tests/unit/,test_board test_board_detect test_board_shot) $(addprefix $(B)/tests/sim/test_cli_,calibrate calibrate_reels calibrate_modes calibrate_refine): $(B)/tests/lib/board_picture.o $(B)/tests/lib/board_judge.o

$(B)/tests/soak/soak: $(SOAK)
# Preloaded into what records.
$(B)/tests/power/shim.so: $(B)/tests/power/shim.o
	$(call say,LD)
	$(Q)$(CC) -shared $(CFLAGS) -o $@ $< -ldl
$(B)/tests/vm/vm_uvccams $(B)/tests/vm/vm_flame $(B)/tests/vm/vm_views $(B)/tests/unit/test_usbip: $(VM_UVC)
# Fuzz targets: with LIBFUZZER=1 libFuzzer's main, else a plain main that runs the corpus.
$(FUZZ): $(B)/tests/fuzz/fuzz_%: $(B)/tests/fuzz/fuzz_%.o $(if $(LIBFUZZER),,$(B)/tests/fuzz/main.o) $(LIBS)
	$(call say,LD)
	$(Q)$(link) $(if $(LIBFUZZER),-fsanitize=fuzzer)
$(B)/tests/fuzz/fuzz_pictures: | $(B)/lib/pyrovox/pyrovox-opencv.so
# Where Debian's packages have the modules.
$(B)/daemon/base/module.%: CPPFLAGS += -DPVX_MULTIARCH='"$(shell $(CC) -print-multiarch 2>/dev/null)"'
# The allocation test interposes malloc in the executable.
-include $(shell test -d $(B) && find $(B) -type f -name '*.d')

install: all ## install programs, man pages, units and headers under DESTDIR/PREFIX
	@systemd/install.sh "$(B)" "$(DESTDIR)" "$(PREFIX)"
install-recon: $(RECON) ## install the reconstruction as a library alone; needs no camera's packages
	@systemd/install-recon.sh "$(B)" "$(DESTDIR)" "$(PREFIX)"
REVISION ?= 1
deb: setup ## Debian packages of what make install installs: build/deb/*.deb, lintian clean (REVISION=n, 1)
	@tests/setup.sh $(PACKAGES_DEB)
	@nice systemd/deb.sh $(B) $(VERSION) $(REVISION) $(PACKAGES_BUILD)
test-deb: deb ## the packages in a clean Debian: what each needs, upgrade, removal, purge; upgrade of a daemon that runs; the same bits again
	@tests/setup.sh $(PACKAGES_CHROOT) $(PACKAGES_VM)
	@$(MAKE) --no-print-directory -j$$(nproc) all
	@tests/deb/test.sh $(B) $(VERSION) $(REVISION) $(PACKAGES_BUILD)
sbom: all ## what each program, library and module is linked with, versions and licences (SPDX 2.3): build/pyrovox.spdx.json
	@rm -rf $(B)/sbom
	@systemd/install.sh $(B) $(CURDIR)/$(B)/sbom /usr
	@/usr/bin/python3 systemd/sbom.py $(B)/sbom $(VERSION) $(B)/pyrovox.spdx.json
release: setup-test ## all that a release wants, checked: NEWS, what the libraries show, test, lint, test-deb; its files: build/release/
	@systemd/release.sh $(B) $(VERSION)
uninstall: ## remove what install put there
	@systemd/install.sh --remove "$(DESTDIR)" "$(PREFIX)"
