#!/bin/sh
# Starts the robot (simulated), its agent and the dashboard, and prints the address to open.
# On the first call it installs what they need into this folder. Its arguments go to `robot-acp up`; with
# `--robot ros2` among them it installs the packages of ROS 2, too.
set -eu
cd "$(dirname "$0")"
. scripts/prepare.sh
lock=requirements.lock
case " $* " in *ros2*) lock=requirements-ros2.lock ;; esac
prepare_python "$lock"
prepare_web
exec .venv/bin/robot-acp up "$@"
