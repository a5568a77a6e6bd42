"""The nominal model, hypotheses about it, and their simulation along a record."""
