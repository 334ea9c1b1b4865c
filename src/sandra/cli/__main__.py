"""`python -m sandra.cli`."""

import sys

from sandra.cli import main

if __name__ == "__main__":
    sys.exit(main())
