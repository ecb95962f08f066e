#!/bin/sh
# Starts the robot (simulated), its agent and the dashboard, and prints the address to open.
# On the first call it installs what they need into this folder. Its arguments go to `robot-acp up`.
set -eu
cd "$(dirname "$0")"
. scripts/prepare.sh
prepare_python requirements.lock
prepare_web
exec .venv/bin/robot-acp up "$@"
