"""Diagnosis of the sim-to-real gap: records, model, evidence, search, judge, experiment; each uses those before it."""
