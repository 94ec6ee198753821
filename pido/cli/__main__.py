"""`python -m pido.cli`."""

from pido.cli import main

main()
