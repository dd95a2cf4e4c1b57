# Each target is a function of make.py, which runs where there is no make, too: `python make.py demo`.
PYTHON ?= python3

.PHONY: setup demo test test-rare test-all test-lowest quick check lint bench pictures docs release licences lock clean

setup demo test test-rare test-lowest quick lint bench pictures docs release licences lock clean:
	@$(PYTHON) make.py $@

test-all: test test-rare

check: test lint
