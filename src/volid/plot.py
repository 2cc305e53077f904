"""`from volid.plot import error_functions`: the figures of `volid.report.plot`, under the name by which they are public."""

import sys

from volid.report import plot

sys.modules[__name__] = plot
