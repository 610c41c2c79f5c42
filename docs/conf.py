"""Settings of Sphinx for the documentation: `make docs`, or rosdoc2."""

import re
import sys
from pathlib import Path
from typing import Any

import jupytext

# rosdoc2 executes this file from one of its own, which names it.
_wrapped = re.search(r'^exec\(open\("(.+?)"\)', Path(__file__).read_text(), re.MULTILINE)
ROOT = Path(_wrapped[1] if _wrapped else __file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'docs')]

from in_browser.build import build  # noqa: E402

from impact_damper_ros import __version__  # noqa: E402

project = 'impact_damper_ros'
author = 'the impact_damper_ros developers'
copyright = f'2026, {author}'  # noqa: A001 - the name that Sphinx reads
release = version = __version__

extensions = ['myst_parser', 'sphinx-mathjax-offline', 'sphinx_copybutton', 'sphinx_design']
exclude_patterns = ['_build']
root_doc = 'index'
nitpicky = True
# That nothing of the site is missing is checked by `-b linkcheck`, which needs a network.
linkcheck_exclude_documents = ['results/gallery/index', 'reference/python/.*']

myst_enable_extensions = ['dollarmath', 'amsmath', 'colon_fence', 'deflist']
myst_heading_anchors = 4

# Equations have the number of their page in the theory: (3.2).
numfig = True
numfig_secnum_depth = 1
math_numfig = True

html_theme = 'furo'
html_title = f'Impact damper {release}'
html_show_sourcelink = False
html_copy_source = False
html_static_path = ['static']
html_css_files = ['tables.css']
# Blocks of code have up to 98 columns.
_code = {'code-font-size': '0.75rem'}
html_theme_options = {'light_css_variables': _code, 'dark_css_variables': _code}
# Prompts are no part of what is copied.
copybutton_prompt_text = r'>>> |\.\.\. |\$ '
copybutton_prompt_is_regexp = True


def _insert_links(_app: Any, name: str, source: list[str]) -> None:
    """Put beside each link to a live rig the one to a rig in the reader's browser."""
    up = '../' * name.count('/')
    beside = rf'\g<0> (<a href="{up}try/index.html#\1">in your browser</a>)'
    source[0] = re.sub(r'\]\(http://127\.0\.0\.1:8088/#([^)\s]+)\)', beside, source[0])


#: That the cells of a tutorial are of Python, however many lines of the shell it has.
_PYTHON = """---
jupyter:
  kernelspec:
    display_name: Python 3
    language: python
    name: python3
---

"""


def _offer_notebook(app: Any, name: str, source: list[str]) -> None:
    """Write a page that is worked through as a notebook, and link it below the title."""
    if 'test_tutorials.py works through' not in source[0] or '```python' not in source[0]:
        return
    notebook = jupytext.reads(_PYTHON + source[0], fmt='md')
    for cell in notebook.cells:
        if file := re.match(r'# (\S+\.py)\n', cell.source):
            cell.source = f'%%writefile {file[1]}\n{cell.source}'
    path = Path(app.outdir) / f'{name}.ipynb'
    path.parent.mkdir(parents=True, exist_ok=True)
    jupytext.write(notebook, path)
    link = f'<a href="{path.name}" download>Download this page as a notebook</a>'
    source[0] = re.sub(r'^(# .*)$', rf'\1\n\n{link}', source[0], count=1, flags=re.M)


def _build_page(app: Any, exception: Exception | None) -> None:
    """Build the page with a rig of its own."""
    if exception is None and app.builder.name == 'html':
        build(Path(app.outdir) / 'try')


def setup(app: Any) -> None:
    """Connect what is done to sources and the built site."""
    app.connect('source-read', _offer_notebook)
    app.connect('source-read', _insert_links)
    app.connect('build-finished', _build_page)
