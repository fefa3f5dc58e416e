#!/usr/bin/env bash
# Runs the tests under each Python in VERSIONS, with the newest JAX that it can have, each in an environment of its own.
# Where uv is, it gets a Python that is missing; else a missing one is skipped. Arguments go to pytest.
set -euo pipefail
cd "$(dirname "$0")/.."
tested=() missing=()
for version in ${VERSIONS:-3.11 3.12 3.13 3.14}; do
	venv=.venvs/$version
	if command -v uv >/dev/null 2>&1; then
		uv venv --quiet --allow-existing --python "$version" "$venv" || { missing+=("$version"); continue; }
		uv pip install --quiet --upgrade --python "$venv/bin/python" -e '.[dev]'
	elif command -v "python$version" >/dev/null 2>&1; then
		test -x "$venv/bin/python" || "python$version" -m venv "$venv"
		"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --upgrade -e '.[dev]'
	else
		missing+=("$version")
		continue
	fi
	echo "Python $version, JAX $("$venv/bin/python" -c 'import jax; print(jax.__version__)')"
	"$venv/bin/python" -m pytest -q -n 2 "${@:-tests}"
	tested+=("$version")
done
echo "passed: ${tested[*]:-none}; not there: ${missing[*]:-none}"
test ${#tested[@]} -gt 0
