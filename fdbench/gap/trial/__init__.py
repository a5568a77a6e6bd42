"""Blind trials of the diagnosis: make records whose causes are sealed, answer without the key, score with it."""
