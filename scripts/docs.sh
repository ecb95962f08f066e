#!/bin/sh
# Writes the reference pages of docs/ anew and builds the site into site/. A link that leads nowhere is an error.
# Once the packages of requirements-docs.lock are installed, it needs no network.
set -eu
cd "$(dirname "$0")/.."
. scripts/prepare.sh
prepare_python requirements-docs.lock
.venv/bin/python -m scripts.reference
.venv/bin/python -m mkdocs build --strict --quiet
printf 'The site is in site/; open site/index.html.\n'
