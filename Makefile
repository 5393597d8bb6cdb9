# make demo: one acquisition on the simulated rig, from the start request to the recovered material.
# make test: every check and test of the workspace; the first that fails ends the run.
# make browser: the page in Chromium (minutes; with network the first time); with PICTURES=docs its pictures there are taken anew.
# make exports: what `rigd export` writes, read by the programs it is for (a minute or two; with network the first time).
# make guide: every command of docs/guide, run and compared (minutes, not part of make test); make guide-pictures takes its pictures anew.
# make report-check: session reports read by other programs (html5lib, qpdf, pypdf; minutes, with network the first time).
# make deb: a Debian package in target/deb; make deb-check installs, runs and removes it in a fresh Debian (as root, with network, minutes).

SHARED := $(or $(RIGD_SHARED),../shared)
TARGET := $(or $(CARGO_TARGET_DIR),target)
RIGD   := $(TARGET)/release/rigd
CARGO  := cargo --locked
heading = @printf '\n== %s\n'

.PHONY: demo test packages photographs format lint units features documentation no-std release simulated studies oracle golden-frames \
	firmware firmware-cross unit-file openapi contract browser exports guide guide-pictures report-check deb deb-check
.NOTPARALLEL:

demo:
	cargo run --release -- demo

test: packages photographs format lint units features documentation no-std golden-frames firmware oracle release simulated studies \
		unit-file contract openapi
	$(heading) 'all checks passed'

packages:
	$(heading) 'Debian packages'
	@missing=; \
	command -v cc >/dev/null || missing="$$missing gcc libc6-dev"; \
	command -v cmake >/dev/null || missing="$$missing cmake"; \
	command -v nasm >/dev/null || missing="$$missing nasm"; \
	command -v openssl >/dev/null || missing="$$missing openssl"; \
	pkg-config --exists libgphoto2 2>/dev/null || missing="$$missing pkg-config libgphoto2-dev"; \
	ls /usr/lib/llvm-*/lib/libclang.so* /usr/lib/llvm-*/lib/clang/*/include/stdarg.h >/dev/null 2>&1 || \
		missing="$$missing libclang-dev"; \
	command -v gphoto2 >/dev/null || missing="$$missing gphoto2"; \
	python3 -c 'import ensurepip, venv' 2>/dev/null || missing="$$missing python3 python3-venv"; \
	if [ -z "$$missing" ]; then echo 'all there'; exit 0; fi; \
	as_root=$$([ "$$(id -u)" = 0 ] || echo sudo); \
	echo "installing$$missing"; \
	$$as_root apt-get update -qq && \
	$$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $$missing

photographs:
	$(heading) 'photographs for the tests'
	@if [ -d '$(SHARED)/data' ]; then echo 'in $(SHARED)/data'; \
	else echo 'SKIPPED: $(SHARED)/data is not there (set RIGD_SHARED): the tests on real photographs do nothing'; fi

format:
	$(heading) 'format'
	@cargo fmt --all --check && cargo fmt --manifest-path fuzz/Cargo.toml --check

# With every feature, so that what only a build with them has is looked at as well.
lint:
	$(heading) 'lints'
	@$(CARGO) clippy --quiet --workspace --all-targets --features rigd/raw,rigd/libjpeg-turbo,rigd/tls -- -D warnings

WAITING := acquisition daemon_night fault_matrix faults shooting usb usb_driver

# The camera worker's tests wait for most of their time, so they run beside the rest.
units:
	$(heading) 'tests of the workspace'
	@$(CARGO) test --quiet --workspace --no-run
	@told=$$(mktemp) && trap 'rm -f "$$told"' EXIT && \
		{ $(CARGO) test --quiet --workspace --bin camera-worker $(WAITING:%=--test %) >"$$told" 2>&1 & waiting=$$!; \
		$(CARGO) test --quiet --workspace --exclude camera-worker; rest=$$?; \
		wait $$waiting; waiting=$$?; cat "$$told"; [ $$rest = 0 ] && [ $$waiting = 0 ]; }

features:
	$(heading) 'tests of the features raw (Canon raw files), libjpeg-turbo and tls'
	@$(CARGO) test --quiet --features raw,libjpeg-turbo,tls --test raw --test raw_folder --test fuzz_readers --test tls --test notify_daemon
	@$(CARGO) test --quiet --features raw,libjpeg-turbo,tls --lib pipeline::decode

documentation:
	$(heading) 'documentation of the code'
	@RUSTDOCFLAGS='-D warnings' $(CARGO) doc --quiet --no-deps --workspace

no-std:
	$(heading) 'firmware-protocol needs no std'
	@$(CARGO) build --quiet --package firmware-protocol --lib
	@rustc --edition 2024 --crate-type staticlib -C panic=abort -L dependency='$(TARGET)/debug/deps' \
		--extern firmware_protocol='$(TARGET)/debug/libfirmware_protocol.rlib' \
		-o '$(TARGET)/no_std_proof.a' firmware-protocol/no_std/proof.rs

golden-frames:
	$(heading) 'golden frames, packed by hand'
	@python3 firmware-protocol/golden/check.py

# The cross-build fetches a compiler, so it is not made here before somebody has asked for it once.
firmware:
	$(heading) 'firmware: motion and protocol on a simulated arm'
	@cargo fmt --all --manifest-path firmware/Cargo.toml --check
	@$(CARGO) clippy --quiet --manifest-path firmware/Cargo.toml --target-dir '$(TARGET)/firmware' --all-targets -- -D warnings
	@$(CARGO) test --quiet --manifest-path firmware/Cargo.toml --target-dir '$(TARGET)/firmware'
	@if [ -e '$(TARGET)/firmware-cross/arm-pico.uf2' ]; then $(MAKE) --no-print-directory firmware-cross; \
	else echo 'SKIPPED: cross-build and QEMU, until make firmware-cross has fetched what they need'; fi

firmware-cross:
	$(heading) 'firmware for the Pico, and in QEMU'
	@firmware/cross-build && firmware/qemu-check

oracle: $(TARGET)/oracle/installed
	$(heading) 'the fit and the BRDF models against independent scripts'
	@'$(TARGET)/oracle/bin/python' tests/oracle/zheng2008.py --check
	@'$(TARGET)/oracle/bin/python' tests/oracle/brdf.py --check
	@'$(TARGET)/oracle/bin/python' tests/oracle/varpro.py --check

$(TARGET)/oracle/installed: tests/oracle/requirements.txt
	@mkdir -p '$(TARGET)' && python3 -m venv '$(TARGET)/oracle'
	@'$(TARGET)/oracle/bin/pip' install --quiet --disable-pip-version-check -r tests/oracle/requirements.txt
	@touch '$@'

release:
	$(heading) 'release build'
	@$(CARGO) build --quiet --release

simulated: release
	$(heading) 'demo: two simulated balls, geometry known and calibrated'
	@data=$$(mktemp -d) && trap 'rm -rf "$$data"' EXIT && '$(RIGD)' demo --data "$$data" && '$(RIGD)' demo --calibrate --data "$$data"

studies: release
	$(heading) 'studies, short forms'
	@out=$$(mktemp -d) && trap 'rm -rf "$$out"' EXIT && '$(RIGD)' study speed --out "$$out" && \
		'$(RIGD)' study stability --out "$$out" && wc -l "$$out"/*.csv

unit-file: release
	$(heading) 'systemd unit'
	@systemd/check '$(RIGD)'

contract: release
	$(heading) 'surfaces that stay'
	@if [ -f '$(SHARED)/check_contract.py' ]; then python3 '$(SHARED)/check_contract.py' '$(RIGD)'; \
	else echo 'SKIPPED: $(SHARED)/check_contract.py is not there'; fi

openapi: release
	$(heading) 'fuzz of the REST surface'
	@tests/schemathesis.sh '$(RIGD)' 60

PICTURES := $(TARGET)/browser-pictures

browser: release $(TARGET)/browser/installed
	$(heading) 'the page in a browser'
	@'$(TARGET)/browser/bin/python' tests/browser/page.py '$(RIGD)' '$(PICTURES)'
	@'$(TARGET)/browser/bin/python' tests/browser/viewer.py '$(RIGD)' '$(PICTURES)'

$(TARGET)/browser/installed: tests/browser/requirements.txt
	@mkdir -p '$(TARGET)' && python3 -m venv '$(TARGET)/browser'
	@'$(TARGET)/browser/bin/pip' install --quiet --disable-pip-version-check -r tests/browser/requirements.txt
	@touch '$@'

exports: release $(TARGET)/exports/installed
	$(heading) 'exports, read by others'
	@for reader in exr mitsuba_scene pbrt merl materialx usd gltf; do \
		NODE_TOOLS='$(abspath $(TARGET)/exports)' '$(TARGET)/exports/bin/python' tests/exports/$$reader.py '$(RIGD)' || exit 1; done
	@data=$$(mktemp -d) && trap 'rm -rf "$$data"' EXIT && '$(RIGD)' demo --calibrate --data "$$data" >/dev/null && \
		for result in "$$data"/calibrated/sessions/*/result; do for reader in rti session_crate; do \
		'$(TARGET)/exports/bin/python' tests/exports/$$reader.py '$(RIGD)' "$$result" || exit 1; done; done

