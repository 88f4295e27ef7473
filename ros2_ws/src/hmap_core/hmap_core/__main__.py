"""``python -m hmap_core`` is the command ``hmap``."""

import sys

from hmap_core.cli import main

if __name__ == "__main__":
    sys.exit(main())
