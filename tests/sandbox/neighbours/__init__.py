"""A package of two estimators, of which one does all that it can to the other."""
