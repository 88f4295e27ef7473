"""The nodes, one module each: ``main`` runs it as a process."""
