# Tests.  README.md beside this says what runs in CI, what in `make test-all`, and how long each takes.
.PHONY: test test-sanitize test-asan test-tsan test-vm test-cluster test-view test-blender blender-addon test-all

test: setup-test ## install what is missing, build, run every test; ends with "N passed, N failed, N skipped"
	@$(PARALLEL) built tests-build
	@tests/run.sh $(B)

# Warnings are for the build without sanitizers: with them gcc sees paths that there are not.
test-asan: setup-test
	@$(PARALLEL) SAN=address,undefined WERROR= built tests-run
	@tests/run.sh build-address-undefined --no-system
test-tsan: setup-test
	@$(PARALLEL) SAN=thread WERROR= built tests-run
	@tests/run.sh build-thread --no-system
test-sanitize: ## the unit, check and sim tests under ASan+UBSan and TSan, the fuzz corpora under the former
	@$(MAKE) --no-print-directory test-asan; asan=$$?; $(MAKE) --no-print-directory test-tsan && exit $$asan

test-vm: setup-test ## cameras behind a real kernel's drivers, in a small virtual machine; QUICK=1: three scripts
## (fetches Debian's kernel once)
	@tests/setup.sh $(PACKAGES_VM) || echo "without them most of this cannot run" >&2
	@$(PARALLEL) built $(VM)
	@tests/vm/test.sh $(B) $(if $(QUICK),--quick)

test-cluster: setup-test ## recordings solved by Slurm and by Open MPI on a cluster made for it:
## tasks and nodes die, disks fill, the file server stalls (ONLY=FILTER)
	@tests/setup.sh $(PACKAGES_CLUSTER)
	@$(PARALLEL) built
	@tests/cluster/test.sh $(B) '$(ONLY)'

test-view: setup-test ## the page in a headless browser, driven as a person would; screenshots in build/view/
	@tests/setup.sh $(PACKAGES_VIEW)
	@$(PARALLEL) built
	@tests/view/test.sh $(B)

ADDON := $(wildcard proto/clients/blender/pyrovox_blender/*.py)
blender-addon: ## the Blender add-on as a zip that Blender installs: build/pyrovox-blender.zip
	@tests/setup.sh python3
	@$(MAKE) --no-print-directory $(B)/pyrovox-blender.zip
$(B)/pyrovox-blender.zip: $(ADDON) proto/clients/pyrovox_sub.py
	@rm -rf $@ $(@D)/addon && mkdir -p $(@D)/addon/pyrovox_blender
	$(call say,ZIP)
	@cp -L $(ADDON) $(@D)/addon/pyrovox_blender/
	$(Q)cd $(@D)/addon && python3 -m zipfile -c ../$(@F) pyrovox_blender

test-blender: setup-test ## Blender: the add-on follows a live daemon, pictures agree with pyrovox render;
## screenshots in build/blender/; QUICK=1: one check
	@tests/setup.sh $(PACKAGES_BLENDER)
	@$(PARALLEL) built $(B)/pyrovox-blender.zip
	@tests/blender/test.sh $(B) $(if $(QUICK),a-sequence)

test-all: setup-ci ## every test in its long form, for hours: CI's, the whole virtual machine and Blender, cluster,
## packages, stability, power cuts, fuzzer, soak (HOURS=n, 2)
	@tests/all.sh
