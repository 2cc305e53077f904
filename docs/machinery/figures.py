"""Drawn figures of the pages: every `figures/NAME.py` has a function `draw() -> Figure`, which becomes `NAME.svg`."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType


def write_figures(scripts: Path, target: Path) -> None:
    """Draw what is missing, or older than its script; a fresh checkout draws all. Takes some seconds."""
    target.mkdir(parents=True, exist_ok=True)
    for script in sorted(scripts.glob("[!_]*.py")):
        image = target / f"{script.stem}.svg"
        if not image.exists() or image.stat().st_mtime < script.stat().st_mtime:
            module = loaded(script)
            if hasattr(module, "draw"):
                module.draw().savefig(image, metadata={"Date": None})


def loaded(script: Path) -> ModuleType:
    """The module in a file, under the name of the file; what several figures share stands beside them as `_NAME.py`."""
    import sys

    if str(script.parent) not in sys.path:
        sys.path.insert(0, str(script.parent))
    spec = spec_from_file_location(f"figures_{script.stem}", script)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
