"""The standards of `volid evaluate`, one module each: HELP, EPILOG, add_arguments(parser), evaluate(args), draw(evaluations).

`evaluate(args)` gives evaluations without limits; `draw` gives the figure of matplotlib that people know from the standard.
"""
