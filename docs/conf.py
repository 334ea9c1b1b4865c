"""The documentation site: `make docs` builds it from the Markdown pages beside this file.

Sphinx reads the project's root, so that links between `docs/`, CONTRIBUTING.md and the sources are
those that a forge follows, too. Nothing is fetched when a page is viewed: fonts are the reader's
own, and formulas are MathML.
"""

from __future__ import annotations

import os
import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "docs" / "site")]
os.environ["PYTHONPATH"] = str(ROOT / "src")  # of the notebooks

project = "SanDRA"
author = "The SanDRA developers"
copyright = author
version = release = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "commands",
    "mathml",
    "navigation",
]
root_doc = "docs/index"
include_patterns = ["docs/**.md", "docs/**.ipynb", "CONTRIBUTING.md", "CHANGELOG.md"]
exclude_patterns = [".*", "site", "build", "demo", "src", "tests", "scripts", "examples", "runs"]

html_theme = "furo"
html_title = f"SanDRA {version}"
html_extra_path = ["site/index.html"]
html_copy_source = False
html_show_sphinx = False
highlight_language = "none"

# Headings have the anchors that a forge gives them.
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath", "html_image"]
# A notebook is stored without outputs and run here; tests run it, too.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_timeout = 120
nb_execution_raise_on_error = True
nb_execution_show_tb = True

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_default_options = {"members": True, "show-inheritance": False}


def _plain(app, what, name, obj, options, lines) -> None:  # type: ignore[no-untyped-def]
    """Docstrings here are plain text with code in backticks, not reStructuredText."""
    for i, line in enumerate(lines):
        parts = re.split(r"(?<!`)`([^`]+)`(?!`)", line)
        parts[0::2] = [part.replace("|", "\\|").replace("*", "\\*") for part in parts[0::2]]
        parts[1::2] = [f"``{part}``" for part in parts[1::2]]
        lines[i] = "".join(parts)


def setup(app) -> None:  # type: ignore[no-untyped-def]
    """Listen to docstrings being read."""
    app.connect("autodoc-process-docstring", _plain, priority=900)
