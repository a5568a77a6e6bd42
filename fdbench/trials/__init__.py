"""Blind trials of diagnosers: made with sealed causes, answered, scored."""
