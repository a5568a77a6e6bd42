"""Records as they are compared: runs, whether they are plausible, and their noise."""
