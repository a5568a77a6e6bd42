"""The commands, one file each; each imports what it needs when it runs, so that ``fdbench list`` is quick."""
