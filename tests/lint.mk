# Checks of the text: nothing of the product runs.
.PHONY: lint check-layers check-abi abi format-check tidy

lint: setup-lint ## layers, formatting, man pages, shell scripts, conventions, clang-tidy, what the libraries show
	@$(PARALLEL) built
	@$(MAKE) --no-print-directory check-layers format-check
	@tests/lint.sh $(VERSION)
	@$(PARALLEL) -k tidy-files abi-compare
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

.PHONY: tidy-files abi-compare
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