$(TARGET)/exports/installed: tests/exports/requirements.txt
	@mkdir -p '$(TARGET)' && python3 -m venv '$(TARGET)/exports'
	@'$(TARGET)/exports/bin/pip' install --quiet --disable-pip-version-check -r tests/exports/requirements.txt
	@npm install --silent --no-fund --no-audit --prefix '$(TARGET)/exports' gltf-validator@2.0.0-dev.3.10
	@touch '$@'

guide: release
	$(heading) 'the guide'
	@python3 tests/guide.py '$(RIGD)'

guide-pictures: release $(TARGET)/browser/installed
	$(heading) 'pictures of the guide'
	@'$(TARGET)/browser/bin/python' tests/browser/guide.py '$(RIGD)' docs

report-check: release $(TARGET)/report/installed
	$(heading) 'session reports, read by other programs'
	@'$(TARGET)/report/bin/python' tests/report/check.py '$(RIGD)'

$(TARGET)/report/installed: tests/report/requirements.txt
	@mkdir -p '$(TARGET)' && python3 -m venv '$(TARGET)/report'
	@'$(TARGET)/report/bin/pip' install --quiet --disable-pip-version-check -r tests/report/requirements.txt
	@touch '$@'

deb:
	$(heading) 'Debian package'
	@$(CARGO) build --quiet --release --package camera-worker
	@$(CARGO) build --quiet --release --features tls
	@packaging/build-deb '$(TARGET)/release' '$(TARGET)/deb'

deb-check: deb
	$(heading) 'Debian package in a fresh Debian'
	@packaging/check-deb "$$(ls -t '$(TARGET)'/deb/rigd_*.deb | head -n 1)"
