"""What is said of what was found: probabilities, shares, intervals, places."""
