"""Speed and memory of volid against peers and against what the machine can do, in one run: `python -m benchmarks`.

See README.md in this folder for what a figure comprises. Nothing here is imported by the package.
"""
