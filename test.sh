#!/bin/sh
# Installs what the tests need, then checks format, lint and types, and runs all tests of backend/ and web/.
# Its arguments go to pytest.
set -eu
cd "$(dirname "$0")"
. scripts/prepare.sh
prepare_python requirements-dev.lock
prepare_web
prepare_node_modules
find_node

find_chromium() {
  for name in chromium chromium-browser google-chrome-stable google-chrome; do
    if command -v "$name" >/dev/null 2>&1; then
      command -v "$name"
      return
    fi
  done
}
CHROMIUM=$(find_chromium)
if [ -z "$CHROMIUM" ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
  printf 'Installing Chromium …\n'
  { apt-get update -q && apt-get install -q -y --no-install-recommends chromium fonts-dejavu-core; } >/dev/null 2>&1 || true
  CHROMIUM=$(find_chromium)
fi
if [ -z "$CHROMIUM" ]; then
  .venv/bin/python -m playwright install chromium # does nothing when it is there
fi
export ROBOT_ACP_TEST_CHROMIUM="$CHROMIUM"

printf '\nFormat, lint and types\n'
.venv/bin/ruff format --check .
.venv/bin/ruff check .
.venv/bin/mypy
(cd web && npm run --silent format:check && npm run --silent lint && npm run --silent typecheck)

printf '\nTests of web/\n'
(cd web && npm run --silent test)

printf '\nTests of backend/\n'
.venv/bin/python -m pytest "$@"
