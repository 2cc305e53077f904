"""What people look at and hand over: texts, figures, the page, and what it says."""

from volid.report import plot as plot
