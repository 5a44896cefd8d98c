"""`python -m meshmark`."""

from meshmark.cli import main

if __name__ == "__main__":
    main()
