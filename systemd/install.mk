# Installation, Debian packages, release.
.PHONY: install install-recon uninstall deb test-deb sbom release

install: all ## install programs, man pages, units and headers under DESTDIR/PREFIX
	@systemd/install.sh "$(B)" "$(DESTDIR)" "$(PREFIX)"
install-recon: ## install the reconstruction as a library alone; needs no camera's packages
	@tests/setup.sh $(PACKAGES_RECON) || true
	@+$(MAKE) --no-print-directory $(RECON)
	@systemd/install-recon.sh "$(B)" "$(DESTDIR)" "$(PREFIX)"
REVISION ?= 1
deb: setup ## Debian packages of what make install installs: build/deb/*.deb, lintian clean (REVISION=n, 1)
	@tests/setup.sh $(PACKAGES_DEB)
	@nice systemd/deb.sh $(B) $(VERSION) $(REVISION) $(PACKAGES_BUILD)
test-deb: deb ## the packages in a clean Debian: what each needs, upgrade, removal, purge;
## upgrade of a daemon that runs; the same bits again
	@tests/setup.sh $(PACKAGES_CHROOT) $(PACKAGES_VM)
	@$(PARALLEL) built
	@tests/deb/test.sh $(B) $(VERSION) $(REVISION) $(PACKAGES_BUILD)
sbom: all ## what each program, library and module is linked with, versions and licences (SPDX 2.3):
## build/pyrovox.spdx.json
	@tests/setup.sh python3
	@rm -rf $(B)/sbom
	@systemd/install.sh $(B) $(CURDIR)/$(B)/sbom /usr
	@/usr/bin/python3 systemd/sbom.py $(B)/sbom $(VERSION) $(B)/pyrovox.spdx.json
release: setup-test ## all that a release wants, checked: NEWS, what the libraries show, test, lint, test-deb;
## its files: build/release/
	@systemd/release.sh $(B) $(VERSION)
uninstall: ## remove what install put there
	@systemd/install.sh --remove "$(DESTDIR)" "$(PREFIX)"
