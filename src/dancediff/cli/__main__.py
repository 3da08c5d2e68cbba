"""`python -m dancediff.cli`."""

import sys

from dancediff.cli import main

if __name__ == "__main__":
    sys.exit(main())
