"""The site, for Sphinx: `.venv/bin/python -m sphinx -W --keep-going -b html docs docs/_build/html`.

What is written at build (figures, commands, copies of texts of the repository) comes from `machinery`.
"""

import re
import sys
from importlib.metadata import version as installed_version
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from docutils import nodes  # noqa: E402
from machinery.commands import write_commands  # noqa: E402
from machinery.copies import write_copies  # noqa: E402
from machinery.docstrings import process  # noqa: E402
from machinery.figures import write_figures  # noqa: E402
from machinery.formats import write_formats  # noqa: E402
from machinery.formulas import setup_formulas  # noqa: E402
from machinery.interface import write_interface  # noqa: E402
from sphinx.errors import ExtensionError  # noqa: E402

project = "volid"
author = "the volid contributors"
copyright = "the volid contributors, Apache-2.0"
release = version = installed_version("volid")

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build", "_generated/files", "machinery", "figures", "images"]
html_theme = "furo"
html_title = f"volid {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_math_renderer = "mathml"

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence", "fieldlist"]
myst_heading_anchors = 4
nb_execution_mode = "off"  # notebooks are shown with their stored outputs; that they run is a test
nb_merge_streams = True

default_role = "code"  # docstrings set names in single backquotes
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # shapes and units stand in the docstrings; the signature has the annotations
autodoc_typehints_format = "short"
napoleon_numpy_docstring = False
napoleon_use_ivar = True


def write_all(app, config) -> None:
    """Everything under docs/_generated, before Sphinx looks for sources."""
    root, target = HERE.parent, HERE / "_generated"
    write_copies(root, target)
    write_commands(target / "commands")
    write_interface(root, target / "python")
    write_formats(target / "files")
    write_figures(HERE / "figures", target / "figures")


def list_links(app, exception) -> None:
    """Addresses of other places, for whoever wants to look at them; the build follows none, since it needs no network."""
    found = {
        node["refuri"]
        for name in app.env.found_docs
        for node in app.env.get_doctree(name).findall(nodes.reference)
        if node.get("refuri", "").startswith("http")
    }
    (Path(app.outdir) / "external_links.txt").write_text(
        "".join(f"{link}\n" for link in sorted(found)), encoding="utf-8"
    )


def check_offline(app, exception) -> None:
    """Raises where a page would load anything from the network: the site is read in workshops."""
    if exception is not None:
        return
    for page in Path(app.outdir).rglob("*.html"):
        for element in re.findall(r"<(?:script|link|img|iframe)\b[^>]*>", page.read_text(encoding="utf-8")):
            if re.search(r"(?:src|href)=\"(?:https?:)?//", element):
                raise ExtensionError(f"{page.relative_to(app.outdir)} needs the network: {element}")


def setup(app) -> None:
    """Called by Sphinx."""
    setup_formulas(app)
    app.connect("config-inited", write_all)
    app.connect("build-finished", list_links)
    app.connect("build-finished", check_offline)
    app.connect("autodoc-process-docstring", process)
