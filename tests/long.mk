# Figures, campaigns and what takes hours.
.PHONY: bench fit paper stability stability-card soak ignitions power fuzz fuzz-keep fuzz-coverage

bench: setup-test ## all figures (build/bench/, tests/bench/RESULTS.md); ONLY=REGEX: these;
## AGAINST=DIR: beside another built checkout, in turns
	@$(PARALLEL) built $(BENCH) $(B)/tests/bench/record
	@$(if $(AGAINST),/usr/bin/python3 tests/bench/against.py $(B) $(AGAINST)/build,tests/bench/run.sh $(B) '$(ONLY)')

fit: setup-test ## fit the automatic weight's exponents anew from random cases (CASES=n), beside those in the code
	@$(PARALLEL) $(B)/tests/fit/fit
	@mkdir -p $(B)/fit
	@$(B)/tests/fit/fit $(B)/fit $(CASES)
	@/usr/bin/python3 tests/fit/fit.py $(B)/fit/fit.csv

paper: setup-test ## the paper's figures on a recording like its own, fires held out and a real plume:
## build/paper/report.html and .pdf (goes on where it stopped)
	@$(PARALLEL) built $(B)/tests/bench/record
	@tests/bench/paper.sh $(B)

stability: setup-test ## every hard case: outcome, error against the truth, bound (writes build/stability/)
	@$(PARALLEL) $(B)/tests/stability/stability
	@mkdir -p $(B)/stability
	@$(B)/tests/stability/stability $(B)/stability

stability-card: setup-test ## the same of the default solver on an OpenCL device (CARD=NAME, default pocl's),
## each case compared with the processors
	@$(PARALLEL) $(B)/tests/stability/stability
	@$(B)/tests/stability/stability --card $(or $(CARD),Portable)

soak: setup-test ## eight GigE cameras for SECONDS=n (600): every frame there, what it costs;
## HOURS=n: under faults, slopes of memory and latency, picture (SEED=n BUSY=1 FASTER=n);
## LAPSE=1: what comes after years
	@$(PARALLEL) built $(B)/tests/soak/soak $(B)/tests/unit/test_pub
ifdef LAPSE
	@PYROVOX_BUILD=$(abspath $(B)) LAPSE_S=$(or $(LAPSE_S),120) tests/system/058-lapse.sh
else ifdef HOURS
	@tests/setup.sh $(PACKAGES_BENCH)
	@tests/soak/hours.sh $(B) $(HOURS)
else
	@tests/soak/soak.sh $(B) $(if $(filter command line,$(origin SECONDS)),$(SECONDS),600)
endif

ignitions: setup-test ## N=n (200) random ignitions at 60 Hz under faults and a slow disk: every raw frame around them
## is in a take or named as lost
	@$(PARALLEL) built $(B)/tests/power/slow.so
	@tests/soak/ignitions.sh $(B) $(or $(N),200)

power: setup-test ## power cuts of a take and of a recording of volumes,
## CUTS=n (1000) of each kind of disk, SETS=n (300) long
	@$(PARALLEL) built $(POWER)
	@POWER_CUTS=$(or $(CUTS),1000) POWER_SETS=$(or $(SETS),300) tests/system/048-power-cut.sh

FUZZER := build-clang-address-undefined-fuzzer
fuzz: setup-test ## libFuzzer on every parser, 60 s each (FUZZ_SECONDS=n, ONLY=REGEX);
## inputs stay in build-clang-address-undefined-fuzzer/fuzz
	@$(PARALLEL) CC=clang SAN=address,undefined LIBFUZZER=1 $(patsubst $(B)/%,$(FUZZER)/%,$(FUZZ))
	@tests/fuzz/run.sh $(FUZZER) $(or $(FUZZ_SECONDS),60) '$(ONLY)'
fuzz-keep: ## what make fuzz found, as few inputs as reach as much, into tests/fuzz/found
	@[ -d $(FUZZER)/fuzz ] || { echo "nothing in $(FUZZER)/fuzz: first make fuzz"; exit 1; }
	@tests/fuzz/keep.sh $(FUZZER) '$(ONLY)'
fuzz-coverage: setup-test ## a table: what the inputs in the tree reach of each parser
	@tests/setup.sh llvm
	@$(PARALLEL) -s CC=clang COVERAGE=1 $(patsubst $(B)/%,build-clang-coverage/%,$(FUZZ))
	@tests/fuzz/coverage.sh build-clang-coverage
