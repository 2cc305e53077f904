"""The standards of `volid evaluate`, one module each: HELP, EPILOG, add_arguments(parser), options(args), draw(evaluations).

`options(args)` gives what `volid.evaluate` takes beside the files; `draw` gives the figure of matplotlib that people know from
the standard; `write(evaluations, args)`, where there is one, writes more files.
"""
