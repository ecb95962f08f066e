#!/bin/sh
# Known vulnerabilities in everything that the lock files name: pip-audit for Python, npm audit for web/.
# It needs the network, and no test runs it: an advisory of tomorrow must not break the build of today.
# Exit status 1: something was found, or something could not be looked up.
set -eu
cd "$(dirname "$0")/.."

scanner=$(mktemp -d)
trap 'rm -rf "$scanner"' EXIT
python3 -m venv "$scanner"
"$scanner/bin/pip" install --quiet 'pip-audit==2.10.1'

status=0
for lock in requirements*.lock; do
    echo "== $lock"
    "$scanner/bin/pip-audit" --strict --progress-spinner off --disable-pip --no-deps --requirement "$lock" || status=1
done
echo "== web/package-lock.json"
(cd web && npm audit) || status=1
exit $status
