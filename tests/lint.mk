# Checks of the text: nothing of the product runs.
.PHONY: lint check-layers check-abi abi format-check tidy

lint: setup-lint ## layers, formatting, man pages, shell scripts, conventions, clang-tidy, kernels, libraries
	@$(PARALLEL) built
	@$(MAKE) --no-print-directory check-layers format-check
	@tests/lint.sh $(VERSION)
	@$(PARALLEL) -k tidy-files kernels-compile abi-compare
check-layers: all ## dependencies one way: daemon/base <- {capture, recon, proto} <- daemon; no circles in a room
	@tests/setup.sh git
	@tests/check-layers.sh $(B)
format-check: setup-lint ## clang-format --dry-run over the C sources
	@clang-format --dry-run -Werror $$(git ls-files '*.c' '*.h' '*.cpp')
tidy: setup-lint ## clang-tidy (.clang-tidy) over what changed since it was last clean;
## DEEP=1: looks at more states of a function
	@$(PARALLEL) -k tidy-files
check-abi: setup-lint ## what the libraries show breaks no program that was built with their last release
	@$(PARALLEL) abi-compare
abi: setup-lint ## write down what the libraries show (*.abi): for a release, and before the first whenever it changes
	@$(PARALLEL) built
	@tests/abi.sh $(B) --renew

.PHONY: tidy-files kernels-compile abi-compare
abi-compare: built
	@tests/abi.sh $(B)
# A stamp beside each object, made after it: a header that changed makes both anew.
TIDY_FILES := $(wildcard */*.c */*/*.c */*/*/*.c */*/*/*/*.c)
TIDY_FILES := $(filter-out $(FOREIGN) $(if $(MPI),,%_mpi.c),$(TIDY_FILES))
tidy-files: $(TIDY_FILES:%.c=$(B)/%.$(if $(DEEP),deep,tidy))
# The analyzer looks at 225,000 states of a function, and at tests too.  5,000 of the product's are what CI can afford:
# all else of clang-tidy takes as long.
FEWER = $(if $(filter tests/%,$<),--checks=-clang-analyzer-*, \
  $(addprefix --extra-arg=,-Xclang -analyzer-config -Xclang max-nodes=5000))
# .clang-tidy says what is an error: -Werror would count in the headers of libraries.
define tidy
	$(call say,TIDY)
	$(Q)clang-tidy --quiet $(1) $< -- $(filter-out -MMD -MP -Werror,$(CPPFLAGS) $(CFLAGS)) $(pkg_cflags) \
	  > $@.log 2>&1 || { cat $@.log; exit 1; }
	@touch $@
endef
$(B)/%.tidy: %.c $(B)/%.o .clang-tidy
	$(call tidy,$(FEWER))
$(B)/%.deep: %.c $(B)/%.o .clang-tidy
	$(call tidy,)

# The kernels as the compilers of NVIDIA and AMD cards see them: pocl, on which the tests run, has another.
KERNELS := $(filter-out common,$(basename $(notdir $(wildcard recon/opencl/kernels/*.cl))))
KERNEL_HEADS := $(addprefix recon/opencl/kernels/,shared.h common.cl)
CARDS := nvptx64-nvidia-nvcl amdgcn-amd-amdhsa
kernels-compile: $(foreach t,$(CARDS),$(foreach l,1 4,$(KERNELS:%=$(B)/kernels/$t/$l/%.ok)))
$(B)/kernels/%.ok: $(KERNEL_HEADS) $(wildcard recon/opencl/kernels/*.cl) tests/lint.mk
	@mkdir -p $(@D)
	$(call say,CL)
	$(Q)cat $(KERNEL_HEADS) recon/opencl/kernels/$(notdir $*).cl | clang -x cl -target $(firstword $(subst /, ,$*)) \
	  -DCS=$(notdir $(patsubst %/,%,$(dir $*))) -cl-std=CL1.2 -Xclang -finclude-default-header -nogpulib \
	  -Wall -Werror -Wno-unused-function -O1 -S -o /dev/null -
	@touch $@
