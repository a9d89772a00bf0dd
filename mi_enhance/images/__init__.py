"""From photographs to parameters."""
