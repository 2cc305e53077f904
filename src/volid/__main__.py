"""`python -m volid`: the command line."""

import sys

from volid.cli import console

if __name__ == "__main__":
    sys.exit(console())
