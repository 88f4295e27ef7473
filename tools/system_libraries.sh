#!/usr/bin/env bash
# Installs the system packages that no wheel brings, where root and apt allow it; else prints the line to run.
set -euo pipefail

python=${1:-python3.11}
missing=()

version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null || echo none)
if [ "$version" != 3.11 ]; then
  echo "Python 3.11 is needed: the ROS wheels of PyPI are built for it; $python is $version." >&2
  echo "Name one with: make PYTHON=/path/to/python3.11" >&2
  exit 1
fi
libraries=$(PATH=$PATH:/sbin:/usr/sbin ldconfig -p)

needs_library() { # file, Debian package
  [[ $libraries == *"$1"* ]] || missing+=("$2")
}

needs_library libusb-1.0.so.0 libusb-1.0-0 # open3d
needs_library libGL.so.1 libgl1            # open3d
needs_library libgomp.so.1 libgomp1        # open3d, coal
command -v c++ >/dev/null || missing+=(g++) # the generated type supports
"$python" -c 'import ensurepip' 2>/dev/null || missing+=(python3.11-venv)
headers=$("$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')
[ -f "$headers/Python.h" ] || missing+=(python3.11-dev)

if [ ${#missing[@]} -eq 0 ]; then
  exit 0
fi
if [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then
  apt-get update -qq
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
else
  echo "System packages are missing. Run this line, then make again:" >&2
  echo "  sudo apt-get install -y --no-install-recommends ${missing[*]}" >&2
  exit 1
fi
