# Test programs: which there are, and what each is linked with beside the product's rooms.
UNIT  := $(patsubst %.c,$(B)/%,$(sort $(wildcard tests/unit/test_*.c tests/check/test_*.c tests/sim/test_*.c)))
VM    := $(patsubst %.c,$(B)/%,$(sort $(wildcard tests/vm/vm_*.c)))
VM_UVC := $(call obj,$(sort $(wildcard tests/vm/uvc/*.c)))
FUZZ  := $(patsubst %.c,$(B)/%,$(sort $(wildcard tests/fuzz/fuzz_*.c)))
STABILITY := $(call obj,$(filter-out tests/stability/stability.c,$(sort $(wildcard tests/stability/*.c))))
# Stands in front of the real one, and fails on demand.
CL_SHIM := $(B)/tests/opencl/libOpenCL.so.1
POWER := $(B)/tests/power/power $(B)/tests/power/shim.so $(B)/tests/power/slow.so
SOAK := $(call obj,$(sort $(wildcard tests/soak/*.c)))
BENCH := $(patsubst %.c,$(B)/%,$(sort $(wildcard tests/bench/bench_*.c)))

.PHONY: tests-run tests-build
# What run.sh runs.  Under ThreadSanitizer only what has threads of its own; a parser has one.
NOT_UNDER_TSAN := $(addprefix %/,$(shell grep -o '^[a-z0-9_]*' tests/not-under-tsan.txt))
tests-run: $(if $(filter thread,$(SAN)),$(filter-out $(NOT_UNDER_TSAN),$(UNIT)),$(UNIT) $(FUZZ)) $(CL_SHIM)
tests-build: tests-run $(BENCH) $(VM) $(B)/tests/bench/record $(B)/tests/fit/fit $(B)/tests/stability/stability $(POWER)

# gold links in a third of the time, and these are 200 programs.
GOLD := $(if $(shell command -v ld.gold),-fuse-ld=gold)
$(B)/tests/%: LDFLAGS += $(GOLD)
# make keeps their objects.  Those of the rooms are named as prerequisites: a new file is compiled, however old it is.
.SECONDARY: $(addsuffix .o,$(UNIT) $(VM) $(FUZZ) $(BENCH) \
  $(addprefix $(B)/tests/,bench/record fit/fit power/power stability/stability))
$(B)/tests/%: $(B)/tests/%.o $(LIBS)
	$(call say,LD)
	$(Q)$(link)
$(UNIT): $(B)/tests/lib/main.o
STABILITY_PROGRAMS := $(B)/tests/stability/stability $(addprefix $(B)/tests/sim/test_,stability cl_stability)
$(STABILITY_PROGRAMS): $(STABILITY)
$(STABILITY_PROGRAMS) $(B)/tests/unit/test_resolution $(B)/tests/unit/test_perturb: LDLIBS += -llapacke
# It also writes files.
$(B)/tests/unit/test_tiff: LDLIBS += -ltiff
# A V4L2 device that umockdev answers for.
$(B)/tests/sim/test_v4l2_umockdev: $(B)/tests/lib/mock_v4l2.o
$(B)/tests/sim/test_v4l2_umockdev: LDLIBS += $(shell pkg-config --libs umockdev-1.0 2> /dev/null)
$(B)/tests/lib/mock_v4l2.%: CPPFLAGS += $(shell pkg-config --cflags umockdev-1.0 2> /dev/null)
# Pictures of boards with known truth.
BOARD_PROGRAMS := $(addprefix $(B)/tests/,$(addprefix unit/test_,board board_detect board_shot) \
  $(addprefix sim/test_cli_,calibrate calibrate_reels calibrate_modes calibrate_refine))
$(BOARD_PROGRAMS): $(B)/tests/lib/board_picture.o $(B)/tests/lib/board_judge.o
$(B)/tests/soak/soak: $(SOAK)
# Preloaded into what records.
$(B)/tests/power/%.so: $(B)/tests/power/%.o
	$(call say,LD)
	$(Q)$(CC) -shared $(CFLAGS) -o $@ $< -ldl
$(CL_SHIM): $(call obj,$(sort $(wildcard tests/opencl/*.c)))
	$(call say,LD)
	$(Q)$(CC) -shared $(CFLAGS) -Wl,-soname,$(@F) -o $@ $^ -ldl
$(B)/tests/opencl/shim.%: CPPFLAGS += -DPVX_MULTIARCH='"$(shell $(CC) -print-multiarch 2>/dev/null)"'
$(B)/tests/vm/vm_uvccams $(B)/tests/vm/vm_flame $(B)/tests/vm/vm_views: $(VM_UVC)
# Fuzz targets: with LIBFUZZER=1 libFuzzer's main, else a plain main that runs the corpus.
FUZZ_MAIN := $(if $(LIBFUZZER),,$(B)/tests/fuzz/main.o)
$(FUZZ): $(B)/tests/fuzz/fuzz_%: $(B)/tests/fuzz/fuzz_%.o $(FUZZ_MAIN) $(LIBS)
	$(call say,LD)
	$(Q)$(link) $(if $(LIBFUZZER),-fsanitize=fuzzer)
$(B)/tests/fuzz/fuzz_pictures: | $(TIFF)
$(B)/tests/fuzz/fuzz_films: | $(FILMS)
