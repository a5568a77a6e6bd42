"""The published figures beside ours: one paper, one file."""
