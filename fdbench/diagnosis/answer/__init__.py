"""What a diagnosis says: the one place of its shape, in Python, as JSON, on the terminal and on the page."""
