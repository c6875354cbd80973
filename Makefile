# Pyrovox - no recursion, everything built under $(B).  `make help` lists the targets.
# SAN=address,undefined | thread, CC=clang, O=-O0 each build in a folder of their own.
#
#   Makefile            options, sources, libraries, programs
#   daemon/modules.mk   the modules that are loaded on first use
#   systemd/packages.mk Debian packages that each target installs where they are missing
#   systemd/install.mk  install, Debian packages, release
#   tests/programs.mk   test programs: what each is linked with
#   tests/test.mk       tests;  tests/lint.mk: checks of the text;  tests/long.mk: figures and what takes hours
SHELL := /bin/bash
.DEFAULT_GOAL := all
-include config.mk
ifeq ($(origin CC),default)
CC := gcc
endif
Q := $(if $(V),,@)
say = $(if $(V),,@printf '  %-4s %s\n' $(1) $@)
SAN ?=
# What runs under a sanitizer is built with less optimisation and knows lines and no variables: each takes a third from
# the time of its build.
O   ?= $(if $(SAN),-O1,-O2)
comma := ,
VARIANT := $(if $(filter-out gcc cc,$(notdir $(CC))),-$(notdir $(CC)))
VARIANT := $(VARIANT)$(if $(strip $(SAN)),-$(subst $(comma),-,$(strip $(SAN))))
VARIANT := $(VARIANT)$(if $(COVERAGE),-coverage)$(if $(LIBFUZZER),-fuzzer)
VARIANT := $(VARIANT)$(if $(filter-out $(if $(SAN),-O1,-O2),$(O)),$(O))
B := build$(VARIANT)
PREFIX ?= /usr/local
DESTDIR ?=
# The newest entry of NEWS.
VERSION := $(shell awk '/^[0-9]/ { print $$1; exit }' NEWS)
PARALLEL = $(MAKE) --no-print-directory -j$$(nproc)

PKGS := aravis-0.8 libxml-2.0 zlib libzmq yaml-0.1 libcjson libxxhash liblz4 libzstd libsystemd libturbojpeg hdf5 \
  cairo libmicrohttpd gnutls libpng
# The set-up targets must work before the packages are there, so pkg-config is asked lazily, once.
pkg_cflags = $(eval pkg_cflags := $$(shell pkg-config --cflags $(PKGS)))$(pkg_cflags)
pkg_libs   = $(eval pkg_libs := $$(shell pkg-config --libs $(PKGS)))$(pkg_libs)

WARN := -Wall -Wextra -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wvla -Wformat=2 \
  -Wpointer-arith -Wwrite-strings -Wundef
CPPFLAGS += -I. -Idaemon -D_GNU_SOURCE -DPVX_VERSION='"$(VERSION)"' -MMD -MP
# Where it is built is not in it: the same bits anywhere.  (A debugger finds the sources from here.)
ANYWHERE := -ffile-prefix-map='$(CURDIR)=.'
INSTRUMENT := $(if $(SAN),-fsanitize=$(SAN) -fno-omit-frame-pointer) $(if $(LIBFUZZER),-fsanitize=fuzzer-no-link) \
  $(if $(COVERAGE),-fprofile-instr-generate -fcoverage-mapping)
# gcc defines these itself.
SAN_MACROS := $(if $(filter address%,$(SAN)),-D__SANITIZE_ADDRESS__=1)
SAN_MACROS += $(if $(filter thread,$(SAN)),-D__SANITIZE_THREAD__=1)
INSTRUMENT += $(if $(findstring clang,$(CC)),$(SAN_MACROS))
CFLAGS   += -std=c17 $(O) $(if $(SAN),-g1,-g) $(ANYWHERE) $(WARN) -fno-math-errno -ffp-contract=off -fPIC \
  $(if $(WERROR),-Werror) $(INSTRUMENT)
CXXFLAGS += -std=c++17 $(if $(SAN),-O2,$(O)) -g $(ANYWHERE) -Wall -Wextra -fPIC $(if $(WERROR),-Werror)
LDFLAGS  += $(if $(SAN),-fsanitize=$(SAN)) $(if $(COVERAGE),-fprofile-instr-generate)
# A program is tied to what it calls: the daemon has no need of cairo.
LDLIBS    = -Wl,--as-needed $(pkg_libs) -lwslay -lpthread -ldl -lm

