"""Sphinx settings: `python -m sphinx -W -b html docs build/docs`."""

import os
import sys
from pathlib import Path

# Compiled functions are then plain functions, with signatures and docstrings to show.
os.environ["NUMBA_DISABLE_JIT"] = "1"

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / "_ext")]

import footik_runtime  # noqa: E402

project = "footik_runtime"
author = "the footik_runtime authors"
copyright = author
version = release = footik_runtime.__version__

extensions = ["sphinx.ext.autodoc", "sphinx.ext.napoleon", "myst_parser", "footik_tables"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
default_role = "code"

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

html_theme = "sphinx_book_theme"
html_title = f"footik_runtime {release}"
html_theme_options = {"show_toc_level": 2, "use_download_button": False}
exclude_patterns = ["_build"]
