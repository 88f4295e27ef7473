"""KOMO: paths of joints under objectives and constraints by phase; see ``docs/komo.md``."""
