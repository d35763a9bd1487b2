"""`python -m barnax`, the same as the command `barnax`."""

from .cli import main

if __name__ == "__main__":
    main()
