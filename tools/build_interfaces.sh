#!/usr/bin/env bash
# Builds the interface packages with colcon and installs them into the virtual environment, where the ROS wheels lie too.
# Nothing has to be sourced afterwards. Usage: build_interfaces.sh VENV
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=$(cd "$1" && pwd)
workspace=$root/ros2_ws

# Only the virtual environment: a ROS that happens to be sourced would be mixed in.
unset PYTHONPATH COLCON_PREFIX_PATH
export VIRTUAL_ENV=$venv PATH=$venv/bin:$PATH
export CMAKE_PREFIX_PATH=$venv AMENT_PREFIX_PATH=$venv LD_LIBRARY_PATH=$venv/lib
touch "$venv/local_setup.sh" # colcon asks for one in every prefix; the wheels bring none

cd "$root" # for colcon.meta
"$venv/bin/colcon" --log-base "$workspace/log" build \
  --metas colcon.meta \
  --base-paths "$workspace/src/hmap_msgs" "$workspace"/src/compat/*_msgs \
  --packages-select control_msgs hmap_msgs tf2_msgs \
  --build-base "$workspace/build" --install-base "$venv" --merge-install \
  --cmake-args -G Ninja -DBUILD_TESTING=OFF
