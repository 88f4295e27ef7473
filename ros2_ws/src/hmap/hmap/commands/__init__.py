"""What the package adds to the command ``hmap``: one module per sub-command."""
