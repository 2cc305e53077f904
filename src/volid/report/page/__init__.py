"""The report as one page of HTML that needs no other file: a template, a style, a script, and one module for each section."""
