"""Looks at a running graph, and says what is missing, stale, or of the wrong type, quality of service or frame."""
