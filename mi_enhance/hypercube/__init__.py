"""The search for what to replace (sections 4.1 and 4.2 of the paper)."""
