"""Notebooks run from their percent scripts, and the stored ones are those scripts with outputs."""

import jupytext
import nbclient
import pytest
from support.places import ROOT

SCRIPTS = sorted((ROOT / "notebooks").glob("*.py"))


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_notebook_runs(script):
    notebook = jupytext.read(script)
    nbclient.NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": script.parent}}
    ).execute()
    printed = "".join(o.get("text", "") for c in notebook.cells if c.cell_type == "code" for o in c.outputs)
    assert "accepted by the data" in printed


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_stored_notebook_is_the_script_with_outputs(script):
    stored = jupytext.read(script.with_suffix(".ipynb"))
    source = jupytext.read(script)
    assert [c.source for c in stored.cells] == [c.source for c in source.cells]
    code = [c for c in stored.cells if c.cell_type == "code"]
    assert any("image/png" in o.get("data", {}) for c in code for o in c.outputs)
    assert not any(o.output_type == "error" for c in code for o in c.outputs)
