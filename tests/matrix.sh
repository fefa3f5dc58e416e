#!/usr/bin/env bash
# Runs the tests under each Python in VERSIONS, with the newest JAX that it can have, each in an environment of its own.
# Where uv is, it gets a Python that is missing; else a missing one is named and left out. Arguments go to pytest.
# EXTRA=test leaves out PyTorch, which is gigabytes of CUDA where no CPU build is at hand.
set -euo pipefail
cd "$(dirname "$0")/.."
EXTRA=${EXTRA:-dev}
tested=() missing=()
for version in ${VERSIONS:-3.11 3.12 3.13 3.14}; do
	venv=.venvs/$version
	if command -v uv >/dev/null 2>&1; then
		uv venv --quiet --allow-existing --python "$version" "$venv" || { missing+=("$version"); continue; }
		uv pip install --quiet --upgrade --python "$venv/bin/python" -e ".[$EXTRA]"
	elif "python$version" -c "" 2>/dev/null; then  # a shim of pyenv may be there without its Python
		test -x "$venv/bin/python" || "python$version" -m venv "$venv"
		"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile --upgrade -e ".[$EXTRA]"
	else
		missing+=("$version")
		continue
	fi
	echo "Python $version, JAX $("$venv/bin/python" -c 'import jax; print(jax.__version__)')"
	# As `make test`: compiling is quick, and tests of rounding, if any are among them, are compiled as users do.
	flags=${XLA_FLAGS-$("$venv/bin/python" tests/xla_flags.py)}
	test=("$venv/bin/python" -m pytest -q -n 2 --dist worksteal)
	XLA_FLAGS=$flags "${test[@]}" -m "not rounding" "${@:-tests}"
	XLA_FLAGS='' "${test[@]}" -m rounding "${@:-tests}" || test $? -eq 5
	tested+=("$version")
done
echo "passed: ${tested[*]:-none}; not there: ${missing[*]:-none}"
test ${#tested[@]} -gt 0
