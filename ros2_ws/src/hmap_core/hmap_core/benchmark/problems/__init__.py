"""The problems, one file each: seeded instances, made without the solvers that are compared."""
