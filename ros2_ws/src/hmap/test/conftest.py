"""Scenarios of executions that the tests of hmap_core have, too."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "hmap_core" / "test"))
