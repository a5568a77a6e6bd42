"""``python -m fdbench``: the command line, where no script is on the path."""

from fdbench.cli import main

main()
