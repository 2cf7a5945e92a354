"""`python -m simtune`: the command, where its script is not on the path."""

from simtune.cli import main

if __name__ == "__main__":
    main()
