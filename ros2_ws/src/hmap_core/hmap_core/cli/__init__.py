"""The command ``hmap``: one module per sub-command. Packages add sub-commands through the entry points
``hmap.commands``.

Results are written to standard output, progress and logs to standard error. Exit codes: 0 yes, 1 no, 2 bad input.
"""

from hmap_core.cli.main import main

__all__ = ["main"]
