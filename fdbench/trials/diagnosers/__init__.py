"""The diagnosers that answer blind trials: the package's own, and simple ones as reference rows."""
