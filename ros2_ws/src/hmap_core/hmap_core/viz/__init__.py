"""Plans made visible: a picture, a summary."""