# ---- sources ----------------------------------------------------------------------------------
# One archive a room, the last room of tests/rooms.txt first: what a room calls upwards does not link.
ROOMS := $(shell awk '/^[a-z]/ { r = $$1 " " r } END { print r }' tests/rooms.txt)
FILMS_SOURCES := $(addprefix capture/files/film_,pixels.c read.c)
MAINS := daemon/main.c daemon/cli/pyrovox.c daemon/cli/reconstruct/ranks_mpi.c $(FILMS_SOURCES) \
  capture/files/tiff.c proto/clients/example.c \
  recon/view/example.c
ifneq ($(shell $(CC) -dumpmachine 2> /dev/null | cut -d- -f1),x86_64)
FOREIGN := %_avx2.c %_avx512.c
endif
obj = $(patsubst %.c,$(B)/%.o,$(1))
# Folders inside a room belong to it, unless they are rooms themselves.
room_files = $(sort $(wildcard $(1)/*.c $(if $(findstring /,$(1)),$(1)/*/*.c)))
room_others = $(MAINS) $(FOREIGN) $(addsuffix /%,$(filter $(1)/%,$(ROOMS)))
room_obj = $(call obj,$(filter-out $(room_others),$(room_files)))
LIBS := $(foreach r,$(ROOMS),$(B)/$(r)/room.a)
BINS := $(B)/bin/pyrovox $(B)/bin/pyrovoxd
# What libpyrovox-recon.so.1 is made of, and all that it needs: no camera, no socket, no drawing.
RECON_OTHERS := $(addprefix recon/,light spectral exchange board calib check)
RECON_ROOMS := $(filter-out $(RECON_OTHERS),$(filter recon/%,$(ROOMS)))
RECON_LIBS := -lyaml -lxxhash -lpthread -lm
RECON := $(B)/lib/libpyrovox-recon.so.1 $(B)/lib/pyrovox-recon.pc
CLIENT := $(B)/lib/libpyrovox-client.so.1 $(B)/lib/pyrovox-client.pc

include systemd/packages.mk daemon/modules.mk tests/programs.mk

.PHONY: all built help run clean
.DELETE_ON_ERROR:

# What is built hangs on the packages that are there.  So make begins anew when it has installed some.
ifneq ($(filter all install sbom check-layers,$(or $(MAKECMDGOALS),all)),)
BARE := $(shell tests/setup.sh --missing $(PACKAGES_BUILD))
endif
ifdef BARE
all: setup
	@+$(MAKE) --no-print-directory built
else
all: built ## install what is missing, build; then `. build/env` for PATH, man pages, Python
endif
built: $(BINS) $(PLUGINS) $(RECON) $(CLIENT) $(B)/env

help: ## list the targets
	@awk -F':.*## ' '/^[a-z][a-z-]*:.*## / { printf "  make %-14s %s\n", $$1, $$2 } \
	  /^## / { printf "%22s%s\n", "", substr($$0, 4) }' $(filter-out %.d,$(MAKEFILE_LIST))
	@echo
	@echo "  Variables: SAN=address,undefined|thread, CC=clang, O=-O0, WERROR=1, PREFIX, DESTDIR"

# SECONDS is bash's own clock unless it is given on make's command line.
RUN_SECONDS := $(if $(filter command line,$(origin SECONDS)),$(SECONDS),0)
run: setup ## install what is missing, build, and watch 8 simulated GigE cameras become a flame
## (SECONDS=n to stop by itself)
	@$(PARALLEL) -s built
	@exec $(B)/bin/pyrovox demo --seconds $(RUN_SECONDS)

include tests/test.mk tests/lint.mk tests/long.mk systemd/install.mk

clean: ## remove everything that was built
	rm -rf build build-*

# ---- rules ------------------------------------------------------------------------------------
# Where loops are written to be vectorised: at -O2 gcc 12 leaves most of them scalar.
FAST := $(if $(filter -O2,$(O)),-O3)
$(B)/recon/%.o $(B)/proto/pvp_encode.o $(B)/proto/pvp_decode.o: CFLAGS += $(FAST)
$(B)/capture/gevsim/optics.o $(B)/capture/pixel/pixfmt_%.o $(B)/daemon/cli/simcams/ring.o: CFLAGS += $(FAST)
AVX2 := -mavx2 -mfma -mbmi2
$(B)/recon/simd/kernels_avx512.% $(B)/recon/simd/windows_avx512.%: CFLAGS += -mavx512f -mavx512vl $(AVX2)
$(B)/recon/simd/kernels_avx2.% $(B)/recon/simd/windows_avx2.% $(B)/recon/solve/passes/pcg_pass_avx2.%: CFLAGS += $(AVX2)
$(B)/recon/carve/photo_pass_avx2.% $(B)/capture/pixel/pixfmt_avx2.%: CFLAGS += -mavx2
$(B)/capture/%.o $(B)/proto/%.o: CFLAGS += -Wconversion -Wno-sign-conversion

