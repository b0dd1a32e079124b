"""``python -m pianorig``: the command line without its console script."""

from pianorig.cli import main

main()
