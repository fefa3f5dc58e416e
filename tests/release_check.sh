#!/usr/bin/env bash
# Builds source and wheel, checks them, installs the wheel into a fresh environment, and runs demo and tests from there.
# PYTHON: for the fresh environment; RELEASE: a Python with the extra `release`. TESTS=... limits the tests.
set -euo pipefail
cd "$(dirname "$0")/.."
PYTHON=${PYTHON:-python3}
rm -rf dist
"$RELEASE" -m build --outdir dist .
"$RELEASE" -m twine check --strict dist/*
wheel=$(ls "$PWD"/dist/*.whl) source=$(ls "$PWD"/dist/*.tar.gz)
if git rev-parse --git-dir >/dev/null 2>&1; then
	missing=$(comm -23 <(git ls-files | grep -v "^\.ci/" | sort) <(tar -tzf "$source" | sed "s,^[^/]*/,," | sort))
	test -z "$missing" || { echo "not in the source distribution: $missing"; exit 1; }
fi
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$PYTHON" -m venv "$folder/venv"
pip=("$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check)
"${pip[@]}" "$wheel"
(cd "$folder" && venv/bin/deggflow --version && venv/bin/deggflow demo)
"${pip[@]}" "${wheel}[dev]"
# The tests of the source distribution import the installed wheel: nothing puts src on the path.
tar -xzf "$source" -C "$folder"
cd "$folder"/deggflow-*/
# As `make test`: compiling is quick, and tests of rounding are compiled as users do.
flags=${XLA_FLAGS-$("$folder/venv/bin/python" tests/xla_flags.py)}
test=("$folder/venv/bin/python" -m pytest -q -n 2 --dist worksteal)
XLA_FLAGS=$flags "${test[@]}" -m "not rounding" ${TESTS:-tests}
test -n "${TESTS:-}" || XLA_FLAGS= "${test[@]}" -m rounding tests
echo "The release in dist is good."