$(B)/%.o: %.c Makefile
	@mkdir -p $(@D)
	$(call say,CC)
	$(Q)$(CC) $(CPPFLAGS) $(CFLAGS) $(pkg_cflags) -c $< -o $@

# The page's files are compiled in.
$(B)/daemon/view/files.o: $(wildcard daemon/view/page/*)
# So are the kernels.
$(B)/recon/opencl/kernels.o: $(wildcard recon/opencl/kernels/*)
# Where Debian's packages have the modules.
$(B)/daemon/base/module.%: CPPFLAGS += -DPVX_MULTIARCH='"$(shell $(CC) -print-multiarch 2>/dev/null)"'
$(addprefix $(B)/,$(addsuffix /%.o,$(RECON_ROOMS) daemon/base)): pkg_cflags =

archive = @rm -f $@ && mkdir -p $(@D) && ar qcs $@ $^
define room
$(B)/$(1)/room.a: $(call room_obj,$(1))
	$$(archive)
endef
$(foreach r,$(ROOMS),$(eval $(call room,$(r))))

# One file for a subscriber: the wire format, and of base what it calls.
CLIENT_FILES := fields pvp_decode pvp_encode pvp_messages pvp_preview pvp_bars attach auth keys door clients/sub
$(B)/lib/libpyrovox-client.so.1: proto/clients/client.map $(CLIENT_FILES:%=$(B)/proto/%.o) $(B)/daemon/base/room.a
$(B)/lib/libpyrovox-client.so.1: SO_LIBS = $(LDLIBS)
RECON_OBJ := $(foreach r,$(RECON_ROOMS),$(call room_obj,$(r)))
$(B)/lib/libpyrovox-recon.so.1: recon/recon.map $(RECON_OBJ) $(B)/daemon/base/room.a
$(B)/lib/libpyrovox-recon.so.1: SO_LIBS = -Wl,--as-needed $(RECON_LIBS)
SO_FLAGS = $(if $(SAN),,-Wl,-z,defs) -Wl,-soname,$(@F),--version-script=$<
$(filter %.so.1,$(CLIENT) $(RECON)):
	@mkdir -p $(@D)
	$(call say,LD)
	$(Q)$(CC) -shared $(CFLAGS) $(LDFLAGS) $(SO_FLAGS) -o $@ $(filter %.o %.a,$^) $(SO_LIBS)
$(B)/lib/pyrovox-client.pc: proto/clients/pyrovox-client.pc.in
$(B)/lib/pyrovox-recon.pc: recon/pyrovox-recon.pc.in
$(B)/lib/%.pc: Makefile
	@mkdir -p $(@D)
	@sed 's|@VERSION@|$(VERSION)|' $(filter %.in,$^) > $@

link = $(CC) $(CFLAGS) $(LDFLAGS) -rdynamic -o $@ $(filter %.o,$^) $(filter %.a,$^) $(LDLIBS)
$(B)/bin/pyrovox: $(B)/daemon/cli/pyrovox.o $(LIBS)
$(B)/bin/pyrovoxd: $(B)/daemon/main.o $(LIBS)
$(BINS):
	@mkdir -p $(@D)
	$(call say,LD)
	$(Q)$(link)

# `. build/env` in a shell is `make install` for this shell alone.
$(B)/env: Makefile $(wildcard daemon/man/*.[1358])
	@for m in $(filter-out Makefile,$^); do \
	  mkdir -p $(B)/man/man$${m##*.} && ln -sf "$(CURDIR)/$$m" $(B)/man/man$${m##*.}/; done
	@printf 'PATH=%q:$$PATH\nMANPATH=%q:$${MANPATH:-}\nPYTHONPATH=%q$${PYTHONPATH:+:$$PYTHONPATH}\n' \
	  "$(CURDIR)/$(B)/bin" "$(CURDIR)/$(B)/man" "$(CURDIR)/proto/clients/python" > $@
	@printf 'export PATH MANPATH PYTHONPATH\n[ -z "$${BASH_VERSION:-}" ] || . %q\n' \
	  "$(CURDIR)/systemd/pyrovox.completion" >> $@

-include $(shell test -d $(B) && find $(B) -type f -name '*.d')
