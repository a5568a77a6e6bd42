"""State that both estimators use."""

SCALE = [1.0]
