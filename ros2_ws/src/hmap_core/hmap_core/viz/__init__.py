"""Pictures and summaries of plans."""
