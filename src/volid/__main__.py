"""`python -m volid`: the command line."""

import sys

from volid.cli import main

if __name__ == "__main__":
    sys.exit(main())
