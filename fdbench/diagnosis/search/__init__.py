"""The search for effects that explain the difference."""
