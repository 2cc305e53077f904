"""Formulas as MathML, which browsers draw themselves: no script, and nothing from the network.

docutils, on which Sphinx is built, turns LaTeX into MathML; a formula that it does not know is a warning, and so an error.
Indices stand at their height in fonts made for mathematics, which Windows, macOS and most others have (`static/site.css`).
"""

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging


def setup_formulas(app) -> None:
    """Called by conf.py, which names this renderer in `html_math_renderer`."""
    app.add_html_math_renderer("mathml", (inline, None), (displayed, None))


def inline(writer, node) -> None:
    """A formula in a line of text."""
    add(writer, node, "span")


def displayed(writer, node) -> None:
    """A formula that stands alone."""
    add(writer, node, "div")


def add(writer, node, element: str) -> None:
    """The formula as MathML in an element of its own."""
    try:
        formula = tex2mathml(node.astext(), as_block=element == "div")
    except MathError as error:
        logging.getLogger(__name__).warning("formula %r: %s", node.astext(), error, location=node)
        formula = f"<code>{writer.encode(node.astext())}</code>"
    writer.body.append(writer.starttag(node, element, "", CLASS="math") + formula + f"</{element}>")
    raise nodes.SkipNode
