#!/usr/bin/env bash
# Installs the browser that tests of the page drive, where root and apt allow it; else those tests are left out.
set -euo pipefail

if command -v chromium >/dev/null; then
  exit 0
fi
if [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then
  apt-get update -qq
  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium
else
  echo "chromium is missing, so tests of the page are skipped; for them: sudo apt-get install chromium" >&2
fi
