"""Estimators for fdbench: each file here is one, under the name of the file; those that begin with _ are helpers."""
