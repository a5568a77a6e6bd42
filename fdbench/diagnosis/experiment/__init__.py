"""The next experiment: the motion that tells apart what is in doubt."""
