"""The sub-commands that this package adds to ``hmap``, one module each."""
