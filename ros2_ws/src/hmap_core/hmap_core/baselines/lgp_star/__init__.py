"""LGP with its decisions made: the skeleton and the intermediate poses are given, as in the paper's LGP*."""
