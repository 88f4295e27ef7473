"""The command ``hmap``: a module per sub-command; packages add theirs through the entry points ``hmap.commands``.

Results go to standard output, progress and logs to standard error. Exit codes: 0 yes, 1 no, 2 bad input.
"""

from hmap_core.cli.main import main

__all__ = ["main"]
