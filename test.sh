#!/bin/sh
# Checks and tests all of backend/ and web/. On two cores with nothing else running:
#   ./test.sh --quick   after every change: format, lint, types, and quick tests that start no process (3 minutes)
#   ./test.sh           before a change lands, and what CI runs: all tests (15 minutes)
#   ./test.sh --deep    every generated case with fresh seeds, coverage, and a soak (36 minutes)
# Further arguments go to pytest. The first call installs what is missing.
set -eu
cd "$(dirname "$0")"
. scripts/prepare.sh

unset PYTHONDONTWRITEBYTECODE # without bytecode every start of a Python costs some tenths of a second more

depth=usual
case "${1:-}" in
  --quick | --deep) depth=${1#--}; shift ;;
esac

prepare_python requirements-dev.lock
prepare_web
prepare_node_modules
find_node
prepare_programs # a browser and a voice

# Both halves of the checks at once, each on a core; neither says anything before both have ended.
said=$(mktemp -d)
trap 'rm -rf "$said"' EXIT
check_backend() { .venv/bin/ruff format --check . && .venv/bin/ruff check . && .venv/bin/mypy; }
check_web() { (cd web && npm run --silent format:check && npm run --silent lint && npm run --silent typecheck && npm run --silent test); }
printf '\nFormat, lint, types, and the tests of web/\n'
failed=0
check_web >"$said/web" 2>&1 & web=$!
check_backend >"$said/backend" 2>&1 || failed=1
wait "$web" || failed=1
cat "$said/backend" "$said/web"
[ "$failed" = 0 ] || fail "The lines above say what has to be mended first."

printf '\nTests of backend/\n'
workers="-n 3 --dist loadfile --no-loadscope-reorder" # by the order of tests/conftest.py
alone="not processes and not slow"
case $depth in
  # shellcheck disable=SC2086
  quick) exec .venv/bin/python -m pytest $workers -m "$alone" "$@" ;;
  # shellcheck disable=SC2086
  usual) exec .venv/bin/python -m pytest $workers "$@" ;;
esac

# A part that fails ends none of those after it.
export ROBOT_ACP_TEST_DEEP=1
# shellcheck disable=SC2086
.venv/bin/python -m pytest $workers --cov --cov-report=term:skip-covered "$@" || failed=1
(cd web && npm run --silent coverage) || failed=1

if python3.13 --version >/dev/null 2>&1; then
  printf '\nThe quick tests with %s\n' "$(python3.13 --version)"
  prepare_python requirements-dev.lock .venv/newest python3.13
  # shellcheck disable=SC2086
  ROBOT_ACP_TEST_DEEP= .venv/newest/bin/python -m pytest $workers -m "$alone" || failed=1
else
  printf '\nThere is no python3.13: nothing was tested with the newest Python.\n'
fi

printf '\nSoak\n'
.venv/bin/python bench/endurance.py --minutes 10 || failed=1
exit "$failed"
