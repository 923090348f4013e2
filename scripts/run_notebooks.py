"""Run notebooks from their first cell to their last, and keep what the cells print and draw as their outputs.

python scripts/run_notebooks.py examples/quick_start.ipynb

Each runs without Jupyter in an empty folder, which its outputs do not name;
cells that install packages are skipped.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import subprocess
import sys
import tempfile
import types
from pathlib import Path
from typing import Any

import matplotlib
from command import run

matplotlib.use("agg")
import matplotlib.pyplot as plt


class Image:
    """Stand-in for ``IPython.display.Image``: a file that a cell shows."""

    def __init__(self, filename: str, format: str = "png") -> None:
        self.data = Path(filename).read_bytes()


def stub_ipython() -> None:
    """Let ``from IPython.display import Image`` find the class above, also where IPython is not installed."""
    package, display = types.ModuleType("IPython"), types.ModuleType("IPython.display")
    vars(package).update(get_ipython=lambda: None, version_info=(9, 0))  # which matplotlib asks
    vars(display).update(Image=Image)
    sys.modules |= {"IPython": package, "IPython.display": display}


def run_cell(source: str, names: dict[str, Any], number: int) -> list[dict[str, Any]]:
    """Run a cell's code, and return its outputs: what it prints, its figures, and its last value."""
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        if source.startswith("!"):
            for line in source.splitlines():
                done = subprocess.run(line.removeprefix("!"), shell=True, capture_output=True, text=True)
                print(done.stdout, end="")
                done.check_returncode()
        else:
            tree = ast.parse(source)
            last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
            exec(compile(tree, "cell", "exec"), names)
            if isinstance(last, ast.Expr):
                value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    outputs: list[dict[str, Any]] = []
    if text := printed.getvalue().replace(f"{Path.cwd()}{os.sep}", ""):
        outputs.append({"name": "stdout", "output_type": "stream", "text": text.splitlines(keepends=True)})
    for figure in map(plt.figure, plt.get_fignums()):
        image = io.BytesIO()
        figure.savefig(image, format="png", bbox_inches="tight")
        outputs.append({"output_type": "display_data", "metadata": {}, "data": _shown(image.getvalue())})
    plt.close("all")
    if value is not None:
        data = _shown(value.data) if isinstance(value, Image) else {"text/plain": [repr(value)]}
        result = {"output_type": "execute_result", "execution_count": number, "metadata": {}, "data": data}
        outputs.append(result)
    return outputs


def _shown(image: bytes) -> dict[str, str]:
    return {"image/png": base64.b64encode(image).decode()}


def run_notebook(path: Path) -> None:
    """Run a notebook in an empty folder, and write it with its outputs."""
    content = json.loads(path.read_text())
    cells = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
    names: dict[str, Any] = {"__name__": "__main__"}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for number, cell in enumerate(cells, 1):
            source = "".join(cell["source"])
            is_install = source.startswith("%pip")
            cell["execution_count"] = number
            cell["outputs"] = [] if is_install else run_cell(source, names, number)
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n")


def main(notebooks: list[Path]) -> None:
    """Run the notebooks."""
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    stub_ipython()
    plt.show = lambda: None
    for path in notebooks:
        run_notebook(path.resolve())
        print(f"written: {path}, {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    run(main)
