#!/bin/sh
# Writes the reference pages of docs/ anew and builds the site into site/. A link that leads nowhere is an error.
# Once the packages of requirements-docs.lock are installed, it needs no network.
set -eu
cd "$(dirname "$0")/.."
. scripts/prepare.sh
prepare_python requirements-docs.lock
.venv/bin/python -m scripts.reference
# The theme is maintained until May 2027. Zensical, its successor, reads the same mkdocs.yml.
export NO_MKDOCS_2_WARNING=1
.venv/bin/python -m mkdocs build --strict # not --quiet: that would hide the warnings from --strict, too
printf 'The site is in site/. To read it: .venv/bin/python -m http.server -d site 8001\n'
