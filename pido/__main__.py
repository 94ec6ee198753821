"""`python -m pido`: the command line where its script is not on the path."""

from pido.cli import main

if __name__ == "__main__":
    main()
